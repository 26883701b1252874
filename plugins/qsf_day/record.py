"""What was read on the day: `day.jsonl`, a journal of sealed records, each safe on disk before anybody is answered.

A record is one delivery, one decision or one reading of the floor. It holds all of every state that it speaks of, with
what is said of it, so the last record of a state holds. `readings.csv` and the floor's table are made from it.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from qsf_day.protocol import Protocol, ProtocolState, Visit, row_start
from qsframework.errors import InputError, Problem
from qsframework.experiment import (
    STATES,
    WRENCH,
    WRENCH_NAMES,
    XYZ,
    Experiment,
    Table,
    floor_file,
    joint_stems,
    write_table,
)
from qsframework.files import write_bytes
from qsframework.files.journal import Journal
from qsframework.plugin import Array

TABLE, LOG = "readings.csv", "day.jsonl"
DOUBT = "look again"
"""Said of a state that waits for a decision; the others are "as expected", "kept", "corrected" and "again"."""
_SAME = 1e-6
"""rad, N: angles and forces of a row that differ by less are those of the protocol."""
_WAIT = 10.0
"""s: how long another process is waited for."""
_FLOOR = ["visit", "pose", "repeat", "reflector", "x_mm", "y_mm", "z_mm", "series"]


@dataclass(frozen=True, order=True)
class Slot:
    """One state of one visit: their places in the protocol."""

    visit: int
    state: int


@dataclass(frozen=True, eq=False, kw_only=True)
class Entry:
    """One state as it was read. xyz: positions (3,) m by marker in the tracker's frame `series`; pendant (n,) rad and
    wrench (6,) as the readings have them; time: s since 1970; said: what was judged or decided, "" where nobody has;
    mistake: the kind of it that was named"""

    slot: Slot
    xyz: Mapping[str, Array]
    pendant: Array
    wrench: Array
    series: str = ""
    time: float = 0.0
    said: str = ""
    mistake: str = ""


@dataclass(frozen=True)
class DayRow:
    """One marker at one state: xyz (3,) m in the frame `series`."""

    slot: Slot
    marker: str
    xyz: Array
    series: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Record:
    """What the journal says so far. log: its records; spoilt: lines of it that are none; states: as they stand, in the
    order in which they were read; read: every position that was ever read, as (slot, marker, x, y, z); floor: first
    positions of the reflectors by series and name; series: the frame that the tracker stands in now"""

    folder: Path
    protocol: Protocol
    series: str
    log: tuple[Mapping[str, Any], ...] = ()
    spoilt: tuple[int, ...] = ()
    states: Mapping[Slot, Entry]
    read: frozenset[tuple[Any, ...]] = frozenset()

    @property
    def table(self) -> Path:
        return self.folder / TABLE

    @property
    def rows(self) -> tuple[DayRow, ...]:
        """Every position that stands."""
        entries = self.states.values()
        return tuple(DayRow(e.slot, name, xyz, e.series) for e in entries for name, xyz in e.xyz.items())

    @property
    def doubtful(self) -> list[Slot]:
        """States that wait for a decision."""
        return [slot for slot, entry in self.states.items() if entry.said == DOUBT]

    @property
    def files(self) -> dict[str, str]:
        """Names of the files that were taken in, by their hashes."""
        return {record["file"]["sha256"]: record["file"]["name"] for record in self.log if "file" in record}

    @property
    def floor(self) -> list[Mapping[str, Any]]:
        """The floor's reflectors, reading by reading."""
        return [record["floor"] for record in self.log if "floor" in record]

    def state(self, slot: Slot) -> ProtocolState:
        return self.protocol.visits[slot.visit].states[slot.state]

    def visit(self, slot: Slot) -> Visit:
        return self.protocol.visits[slot.visit]

    def at(self, slot: Slot) -> Mapping[str, Array]:
        """Positions (3,) m of a state by marker."""
        return self.states[slot].xyz if slot in self.states else dict[str, Array]()

    @property
    def slots(self) -> list[Slot]:
        """All states of the protocol, in the order of the day."""
        return [Slot(v, k) for v, visit in enumerate(self.protocol.visits) for k in range(len(visit.states))]

    @property
    def next(self) -> Slot | None:
        """The first state of which a marker is missing; None: the day is done."""
        return next((s for s in self.slots if any(m not in self.at(s) for m in self.visit(s).markers)), None)

    def series_at(self, slot: Slot) -> str:
        """The frame that a state is read in: that of the tracker's present stand, or of the station it is moved to."""
        station = self.visit(slot).station
        return self.series if not station or _stem(self.series) == _stem(station) else station


