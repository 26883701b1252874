"""Tables and paragraphs as lines of so many columns: nothing breaks inside a word, and a number stays with its unit."""

from __future__ import annotations

import os
import re
import shutil
import textwrap
from collections.abc import Iterator, Sequence
from typing import TextIO

PIPE = 100
"""Columns of what goes to a file or a pipe."""
_WHOLE = 20
"""Characters up to which a cell is never broken: numbers with their unit and sd."""
_WORDY = 24
"""A column with a longer cell holds words, and may stand below its row instead."""
_UNIT = re.compile(
    r"(?<=\d) (?=±)|(?<=±) (?=\d)|(?<=\d) (?=(?:%|(?:[umn]?rad|[unm]?m|deg|[kM]?N|Nm|kg|s|h)\b))|(?<=\b[kM]N) (?=m\b)"
    r"|(?<=\bN) (?=m\b)"
)
"""A space inside a quantity: around ± of an sd, before its unit, and within a unit such as urad/(kN m)^3."""
_TIED = "\N{NO-BREAK SPACE}"
"""Between a number and its unit while lines are broken."""
_GAP = 2
_SILENT = ("", "-", "ok")
"""Cells that are not worth a line of their own."""

Row = Sequence[str]


def width() -> int:
    """Columns of the terminal."""
    return max(40, shutil.get_terminal_size((PIPE, 24)).columns)


_INK = {"red": "31", "green": "32", "amber": "33"}


def coloured(text: str, ink: str, stream: TextIO) -> str:
    """The text, bold and in a colour where the stream is a terminal that has colours and nobody refused them."""
    if not stream.isatty() or os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return text
    return f"\x1b[1;{_INK[ink]}m{text}\x1b[0m"


def printable(line: str) -> str:
    """The line with what a terminal would obey, such as the colours of a file's text, as a mark."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in line)


def paragraphs(said: str, room: int) -> list[str]:
    """Paragraphs, one a line, each folded; the lines of an item, or of one that is set in, keep its edge."""
    out: list[str] = []
    for line in said.splitlines():
        edge = len(line) - len(line.lstrip())
        out.append(folded(line, room, " " * (edge + 2 if edge or line.startswith("- ") else 0)))
    return out


def table_lines(header: Row, rows: Sequence[Row], room: int) -> list[str]:
    """The lines of a table in so many columns."""
    count = len(header)
    columns = list(range(count))
    below: list[int] = []
    while _least(header, rows, columns) > room:
        wordy = [k for k in columns[1:] if max((len(r[k]) for r in rows), default=0) > _WORDY]
        words = wordy or [k for k in columns[1:] if not _numbers([r[k] for r in rows])]
        silent = [k for k in columns[1:] if all(r[k].strip() in _SILENT for r in rows)]
        if not words and not silent:
            break
        last = (silent or words)[-1]
        below.insert(0, last)
        columns.remove(last)
    out: list[str] = []
    for part in _parts(header, rows, columns, room):
        out += [""] if out else []
        out += _lines(header, rows, part, below, room)
        below = []
    return out


def _parts(header: Row, rows: Sequence[Row], columns: Sequence[int], room: int) -> Iterator[list[int]]:
    """The columns, in parts that fit, each with the first."""
    part = [columns[0]]
    for k in columns[1:]:
        if len(part) > 1 and _least(header, rows, [*part, k]) > room:
            yield part
            part = [columns[0]]
        part.append(k)
    yield part


def _lines(header: Row, rows: Sequence[Row], columns: Sequence[int], below: Sequence[int], room: int) -> list[str]:
    """A table of some columns, with others as lines below each row."""
    widths = _widths(header, rows, columns, room)
    left = [i == 0 or not _numbers([r[k] for r in rows]) for i, k in enumerate(columns)]
    out = _row([header[k] for k in columns], widths, left, bottom=True)
    out.append("─" * (sum(widths) + _GAP * (len(widths) - 1)))
    for r in rows:
        out += _row([r[k] for k in columns], widths, left)
        for k in below:
            if r[k].strip() not in _SILENT:
                out.append(folded(f"    {header[k]}: {r[k]}" if header[k] else f"    {r[k]}", room, "      "))
    return out


def folded(said: str, room: int, indent: str) -> str:
    """A line folded at so many columns; what follows its first is indented."""
    kept = len(said) - len(said.lstrip())
    return "\n".join(_broken(said.lstrip(), room, said[:kept], indent))


def _broken(said: str, room: int, first: str = "", rest: str = "") -> list[str]:
    """Lines of so many columns; a word is never broken, and a number stays with its unit."""
    wrapper = textwrap.TextWrapper(
        room, initial_indent=first, subsequent_indent=rest, break_on_hyphens=False, break_long_words=False
    )
    lines = wrapper.wrap(_UNIT.sub(_TIED, said))
    return [line.replace(_TIED, " ") for line in lines]


def _row(cells: Row, widths: Sequence[int], left: Sequence[bool], bottom: bool = False) -> list[str]:
    parts = [_wrapped(cell, size) for cell, size in zip(cells, widths, strict=True)]
    height = max(len(p) for p in parts)
    parts = [[""] * (height - len(p)) + p if bottom else p + [""] * (height - len(p)) for p in parts]
    lines = [
        (" " * _GAP).join(
            part[i].ljust(size) if start else part[i].rjust(size)
            for part, size, start in zip(parts, widths, left, strict=True)
        )
        for i in range(height)
    ]
    return [line.rstrip() for line in lines]


def _wrapped(cell: str, size: int) -> list[str]:
    if len(cell) <= size:
        return [cell]
    return _broken(cell, size) or [""]


def _numbers(cells: Row) -> bool:
    """Whether most of a column's cells that say anything are numbers."""
    told = [c.strip() for c in cells if c.strip() not in _SILENT]
    return 2 * sum(c.lstrip("+-<> ")[:1].isdigit() and len(c) <= _WORDY for c in told) >= len(told)


def _word(text: str) -> int:
    return max((len(word) for word in re.split(r"[ \n]+", _UNIT.sub(_TIED, text))), default=0)


def _smallest(header: Row, rows: Sequence[Row], k: int) -> int:
    """The narrowest that a column may be: short cells stay whole, long ones and heads break between words."""
    return max((_word(header[k]), *(len(r[k]) if len(r[k]) <= _WHOLE else _word(r[k]) for r in rows)))


def _least(header: Row, rows: Sequence[Row], columns: Sequence[int]) -> int:
    return sum(_smallest(header, rows, k) for k in columns) + _GAP * (len(columns) - 1)


def _widths(header: Row, rows: Sequence[Row], columns: Sequence[int], room: int) -> list[int]:
    """Widths of columns: what each wants, and where that is too much, cells of words and heads give way."""
    least = [_smallest(header, rows, k) for k in columns]
    wanted = [max((len(header[k]), *(len(r[k]) for r in rows))) for k in columns]
    spare = room - sum(least) - _GAP * (len(columns) - 1)
    out = list(least)
    while spare > 0 and (open_ := [i for i in range(len(out)) if out[i] < wanted[i]]):
        narrowest = min(open_, key=lambda i: (wanted[i] > _WHOLE, out[i] / wanted[i]))
        out[narrowest] += 1
        spare -= 1
    return out
