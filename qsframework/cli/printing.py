"""Text and tables on standard output, as wide as the terminal."""

from __future__ import annotations

import sys
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from io import BufferedWriter, FileIO, TextIOWrapper
from typing import TYPE_CHECKING

from qsframework.terminal import Row, coloured, folded, paragraphs, printable, table_lines, width

if TYPE_CHECKING:
    from qsframework.report.blocks import Verdict


_HELD = 1 << 20
"""Bytes that are printed at the end; no command prints as many."""


def _lines(paragraphs: Sequence[str]) -> str:
    """Lines as they are, but for what a terminal would obey."""
    return "\n".join(printable(line) for lines in paragraphs for line in lines.split("\n"))


def print_folded(*texts: str) -> None:
    """Paragraphs, one a line, each folded; the lines of an item, or of one that is set in, keep its edge."""
    for text in texts:
        print(_lines(paragraphs(text, width())))


def print_notes(notes: Iterable[str]) -> None:
    """What to know of a result, a paragraph each."""
    print_folded(*(f"note: {note}" for note in notes))


def print_verdict(verdict: Verdict) -> None:
    """What the reader came for, first: the word and the sentence."""
    said = _lines(paragraphs(f"{verdict.word}: {verdict.said}", width()))
    ink = {"good": "green", "look": "amber", "bad": "red"}[verdict.mark.value]
    print(coloured(verdict.word, ink, sys.stdout) + said.removeprefix(verdict.word) + "\n")


def print_line(lead: str, text: str) -> None:
    """A statement as an item of a list, with what it is about in front."""
    text = f"{lead}: {text}" if lead else text
    print(_lines([folded(f"  - {text}", width(), "    ")]))


def print_table(header: Row, rows: Sequence[Row], title: str = "", caption: str = "", most: int | None = None) -> None:
    """A table, its caption and an empty line: words from the left, numbers from the right; most: rows at most.

    Where the terminal is too narrow, columns of words stand below their row; where it still is, the table is cut into
    several, each with the first column.
    """
    if title:
        print(f"\n{title}")
    more = [] if most is None or len(rows) <= most else [f"and {len(rows) - most} more: --verbose, or --report"]
    print(
        _lines([*table_lines(header, rows[:most] if more else rows, width()), *more, *paragraphs(caption, width()), ""])
    )


@contextmanager
def held_back() -> Generator[None, None, None]:
    """Within, what goes into a pipe or a file waits until the end: the command's files are written before.

    A reader such as `head` may leave early, and a disk may be full: neither is to cost a file. What is printed with
    flush=True goes at once, and a terminal shows every line.
    """
    out = sys.stdout
    if out is not sys.__stdout__ or out.isatty():  # sys.__stdout__ is None where there is none
        yield
        return
    out.flush()
    raw = FileIO(out.fileno(), "w", closefd=False)
    held = TextIOWrapper(BufferedWriter(raw, _HELD), encoding=out.encoding, errors=out.errors)
    sys.stdout = held
    try:
        yield
    finally:
        sys.stdout = out
        held.close()  # what is held goes out; the descriptor stays open
