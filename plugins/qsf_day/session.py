"""The day as a value: what was accepted so far, and the verbs that take a reading and a decision.

day = begin(experiment, plan, folder)
day, judged = enter(day, {"m1": xyz, ...})      # judged and stored in one record
day = decide(day, slot, "again")                # the operator's word, always the last
"""

from __future__ import annotations

import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from qsf_day.judge import (
    LEVEL,
    Expected,
    Known,
    StateReading,
    StateVerdict,
    expected,
    judge,
    known,
)
from qsf_day.mistakes import Explanation, most_likely
from qsf_day.options import ProtocolOptions
from qsf_day.protocol import make_protocol
from qsf_day.record import (
    DOUBT,
    Entry,
    Record,
    Slot,
    as_json,
    as_planned,
    delivery,
    grown,
    keep_before,
    next_series,
    opened,
    unread,
    write_tables,
)
from qsframework.errors import InputError, Problem, nearest, refuse
from qsframework.estimation.tails import chi2_isf
from qsframework.experiment import Experiment, Plan, procrustes
from qsframework.files.journal import Journal
from qsframework.plugin import Array

DECISIONS = ("keep", "correct", "again")
_FAR = 100.0
"""m: no tracker reads farther."""
_WANDER = 3e-5
"""m: what a reflector on a floor may drift beside the noise."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Day:
    """A measuring day. known: what the accepted states tell; mistakes: of the states that wait for a decision."""

    experiment: Experiment
    plan: Plan
    expected: Expected
    record: Record
    known: Known
    mistakes: Mapping[Slot, Explanation]

    @property
    def next(self) -> Slot | None:
        return self.record.next

    @property
    def visits_done(self) -> int:
        """Visits before the one that comes next."""
        return len(self.record.protocol.visits) if self.next is None else self.next.visit


@dataclass(frozen=True, eq=False)
class Judged:
    """What was said of a state when a reading of it came in; mistake: where it is not as expected."""

    slot: Slot
    verdict: StateVerdict
    mistake: Explanation | None


@dataclass(frozen=True)
class FloorJudged:
    """What the floor says. kind: "first", "still", "tracker" where all moved as one, "reflector" where one did alone;
    off: the largest motion, m; reflector: which one"""

    kind: str
    off: float
    reflector: str = ""


def begin(experiment: Experiment, plan: Plan, folder: Path, options: ProtocolOptions | None = None) -> Day:
    """The day of a plan, begun or, where the folder holds one, continued: what nobody has judged yet is judged.

    InputError where the plan does not belong to the experiment, or the folder to another plan.
    """
    protocol = make_protocol(experiment, plan, options)
    with opened(folder, protocol) as journal:
        series = experiment.frames[0].series if experiment.frames else "S1"
        series = protocol.visits[0].station or series
        record = Record(folder=folder, protocol=protocol, series=series, states={})
        if journal.spoilt:
            keep_before(folder)
        elif not journal.records:
            journal.append(delivery(record))
        record = grown(replace(record, spoilt=tuple(journal.spoilt)), journal.records)
        day = _seen(experiment, plan, expected(experiment, protocol), record)
        if unjudged := [entry for entry in record.states.values() if not entry.said]:
            day, _ = _judged(day, journal, unjudged)
        write_tables(day.record)
        return day


@contextmanager
def locked(day: Day) -> Generator[tuple[Day, Journal]]:
    """The day as its journal now says, and the journal, which no other process writes meanwhile."""
    with opened(day.record.folder, day.record.protocol) as journal:
        old = day.record.log
        if tuple(journal.records[: len(old)]) != old:
            hint = "Put it back as it was, or start the command again to go on with what it holds."
            raise InputError(Problem("was changed by other hands", str(journal.path), hint=hint))
        if more := journal.records[len(old) :]:
            day = _seen(day.experiment, day.plan, day.expected, grown(day.record, more))
        yield day, journal


def reread(day: Day) -> Day:
    """The day with what other processes have written, and its tables made anew."""
    with locked(day) as (day, _):
        write_tables(day.record)
        return day


def enter(day: Day, readings: Mapping[str, Array], slot: Slot | None = None) -> tuple[Day, Judged]:
    """The day with readings (3,) m of one or more markers of a state, the one that comes next in `day` if None.

    InputError where another state comes next by now, a marker is unknown or was read already, or no number is one; then
    nothing is stored.
    """
    slot = day.next if slot is None else slot
    if slot is None:
        raise InputError("the plan is done: every state of every pose was read")
    visit, state = day.record.visit(slot), day.record.state(slot)
    entry = Entry(slot=slot, xyz=readings, pendant=visit.pendant, wrench=state.wrench)
    day, judged = enter_states(day, [entry], of_next=True)
    return day, judged[0]


def enter_states(
    day: Day, entries: Sequence[Entry], of_next: bool = False, file: Mapping[str, str] | None = None
) -> tuple[Day, list[Judged]]:
    """The day with a delivery: states, stored and judged as a whole. of_next: only while it is the next state.

    file: name and sha256 of the file that they come from; states of which it says nothing new are passed over.
    InputError as `enter` has it.
    """
    with locked(day) as (day, journal):
        if file is not None:
            entries = [new for entry in entries if (new := unread(day.record, entry)).xyz]
            if file["sha256"] in day.record.files or not entries:
                return day, []
        if of_next and entries[0].slot != day.next:
            there = "every state was read" if day.next is None else f"next is {_where(day, day.next)}"
            raise InputError(f"the day has moved on: {there}")
        entries = [_merged(day, entry) for entry in entries]
        day, judged = _judged(day, journal, entries, **({} if file is None else {"file": dict(file)}))
    return day, judged


def _merged(day: Day, entry: Entry) -> Entry:
    """A state with what was read there before. InputError where it cannot be."""
    _check(day, entry.xyz, entry.slot)
    new = {m: np.asarray(xyz, dtype=float) for m, xyz in entry.xyz.items()}
    there = day.record.states.get(entry.slot)
    if there is None:
        return replace(entry, xyz=new, series=day.record.series_at(entry.slot), time=round(time.time(), 3))
    return replace(entry, xyz={**there.xyz, **new}, series=there.series, time=there.time)


def decide(day: Day, slot: Slot, decision: str, read_at: float | None = None) -> Day:
    """The day after the operator's word on a state that waits: "keep" it as it is, "correct" it as was proposed, or
    read it "again", whereupon it comes next. read_at: the time of the reading that is meant, where it matters.

    InputError where nothing was read there, or the reading was decided upon meanwhile.
    """
    if decision not in DECISIONS:
        raise InputError(
            Problem(f"decision {decision!r}", allowed=", ".join(DECISIONS), hint=nearest(decision, DECISIONS))
        )
    with locked(day) as (day, journal):
        entry, mistake = day.record.states.get(slot), day.mistakes.get(slot)
        if entry is None:
            raise InputError(f"nothing was read at {_where(day, slot)} that could be decided upon")
        if read_at is not None and (entry.time != read_at or slot not in day.mistakes):
            raise InputError(f"the day has moved on: {_where(day, slot)} was decided upon")
        series = day.record.series_at(slot)
        if decision == "correct" and mistake is not None and mistake.kind == "tracker":
            series = next_series(series)
            entry = replace(entry, series=series)
        elif decision == "correct":
            entry = replace(entry, xyz=_corrected(day, entry, mistake))
        elif decision == "again":
            entry = replace(entry, xyz={})
        said = {"keep": "kept", "correct": "corrected", "again": "again"}[decision]
        made = delivery(day.record, states=[as_json(day.record.protocol, replace(entry, said=said))])
        return _stored(day, journal, made | {"series": series})


def _stored(day: Day, journal: Journal, made: Mapping[str, Any]) -> Day:
    """The day with one more record, on disk when this returns; its tables follow where there is room."""
    journal.append(made)
    day = _with(day, made)
    with suppress(InputError):  # made anew when the day is opened
        write_tables(day.record)
    return day


def enter_floor(day: Day, readings: Mapping[str, Array], slot: Slot | None = None) -> tuple[Day, FloorJudged]:
    """The day with positions (3,) m of floor reflectors in the tracker's present frame, at the visit of `slot`, and how
    they compare with the first ones: where they are at the start of every visit tells whether the tracker still stands.

    They are read beside the plan; nothing is fitted to them. InputError where one is no position, or cannot be stored.
    """
    bad = [n for n, xyz in readings.items() if np.shape(xyz) != (3,) or not np.isfinite(xyz).all()]
    if bad or not readings:
        raise InputError(Problem(f"no position of {', '.join(bad) or 'a reflector'}", allowed="x, y, z in mm"))
    with locked(day) as (day, journal):
        visit = day.record.protocol.visits[-1 if slot is None else slot.visit]
        series = day.record.series if slot is None else day.record.series_at(slot)
        floor = {"is": [visit.number, visit.pose, visit.repeat], "series": series}
        floor |= {"xyz_m": {name: np.asarray(xyz).tolist() for name, xyz in readings.items()}}
        day = _stored(day, journal, delivery(day.record, floor=floor))
    first: dict[str, Array] = {}
    for floor in (f for f in day.record.floor[:-1] if f["series"] == day.record.series):
        first = {name: np.array(xyz) for name, xyz in floor["xyz_m"].items()} | first
    names = [n for n in readings if n in first]
    if not names:
        return day, FloorJudged("first", 0.0)
    was, now = (np.array([of[n] for n in names]) for of in (first, readings))
    motion = np.linalg.norm(now - was, axis=1)
    sd = float(np.sqrt(2.0) * np.hypot(day.expected.sigma, _WANDER))
    limit = sd * float(
        np.sqrt(chi2_isf(LEVEL / len(names), 3))
    )  # that the worst of these exceeds with the chance LEVEL
    worst = int(np.argmax(motion))
    together = len(names) < 3 or np.linalg.norm(procrustes(was, now).apply(was) - now, axis=1).max() <= limit
    kind, alone = "tracker", len(names) >= 2 and (motion > limit).sum() == 1
    if motion[worst] <= limit:
        kind = "still"
    elif alone or not together:
        kind = "reflector"
    return day, FloorJudged(kind, float(motion[worst]), names[worst] if kind == "reflector" else "")


def _with(day: Day, made: Mapping[str, Any]) -> Day:
    return _seen(day.experiment, day.plan, day.expected, grown(day.record, [made]), day.mistakes)


def _corrected(day: Day, entry: Entry, mistake: Explanation | None) -> dict[str, Array]:
    """Positions of a state as they were meant."""
    if mistake is None or mistake.xyz is None:
        hint = "Keep it, or read it again."
        raise InputError(Problem(f"nobody knows what {_where(day, entry.slot)} should read", hint=hint))
    names = list(day.expected.names)
    return {m: mistake.xyz[names.index(m)] if m in names else xyz for m, xyz in entry.xyz.items()}


def _judged(day: Day, journal: Journal, entries: Sequence[Entry], **source: Any) -> tuple[Day, list[Judged]]:
    """The day with states, each judged by what the earlier ones tell, in one record."""
    made, said, now = delivery(day.record, states=[], **source), list[Judged](), day
    for entry in entries:
        verdict = judge(now.known, _reading(now, entry))
        odd = not verdict.fine or not as_planned(entry, day.record)
        mistake = _mistake(now, entry) if odd else None
        entry = replace(entry, said=DOUBT if odd else "as expected", mistake=mistake.kind if mistake else "")
        said.append(Judged(entry.slot, verdict, mistake))
        made = made | {"states": [*made["states"], as_json(day.record.protocol, entry)]}
        mistakes = now.mistakes if mistake is None else {**now.mistakes, entry.slot: mistake}
        now = _with(replace(day, mistakes=mistakes), made)
    return _stored(replace(day, mistakes=now.mistakes), journal, made), said


def _mistake(day: Day, entry: Entry) -> Explanation:
    """What a state that is not as expected most likely is."""
    if not as_planned(entry, day.record):
        return _other_than_planned(day, entry)
    return most_likely(day.known, _reading(day, entry))


def _other_than_planned(day: Day, row: Entry) -> Explanation:
    """A row whose own angles or load are not those of its state: which, and what the protocol has."""
    visit, state = day.record.visit(row.slot), day.record.state(row.slot)
    turned = np.abs(row.pendant - visit.pendant)
    if turned.max() > 1e-6:
        k = int(np.argmax(turned))
        unit = day.experiment.robot.controller.units[k]
        off = f"{unit.per * (row.pendant[k] - visit.pendant[k]):+.2f} {unit.shown}"
        return Explanation(kind="angle", what=(f"q{k + 1}", day.experiment.robot.facts.driven[k], off))
    force, told = float(np.linalg.norm(row.wrench[:3])), float(np.linalg.norm(state.wrench[:3]))
    return Explanation(kind="force", what=(f"{force:.0f} N", f"{told:.0f} N"))


def _seen(
    experiment: Experiment,
    plan: Plan,
    told: Expected,
    record: Record,
    mistakes: Mapping[Slot, Explanation] | None = None,
) -> Day:
    """The day; it learns from the states that do not wait for a decision, and were not kept against its advice. What
    waits gets the mistake that it most likely is."""
    day = Day(experiment=experiment, plan=plan, expected=told, record=record, known=known(told, ()), mistakes={})
    readings = [_reading(day, entry) for entry in record.states.values() if entry.said not in ("", DOUBT, "kept")]
    day = replace(day, known=known(told, [r for r in readings if r.read.any()]))
    old, states = mistakes or {}, record.states
    return replace(day, mistakes={s: old[s] if s in old else _mistake(day, states[s]) for s in record.doubtful})


def _reading(day: Day, entry: Entry) -> StateReading:
    """The readings of the judged markers of a state."""
    xyz = np.array([entry.xyz.get(m, np.full(3, np.nan)) for m in day.expected.names])
    return StateReading(entry.slot, xyz, entry.series)


def _check(day: Day, readings: Mapping[str, Array], slot: Slot) -> None:
    problems: list[Problem] = []
    markers, there = day.record.protocol.markers, day.record.at(slot)
    for marker, xyz in readings.items():
        where = f"{_where(day, slot)}, marker {marker!r}"
        if marker not in markers:
            problems.append(Problem(f"no marker {marker!r}", allowed=", ".join(markers), hint=nearest(marker, markers)))
        elif marker in there:
            hint = "Decide to read it again first: a state has one reading of a marker."
            problems.append(Problem(f"{where} was read already", hint=hint))
        elif np.shape(xyz) != (3,) or not np.isfinite(xyz).all() or np.abs(xyz).max() > _FAR:
            found = ", ".join(f"{1e3 * v:g}" for v in np.ravel(xyz)) + " mm"
            problems.append(Problem(f"{where}: no position", found=found, allowed=f"x, y, z up to {_FAR:g} m"))
    if not readings:
        problems.append(Problem("no reading was given"))
    refuse(problems)


def _where(day: Day, slot: Slot) -> str:
    visit, state = day.record.visit(slot), day.record.state(slot)
    return f"pose {visit.pose!r}, {state.load_id or 'unloaded'}, cycle {state.cycle}"
