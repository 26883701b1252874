"""CSV tables whose column names carry their unit: read with every problem found, written all or nothing."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from qsframework import plausible, units
from qsframework.errors import MOST_PROBLEMS, InputError, Problem, near_name, nearest, refuse, some_of
from qsframework.files import read_text, write_text
from qsframework.files.documents import DECIMAL
from qsframework.plugin import Array, Indices

LARGEST, MOST_LINES, MOST_COLUMNS = 50_000_000, 250_000, 1000
"""Bytes, lines and columns of a table."""
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1b\x1f\x7f-\x84\x86-\x9f]")
"""Characters that a terminal obeys instead of showing them."""
_ENDS = ("\n", "\r", "\v", "\f", "\x1c", "\x1d", "\x1e", "\x85", "\u2028", "\u2029")
"""What `str.splitlines` takes for the end of a line."""
_MOST = 100_000
_GREATEST = 1e15
_TRUE, _FALSE = ("1", "true", "yes"), ("0", "false", "no")
_LONGEST, _SHOWN = 200, 60
"""Characters of a name, and of a cell that is shown."""
XYZ, FORCE, MOMENT = ("x", "y", "z"), ("fx", "fy", "fz"), ("mx", "my", "mz")
WRENCH = (*FORCE, *MOMENT)
WRENCH_NAMES = ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")
"""How a wrench is written."""
_MEASURED = ("dx", "dy", "dz", "x", "y", "z", "gauge", "ux", "uy", "uz", "sigma")
"""Columns that may hold anything in a row that is masked (use = 0): that is why it is masked."""


IMPORT = "`qsf import EXPERIMENT FILE` makes readings of it."
"""What to do with the file of another program."""
_OURS = re.compile(r"pose|target|marker|state|reflector|load|(?:d?[xyz]|q\d+|f[xyz]|gauge)_\w+")
"""Columns of which every table of ours has some."""


_NOTHING = ("nan", "na", "n/a", "-", "none", "null", "#n/a")
"""What other programs write where nothing was measured."""
Check = Callable[[Any, str], Problem | None]
"""What is wrong with a value, a text or a number in SI, of a column that the file calls so; None where nothing is."""


WholeCheck = Callable[[Mapping[str, Array], str], tuple[int, Problem] | None]
"""What is wrong with a column that the file calls so, of all numbers by their stems: the row and the problem."""


@dataclass(frozen=True)
class Column:
    """A column: kind "text", "number" (with its SI unit), "count" (1, 2, ...), "flag", or "side" (-1, +1).

    `blank`: a cell may be empty and is then NaN; check: of every cell that is not, of what is measured in use alone;
    whole: of all its cells
    """

    stem: str
    kind: str
    unit: str = ""
    _: KW_ONLY
    required: bool = False
    blank: bool = False
    check: Check | None = None
    whole: WholeCheck | None = None

    def spelling(self) -> str:
        return units.allowed_names(self.stem, self.unit) if self.unit else self.stem


@dataclass(frozen=True, eq=False)
class Table:
    """Values by stem, SI; `rows` are line numbers in the file, `names` the columns as the file spells them."""

    path: Path
    rows: list[int]
    names: dict[str, str]
    numbers: dict[str, Array]
    texts: dict[str, list[str]]
    problems: list[Problem]

    def column(self, stem: str, missing: float = math.nan) -> Array:
        """Numbers (R,) of a column, `missing` in all rows where the table does not have it."""
        return self.numbers.get(stem, np.full(len(self.rows), missing))

    def columns(self, stems: Sequence[str], missing: float = math.nan) -> Array:
        """Numbers (R, n) of several columns."""
        return np.stack([self.column(stem, missing) for stem in stems], axis=1)

    def text(self, stem: str) -> list[str]:
        """Words (R,) of a column, "" in all rows where the table does not have it."""
        return self.texts.get(stem, [""] * len(self.rows))

    def counts(self, stem: str) -> list[int]:
        """Whole numbers (R,) of a column, 1 where nothing stands."""
        return np.nan_to_num(self.column(stem), nan=1.0).astype(int).tolist()

    def problem(
        self,
        i: int,
        stem: str,
        message: str,
        found: str | None = None,
        allowed: str | None = None,
        hint: str | None = None,
    ) -> Problem:
        """A problem in row i, in the column of this stem."""
        name = self.names.get(stem, stem)
        return Problem(message, str(self.path), self.rows[i], name, found=found, allowed=allowed, hint=hint)

    def each(self, wrong: npt.NDArray[np.bool_], stem: str, message: str, hint: str | None = None) -> list[Problem]:
        """The same problem in each of the rows (R,) that are wrong."""
        rows = np.flatnonzero(wrong)[:MOST_PROBLEMS].tolist()
        return [self.problem(i, stem, message, hint=hint) for i in rows]


def joint_stems(joints: int) -> list[str]:
    """q1, q2, ..."""
    return [f"q{k + 1}" for k in range(joints)]


def force_columns(required: bool, blank: bool = False) -> list[Column]:
    """Columns of a force and of a moment, which may always be missing."""
    forces = [Column(f, "number", "N", required=required, blank=blank) for f in FORCE]
    return [*forces, *(Column(m, "number", "N m", blank=blank) for m in MOMENT)]


def numbered(keys: Sequence[Hashable]) -> tuple[Indices, Indices]:
    """Number of each key, in the order of their first rows, and these rows."""
    number: dict[Hashable, int] = {}
    group = np.array([number.setdefault(key, len(number)) for key in keys], dtype=np.intp)
    return group, np.unique(group, return_index=True)[1]


def check_ours(path: Path, allowed: str) -> None:
    """InputError, one for the file, where a table is of another program or saved by a spreadsheet in its own way."""
    if not path.is_file():
        return
    with path.open("rb") as stream:
        start = stream.read(8)
    if start.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        raise InputError(Problem("is an Excel workbook, not a table in CSV", str(path), hint=IMPORT))
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputError(Problem("is a text in UTF-16, not in UTF-8", str(path), hint=IMPORT))
    try:
        numbered = [(i, line) for i, line in enumerate(table_lines(path), start=1) if line.strip()]
    except InputError as error:
        if isinstance(error.__cause__, UnicodeDecodeError):  # as spreadsheets write it
            raise InputError([replace(p, hint=IMPORT) for p in error.problems]) from error
        raise
    number, line = next(((i, x) for i, x in numbered if not x.lstrip().startswith("#")), (1, ""))
    ours = [name for name in re.split(r"[;\t|,]", line.lower()) if _OURS.fullmatch(name.strip())]
    if line and len(ours) < 2:
        found = repr(line if len(line) <= 60 else line[:57] + "...")
        message = "is no table of ours: its first line names none of the columns"
        raise InputError(Problem(message, str(path), number, found=found, allowed=allowed, hint=IMPORT))


def read_table(path: str | Path, columns: Sequence[Column], robot: str, foreign: str | None = None) -> Table:
    """Read a table. InputError at once where its header is wrong; problems in cells are collected.

    foreign: what to do with a table whose columns another sign separates, of a file that `check_ours` has passed
    """
    path = Path(path)
    if foreign is None:
        check_ours(path, ", ".join(c.stem for c in columns if c.required) or columns[0].stem)
    lines = [(i, line) for i, line in enumerate(table_lines(path), start=1) if line.strip()]
    _check_robot(path, lines, robot)
    lines, problems = _without_comments(path, lines)
    if not lines:
        raise InputError(
            Problem("is empty", file=str(path), allowed=", ".join(c.spelling() for c in columns if c.required))
        )
    return make_table(path, _cells(path, lines, foreign), columns, problems)


def make_table(
    path: Path, parsed: Sequence[tuple[int, Sequence[str]]], columns: Sequence[Column], problems: Sequence[Problem] = ()
) -> Table:
    """A table of cells, each row with its line, the header first; problems: those of its lines.

    InputError at once where its header is wrong; problems in cells are collected.
    """
    problems = list(problems)
    header = [cell.strip() for cell in parsed[0][1]]
    if len(header) > MOST_COLUMNS:
        raise InputError(Problem(f"holds more than {MOST_COLUMNS} columns", file=str(path), line=parsed[0][0]))
    chosen = _read_header(path, parsed[0][0], header, columns)
    if len(parsed) == 1:
        raise InputError(Problem("holds a header and no rows", file=str(path), line=parsed[0][0]))
    problems += _odd_rows(path, parsed)
    good = [(line, cells) for line, cells in parsed[1:] if len(cells) == len(header)]
    if not good:
        raise InputError(problems)
    table = Table(
        path, [line for line, _ in good], {c.stem: header[i] for i, (c, _) in chosen.items()}, {}, {}, problems
    )
    switch = next((i for i, (column, _) in chosen.items() if column.stem == "use"), None)
    masked = (
        set[int]() if switch is None else {r for r, (_, c) in enumerate(good) if c[switch].strip().lower() in _FALSE}
    )
    for i, (column, unit) in chosen.items():
        cells = [row[i].strip() for _, row in good]
        if column.required or any(cells):  # an optional column that nobody filled in is as good as not there
            _read_column(table, column, unit, cells, masked)
    for column, _ in chosen.values():
        if column.whole is not None and column.stem in table.numbers:
            name = table.names[column.stem]
            if (wrong := column.whole(table.numbers, name)) is not None:
                problems.append(replace(wrong[1], file=str(path), line=table.rows[wrong[0]], column=name))
    if len(problems) > MOST_PROBLEMS:
        raise InputError(problems)
    return table


def _odd_rows(path: Path, parsed: Sequence[tuple[int, Sequence[str]]]) -> list[Problem]:
    """One problem for all rows whose number of cells is not the header's."""
    width = len(parsed[0][1])
    odd = [(line, cells) for line, cells in parsed[1:] if len(cells) != width]
    if not odd:
        return []
    long = all(len(cells) > width for _, cells in odd) and not any("." in c for _, cells in odd for c in cells)
    hint = "Do the numbers have decimal commas? Write them with a point." if long else None
    many = f" in {len(odd)} of {len(parsed) - 1} rows, of which this is the first" if len(odd) > 1 else ""
    line, cells = odd[0]
    message = f"wrong number of columns{many}"
    return [Problem(message, str(path), line, found=str(len(cells)), allowed=str(width), hint=hint)]


