"""What was read on the day: the ordinary table of readings, which is safe on disk before anybody is answered.

A reading is appended and synced. A row that is taken back leaves the table and stays in the log beside it, which also
holds every judgement and every decision, so that nothing that was ever read is lost.
"""

from __future__ import annotations

import csv
import io
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from qsframework.applications.protocol import Protocol, ProtocolState, Visit
from qsframework.errors import InputError, Problem
from qsframework.experiment import Experiment
from qsframework.experiment.columns import joint_cells, number, read_table, table_text
from qsframework.experiment.readings_table import state_columns
from qsframework.files import append_text, sha256, write_text
from qsframework.plugin import Array

TABLE, LOG = "readings.csv", "day.jsonl"
_SAME = 1e-6
"""rad, N: angles and forces of a row that differ by less are those of the protocol."""
_FULL = "the reading is not stored: {}. Make room, then enter it again"


@dataclass(frozen=True, order=True)
class Slot:
    """One state of one visit: their places in the protocol."""

    visit: int
    state: int


@dataclass(frozen=True, eq=False, kw_only=True)
class DayRow:
    """One marker at one state. xyz (3,) m in the tracker's frame `series`; pendant (n,) rad and wrench (6,) as they
    stand in the table; time: s since the day began"""

    slot: Slot
    marker: str
    xyz: Array
    pendant: Array
    wrench: Array
    series: str
    time: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Record:
    """The rows so far, with the hash of the table that holds them; began: s since the epoch; doubtful: states that wait
    for a decision, with what was said of them; taken: what was decided of states; series: the frame that the tracker
    stands in now; files: hashes of those that were taken in"""

    folder: Path
    robot: str
    protocol: Protocol
    rows: tuple[DayRow, ...]
    began: float
    hash: str
    doubtful: Mapping[Slot, str]
    taken: Mapping[Slot, str]
    series: str
    files: frozenset[str] = frozenset()

    @property
    def table(self) -> Path:
        return self.folder / TABLE

    def state(self, slot: Slot) -> ProtocolState:
        return self.protocol.visits[slot.visit].states[slot.state]

    def visit(self, slot: Slot) -> Visit:
        return self.protocol.visits[slot.visit]

    def at(self, slot: Slot) -> dict[str, DayRow]:
        """The rows of a state by marker."""
        return {row.marker: row for row in self.rows if row.slot == slot}

    @property
    def slots(self) -> list[Slot]:
        """All states of the protocol, in the order of the day."""
        return [Slot(v, k) for v, visit in enumerate(self.protocol.visits) for k in range(len(visit.states))]

    @property
    def next(self) -> Slot | None:
        """The first state of which a marker is missing; None: the day is done."""
        read = {(row.slot, row.marker) for row in self.rows}
        return next((s for s in self.slots if any((s, m) not in read for m in self.protocol.markers)), None)


def open_record(folder: Path, experiment: Experiment, protocol: Protocol) -> Record:
    """The record of a day, begun or continued. InputError where the table there is of another plan, or cannot be read.

    A line that a crash left half written is moved to the log.
    """
    table, log = folder / TABLE, folder / LOG
    if not table.exists():
        write_text(table, _text(protocol.robot, protocol, []))
    if not log.exists():
        _log(log, {"event": "begun", "robot": protocol.robot, "visits": len(protocol.visits)})
    _mend(table, log)
    events = _events(log)
    rows = _read(table, experiment, protocol)
    first = experiment.frames[0].series if experiment.frames else "S1"
    doubtful: dict[Slot, str] = {}
    taken: dict[Slot, str] = {}
    for event in (e for e in events if "visit" in e):
        slot = Slot(int(event["visit"]) - 1, int(event["state"]) - 1)
        if event["event"] == "look again":
            doubtful[slot] = str(event["said"])
        elif event["event"] in ("as expected", "kept", "corrected", "again"):
            doubtful.pop(slot, None)
            taken[slot] = str(event["event"])
    return Record(
        folder=folder,
        robot=protocol.robot,
        protocol=protocol,
        rows=tuple(rows),
        began=float(events[0]["time"]),
        hash=sha256(table),
        doubtful=doubtful,
        taken=taken,
        series=next((str(e["series"]) for e in reversed(events) if e["event"] == "tracker moved"), first),
        files=frozenset(str(e["hash"]) for e in events if e["event"] == "file"),
    )


