"""Progress bars on the terminal; silent where there is none."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager

Tell = Callable[[str, int, int], None]
_WIDE = 160
"""Columns of a table that goes to a file or a pipe."""
_LINE = 120
"""Columns of text that goes there."""


@contextmanager
def progress() -> Generator[Tell, None, None]:
    """A function (label, done, total) that draws one bar per label."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=False) as bars:
        tasks: dict[str, TaskID] = {}

        def tell(label: str, done: int, total: int) -> None:
            if label not in tasks:
                tasks[label] = bars.add_task(label, total=total)
            bars.update(tasks[label], completed=done, total=total)

        yield tell


def print_folded(said: str) -> None:
    """A paragraph, folded at the terminal's width."""
    import shutil
    import textwrap

    width = shutil.get_terminal_size((_LINE, 24)).columns
    print(textwrap.fill(said, width, subsequent_indent="  " if said.startswith("- ") else "", break_on_hyphens=False))


def print_line(lead: str, said: str) -> None:
    """A statement as an item of a list, with what it is about in front, folded at the terminal's width."""
    import shutil
    import textwrap

    width = shutil.get_terminal_size((_LINE, 24)).columns
    text = f"{lead}: {said}" if lead else said
    print(textwrap.fill(text, width, initial_indent="  - ", subsequent_indent="    ", break_on_hyphens=False))


def print_table(header: tuple[str, ...], rows: tuple[tuple[str, ...], ...], title: str = "") -> None:
    """A table on standard output; wide cells fold."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=escape(title) or None, title_justify="left")
    for i, name in enumerate(header):
        table.add_column(escape(name), justify="left" if i == 0 else "right", overflow="fold", no_wrap=i == 0)
    for row in rows:
        table.add_row(*(escape(cell) for cell in row))
    console = Console()
    if not console.is_terminal:
        console = Console(width=_WIDE)
    console.print(table)
