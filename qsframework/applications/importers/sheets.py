"""Tables as other programs write them: any separator, decimal comma, lines of text above, Excel workbooks.

What is found out of the text itself - the separator, the decimal sign, the encoding - is kept with the table, so that
it can be shown. Numbers stay text here, with their row.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from pathlib import Path
from typing import Any, cast

from qsframework.applications.importers.layout import Layout, SheetRow, is_axis_line, is_data, lay_out
from qsframework.applications.importers.records import records
from qsframework.applications.programmes.log import joint_log
from qsframework.errors import InputError, Problem, missing_extra, nearest
from qsframework.experiment.columns import LARGEST, MOST_COLUMNS, MOST_LINES, unquoted
from qsframework.files.documents import nearest_file

SEPARATORS = {"tab": "\t", ";": ";", "|": "|", ",": ",", "space": " "}
"""What may stand between two cells, by the name that a user gives it; tried in this order."""
DECIMALS = (".", ",")
WORKBOOKS = (".xlsx", ".xlsm")
NUMBER = re.compile(r"[-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][-+]?\d+)?")
"""A number with either decimal sign, and no sign between thousands."""
_COMMENT = re.compile(r"\s*(?://|#|!|%\s)")
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
_TRIED = 2000
"""Lines from which the separator is told."""
_OLD_EXCEL, _ZIP = b"\xd0\xcf\x11\xe0", b"PK\x03\x04"
_UNPACKED, _PART = LARGEST, 5_000_000
"""Bytes that a workbook may unpack to, and a part of it that is no sheet and no list of texts."""
_LARGE_PARTS = ("xl/worksheets/", "xl/sharedStrings")
_MOST_CELLS, _LONGEST = 1_000_000, 32_767
"""Cells of a workbook, empty ones too; characters of one, which is what Excel takes."""


@dataclass(frozen=True)
class Sheet:
    """One table. header: its names, () where there is none; above: lines of text over it; decimal "" in a workbook.

    separator: a key of SEPARATORS, "" in a workbook, "programme" of positions in a controller's programme, "json"
    encoding: of a text; blocks, left, below: what its layout says
    """

    path: Path
    name: str
    header: tuple[str, ...]
    rows: tuple[SheetRow, ...]
    _: KW_ONLY
    header_line: int = 1
    above: tuple[str, ...] = ()
    separator: str = ""
    decimal: str = ""
    encoding: str = ""
    blocks: tuple[str, ...] = ()
    left: tuple[str, ...] = ()
    below: tuple[str, ...] = ()

    def problem(self, row: SheetRow | None, message: str, column: int | None = None, **more: str | None) -> Problem:
        """A problem at a row (None: the header) and a column, counted from 0."""
        name = None if column is None else self.column(column)
        line = self.header_line if row is None else row.line
        found, allowed, hint = (more.get(k) for k in ("found", "allowed", "hint"))
        return Problem(message, self.where, line, name, found=found, allowed=allowed, hint=hint)

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


def read_sheet(
    path: Path, sheet: str = "", separator: str = "", decimal: str = "", ignore: Sequence[str] = ()
) -> Sheet:
    """Read the table of a file; sheet: which one of a workbook; separator, decimal: stated, else told from the text;
    ignore: names of columns to leave out.

    InputError where it is no table, or where more than one reading of it is possible.
    """
    content = _content(path)
    if content.startswith(_OLD_EXCEL):
        hint = "Save it as .xlsx or as CSV."
        raise InputError(Problem("is a workbook of the old Excel format", str(path), hint=hint))
    if content.startswith(_ZIP):
        return _workbook(path, sheet, ignore)
    if path.suffix.lower() in WORKBOOKS:
        raise InputError(Problem("is no Excel workbook, though its name says so", str(path), hint="Export it again."))
    if sheet:
        hint = "Leave the sheet out."
        raise InputError(Problem("is a text, which has no sheets", str(path), found=repr(sheet), hint=hint))
    text, encoding = _decoded(path, content)
    logged = joint_log(path, text)
    if logged is not None:
        header, found = logged
        rows = tuple(SheetRow(line, cells) for line, cells in found)
        return Sheet(path, "", header, rows, separator="programme", decimal=".", encoding=encoding)
    found_rows = records(path, text)
    if found_rows is not None:
        whole = Sheet(path, "", (), (), separator="json", decimal=".", encoding=encoding)
        return _of_layout(whole, lay_out(found_rows, ignore), ".")
    return _text_sheet(path, text, encoding, separator, decimal, ignore)


def _content(path: Path) -> bytes:
    try:
        if not path.is_file():
            raise InputError(Problem("no such file", str(path), hint=nearest_file(path)))
        if path.stat().st_size > LARGEST:
            hint = "Split it into several files."
            raise InputError(Problem(f"is larger than {LARGEST // 1_000_000} MB", str(path), hint=hint))
        return path.read_bytes()
    except OSError as error:
        raise InputError(Problem(f"cannot be read: {error.strerror}", str(path))) from error


def _decoded(path: Path, content: bytes) -> tuple[str, str]:
    """The text and its encoding."""
    encodings = ("utf-16",) if content[:2] in (b"\xff\xfe", b"\xfe\xff") else ("utf-8-sig", "cp1252")
    for encoding in encodings:
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        if control := _CONTROL.search(text):
            line = text.count("\n", 0, control.start()) + 1
            raise InputError(Problem("is no text table: it holds a control character", str(path), line))
        return text, encoding.removesuffix("-sig")
    hint = "Export it as CSV in UTF-8, or as an Excel workbook."
    raise InputError(Problem("is no text that can be read", str(path), hint=hint))


def _text_sheet(path: Path, text: str, encoding: str, separator: str, decimal: str, ignore: Sequence[str]) -> Sheet:
    every = text.splitlines()
    if len(every) > MOST_LINES:
        hint = "Split it into several files."
        raise InputError(Problem(f"holds more than {MOST_LINES} lines", str(path), hint=hint))
    lines = [(i, line) for i, line in enumerate(every, start=1) if line.strip()]
    comments = [(i, line.strip()) for i, line in lines if _COMMENT.match(line)]
    lines = [(i, line) for i, line in lines if not _COMMENT.match(line)]
    if not lines:
        raise InputError(Problem("is empty", str(path)))
    name = _separator(path, lines, separator)
    whole = Sheet(path, "", (), (), above=tuple(line for _, line in comments), separator=name, encoding=encoding)
    rows = [SheetRow(i, _split(line, name)) for i, line in lines]
    first = [line for i, line in comments if i < rows[0].line]
    heading = _split(first[-1].lstrip("#/!% "), name) if first else ()
    if is_data(rows[0].cells) and len(heading) == len(rows[0].cells):  # as numpy and gnuplot write it
        rows.insert(0, SheetRow(lines[0][0] - 1, heading))
    return _of_layout(whole, lay_out(rows, ignore), decimal)


def _of_layout(sheet: Sheet, found: Layout, decimal: str) -> Sheet:
    """The table that was found in a file, its rows as wide as its heading and its decimal sign known."""
    if not found.rows and not found.wrong:
        hint = "A point list has at least three numbers in every row; is it an export of points, and not of a report?"
        raise InputError(Problem("holds no rows of numbers", sheet.where, hint=hint))
    sheet = replace(
        sheet,
        header=found.header,
        rows=found.rows,
        header_line=found.line,
        above=(*sheet.above, *found.above),
        blocks=found.blocks,
        left=found.left,
        below=found.below,
    )
    _check_widths(sheet, found)
    return replace(sheet, decimal=_decimal(sheet, decimal))


def _split(line: str, name: str) -> tuple[str, ...]:
    """The cells of a line."""
    if name == "space":
        return tuple(line.split())
    try:
        cells = next(csv.reader([line], delimiter=SEPARATORS[name], skipinitialspace=True), list[str]())
    except csv.Error:
        cells = line.split(SEPARATORS[name])
    return tuple(unquoted(cell.strip()) for cell in cells)


def _separator(path: Path, lines: Sequence[tuple[int, str]], stated: str) -> str:
    """The separator by which most lines become rows of numbers."""
    if stated:
        if stated not in SEPARATORS:
            hint = nearest(stated, SEPARATORS)
            allowed = ", ".join(SEPARATORS)
            raise InputError(Problem(f"{path.name}: no such separator", found=repr(stated), allowed=allowed, hint=hint))
        return stated
    scores = {
        name: sum(is_data(cells) or is_axis_line(cells) for _, line in lines[:_TRIED] if (cells := _split(line, name)))
        for name in SEPARATORS
    }
    return max(scores, key=lambda name: scores[name])


def _check_widths(sheet: Sheet, found: Layout) -> None:
    """InputError for rows with another number of cells than the header, or than the first row."""
    width, wrong = found.width or len(found.header), found.wrong
    if width > MOST_COLUMNS:
        raise InputError(sheet.problem(None, f"holds more than {MOST_COLUMNS} columns"))
    if not wrong:
        return
    hint = None
    if sheet.separator == "," and not sheet.rows and all(len(r.cells) > width for r in wrong):
        hint = "A comma seems to separate the columns and the decimals: export with ';' or a tab between columns."
    problems = [
        sheet.problem(row, "wrong number of columns", found=str(len(row.cells)), allowed=str(width), hint=hint)
        for row in wrong
    ]
    raise InputError(problems)


def _decimal(sheet: Sheet, stated: str) -> str:
    """The decimal sign; InputError where a file has both, as it would read 1,234 in two ways."""
    if stated:
        if stated not in DECIMALS:
            allowed = " ".join(DECIMALS)
            raise InputError(Problem(f"{sheet.path.name}: no such decimal sign", found=repr(stated), allowed=allowed))
        return stated
    by_sign: dict[str, tuple[SheetRow, int]] = {}
    for row in sheet.rows:
        for k, cell in enumerate(row.cells):
            sign = next((s for s in DECIMALS if s in cell), None)
            if sign is not None and NUMBER.fullmatch(cell):
                by_sign.setdefault(sign, (row, k))
    if len(by_sign) == 2:
        row, k = max(by_sign.values(), key=lambda at: at[0].line)
        other = min(by_sign.values(), key=lambda at: at[0].line)[0].line
        message = f"another decimal sign than in line {other}"
        hint = "Write all numbers alike; a sign between thousands is not read."
        raise InputError(sheet.problem(row, message, k, found=repr(row.cells[k]), hint=hint))
    return next(iter(by_sign), ".")


def _workbook(path: Path, sheet: str, ignore: Sequence[str]) -> Sheet:
    """A sheet of an Excel workbook: the stated one, or the only one that holds anything."""
    found = _sheets(path)
    filled = {name: rows for name, rows in found.items() if rows}
    if sheet and sheet not in filled:
        allowed = ", ".join(filled) or "none that holds anything"
        raise InputError(
            Problem("has no such sheet", str(path), found=repr(sheet), allowed=allowed, hint=nearest(sheet, filled))
        )
    if not filled:
        raise InputError(Problem("is an empty workbook", str(path)))
    if not sheet and len(filled) > 1:
        names = ", ".join(filled)
        problem = Problem(
            "holds several sheets, and nothing says which one is meant",
            str(path),
            found=names,
            hint="State one of them.",
            argument=("sheet", f"'{next(iter(filled))}'"),
        )
        raise InputError(problem)
    name = sheet or next(iter(filled))
    width = max(len(r.cells) for r in filled[name])
    rows = [
        replace(r, cells=(*r.cells, *[""] * (width - len(r.cells) if len(r.cells) > 1 else 0))) for r in filled[name]
    ]
    return _of_layout(Sheet(path, name, (), ()), lay_out(rows, ignore), "")


def _sheets(path: Path) -> dict[str, list[SheetRow]]:
    """The rows of every sheet that hold anything, trailing empty cells left out."""
    try:
        import openpyxl
    except ImportError as error:
        raise missing_extra(f"{path}: reading Excel workbooks needs openpyxl", "excel") from error
    _check_archive(path)
    try:
        book = cast("Any", openpyxl).load_workbook(path, read_only=True, data_only=True)
        out, size = dict[str, list[SheetRow]](), _Size()
        for sheet in book.worksheets:
            sheet.reset_dimensions()  # what the file says of its size need not be true
            out[str(sheet.title)] = _rows(path, sheet.iter_rows(values_only=True), size)
        book.close()
    except InputError:
        raise
    except Exception as error:  # it raises many kinds on what is no workbook
        hint = "Open it in Excel and save it again, or export the points as CSV."
        raise InputError(Problem("cannot be read as an Excel workbook", str(path), hint=hint)) from error
    return out


def _check_archive(path: Path) -> None:
    """InputError for what would grow without end, or for XML that defines entities."""
    import zipfile

    try:
        with zipfile.ZipFile(path) as archive:
            parts = archive.infolist()
            if sum(p.file_size for p in parts) > _UNPACKED or len(parts) > 10_000:
                raise InputError(Problem(f"unpacks to more than {_UNPACKED // 1_000_000} MB", str(path)))
            for part in (p for p in parts if not p.filename.startswith("xl/media/")):
                if part.file_size > _PART and not part.filename.startswith(_LARGE_PARTS):
                    raise InputError(Problem(f"holds a part of more than {_PART // 1_000_000} MB", str(path)))
                with archive.open(name=part) as stream:
                    start = stream.read(4096)
                    if b"<!DOCTYPE" in start or b"<!ENTITY" in start:
                        raise InputError(Problem("holds XML that no workbook holds", str(path)))
    except InputError:
        raise
    except Exception as error:  # a packed file that is cut or made by hand fails in many ways
        hint = "Open it in Excel and save it again, or export the points as CSV."
        raise InputError(Problem("cannot be read as an Excel workbook", str(path), hint=hint)) from error


@dataclass
class _Size:
    """What was read of a workbook so far: cells, with one for each row, and the characters that stand in them."""

    cells: int = 0
    characters: int = 0


def _rows(path: Path, values: Iterable[Sequence[object]], size: _Size) -> list[SheetRow]:
    out: list[SheetRow] = []
    for number, row in enumerate(values, start=1):
        lengths = [len(v) for v in row if isinstance(v, str)]
        size.cells, size.characters = size.cells + len(row) + 1, size.characters + sum(lengths)
        too_large = size.cells > _MOST_CELLS or size.characters > LARGEST or max(lengths, default=0) > _LONGEST
        if number > MOST_LINES or len(row) > MOST_COLUMNS or too_large:
            allowed = f"{MOST_LINES} rows, {MOST_COLUMNS} columns, {_MOST_CELLS} cells of {_LONGEST} characters"
            allowed += f", {LARGEST // 1_000_000} million characters in all"
            hint = "Split it, or export the points as CSV."
            raise InputError(Problem("the workbook is larger than that", str(path), number, allowed=allowed, hint=hint))
        cells = [_cell(v) for v in row]
        while cells and not cells[-1]:
            cells.pop()
        if cells and not _COMMENT.match(cells[0]):
            out.append(SheetRow(number, tuple(cells)))
    return out


def _cell(value: object) -> str:
    """The text of a workbook's cell: numbers with all their digits, dates as ISO has them."""
    import datetime

    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value)
    if isinstance(value, float):
        return repr(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
    if isinstance(value, datetime.datetime | datetime.time):
        return value.isoformat()
    text = str(value).strip()
    if _CONTROL.search(text):
        raise InputError("a control character in a cell of the workbook")
    return text