def refreshed(record: Record, experiment: Experiment) -> Record:
    """The record, read again where somebody has edited its table meanwhile."""
    if record.table.is_file() and sha256(record.table) == record.hash:
        return record
    if not record.table.is_file():
        hint = "Put it back; what was entered also stands in the log."
        raise InputError(Problem("the table of the day is gone", str(record.table), hint=hint))
    return open_record(record.folder, experiment, record.protocol)


def stored(record: Record, rows: Sequence[DayRow]) -> Record:
    """The record with more rows, on disk when this returns. InputError where they cannot be stored."""
    _append(record.table, "".join(_line(record.protocol, row) for row in rows))
    return replace(record, rows=(*record.rows, *rows), hash=sha256(record.table))


def without(record: Record, slot: Slot, instead: Sequence[DayRow] = ()) -> Record:
    """The record with other rows of a state, or none; those that stood there go to the log."""
    gone = [row for row in record.rows if row.slot == slot]
    _log(record.folder / LOG, _about(slot) | {"event": "taken back", "rows": [_values(row) for row in gone]})
    kept = [row for row in record.rows if row.slot != slot]
    place = next((i for i, row in enumerate(record.rows) if row.slot == slot), len(kept))
    rows = (*kept[:place], *instead, *kept[place:])
    write_text(record.table, _text(record.robot, record.protocol, rows))
    return replace(record, rows=rows, hash=sha256(record.table))


def noted(record: Record, slot: Slot, event: str, said: str = "") -> Record:
    """The record with a judgement or a decision: "as expected", "look again", "kept", "corrected" or "again"."""
    _log(record.folder / LOG, _about(slot) | {"event": event, "said": said})
    doubtful = {s: text for s, text in record.doubtful.items() if s != slot}
    taken = {s: text for s, text in record.taken.items() if s != slot}
    if event == "look again":
        doubtful[slot] = said
    else:
        taken[slot] = event
    return replace(record, doubtful=doubtful, taken=taken)


def moved_on(record: Record) -> Record:
    """The record whose next readings are in a new frame: the tracker was moved."""
    stem = record.series.rstrip("0123456789")
    series = f"{stem}{int(record.series[len(stem) :] or 1) + 1}"
    _log(record.folder / LOG, {"event": "tracker moved", "series": series})
    return replace(record, series=series)


def taken_in(record: Record, name: str, hash: str) -> Record:
    """The record that knows that a file was taken in, so that it is not taken twice."""
    _log(record.folder / LOG, {"event": "file", "name": name, "hash": hash})
    return replace(record, files=record.files | {hash})


def _about(slot: Slot) -> dict[str, Any]:
    return {"visit": slot.visit + 1, "state": slot.state + 1}


def _values(row: DayRow) -> dict[str, Any]:
    return {"marker": row.marker, "xyz_mm": (1e3 * row.xyz).round(4).tolist(), "series": row.series}


def _log(path: Path, event: Mapping[str, Any]) -> None:
    _append(path, json.dumps({"time": round(time.time(), 3)} | dict(event)) + "\n")


def _append(path: Path, text: str) -> None:
    try:
        append_text(path, text)
    except OSError as error:
        raise InputError(Problem(_FULL.format(error.strerror), str(path))) from error


def _events(path: Path) -> list[dict[str, Any]]:
    """What the log says; a line that a crash left half written says nothing."""
    out: list[dict[str, Any]] = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            event = json.loads(line)
        except json.JSONDecodeError:
            continue
        out += [event] if isinstance(event, dict) and "event" in event and "time" in event else []
    if not out:
        raise InputError(Problem("is no log of a measuring day", str(path), hint="Name an empty folder."))
    return out


def _mend(table: Path, log: Path) -> None:
    """Move a last line without an end, which a crash left, from the table to the log."""
    content = table.read_bytes() if table.is_file() else b""
    if not content or content.endswith(b"\n"):
        return
    whole, _, rest = content.rpartition(b"\n")
    _log(log, {"event": "half a line", "text": rest.decode("utf-8", "replace")})
    write_text(table, whole.decode() + ("\n" if whole else ""))


def _header(protocol: Protocol) -> list[str]:
    header = ["pose", *protocol.units.names(), "fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"]
    return [
        *header,
        "marker",
        "state",
        "x_mm",
        "y_mm",
        "z_mm",
        "load_id",
        "series",
        "repeat",
        "cycle",
        "time_s",
        "drive_state",
    ]


