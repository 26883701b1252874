"""Readings as they come: typed or pasted, or a file of the tracker's; each ends in the same verb."""

from __future__ import annotations

import hashlib
import re
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from qsframework.applications.day.day import Day, Judged, enter, reread
from qsframework.applications.day.record import DayRow, Slot, rows_of, taken_in
from qsframework.applications.importers import import_readings
from qsframework.applications.protocol import write_reading_file
from qsframework.errors import InputError, Problem
from qsframework.experiment.columns import write_table
from qsframework.files import write_text
from qsframework.plugin import Array

_LARGEST = 5_000_000
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def enter_text(day: Day, text: str) -> tuple[Day, list[Judged]]:
    """The day with readings of the next state from typed or pasted text, or rows of a table with its header.

    A line is `m1 2345.678 -12.345 987.654`, mm, any blanks, commas or semicolons between; without names the markers
    that are missing come in their order. InputError with each line that is none; nothing is stored then.
    """
    if len(text) > _LARGEST:
        raise InputError(Problem("the text", found=f"{len(text)} characters", allowed=f"up to {_LARGEST}"))
    lines = _lines(text)
    if not _is_table(lines):
        day, judged = enter(day, _positions(day, lines))
        return day, [judged]
    with TemporaryDirectory() as folder:
        path = Path(folder) / "pasted.csv"
        write_text(path, "\n".join(lines) + "\n")
        return _enter_rows(day, rows_of(path, day.experiment, day.record.protocol))


def enter_file(day: Day, path: Path) -> tuple[Day, list[Judged]]:
    """The day with the readings of a file: the points of the next state, a table of states, or a tracker's export
    through the importers. InputError where it is none, or was taken in before; the file stays as it is."""
    day = reread(day)
    content = path.read_bytes() if path.stat().st_size <= _LARGEST else b""
    if not content:
        raise InputError(Problem("is empty, or no file of readings", str(path), allowed=f"1 to {_LARGEST} bytes"))
    hash = hashlib.sha256(content).hexdigest()
    if hash in day.record.files:
        raise InputError(Problem("was taken in before", str(path), hint="A second reading of a state is decided upon."))
    lines = _lines(content.decode("utf-8", "replace"))
    try:
        rows = rows_of(path, day.experiment, day.record.protocol) if _is_table(lines) else None
        values = {} if rows else _positions(day, lines)
    except InputError:
        if _is_table(lines):
            raise
        rows, values = _imported(day, path), {}
    if rows:
        day, judged = _enter_rows(day, rows)
    else:
        day, one = enter(day, values)
        judged = [one]
    return replace(day, record=taken_in(day.record, path.name, hash)), judged


def _lines(text: str) -> list[str]:
    return [line.strip() for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]


def _is_table(lines: list[str]) -> bool:
    return bool(lines) and re.match(r"pose\s*,", lines[0]) is not None


def _imported(day: Day, path: Path) -> list[DayRow]:
    """The rows that the importers make of a tracker's file, by the names of its points."""
    with TemporaryDirectory() as folder:
        plan, table = Path(folder) / "protocol.csv", Path(folder) / "readings.csv"
        write_reading_file(plan, day.record.protocol)
        found = import_readings(day.experiment, [path], plan)
        write_table(table, found.header, found.rows, [f"robot: {day.record.robot}"])
        return rows_of(table, day.experiment, day.record.protocol)


def _enter_rows(day: Day, rows: list[DayRow]) -> tuple[Day, list[Judged]]:
    """State after state, as the rows stand."""
    groups: dict[Slot, list[DayRow]] = {}
    for row in rows:
        groups.setdefault(row.slot, []).append(row)
    said: list[Judged] = []
    for slot, own in groups.items():
        day, judged = enter(day, {row.marker: row.xyz for row in own}, slot, own[0].pendant, own[0].wrench)
        said.append(judged)
    return day, said


def read_positions(text: str, names: tuple[str, ...]) -> dict[str, Array]:
    """Positions (3,) m by name of lines in mm, `name x y z` or `x y z` in the order of the names. InputError with every
    line that is none."""
    return _read(_lines(text), names, names)


def _positions(day: Day, lines: list[str]) -> dict[str, Array]:
    """Those of the markers that are missing at the next state."""
    slot, markers = day.next, day.record.protocol.markers
    read = set[str]() if slot is None else set(day.record.at(slot))
    return _read(lines, tuple(m for m in markers if m not in read), markers)


def _read(lines: list[str], missing: tuple[str, ...], names: tuple[str, ...]) -> dict[str, Array]:
    out: dict[str, Array] = {}
    problems: list[Problem] = []
    for i, line in enumerate(lines, start=1):
        parts = [p for p in re.split(r"[\s,;]+", line) if p]
        named = bool(parts) and parts[0] in names
        name = parts[0] if named else next((m for m in missing if m not in out), "")
        numbers = parts[1:] if named else parts
        if len(numbers) != 3 or not all(_NUMBER.fullmatch(n) for n in numbers) or not name or name in out:
            shown = line if len(line) <= 60 else line[:57] + "..."
            allowed = f"one of {', '.join(missing or names)}, and x y z in mm"
            problems.append(Problem("no reading", line=i, found=repr(shown), allowed=allowed))
            continue
        out[name] = 1e-3 * np.array([float(n) for n in numbers])
    if problems or not out:
        raise InputError(problems or [Problem("no reading was given", allowed="a line for each marker: m1 x y z, mm")])
    return out