def table_lines(path: Path) -> list[str]:
    """The lines of a table. InputError if it is no text, or larger than a table may be."""
    text = read_text(path, LARGEST)
    if "\0" in text:
        raise InputError(Problem("is not a text table: it holds a NUL byte", file=str(path)))
    if control := _CONTROL.search(text):
        line = text.count("\n", 0, control.start()) + 1
        raise InputError(Problem("a control character in a table", str(path), line, found=repr(control.group())))
    if sum(text.count(end) for end in _ENDS) > 2 * MOST_LINES or len(lines := text.splitlines()) > MOST_LINES:
        hint = "Split it into several files."
        raise InputError(Problem(f"holds more than {MOST_LINES} lines", file=str(path), hint=hint))
    return lines


def _without_comments(path: Path, lines: list[tuple[int, str]]) -> tuple[list[tuple[int, str]], list[Problem]]:
    """The table's lines; a `#` below the header may be a pose's name, so it is not silently a comment."""
    start = next((k for k, (_, line) in enumerate(lines) if not line.lstrip().startswith("#")), len(lines))
    hidden = [i for i, line in lines[start:] if line.lstrip().startswith("#")]
    hint = "Take the line out, or mask its reading with 0 in the column use."
    problems = [Problem("a line that starts with # below the header", str(path), i, hint=hint) for i in hidden]
    left_out = set(hidden)
    return [(i, line) for i, line in lines[start:] if i not in left_out], problems[:MOST_PROBLEMS]


