"""Readings as they come: typed or pasted, or a file of the tracker's; each ends in the same verb."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from qsf_day.protocol import write_reading_file
from qsf_day.record import Entry, Slot, rows_of
from qsf_day.session import Day, Judged, enter, enter_states
from qsf_trackers import import_readings
from qsframework.errors import InputError, Problem
from qsframework.experiment import make_table, read_table, state_columns
from qsframework.files import sha256, write_text
from qsframework.plugin import Array

_LARGEST = 5_000_000
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


class Unconfirmed(InputError):
    """Plain points, which do not say whose they are: nobody has confirmed a state for them."""


def enter_text(day: Day, text: str, slot: Slot | None = None) -> tuple[Day, list[Judged]]:
    """The day with readings of a state, the one that comes next in `day` if None, from typed or pasted text; or with
    rows of a table with its header, which name theirs.

    A line is `m1 2345.678 -12.345 987.654`, mm, any blanks, commas or semicolons between; without names the markers
    that are missing come in their order. InputError with each line that is none; nothing is stored then.
    """
    if len(text) > _LARGEST:
        raise InputError(Problem("the text", found=f"{len(text)} characters", allowed=f"up to {_LARGEST}"))
    lines = _lines(text)
    if not _is_table(lines):
        slot = day.next if slot is None else slot
        day, judged = enter(day, _positions(day, lines, slot), slot)
        return day, [judged]
    with TemporaryDirectory() as folder:
        path = Path(folder) / "pasted.csv"
        write_text(path, "\n".join(lines) + "\n")
        return enter_states(day, _of_table(day, path))


def enter_file(day: Day, path: Path, slot: Slot | None = None) -> tuple[Day, list[Judged]]:
    """The day with the readings of a file: a table of states, a tracker's export through the importers, or plain points
    of the state that somebody has confirmed (`slot`), which is the next. Of a file that was taken in before, and of
    readings that are there, nothing is taken.

    InputError where it is none, Unconfirmed for plain points without a slot; the file stays as it is.
    """
    content = path.read_bytes() if path.stat().st_size <= _LARGEST else b""
    if not content:
        raise InputError(Problem("is empty, or no file of readings", str(path), allowed=f"1 to {_LARGEST} bytes"))
    file = {"name": path.name, "sha256": hashlib.sha256(content).hexdigest()}
    if file["sha256"] in day.record.files:
        return day, []
    entries = _plain(day, _lines(content.decode("utf-8", "replace")), slot)
    of_next = entries is not None
    if entries is None:
        table = _is_table(_lines(content.decode("utf-8", "replace")))
        entries = _of_table(day, path) if table else _imported(day, path)
    elif slot is None:
        hint = "Confirm the state that they are of, or send a table or an export that names poses."
        raise Unconfirmed(Problem("holds points without a pose", str(path), hint=hint))
    if sha256(path) != file["sha256"]:
        raise InputError(Problem("is still being written", str(path)))
    return enter_states(day, entries, of_next, file)


def _plain(day: Day, lines: list[str], slot: Slot | None) -> list[Entry] | None:
    """Lines of plain points as readings of a state; None where they are something else."""
    slot = slot or day.next
    if _is_table(lines) or slot is None:
        return None
    try:
        xyz = _positions(day, lines, slot)
    except InputError:
        return None
    return [Entry(slot=slot, xyz=xyz, pendant=day.record.visit(slot).pendant, wrench=day.record.state(slot).wrench)]


def _lines(text: str) -> list[str]:
    return [line.strip() for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]


def _is_table(lines: list[str]) -> bool:
    return bool(lines) and re.match(r"pose\s*,", lines[0]) is not None


def _of_table(day: Day, path: Path) -> list[Entry]:
    """The states of one of our own tables."""
    table = read_table(path, state_columns(day.experiment), day.experiment.robot.name)
    return rows_of(table, day.experiment, day.record.protocol)


def _imported(day: Day, path: Path) -> list[Entry]:
    """The states that the importers make of a tracker's file, by the names of its points."""
    with TemporaryDirectory() as folder:
        plan = Path(folder) / "protocol.csv"
        write_reading_file(plan, day.record.protocol)
        found = import_readings(day.experiment, [path], plan)
    cells = list(enumerate([found.header, *found.rows], start=1))
    table = make_table(path, cells, state_columns(day.experiment))
    return rows_of(table, day.experiment, day.record.protocol)


def read_positions(text: str, names: tuple[str, ...]) -> dict[str, Array]:
    """Positions (3,) m by name of lines in mm, `name x y z` or `x y z` in the order of the names. InputError with every
    line that is none."""
    return _read(_lines(text), names, names)


def _positions(day: Day, lines: list[str], slot: Slot | None) -> dict[str, Array]:
    """Those of the markers that are missing at a state."""
    markers = day.record.protocol.markers
    own = markers if slot is None else day.record.visit(slot).markers
    missing = own if slot is None else tuple(m for m in own if m not in day.record.at(slot))
    return _read(lines, missing, markers)


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
