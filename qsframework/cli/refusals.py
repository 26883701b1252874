"""What is refused, in a terminal, in one spelling: equal problems of many lines as one, with the option that mends."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import typer

from qsframework.errors import InputError, Problem, QsfError
from qsframework.terminal import coloured, folded, printable, width

USAGE: Any = typer.BadParameter.__mro__[1]
"""A command line that is not one of ours: the base of typer's own errors of that kind, which it does not export."""
_MOST = 20


def print_errors(lines: Sequence[str]) -> None:
    """Each as `error: ...` on standard error, folded, the first of many."""
    shown = [*lines[:_MOST], *([f"... and {len(lines) - _MOST} more problems"] if len(lines) > _MOST else [])]
    lead = coloured("error:", "red", sys.stderr)
    said = [folded(f"error: {printable(line)}", width(), "  ") for line in shown]
    print("\n".join(lead + one.removeprefix("error:") for one in said), file=sys.stderr, flush=True)


def print_usage(error: Any) -> None:
    """How the command is written, and what was wrong with it; all of its help where nothing was asked."""
    said = error.format_message()
    if "\n" in said:
        print(said, file=sys.stderr)
        return
    if error.ctx is not None:
        print(f"{error.ctx.get_usage()}\nTry '{error.ctx.command_path} -h' for help.\n", file=sys.stderr)
    print_errors([said])


def told(error: QsfError) -> list[str]:
    """The lines of an error, with the options that would mend its problems; those that differ by their line alone are
    one."""
    if not isinstance(error, InputError):
        return str(error).splitlines()
    alike: dict[Problem, list[Problem]] = {}
    for problem in error.problems:
        alike.setdefault(replace(problem, line=None, found=None), []).append(problem)
    return [line for problems in alike.values() for line in _as_one(problems).splitlines()]


def _as_one(problems: Sequence[Problem]) -> str:
    first = problems[0]
    option = "" if first.argument is None else f" (--{' '.join(first.argument)}".rstrip() + ")"
    if len(problems) == 1:
        return f"{first}{option}"
    lines = sorted({p.line for p in problems if p.line is not None})
    place = ", ".join(filter(None, (first.file, f"lines {_ranges(lines)}" if lines else None)))
    found = list(dict.fromkeys(p.found for p in problems if p.found is not None))
    words = None if not found else found[0] + (f" and {len(found) - 1} others" if len(found) > 1 else "")
    return f"{replace(first, file=place, line=None, found=words)}{option}"


def _ranges(lines: Sequence[int]) -> str:
    """`4 to 47, 50`."""
    starts = [lines[0], *(b for a, b in pairwise(lines) if b > a + 1)]
    ends = [*(a for a, b in pairwise(lines) if b > a + 1), lines[-1]]
    return ", ".join(f"{a} to {b}" if b > a else f"{a}" for a, b in zip(starts, ends, strict=True))