def _cells(path: Path, lines: list[tuple[int, str]], foreign: str | None = None) -> list[tuple[int, list[str]]]:
    """Line number and cells of every line."""
    reader = csv.reader(io.StringIO("\n".join(line for _, line in lines)))
    out: list[tuple[int, list[str]]] = []
    try:
        for (number, _), cells in zip(lines, reader, strict=False):
            out.append((number, [unquoted(cell) for cell in cells]))
    except csv.Error as error:
        raise InputError(Problem(f"cannot be split into columns: {error}", str(path), lines[len(out)][0])) from error
    if len(out) != len(lines):
        raise InputError(Problem("a quoted field runs over the end of its line", file=str(path)))
    number, header = out[0]
    for sign, name in ((";", "';'"), ("\t", "a tab")):
        if len(header) == 1 and header[0].count(sign) > 1:
            message = f"the columns are separated by {name}"
            allowed = "a comma between columns, a point in numbers"
            raise InputError(Problem(message, str(path), number, allowed=allowed, hint=foreign))
    last = max((k for k, (_, cells) in enumerate(out) if k and any(map(str.strip, cells))), default=len(out) - 1)
    return [row for k, row in enumerate(out) if k <= last or len(row[1]) > len(header)]  # as a spreadsheet ends them


def _check_robot(path: Path, lines: list[tuple[int, str]], robot: str) -> None:
    for number, line in lines:
        if not line.lstrip().startswith("#"):
            return
        key, _, value = line.lstrip("# \t").partition(":")
        if key.strip() == "robot" and value.strip() != robot:
            raise InputError(Problem("belongs to another robot", str(path), number, found=value.strip(), allowed=robot))


