"""Tables as other programs write them: any separator, decimal comma, lines of text above, Excel workbooks.

What is found out of the text itself - the separator, the decimal sign, the encoding - is kept with the table, so that
it can be shown. Numbers stay text here, with their row.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

from qsf_trackers.layout import Sheet, SheetRow, is_axis_line, is_data, lay_out
from qsf_trackers.options import ImportOptions
from qsframework.errors import InputError, Problem, missing_extra, nearest
from qsframework.experiment.columns import LARGEST, MOST_COLUMNS, MOST_LINES, unquoted
from qsframework.files.documents import read_bytes
from qsframework.plugin import MeasuredFile, read_points

NOTHING_STATED = ImportOptions()
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


def read_sheet(path: Path, options: ImportOptions = NOTHING_STATED) -> Sheet:
    """Read the table of a file; options: which sheet of a workbook, its separator and decimal sign where stated,
    names of columns to ignore.

    InputError where it is no table, or where more than one reading of it is possible.
    """
    content = read_bytes(path, LARGEST)
    file = MeasuredFile(path, content)
    if (points := read_points(file)) is not None:
        rows = [SheetRow(1, points.header), *(SheetRow(line, cells) for line, cells in points.rows)]
        whole = Sheet(path, decimal=".", encoding=file.encoding.removesuffix("-sig"), form=points.form)
        return lay_out(whole, rows, options.ignore)
    if content.startswith(_OLD_EXCEL):
        hint = "Save it as .xlsx or as CSV."
        raise InputError(Problem("is a workbook of the old Excel format", str(path), hint=hint))
    if content.startswith(_ZIP):
        return _workbook(path, options.sheet, options.ignore)
    if path.suffix.lower() in WORKBOOKS:
        raise InputError(Problem("is no Excel workbook, though its name says so", str(path), hint="Export it again."))
    if options.sheet:
        found, hint = repr(options.sheet), "Leave the sheet out."
        raise InputError(Problem("is a text, which has no sheets", str(path), found=found, hint=hint))
    file.check_text()
    whole = Sheet(path, decimal=".", encoding=file.encoding.removesuffix("-sig"))
    found, whole = _text_rows(whole, file.text, options.separator)
    whole = lay_out(whole, found, options.ignore)
    return replace(whole, decimal=options.decimal or _decimal(whole))


def _text_rows(sheet: Sheet, text: str, separator: str) -> tuple[list[SheetRow], Sheet]:
    """The rows of a text, and the sheet with its separator and its comments."""
    every = text.splitlines()
    if len(every) > MOST_LINES:
        hint = "Split it into several files."
        raise InputError(Problem(f"holds more than {MOST_LINES} lines", sheet.where, hint=hint))
    lines = [(i, line) for i, line in enumerate(every, start=1) if line.strip()]
    comments = [(i, line.strip()) for i, line in lines if _COMMENT.match(line)]
    lines = [(i, line) for i, line in lines if not _COMMENT.match(line)]
    if not lines:
        raise InputError(Problem("is empty", sheet.where))
    name = separator or _separator(lines)
    if name == "tab" and not separator and _even(lines, "space") and not _even(lines, name):
        name = "space"  # a tab too many, or a blank in place of one
    rows = [SheetRow(i, _split(line, name)) for i, line in lines]
    first = [line for i, line in comments if i < rows[0].line]
    heading = _split(first[-1].lstrip("#/!% "), name) if first else ()
    if is_data(rows[0].cells) and len(heading) == len(rows[0].cells):  # as numpy and gnuplot write it
        rows.insert(0, SheetRow(lines[0][0] - 1, heading))
    return rows, replace(sheet, above=tuple(line for _, line in comments), separator=name)


def _split(line: str, name: str) -> tuple[str, ...]:
    """The cells of a line."""
    if name == "space":
        return tuple(line.split())
    try:
        cells = next(csv.reader([line], delimiter=SEPARATORS[name], skipinitialspace=True), list[str]())
    except csv.Error:
        cells = line.split(SEPARATORS[name])
    return tuple(unquoted(cell.strip()) for cell in cells)


def _even(lines: Sequence[tuple[int, str]], name: str) -> bool:
    """Whether all lines have as many cells."""
    return len({len(_split(line, name)) for _, line in lines}) == 1


def _separator(lines: Sequence[tuple[int, str]]) -> str:
    """The separator by which most lines become rows of numbers."""
    scores = {
        name: sum(is_data(cells) or is_axis_line(cells) for _, line in lines[:_TRIED] if (cells := _split(line, name)))
        for name in SEPARATORS
    }
    return max(scores, key=lambda name: scores[name])


def _decimal(sheet: Sheet) -> str:
    """The decimal sign; InputError where a file has both, as it would read 1,234 in two ways."""
    by_sign: dict[str, tuple[int, int]] = {}
    for i, row in enumerate(sheet.rows):
        for k, cell in enumerate(row.cells):
            sign = next((s for s in DECIMALS if s in cell), None)
            if sign is not None and NUMBER.fullmatch(cell):
                by_sign.setdefault(sign, (i, k))
    if len(by_sign) == 2:
        (first, _), (i, k) = by_sign.values()
        message = f"another decimal sign than in line {sheet.rows[first].line}"
        hint = "Write all numbers alike; a sign between thousands is not read."
        raise InputError(sheet.problem(i, message, k, found=repr(sheet.rows[i].cells[k]), hint=hint))
    return next(iter(by_sign), ".")


def _workbook(path: Path, sheet: str, ignore: Sequence[str]) -> Sheet:
    """A sheet of an Excel workbook: the stated one, or the only one that holds anything."""
    filled = {name: rows for name, rows in _sheets(path).items() if rows}
    names = ", ".join(filled)
    if sheet and sheet not in filled:
        allowed, hint = names or "none that holds anything", nearest(sheet, filled)
        raise InputError(Problem("has no such sheet", str(path), found=repr(sheet), allowed=allowed, hint=hint))
    if not filled:
        raise InputError(Problem("is an empty workbook", str(path)))
    name = sheet or next(iter(filled))
    if not sheet and len(filled) > 1:
        message = "holds several sheets, and nothing says which one is meant"
        argument = ("sheet", f"'{name}'")
        raise InputError(Problem(message, str(path), found=names, hint="State one of them.", argument=argument))
    width = max(len(r.cells) for r in filled[name])
    rows = [SheetRow(r.line, (*r.cells, *("",) * (width - len(r.cells)) * (len(r.cells) > 1))) for r in filled[name]]
    whole = lay_out(Sheet(path, name), rows, ignore)
    return replace(whole, decimal=_decimal(whole))


def _sheets(path: Path) -> dict[str, list[SheetRow]]:
    """The rows of every sheet that hold anything, trailing empty cells left out."""
    try:
        import openpyxl
    except ImportError as error:
        raise missing_extra(f"{path}: reading Excel workbooks needs openpyxl", "excel") from error
    try:
        _check_archive(path)
        book = cast("Any", openpyxl).load_workbook(path, read_only=True, data_only=True)
        out, size = dict[str, list[SheetRow]](), _Size()
        for sheet in book.worksheets:
            sheet.reset_dimensions()  # what the file says of its size need not be true
            out[str(sheet.title)] = _rows(path, sheet.iter_rows(values_only=True), size)
        book.close()
    except InputError:
        raise
    except Exception as error:  # a packed file that is cut, made by hand or no workbook fails in many ways
        hint = "Open it in Excel and save it again, or export the points as CSV."
        raise InputError(Problem("cannot be read as an Excel workbook", str(path), hint=hint)) from error
    return out


def _check_archive(path: Path) -> None:
    """InputError for what would grow without end, or for XML that defines entities."""
    import zipfile

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
