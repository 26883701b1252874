"""Progress on the terminal: one bar a step, with the time that is left; silent where there is no terminal."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager

Tell = Callable[[str, int, int], None]
_TERMINALS = {"FORCE_COLOR", "TTY_COMPATIBLE"}
"""Variables by which rich takes for a terminal what does not look like one."""


@contextmanager
def progress() -> Generator[Tell, None, None]:
    """A function (label, done, total) that draws one bar per label."""
    if not sys.stderr.isatty() and not _TERMINALS & os.environ.keys():  # nothing to load that nobody sees
        yield lambda label, done, total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    left = TimeRemainingColumn(compact=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TextColumn("left"), left)
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bars:
        tasks: dict[str, TaskID] = {}

        def tell(label: str, done: int, total: int) -> None:
            if label not in tasks:
                tasks[label] = bars.add_task(label, total=total)
            bars.update(tasks[label], completed=done, total=total)

        yield tell


@contextmanager
def steps(label: str, *names: str) -> Generator[Callable[[str], None], None, None]:
    """A function (name) that says which of a command's steps begins, on one bar."""
    with progress() as tell:
        yield lambda name: tell(label, names.index(name), len(names))