def _read_header(path: Path, line: int, header: list[str], columns: Sequence[Column]) -> dict[int, tuple[Column, str]]:
    """For each position the column and its unit."""
    chosen: dict[int, tuple[Column, str]] = {}
    problems: list[Problem] = []
    measured = {c.stem: c for c in columns if c.unit}
    plain = {c.stem: c for c in columns if not c.unit}
    spellings = [s for c in columns for s in c.spelling().split(", ")]

    unknown = list[str]()

    def wrong(name: str, message: str, allowed: str, hint: str | None = None) -> None:
        problems.append(Problem(message, str(path), line, name, allowed=allowed, hint=hint))

    for i, name in enumerate(header):
        parts = units.split(name, list(measured))
        if name in plain:
            chosen[i] = (plain[name], "")
        elif name in measured:
            wrong(name, "the name does not say its unit", measured[name].spelling())
        elif parts is None:
            unknown.append(name or f"{i + 1}, which has no name")
        elif not units.known(parts[1]) or not units.same_dimension(parts[1], measured[parts[0]].unit):
            weighed = (parts[1], measured[parts[0]].unit) == ("kg", "N")
            hint = "1 kg weighs 9.80665 N, which is 1 kgf." if weighed else None
            wrong(name, f"{parts[1]!r} is no unit of this kind", measured[parts[0]].spelling(), hint)
        else:
            chosen[i] = (measured[parts[0]], parts[1])
    meant, hint = _meant(unknown, columns, spellings)
    if unknown:
        message = f"unknown columns {some_of(unknown)}" if len(unknown) > 1 else "unknown column"
        wrong(unknown[0], message, ", ".join(c.stem for c in columns), hint)
    stems = [c.stem for c, _ in chosen.values()]
    for stem in dict.fromkeys(s for s in stems if stems.count(s) > 1):
        wrong(stem, "this column stands here twice", "once")
    told = {p.column for p in problems} | set(meant)
    for column in columns:
        if (
            column.required
            and column.stem not in stems
            and not any(t == column.stem or (t or "").startswith(column.stem + "_") for t in told)
        ):
            wrong(column.stem, "this column is missing", column.spelling())
    refuse(problems)
    return chosen


def _meant(unknown: Sequence[str], columns: Sequence[Column], spellings: Sequence[str]) -> tuple[list[str], str | None]:
    """The near spellings of unknown names, and the hint: these, or how many joints the robot has."""
    meant = [*dict.fromkeys(near for name in unknown if (near := near_name(name, spellings)))]
    if any(re.match(r"q\d+(_|$)", name) for name in unknown):
        joints = sum(re.fullmatch(r"q\d+", c.stem) is not None for c in columns)
        return meant, f"The robot has {joints} joints, q1 to q{joints}."
    return meant, f"Did you mean {some_of([repr(near) for near in meant])}?" if meant else None


def _read_column(table: Table, column: Column, unit: str, cells: list[str], masked: set[int]) -> None:
    if column.kind == "text":
        table.texts[column.stem] = cells
        for i, cell in enumerate(cells):
            if len(cell) > _LONGEST or (not cell and column.required):
                _wrong(table, i, column, "is too long" if cell else "is empty", cell, f"up to {_LONGEST} characters")
            elif cell:
                _checked(table, i, column, cell)
        return
    values = np.full(len(cells), math.nan)
    for i, cell in enumerate(cells):
        if not cell and column.blank:
            continue
        value, allowed = _value(column, cell)
        judged = value is not None and unit and column.stem not in _MEASURED  # what is measured has words of its own
        far = plausible.beyond(float(units.to_si(value, unit)), column.unit) if judged else None
        if far is not None:
            value, allowed = None, plausible.allowed(far, column.unit, unit)
        if value is None and column.stem in _MEASURED and i in masked:
            continue
        if value is None:
            _wrong(table, i, column, "cannot be used", cell, allowed)
        else:
            values[i] = value
    table.numbers[column.stem] = values = units.to_si(values, unit) if unit else values
    for i in np.flatnonzero(np.isfinite(values)).tolist() if column.check is not None else ():
        if not (column.stem in _MEASURED and i in masked):
            _checked(table, i, column, float(values[i]))


def _checked(table: Table, i: int, column: Column, value: float | str) -> None:
    """The problem that a column's own check finds with a value."""
    name = table.names[column.stem]
    problem = None if column.check is None else column.check(value, name)
    if problem is not None and len(table.problems) <= MOST_PROBLEMS:
        table.problems.append(replace(problem, file=str(table.path), line=table.rows[i], column=name))


