"""How a table stands in a file: heading rows, blocks of columns for markers, reports with one axis a line.

What comes out is one plain table: a heading, and one point a row. Nothing is said yet of what the columns are.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace
from pathlib import Path
from typing import Any

from qsf_trackers.vocabulary import (
    AXIS_FILLERS,
    BLOCK,
    NOT_MEASURED,
    header_parts,
    unit_of,
    words_of,
)
from qsframework.errors import InputError, Problem, refuse
from qsframework.experiment import XYZ
from qsframework.experiment.columns import MOST_COLUMNS

NO_SIGHT = frozenset(("", "nan", "-", "--", "---", "n/a", "#n/a", "na", "null", "none", "inf", "-inf"))
"""What stands in a cell in small letters where the instrument saw nothing."""
_NUMBERISH = re.compile(r"[-+]?\d[\d.,']*(?:[eE][-+]?\d+)?(?:\s*[^\d\s]{1,4})?|[-+]?[.,]\d+")
"""What somebody meant as a number, with a unit or a sign between thousands."""
_PLAIN_NUMBER = re.compile(r"[-+]?(?:\d[\d.,]*|[.,]\d+)(?:[eE][-+]?\d+)?")
_FEWEST = 3
"""Numbers of a row of points, or of joints."""
_VALUE = re.compile(r"meas|measured|actual|act|ist|istwert|messwert|value|wert|result", re.IGNORECASE)
"""Heading of the column that holds what was measured, in a report with one axis a line."""
_LABEL = re.compile(r"\bOF\s+\w+\s+(\S+)", re.IGNORECASE)
_ONE_TABLE = "Leave one table in the file: every row as wide as its heading, and text only above it."
_UNITS = re.compile(r"\bunits?\s*[=:]\s*([a-z]+)", re.IGNORECASE)


@dataclass(frozen=True)
class SheetRow:
    """One row: its line (of a workbook its row), and its cells without the blanks around them."""

    line: int
    cells: tuple[str, ...]


@dataclass(frozen=True)
class Sheet:
    """One table. header: its names, () where there is none; above, below: lines of text over and under it.

    separator: a key of SEPARATORS, "" in a workbook; form: what a reader of such files calls it, "" without one
    decimal: "" in a workbook; encoding: of a text; blocks: labels of the blocks of columns that became rows;
    left: columns that were to be ignored
    """

    path: Path
    name: str = ""
    _: KW_ONLY
    header: tuple[str, ...] = ()
    rows: tuple[SheetRow, ...] = ()
    header_line: int = 1
    above: tuple[str, ...] = ()
    separator: str = ""
    form: str = ""
    decimal: str = ""
    encoding: str = ""
    blocks: tuple[str, ...] = ()
    left: tuple[str, ...] = ()
    below: tuple[str, ...] = ()

    def problem(self, row: int | None, message: str, column: int | None = None, **more: Any) -> Problem:
        """A problem at a row (None: the header) and a column, both counted from 0."""
        name = None if column is None else self.column(column)
        line = self.header_line if row is None else self.rows[row].line
        return Problem(message, self.where, line, name, **more)

    @property
    def where(self) -> str:
        """The file, and the sheet of a workbook."""
        return f"{self.path}, sheet {self.name}" if self.name else str(self.path)

    @property
    def width(self) -> int:
        """Columns."""
        return len(self.header) or max((len(r.cells) for r in self.rows), default=0)

    def column(self, k: int) -> str:
        """Name of a column, or its number from 1."""
        return (self.header[k] if k < len(self.header) else "") or str(k + 1)

    def cells(self, k: int) -> list[str]:
        """The cells of a column."""
        return [row.cells[k] for row in self.rows]


def is_data(cells: Sequence[str]) -> bool:
    """Whether a row holds numbers enough for a point, cells in which nothing was seen among them."""
    count = sum(_NUMBERISH.fullmatch(c) is not None for c in cells)
    empty = sum(c.lower() in NO_SIGHT for c in cells)
    return count >= _FEWEST or (count > 0 and count + empty == len(cells) > _FEWEST)


def is_axis_line(cells: Sequence[str]) -> bool:
    """Whether a row is of one axis: X, Y or Z beside a number, in a cell of its own or at the end of the first."""
    cells = _axis_apart(cells)
    return any(c.lower() in XYZ for c in cells) and any(_PLAIN_NUMBER.fullmatch(c) for c in cells)


def lay_out(sheet: Sheet, rows: Sequence[SheetRow], ignore: Sequence[str] = ()) -> Sheet:
    """The sheet with the plain table that rows hold; ignore: names of columns to leave out.

    InputError where there is none, or where rows have another number of cells than its heading, or than the first.
    """
    while rows and not any(rows[-1].cells):  # as a spreadsheet leaves them
        rows = rows[:-1]
    if (folded := _one_point_a_row(sheet, rows)) is not None:
        return folded
    first = _first(rows)
    before, data, below = list(rows[:first]), *_parted(rows[first:])
    while len(before) > 1 and sum(bool(c) and c.lower() in NO_SIGHT for c in before[-1].cells) >= _FEWEST:
        data.insert(0, before.pop())
    units = list[str]()
    while len(before) > 1 and _only_units(before[-1].cells):
        units = list(before.pop().cells)
    before = _with_marker_names(before, data)
    if not before or not data or (len(before[-1].cells) == 1 and len(data[0].cells) > 1):
        line, width = (data[0].line, len(data[0].cells)) if data else (1, 0)
        sheet = replace(sheet, header_line=line, above=(*sheet.above, *_texts(before)), below=below)
        return _with_rows(sheet, data, width)
    heading = before.pop()
    over: list[SheetRow] = []
    while before and _stands_over(before[-1].cells, heading.cells):
        over.insert(0, before.pop())
    columns, blocks = _headed(over, heading, units, [w.lower() for w in ignore])
    before += [] if any(c.over for c in columns) else over
    data = [row for row in data if row.cells != heading.cells]  # exports of one kind, one after the other
    sheet = replace(sheet, header_line=heading.line, above=(*sheet.above, *_texts(before)), below=below)
    return _melted(_with_rows(sheet, data, len(columns)), columns, blocks)


def _with_rows(sheet: Sheet, rows: Sequence[SheetRow], width: int) -> Sheet:
    """The sheet with its rows. InputError where these are none, or not all so wide."""
    if not rows:
        hint = "A point list has at least three numbers in every row; is it an export of points, and not of a report?"
        raise InputError(Problem("holds no rows of numbers", sheet.where, hint=hint))
    rows, hint = [_fitting(row, width) for row in rows], _ONE_TABLE
    if sheet.separator == "," and all(len(row.cells) > width for row in rows):
        hint = "A comma seems to separate the columns and the decimals: export with ';' or a tab between columns."
    _check_widths(sheet, rows, width, hint)
    return replace(sheet, rows=tuple(rows))


def _check_widths(sheet: Sheet, rows: Sequence[SheetRow], width: int, hint: str = _ONE_TABLE) -> None:
    if width > MOST_COLUMNS:
        raise InputError(sheet.problem(None, f"holds more than {MOST_COLUMNS} columns"))
    message, allowed = "wrong number of columns", str(width)
    wrong = [(row.line, str(len(row.cells))) for row in rows if len(row.cells) != width]
    refuse([Problem(message, sheet.where, k, found=found, allowed=allowed, hint=hint) for k, found in wrong])


def _texts(rows: Sequence[SheetRow]) -> tuple[str, ...]:
    """Lines of text; of two rows of which one holds the names and one the values, the unit that they state."""
    said = [" ".join(r.cells) for r in rows]
    for one, two in itertools.pairwise(rows):
        said += [f"Units: {b}" for a, b in zip(one.cells, two.cells, strict=False) if a.lower() == "units"]
    return tuple(said)


def _first(rows: Sequence[SheetRow]) -> int:
    """The first row of the table: the first with numbers, unless a heading follows, and it is as wide as no row of the
    table or begins with nothing, as numbers of markers do."""
    data = [is_data(r.cells) for r in rows]
    first = data.index(True) if True in data else len(rows)
    while True in (rest := data[first + 1 : first + 12]) and not rest[0]:
        k = first + 1 + rest.index(True)
        apart = len(rows[first].cells) != len(rows[k].cells) or not rows[first].cells[0]
        between = [[c for c in r.cells if re.search(r"[^\W\d]", c)] for r in rows[first + 1 : k]]
        if not apart or max(map(len, between)) < _FEWEST:
            break
        first = k
    return first


def _parted(rows: Sequence[SheetRow]) -> tuple[list[SheetRow], tuple[str, ...]]:
    """The rows of the table, and the lines of text that stand below it, apart from it by an empty line."""
    end = len(rows)
    while end > 1 and not any(_NUMBERISH.fullmatch(c) for c in rows[end - 1].cells):
        end -= 1
    if end < len(rows) and rows[end].line > rows[end - 1].line + 1:
        return list(rows[:end]), tuple(" ".join(r.cells) for r in rows[end:])
    return list(rows), ()


def _only_units(cells: Sequence[str]) -> bool:
    """Whether a row holds units alone, in brackets or not."""
    bracketed = all(not c or re.fullmatch(r"[\[(].{0,12}[\])]", c) for c in cells)
    units = [unit_of(c) is not None for c in cells if c.strip("[]()-–%")]
    return bool(cells) and (bracketed or (bool(units) and all(units)))


def _with_marker_names(before: list[SheetRow], data: Sequence[SheetRow]) -> list[SheetRow]:
    """The rows above a table without a heading, one made where the last names the markers whose coordinates follow, as
    QTM writes it."""
    last = before[-1].cells if before else ("",)
    names = last[1:]
    more = len(data[0].cells) - 3 * len(names) if data else -1
    if last[0].upper() != "MARKER_NAMES" or not names or not 0 <= more <= 2:
        return before
    heading = (*("Frame", "Time")[:more], *(f"{name} {axis.upper()}" for name in names for axis in XYZ))
    return [*before, SheetRow(before[-1].line, heading)]


def _stands_over(cells: Sequence[str], heading: Sequence[str]) -> bool:
    """Whether a row is a second heading over another: as wide, or indented, and no line of text."""
    filled = sum(map(bool, cells))
    return filled > 0 and len(cells) > 1 and (not cells[0] or (len(cells) == len(heading) and not is_data(cells)))


@dataclass(frozen=True)
class _Heading:
    """A column: its own heading, and what the rows over it say, an empty cell what stands to its left."""

    name: str
    over: tuple[str, ...]

    @property
    def axis(self) -> str:
        """x, y or z; "" where the headings do not say that it is a measured coordinate."""
        words = words_of(header_parts(self.name)[0].lower())
        every = [*words, *words_of(" ".join(self.over).lower())]
        axes = [w[0] for w in words if re.fullmatch(r"[xyz]\d{0,3}", w)]
        return axes[0] if len(axes) == 1 and not NOT_MEASURED.intersection(every) else ""

    @property
    def label(self) -> str:
        """What its own heading says beside the axis."""
        words = [re.sub(r"^[xyzXYZ](?=\d{0,3}$)", "", w) for w in words_of(header_parts(self.name)[0])]
        return " ".join(w for w in words if w and w.lower() not in AXIS_FILLERS)

    @property
    def is_plain(self) -> bool:
        """Whether nothing in the headings says of which point this coordinate is."""
        words = [w for text in self.over for w in words_of(header_parts(text)[0].lower())]
        return not self.label and AXIS_FILLERS.issuperset(words)

    @property
    def full(self) -> str:
        """The headings in one, the first first."""
        return " ".join(dict.fromkeys(t for t in (*self.over, self.name) if t))


def _cell_or_left(left: str, cell: str) -> str:
    return cell or left


def _columns(rows: Sequence[Sequence[str]], units: Sequence[str]) -> list[_Heading]:
    """The columns by their headings, each with its unit; an empty cell over a heading says what stands to its left."""
    width = max(map(len, rows))
    direct = [(*row, *("",) * (width - len(row))) for row in rows]
    filled = [tuple(itertools.accumulate(row, _cell_or_left)) for row in direct]
    out: list[_Heading] = []
    for k in range(width):
        last = max((i for i, row in enumerate(direct) if row[k]), default=0)
        name, over = direct[last][k], tuple(row[k] for row in filled[:last] if row[k])
        unit = units[k].strip("[]()") if len(units) == width else ""
        owned = over if _axis_word(name) else tuple(row[k] for row in direct[:last])
        unit = unit or next((u for text in owned if (u := header_parts(text)[1])), "")
        out.append(_Heading(f"{name} [{unit}]" if unit and not header_parts(name)[1] else name, over))
    return out


@dataclass(frozen=True)
class _Blocks:
    """Places of columns: of x, y and z in each block whose points become rows, with its label; left: ignored ones."""

    labels: list[str]
    places: list[dict[str, int]]
    left: list[int]


def _headed(
    over: Sequence[SheetRow], heading: SheetRow, units: Sequence[str], ignore: Sequence[str]
) -> tuple[list[_Heading], _Blocks]:
    """The columns by as many heading rows as say what the coordinates are, and their blocks; text that only happens to
    stand above is none."""
    for k in range(len(over) + 1):
        columns = _columns([r.cells for r in (*over[k:], heading)], units)
        left = [i for i, c in enumerate(columns) if {c.name.lower(), c.full.lower()}.intersection(ignore)]
        blocks: dict[object, dict[str, int]] = {}
        for i, column in enumerate(columns):
            if column.axis and i not in left:
                blocks.setdefault((column.label.lower(), column.over), {}).setdefault(column.axis, i)
        whole = [own for own in blocks.values() if len(own) == len(XYZ)]
        first = [columns[own["x"]] for own in whole]
        plain = any(c.is_plain for c in first)
        labels = [] if plain else _labels(first)
        if len(labels) == 1 and over[k].cells[0]:  # a line of text in the columns of a table
            labels = []
        if plain or labels:
            return columns, _Blocks(labels, whole if labels else [], left)
    columns = _columns([heading.cells], units)
    return columns, _Blocks([], [], [i for i, c in enumerate(columns) if c.name.lower() in ignore])


def _melted(sheet: Sheet, columns: Sequence[_Heading], blocks: _Blocks) -> Sheet:
    """The sheet with its heading; where blocks of columns hold coordinates, each becomes rows of its own."""
    within = {k for own in blocks.places for k in own.values()}
    names = _names(columns)
    keep = [k for k in range(len(columns)) if k not in within and k not in blocks.left]
    sheet = replace(sheet, header=tuple(names[k] for k in keep), left=tuple(names[k] for k in blocks.left))
    if not within:
        return replace(sheet, rows=tuple(replace(r, cells=tuple(r.cells[k] for k in keep)) for r in sheet.rows))
    units = {k: header_parts(columns[k].name)[1] for k in within}
    one = units[min(within)] if len(set(units.values())) == 1 else ""
    rows = [
        SheetRow(row.line, (*(row.cells[k] for k in keep), label, *(f"{row.cells[k]} {u}".strip() for k, u in at)))
        for row in sheet.rows
        for label, own in zip(blocks.labels, blocks.places, strict=True)
        for at in [[(own[a], "" if one else units[own[a]]) for a in XYZ]]
    ]
    axes = [f"{a.upper()} [{one}]" if one else a.upper() for a in XYZ]
    return replace(sheet, header=(*sheet.header, BLOCK, *axes), rows=tuple(rows), blocks=tuple(blocks.labels))


def _fitting(row: SheetRow, width: int) -> SheetRow:
    """The row without empty cells behind its last column."""
    end = max([width, *(k for k, cell in enumerate(row.cells, start=1) if cell)])
    return replace(row, cells=row.cells[:end])


def _labels(columns: Sequence[_Heading]) -> list[str]:
    """What tells the blocks of these columns apart: their own headings, or the first row over them; [] for nothing."""
    if len(columns) < 2:  # one block has no other to be told from; its own heading alone may be of any point
        return [" ".join(c.over[:2]) for c in columns if c.over and not c.label]
    depth = max(len(c.over) for c in columns)
    above = [[c.over[i] if i < len(c.over) else "" for c in columns] for i in range(depth)]
    ways = [[c.label for c in columns], *above, [" ".join((*c.over, c.label)).strip() for c in columns]]
    ways = [*(above if depth and all(c.label.isdecimal() for c in columns) else []), *ways]
    return next((way for way in ways if len(set(way)) == len(way) and all(way)), list[str]())


def _names(columns: Sequence[_Heading]) -> list[str]:
    """A name for every column: its own heading, with those over it where another has the same, or where it would be
    taken for a coordinate that was measured."""
    own = [c.name.lower() for c in columns]
    plain = [bool(c.axis) and c.is_plain for c in columns]
    return [
        c.full if c.over and not p and (own.count(c.name.lower()) > 1 or _axis_word(c.name)) else c.name
        for c, p in zip(columns, plain, strict=True)
    ]


def _axis_word(name: str) -> bool:
    """Whether a heading alone would be taken for a coordinate."""
    return header_parts(name)[0].strip().lower() in XYZ


def _one_point_a_row(sheet: Sheet, rows: Sequence[SheetRow]) -> Sheet | None:
    """The sheet with the points of a report with one axis a line; None where it is something else."""
    apart = [replace(r, cells=_axis_apart(r.cells)) for r in rows]
    more = max((len(a.cells) - len(r.cells) for a, r in zip(apart, rows, strict=True)), default=0)
    rows = apart
    lines = [r for r in rows if is_axis_line(r.cells)]
    place = _axis_place(lines)
    if place is None:
        return None
    of_axis = {r.line for r in lines}
    heading: Sequence[str] = ()
    label = unit = ""
    points: list[tuple[int, str, dict[str, str]]] = []
    wrong: list[SheetRow] = []
    for row in rows:
        axis = row.cells[place].lower() if place < len(row.cells) else ""
        if axis not in XYZ or row.line not in of_axis:
            values = [c for c in row.cells if _VALUE.fullmatch(header_parts(c)[0].strip())]
            if values:
                heading = (*[""] * more, *row.cells)
            elif not any(_NUMBERISH.fullmatch(c) for c in row.cells[1:2]):
                label, found = " ".join(row.cells), _UNITS.search(" ".join(row.cells))
                unit = found[1] if found is not None and unit_of(found[1]) else unit
            continue
        if heading and len(heading) != len(row.cells):
            wrong.append(row)
            continue
        k = _value_place(row.cells, heading)
        if k is None:
            return None
        unit = header_parts(heading[k])[1] or unit if k < len(heading) else unit
        texts = [c for i, c in enumerate(row.cells) if i != place and c and not _NUMBERISH.fullmatch(c)]
        found = _LABEL.search(label)
        name = " ".join(texts) or (found[1] if found is not None else label)
        if axis in (points[-1][2] if points else XYZ) or (texts and name != points[-1][1]):
            points.append((row.line, name, {}))
        points[-1][2][axis] = f"{row.cells[k]} {unit}" if unit else row.cells[k]
    if any(len(own) != len(XYZ) for _, _, own in points) and not wrong:
        return None
    sheet = replace(sheet, header=("name", *XYZ), header_line=rows[0].line)
    _check_widths(sheet, wrong, len(heading) - more)
    return replace(sheet, rows=tuple(SheetRow(k, (name, *(own[a] for a in XYZ))) for k, name, own in points))


def _axis_apart(cells: Sequence[str]) -> tuple[str, ...]:
    """The cells with the axis in one of its own where it is the end of the first: P01_m1.X."""
    found = re.fullmatch(r"(.+)[._\s]([xyzXYZ])", cells[0]) if cells else None
    numbers = any(_PLAIN_NUMBER.fullmatch(c) for c in cells[1:])
    return (found[1], found[2], *cells[1:]) if found is not None and numbers else tuple(cells)


def _axis_place(lines: Sequence[SheetRow]) -> int | None:
    """The column in which all these lines name their axis, each axis as often as the others."""
    columns = ([cell.lower() for cell in column] for column in zip(*(r.cells for r in lines), strict=False))
    return next((k for k, c in enumerate(columns) if set(c) == set(XYZ) and len({c.count(a) for a in XYZ}) == 1), None)


def _value_place(cells: Sequence[str], heading: Sequence[str]) -> int | None:
    """The cell of such a line that was measured: by the heading, or the only number."""
    if len(heading) == len(cells):
        named = [k for k, c in enumerate(heading) if _VALUE.fullmatch(header_parts(c)[0].strip())]
        if len(named) == 1:
            return named[0]
    numbers = [k for k, c in enumerate(cells) if _PLAIN_NUMBER.fullmatch(c)]
    return numbers[0] if len(numbers) == 1 else None
