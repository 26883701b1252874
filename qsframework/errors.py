"""One tree of exceptions: everything a user can mend derives from `QsfError`."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass


class QsfError(Exception):
    """Base of every error that qsframework raises on purpose; the command line exits with 2."""


@dataclass(frozen=True)
class Problem:
    """One thing wrong in the input: where it stands, what was found, what is allowed, what to do."""

    message: str
    file: str | None = None
    line: int | None = None
    column: str | None = None
    found: str | None = None
    allowed: str | None = None
    hint: str | None = None

    def __str__(self) -> str:
        place = ", ".join(
            part
            for part in (
                self.file,
                None if self.line is None else f"line {self.line}",
                None if self.column is None else f"column {self.column}",
            )
            if part
        )
        text = f"{place}: {self.message}" if place else self.message
        if self.found is not None:
            text += f"; found {self.found}"
        if self.allowed is not None:
            text += f"; allowed: {self.allowed}"
        if self.hint is not None:
            text += f". {self.hint}"
        return text


class InputError(QsfError):
    """All the problems of the input, collected, so that the user mends them in one go."""

    def __init__(self, problems: Iterable[Problem] | Problem | str):
        if isinstance(problems, str):
            problems = Problem(problems)
        if isinstance(problems, Problem):
            problems = (problems,)
        self.problems: tuple[Problem, ...] = tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))


class NotIdentifiable(QsfError):
    """The readings or the plan cannot tell the parameters apart; the message names them."""


class NotCertified(QsfError):
    """A design whose certified efficiency misses what was asked."""


class NotConverged(QsfError):
    """An iteration that did not reach its tolerance; its last value is not a result."""


class PluginError(QsfError):
    """An effect that breaks the plugin protocol."""


def nearest(name: str, allowed: Iterable[str]) -> str | None:
    """A sentence with the nearest allowed name, or None if nothing is near."""
    close = difflib.get_close_matches(name, list(allowed), n=1, cutoff=0.5)
    return f"Did you mean {close[0]!r}?" if close else None