def _cells(protocol: Protocol, row: DayRow) -> list[str]:
    visit = protocol.visits[row.slot.visit]
    state = visit.states[row.slot.state]
    return [
        visit.pose,
        *joint_cells(row.pendant, protocol.units),
        *([number(v) for v in row.wrench.tolist()] if state.loaded else [""] * 6),
        row.marker,
        "loaded" if state.loaded else "unloaded",
        *(f"{1e3 * v:.4f}" for v in row.xyz.tolist()),
        state.load_id,
        row.series,
        str(visit.repeat),
        str(state.cycle),
        f"{row.time:.0f}",
        protocol.wish.drive,
    ]


def _line(protocol: Protocol, row: DayRow) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerow(_cells(protocol, row))
    return out.getvalue()


def written(path: Path, protocol: Protocol, rows: Sequence[DayRow]) -> Path:
    """A table of rows, in a file of its own."""
    return write_text(path, _text(protocol.robot, protocol, rows))


def _text(robot: str, protocol: Protocol, rows: Sequence[DayRow]) -> str:
    return f"# robot: {robot}\n" + table_text(_header(protocol), [_cells(protocol, row) for row in rows])


def _read(path: Path, experiment: Experiment, protocol: Protocol) -> list[DayRow]:
    """The rows of the day's table; none where it holds only its header."""
    lines = [
        line for line in path.read_text(encoding="utf-8").splitlines() if line.strip() and not line.startswith("#")
    ]
    return [] if len(lines) < 2 else rows_of(path, experiment, protocol)


def rows_of(path: Path, experiment: Experiment, protocol: Protocol) -> list[DayRow]:
    """The rows of a table of states, each at its state of the protocol. InputError with all that belong to none."""
    table = read_table(path, state_columns(experiment), experiment.robot.name)
    problems = list(table.problems)
    places = {
        (visit.pose, visit.repeat, state.cycle, state.load_id): Slot(v, k)
        for v, visit in enumerate(protocol.visits)
        for k, state in enumerate(visit.states)
    }
    count = len(table.rows)

    def texts(name: str) -> list[str]:
        return table.texts.get(name, [""] * count)

    def numbers(name: str, missing: float) -> list[float]:
        return np.nan_to_num(table.numbers.get(name, np.full(count, missing)), nan=missing).tolist()

    n = experiment.robot.controller.axes
    pendant = np.stack([table.numbers[f"q{k + 1}"] for k in range(n)], axis=1)
    wrench = np.stack([numbers(c, 0.0) for c in ("fx", "fy", "fz", "mx", "my", "mz")], axis=1)
    xyz = np.stack([table.numbers[c] for c in ("x", "y", "z")], axis=1)
    out: list[DayRow] = []
    keys = zip(texts("pose"), numbers("repeat", 1.0), numbers("cycle", 1.0), texts("load_id"), strict=True)
    for i, (pose, repeat, cycle, load) in enumerate(keys):
        slot = places.get((pose, int(repeat), int(cycle), load))
        stated = texts("state")[i].lower() == ("loaded" if load else "unloaded")
        if slot is None or not stated or texts("marker")[i] not in protocol.markers:
            what = f"pose {pose!r}, repeat {repeat:.0f}, cycle {cycle:.0f}, state {texts('state')[i]!r}, load {load!r}"
            what += f", marker {texts('marker')[i]!r}"
            hint = "Name another folder with -o, or go on with the plan, the options and the seed of its beginning."
            problems.append(Problem("is no reading of this plan", str(path), table.rows[i], found=what, hint=hint))
            continue
        out.append(
            DayRow(
                slot=slot,
                marker=texts("marker")[i],
                xyz=xyz[i],
                pendant=pendant[i],
                wrench=wrench[i],
                series=texts("series")[i],
                time=numbers("time", 0.0)[i],
            )
        )
    if problems:
        raise InputError(problems)
    return out


def as_planned(row: DayRow, record: Record) -> bool:
    """Whether a row stands at the angles and under the load of its state."""
    visit, state = record.visit(row.slot), record.state(row.slot)
    return bool(
        np.allclose(row.pendant, visit.pendant, atol=_SAME) and np.allclose(row.wrench, state.wrench, atol=_SAME)
    )
