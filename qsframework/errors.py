"""One tree of exceptions: everything a user can mend derives from `QsfError`. And the warning of what will go."""

from __future__ import annotations

import difflib
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import ParamSpec, TypedDict, TypeVar

__all__ = [
    "InputError",
    "NotCertified",
    "NotConverged",
    "NotIdentifiable",
    "PluginError",
    "Problem",
    "QsfError",
]
MOST_PROBLEMS = 1000
"""Problems of one kind that are told of one table; a wrong column would give one for each row."""
_NEAR = 0.6
"""Ratio of letters that two spellings of one name share at least."""
_P = ParamSpec("_P")
_R = TypeVar("_R")


class QsfError(Exception):
    """Base of every error that qsframework raises on purpose; the command line exits with 2."""


@dataclass(frozen=True)
class Problem:
    """One thing wrong in the input: where it stands, what was found, what is allowed, what to do.

    argument: the name of an argument that would mend it, and its value or the form of it ("" for a switch), for a
    command line to name its option
    """

    message: str
    file: str | None = None
    line: int | None = None
    column: str | None = None
    _: KW_ONLY
    found: str | None = None
    allowed: str | None = None
    hint: str | None = None
    argument: tuple[str, str] | None = None

    def __str__(self) -> str:
        place = ", ".join(
            part
            for part in (
                self.file if self.file is None or self.file.strip() else repr(self.file),
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


class ProblemPlace(TypedDict):
    """Where problems stand, as keywords of `Problem`."""

    file: str
    line: int | None


class InputError(QsfError):
    """All the problems of the input, collected, so that the user mends them in one go."""

    def __init__(self, problems: Iterable[Problem] | Problem | str):
        if isinstance(problems, str):
            problems = Problem(problems)
        if isinstance(problems, Problem):
            problems = (problems,)
        self.problems: tuple[Problem, ...] = tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))


def refuse(problems: Sequence[Problem]) -> None:
    """InputError with all these problems, where there are any."""
    if problems:
        raise InputError(problems[:MOST_PROBLEMS])


def all_of(calls: Iterable[Callable[[], _R]]) -> list[_R]:
    """What each call gives; InputError with the problems of all."""
    out: list[_R] = []
    problems: list[Problem] = []
    for call in calls:
        try:
            out.append(call())
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return out


class NotIdentifiable(QsfError):
    """The readings or the plan cannot tell the parameters apart.

    unseen: parameters that nothing depends on; groups: those of which only a combination is seen; at_bound: those that
    stand at a bound meanwhile. The message names them.
    """

    def __init__(
        self,
        message: str = "these readings do not identify the parameters",
        unseen: Sequence[str] = (),
        groups: Sequence[Sequence[str]] = (),
        at_bound: Sequence[str] = (),
    ):
        self.unseen, self.groups = tuple(unseen), tuple(tuple(g) for g in groups)
        self.at_bound = tuple(at_bound)
        said = [f"{name}: no reading depends on it" for name in self.unseen]
        said += [f"{', '.join(group)}: only a combination of these is identifiable" for group in self.groups]
        at = f" (with {', '.join(self.at_bound)} at its bound)" if self.at_bound else ""
        super().__init__(f"{message}{at}" + (f": {'; '.join(said)}" if said else ""))


class NotCertified(QsfError):
    """A design whose certified efficiency misses what was asked."""


class NotConverged(QsfError):
    """An iteration that did not reach its tolerance; its last value is not a result."""


def missing_extra(what: str, extra: str) -> InputError:
    """The error where a package of an extra is not installed, with the command that installs it, from a clone too."""
    hint = f"In the folder of qsframework: {sys.executable} -m pip install '.[{extra}]'"
    return InputError(Problem(what, hint=hint))


class PluginError(QsfError):
    """An effect that breaks the plugin protocol."""


def nearest(name: str, allowed: Iterable[str]) -> str | None:
    """A sentence with the nearest allowed name, or None if nothing is near."""
    near = near_name(name, allowed)
    return None if near is None else f"Did you mean {near!r}?"


def near_name(name: str, allowed: Iterable[str]) -> str | None:
    """The nearest other name, else the first that begins as this one, or None if nothing is near."""
    known = {word.lower(): word for word in allowed if word != name}
    close = difflib.get_close_matches(name.lower(), list(known), n=1, cutoff=_NEAR)
    close += [word for word in known if len(name) > 2 and word.startswith(name.lower())]
    return known[close[0]] if close else None


def listed(names: Sequence[str]) -> str:
    """Names in a sentence: `a`, `a and b`, `a, b and c`."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if names[1:] else names)


def some_of(names: Sequence[str], most: int = 8, between: str = ", ") -> str:
    """Names in a sentence, the first of many."""
    return between.join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
