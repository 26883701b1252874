"""Readers of files that instruments and controllers write: what a reader is handed, what it gives, and its check.

A reader is a function of one file. It knows its files by what stands in them, and gives None for all others:

    def read(file: MeasuredFile) -> PointTable | None: ...

It states nothing that the file does not: units stand in its header as the file has them, `x [mm]`, and a column whose
meaning the importer does not know is listed to the user. Which pose, marker and load a row is of, the importer finds.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import EntryPoint
from pathlib import Path

from qsframework.errors import InputError, PluginError, Problem, QsfError
from qsframework.installed import READERS, entries, label, load
from qsframework.plugin.check import Report, cuts

_UTF16 = (b"\xff\xfe", b"\xfe\xff")
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")


@dataclass(frozen=True)
class MeasuredFile:
    """A file as it was exported: its path and its bytes."""

    path: Path
    content: bytes

    @property
    def encoding(self) -> str:
        """utf-16, utf-8-sig or cp1252; "" where the file is in none of them."""
        return self._decoded[0]

    @cached_property
    def text(self) -> str:
        """What the file says, "" where it is no text: of no known encoding, or with control characters."""
        _, text = self._decoded
        return "" if _CONTROL.search(text) else text

    def check_text(self) -> None:
        """InputError where the file is no text, with the line of what none holds."""
        if not self.encoding:
            hint = "Export it as CSV in UTF-8, or as an Excel workbook."
            raise InputError(Problem("is no text that can be read", str(self.path), hint=hint))
        _, text = self._decoded
        if control := _CONTROL.search(text):
            line = text.count("\n", 0, control.start()) + 1
            raise InputError(Problem("is no text table: it holds a control character", str(self.path), line))

    @cached_property
    def _decoded(self) -> tuple[str, str]:
        """The encoding and the text, with its control characters."""
        for encoding in ("utf-16",) if self.content[:2] in _UTF16 else ("utf-8-sig", "cp1252"):
            try:
                return encoding, self.content.decode(encoding)
            except UnicodeDecodeError:
                continue
        return "", ""


@dataclass(frozen=True)
class PointTable:
    """Rows of points or of joint angles. form: what the rows are, such as `points as JSON`; header: names of columns,
    with their units, such as `name`, `x [mm]`, `time [s]`, `A1 [deg]`; rows: the line in the file, and a text for each
    column, "" where the file has none."""

    form: str
    header: tuple[str, ...]
    rows: tuple[tuple[int, tuple[str, ...]], ...]


Reader = Callable[[MeasuredFile], PointTable | None]


def read_points(file: MeasuredFile) -> PointTable | None:
    """What the first installed reader that knows a file gives of it; None where none does.

    Raises:
        InputError: of a file that its reader knows and cannot read, with the line.
        PluginError: of a reader that cannot be imported, that fails, or that gives something else.
    """
    found = (_read(entry, file) for entry in entries(READERS).values())
    return next((table for table in found if table is not None), None)


def _read(entry: EntryPoint, file: MeasuredFile) -> PointTable | None:
    try:
        table = load(entry)(file)
    except QsfError:
        raise
    except Exception as error:  # whatever a stranger's reader does
        raise PluginError(f"{label(entry)} fails on {file.path}: {type(error).__name__}: {error}") from error
    if not (table is None or isinstance(table, PointTable)):
        raise PluginError(f"{label(entry)} gives {type(table).__name__} of {file.path}, allowed: PointTable or None")
    return table


def check_reader(reader: Reader, example: Path) -> Report:
    """Does a reader keep the protocol? Run it on every reader you write.

    Args:
        reader: the function.
        example: a file that the reader knows.

    Returns:
        The names of the checks that held, and what did not.
    """
    report, content = Report(), example.read_bytes()
    table = report.attempt("reads its example", lambda: reader(MeasuredFile(example, content)))
    report.record("knows its example", isinstance(table, PointTable), f"gave {type(table).__name__}")
    if isinstance(table, PointTable):
        _check_table(report, table, content.count(b"\n") + 1)
    for name, foreign in (("an empty file", b""), ("another text", b"a,b\n1,2\n"), ("bytes", bytes(range(256)))):
        file = MeasuredFile(Path(name), foreign)
        given = report.attempt(f"reads {name}", lambda own=file: reader(own))
        report.record(f"leaves {name} to others", given is None, f"gave {given!r}")
    for cut in cuts(len(content)):
        file = MeasuredFile(example, content[:cut])
        report.bears(f"bears a file that ends after {cut} bytes", lambda own=file: reader(own))
    return report


def _check_table(report: Report, table: PointTable, lines: int) -> None:
    """Rows as wide as the header, each with its line, all of texts."""
    wide = [line for line, cells in table.rows if len(cells) != len(table.header)]
    report.record("has a cell for each column", not wide, f"not in line {wide[:1]}")
    report.record("holds rows", bool(table.rows), "none")
    report.record("names each column once", len({*table.header}) == len(table.header), f"{table.header}")
    numbers = [line for line, _ in table.rows]
    inside = all(1 <= line <= lines for line in numbers) and numbers == sorted(numbers)
    report.record("counts lines from 1, in order", inside, f"{numbers[:5]} of {lines} lines")
    kinds = {type(cell).__name__ for _, cells in table.rows for cell in cells} - {"str"}
    report.record("leaves numbers as texts", not kinds, f"{sorted(kinds)}")