@contextmanager
def opened(folder: Path, protocol: Protocol) -> Generator[Journal]:
    """The journal of a day, begun or continued, which no other process writes meanwhile. InputError where it is of
    another plan, cannot be read, or is gone while its table stands."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(Problem(f"cannot be written: {error.strerror}", str(folder))) from error
    states = [
        [
            v.pose,
            v.repeat,
            v.pendant.tolist(),
            [s.wrench.tolist() for s in v.states],
            *([v.station] if v.station else []),
        ]
        for v in protocol.visits
    ]
    plan = hashlib.sha256(json.dumps([states, protocol.markers]).encode()).hexdigest()[:12]
    log = folder / LOG
    if not log.exists():
        _keep_tables(folder)
    hint = "Name another folder with -o, or go on with the plan, the options and the seed of its beginning."
    header = {"format": "measuring day 1", "robot": protocol.robot, "plan": plan}
    with Journal(log, header, _WAIT, other=hint) as journal:
        if not journal.records:
            _keep_tables(folder)
        yield journal


def _keep_tables(folder: Path) -> None:
    """InputError where tables stand that no journal is there for."""
    hint = f"Put {LOG} back, which it was made from, or name another folder with -o."
    words = f"stands there without {LOG}, or with an empty one, and is not overwritten"
    if problems := [Problem(words, str(table), hint=hint) for table in _tables(folder) if table.exists()]:
        raise InputError(problems)


def _tables(folder: Path) -> tuple[Path, Path]:
    return folder / TABLE, floor_file(folder / TABLE)


def keep_before(folder: Path) -> None:
    """Keep the tables of a day whose journal was spoilt, as they first were: they may hold what it has lost."""
    for table in _tables(folder):
        kept = table.with_stem(f"{table.stem}_before")
        if table.exists() and not kept.exists():
            write_bytes(kept, table.read_bytes())


def grown(record: Record, more: Sequence[Mapping[str, Any]]) -> Record:
    """The record with more records of the journal. InputError where one is of another plan."""
    states, read, series = dict(record.states), set(record.read), record.series
    for one in more:
        try:
            series = str(one.get("series", series))
            for entry in map(lambda data: _entry(record.protocol, data), one.get("states", [])):
                read |= {_key(entry.slot, *position) for position in entry.xyz.items()}
                states[entry.slot] = entry
                if not entry.xyz:
                    del states[entry.slot]
        except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
            raise InputError(Problem("holds a record that is not of this plan", str(record.folder / LOG))) from error
    return replace(record, log=(*record.log, *more), states=states, read=frozenset(read), series=series)


def unread(record: Record, entry: Entry) -> Entry:
    """A state without the positions that were read there before, to the last digit, taken back or not."""
    new = {m: xyz for m, xyz in entry.xyz.items() if _key(entry.slot, m, xyz) not in record.read}
    return replace(entry, xyz=new)


def _key(slot: Slot, marker: str, xyz: Array) -> tuple[Any, ...]:
    return (slot, marker, *np.round(xyz, 9).tolist())


def delivery(record: Record, **what: Any) -> dict[str, Any]:
    """A record for the journal, of now."""
    return {"time": round(time.time(), 3), "series": record.series, **what}


def as_json(protocol: Protocol, entry: Entry) -> dict[str, Any]:
    """A state for the journal; it says which one it is."""
    visit = protocol.visits[entry.slot.visit]
    state = visit.states[entry.slot.state]
    return {
        "visit": visit.number,
        "state": entry.slot.state + 1,
        "is": [visit.pose, visit.repeat, state.load_id, state.cycle],
        "xyz_m": {marker: xyz.tolist() for marker, xyz in entry.xyz.items()},
        "pendant_rad": entry.pendant.tolist(),
        "wrench_N_Nm": entry.wrench.tolist(),
        "series": entry.series,
        "time": entry.time,
        "said": entry.said,
        "mistake": entry.mistake,
    }


def _entry(protocol: Protocol, data: Mapping[str, Any]) -> Entry:
    """A state of the journal. KeyError, TypeError or ValueError where it is none of this protocol."""
    entry = Entry(
        slot=Slot(data["visit"] - 1, data["state"] - 1),
        xyz={str(m): np.array(xyz, dtype=float) for m, xyz in data["xyz_m"].items()},
        pendant=np.array(data["pendant_rad"], dtype=float),
        wrench=np.array(data["wrench_N_Nm"], dtype=float),
        series=str(data["series"]),
        time=float(data["time"]),
        said=str(data.get("said", "")),
        mistake=str(data.get("mistake", "")),
    )
    arrays = [*entry.xyz.values(), entry.pendant, entry.wrench]
    known = min(entry.slot.visit, entry.slot.state) >= 0 and as_json(protocol, entry)["is"] == data["is"]
    if not known or not {*entry.xyz} <= {*protocol.markers} or not all(np.isfinite(a).all() for a in arrays):
        raise ValueError
    return entry


def next_series(series: str) -> str:
    """The name of the next frame: S2 after S1."""
    stem = _stem(series)
    return f"{stem}{int(series[len(stem) :] or 1) + 1}"


def _stem(series: str) -> str:
    return series.rstrip("0123456789")


def write_tables(record: Record) -> None:
    """Write what is made from the journal: `readings.csv`, and the floor's where it was read."""
    began = float(record.log[0].get("time", 0.0)) if record.log else 0.0
    write_readings(record.table, record.protocol, list(record.states.values()), began)
    rows = [
        [*map(str, floor["is"]), name, *(f"{1e3 * v:.4f}" for v in xyz), str(floor["series"])]
        for floor in record.floor
        for name, xyz in floor["xyz_m"].items()
    ]
    if rows:
        write_table(floor_file(record.table), _FLOOR, rows, _comments(record.protocol))