def one_of(names: Sequence[str], message: str, allowed: str = "") -> Check:
    """The check of a text that is one of these."""

    def check(value: str, name: str) -> Problem | None:
        if value in names:
            return None
        return Problem(message, found=repr(value), allowed=allowed or ", ".join(names), hint=nearest(value, names))

    return check


def _value(column: Column, cell: str) -> tuple[float | None, str]:
    if column.kind == "flag":
        lowered = cell.lower()
        return (1.0 if lowered in _TRUE else 0.0 if lowered in _FALSE else None), "1 or 0"
    try:
        value = float(cell) if "_" not in cell and cell.isascii() else math.nan
    except ValueError:
        value = math.nan
    if column.kind == "count":
        return value if 1 <= value <= _MOST and value == int(value) else None, f"1, 2, 3, ... up to {_MOST}"
    if column.kind == "side":
        return value if value in (-1.0, 1.0) else None, "-1 or 1"
    return value if abs(value) <= _GREATEST else None, f"a finite number, at most {_GREATEST:g}"


def _wrong(table: Table, i: int, column: Column, message: str, found: str, allowed: str) -> None:
    if len(table.problems) > MOST_PROBLEMS:
        return
    nothing = column.stem in _MEASURED and found.lower() in _NOTHING
    hint = "Leave the cell empty, or put 0 in the column use of a row that was not measured." if nothing else None
    shown = repr(found if len(found) <= _LONGEST else f"{found[:_SHOWN]}...")
    table.problems.append(table.problem(i, column.stem, message, shown, allowed, hint))


def strength_problems(table: Table, wrench: Array, payload: float | None, gravity: Array) -> list[Problem]:
    """Rows whose force or moment (R, 6) no test of an arm of this payload (kg) applies."""
    g = float(np.linalg.norm(gravity))
    out: list[Problem] = []
    for i, load in enumerate(np.nan_to_num(wrench).tolist()):
        far = plausible.too_strong(load, payload, g)
        if far is not None and len(out) < MOST_PROBLEMS:
            message, letter = (
                f"no test of an arm applies this {far.quantity}; is the column's unit right?",
                far.quantity[0],
            )
            stem = next((c for c in (f"{letter}{axis}" for axis in "zxy") if c in table.names), f"{letter}z")
            out.append(table.problem(i, stem, message, far.found, far.allowed))
    return out


def number(value: float, digits: int = 10) -> str:
    """A number as a table for people holds it: no more digits than say something, no trailing zeros.

    Ten digits of a position in millimetres keep a nanometre to ten metres.
    """
    return f"{value + 0.0:.{digits}g}"


def joint_cells(values: Array, joints: units.JointUnits) -> list[str]:
    """Joint values (n,), rad or m, as a table holds them, in deg or mm: twelve digits keep 1e-9 of either."""
    return [number(v, 12) for v in joints.shown(values).tolist()]


def recorded(value: float) -> str:
    """A time or a temperature: fifteen digits keep ten microseconds of a clock that counts from 1970."""
    return number(value, 15)


def write_table(
    path: str | Path, header: Sequence[str], rows: Sequence[Sequence[str]], comments: Sequence[str]
) -> None:
    """Write a table, all or nothing; comments go first."""
    write_text(path, table_text(header, rows, comments))


def table_text(header: Sequence[str], rows: Sequence[Sequence[str]], comments: Sequence[str] = ()) -> str:
    """Header and rows as a file holds them, comments first."""
    stream = io.StringIO()
    stream.writelines(f"# {comment}\n" for comment in comments)
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerows([[quoted(cell) for cell in row] for row in (header, *rows)])
    return stream.getvalue()


_RUN = re.compile(r"(?:^|(?<=[;\t]))(?='*[=+\-@\t\r].)")
_QUOTED = re.compile(r"(?:^|(?<=[;\t]))'(?='*[=+\-@\t\r].)")
"""Where a spreadsheet runs a cell, which in many countries begins after a semicolon too; and the mark against it."""


def quoted(cell: str) -> str:
    """The cell as a spreadsheet shows it and runs nothing: with an apostrophe before, which our reading takes off."""
    return cell if DECIMAL.fullmatch(cell) else _RUN.sub("'", cell)


def unquoted(cell: str) -> str:
    """The cell that was quoted."""
    return _QUOTED.sub("", cell) if "'" in cell else cell