def _comments(protocol: Protocol) -> list[str]:
    return [f"robot: {protocol.robot}", f"made from {LOG}: what is changed here is overwritten"]


def write_readings(path: Path, protocol: Protocol, entries: Sequence[Entry], began: float) -> None:
    """A table of states, those that wait for a decision out of use."""
    header = ["pose", *protocol.units.names(), *WRENCH_NAMES, "marker", "state"]
    header += ["x_mm", "y_mm", "z_mm", "load_id", "series", "repeat", "cycle", "time_s", "drive_state", "use"]
    rows: list[list[str]] = []
    for entry in entries:
        visit = protocol.visits[entry.slot.visit]
        state = visit.states[entry.slot.state]
        start = row_start(protocol, visit, state, entry.pendant, entry.wrench).values()
        counts = [state.load_id, entry.series, str(visit.repeat), str(state.cycle), f"{entry.time - began:.0f}"]
        for marker, xyz in entry.xyz.items():
            cells = [*start, marker, STATES[state.loaded], *(f"{1e3 * v:.4f}" for v in xyz.tolist()), *counts]
            rows.append([*cells, protocol.options.drive, "0" if entry.said == DOUBT else "1"])
    write_table(path, header, rows, _comments(protocol))


def rows_of(table: Table, experiment: Experiment, protocol: Protocol) -> list[Entry]:
    """The states of a table, each at its place in the protocol. InputError with all rows that belong to none."""
    path = table.path
    problems = list(table.problems)
    places = {
        (visit.pose, visit.repeat, state.cycle, state.load_id): Slot(v, k)
        for v, visit in enumerate(protocol.visits)
        for k, state in enumerate(visit.states)
    }
    pendant = table.columns(joint_stems(experiment.robot.controller.axes))
    wrench, xyz = np.nan_to_num(table.columns(WRENCH, 0.0)), table.columns(XYZ)
    out: dict[Slot, Entry] = {}
    counted = (table.counts("repeat"), table.counts("cycle"))
    keys = list(zip(table.text("pose"), *counted, table.text("load_id"), strict=True))
    for i in map(int, np.flatnonzero(np.nan_to_num(table.column("use"), nan=1.0))):
        pose, repeat, cycle, load = keys[i]
        slot, marker, state = places.get(keys[i]), table.text("marker")[i], table.text("state")[i]
        stated = state.lower() == ("loaded" if load else "unloaded")
        if slot is None or not stated or marker not in protocol.markers:
            what = f"pose {pose!r}, repeat {repeat}, cycle {cycle}, state {state!r}, load {load!r}"
            what += f", marker {marker!r}"
            hint = "Name another folder with -o, or go on with the plan, the options and the seed of its beginning."
            problems.append(Problem("is no reading of this plan", str(path), table.rows[i], found=what, hint=hint))
            continue
        there = out.setdefault(slot, Entry(slot=slot, xyz={}, pendant=pendant[i], wrench=wrench[i]))
        if marker in there.xyz or not _alike(there, pendant[i], wrench[i]):
            what = f"pose {pose!r}, marker {marker!r}"
            hint = "A state has one reading of each marker, at the same angles and under the same load."
            problems.append(Problem("contradicts the rows before", str(path), table.rows[i], found=what, hint=hint))
            continue
        out[slot] = replace(there, xyz={**there.xyz, marker: xyz[i]})
    if problems or not out:
        raise InputError(problems or Problem("holds no row in use", str(path)))
    return list(out.values())


def as_planned(entry: Entry, record: Record) -> bool:
    """Whether a state stands at the angles and under the load of the protocol."""
    return _alike(entry, record.visit(entry.slot).pendant, record.state(entry.slot).wrench)


def _alike(entry: Entry, pendant: Array, wrench: Array) -> bool:
    return np.allclose(entry.pendant, pendant, atol=_SAME) and np.allclose(entry.wrench, wrench, atol=_SAME)
