"""The day as a value: what was accepted so far, and the verbs that take a reading and a decision.

day = begin(experiment, plan, folder)
day, judged = enter(day, {"m1": xyz, ...})      # stored, then judged
day = decide(day, slot, "again")                # the operator's word, always the last
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from qsframework.applications.day.expected import Expected, expected
from qsframework.applications.day.judge import Known, Seen, StateVerdict, judge, known
from qsframework.applications.day.mistakes import Mistake, most_likely
from qsframework.applications.day.record import (
    DayRow,
    Record,
    Slot,
    as_planned,
    moved_on,
    noted,
    open_record,
    refreshed,
    stored,
    without,
)
from qsframework.applications.protocol import ProtocolWish, make_protocol
from qsframework.errors import InputError, Problem, nearest
from qsframework.experiment import Experiment, Plan
from qsframework.plugin import Array

DECISIONS = ("keep", "correct", "again")
_FAR = 100.0
"""m: no tracker reads farther."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Day:
    """A measuring day. known: what the accepted states tell; mistakes: of the states that wait for a decision."""

    experiment: Experiment
    plan: Plan
    expected: Expected
    record: Record
    known: Known
    mistakes: Mapping[Slot, Mistake]

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
    mistake: Mistake | None


def begin(experiment: Experiment, plan: Plan, folder: Path, wish: ProtocolWish | None = None) -> Day:
    """The day of a plan, begun or, where the folder holds one, continued.

    InputError where the plan does not belong to the experiment, or the folder to another plan.
    """
    protocol = make_protocol(experiment, plan, wish)
    record = open_record(folder, experiment, protocol)
    return _explained(_seen(experiment, plan, expected(experiment, protocol), record))


def enter(
    day: Day,
    readings: Mapping[str, Array],
    slot: Slot | None = None,
    pendant: Array | None = None,
    wrench: Array | None = None,
) -> tuple[Day, Judged]:
    """The day with readings (3,) m of one or more markers of a state, the next one if None; stored before judged.

    pendant (n,) rad, wrench (6,): where the row says others than the protocol. InputError where a marker is unknown or
    was read already, or no number is one; then nothing is stored.
    """
    day = reread(day)
    slot = day.next if slot is None else slot
    if slot is None:
        raise InputError("the plan is done: every state of every pose was read")
    _check(day, readings, slot)
    visit, state = day.record.visit(slot), day.record.state(slot)
    there = list(day.record.at(slot).values())
    at = there[0].time if there else time.time() - day.record.began
    rows = [
        DayRow(
            slot=slot,
            marker=marker,
            xyz=np.asarray(xyz, dtype=float),
            pendant=visit.pendant if pendant is None else pendant,
            wrench=state.wrench if wrench is None else wrench,
            series=day.record.series,
            time=at,
        )
        for marker, xyz in readings.items()
    ]
    return _judged(replace(day, record=stored(day.record, rows)), slot)


def decide(day: Day, slot: Slot, decision: str) -> Day:
    """The day after the operator's word on a state that waits: "keep" it as it is, "correct" it as was proposed, or
    read it "again", whereupon it comes next."""
    if decision not in DECISIONS:
        raise InputError(
            Problem(f"decision {decision!r}", allowed=", ".join(DECISIONS), hint=nearest(decision, DECISIONS))
        )
    day = reread(day)
    rows, mistake = day.record.at(slot), day.mistakes.get(slot)
    if not rows:
        raise InputError(f"nothing was read at {_where(day, slot)} that could be decided upon")
    record = day.record
    if decision == "again":
        record = without(record, slot)
    elif decision == "correct" and mistake is not None and mistake.kind == "tracker":
        record = moved_on(record)
        record = without(record, slot, [replace(row, series=record.series) for row in rows.values()])
    elif decision == "correct":
        record = without(record, slot, _corrected(day, slot, list(rows.values()), mistake))
    event = {"keep": "kept", "correct": "corrected", "again": "again"}[decision]
    return _seen(day.experiment, day.plan, day.expected, noted(record, slot, event), _rest(day.mistakes, slot))


def reread(day: Day) -> Day:
    """The day with the table as it now stands, where somebody has edited it."""
    record = refreshed(day.record, day.experiment)
    if record is day.record:
        return day
    return _explained(_seen(day.experiment, day.plan, day.expected, record, day.mistakes))


def _explained(day: Day) -> Day:
    """The day with what every state that waits for a decision most likely is."""
    for slot in day.record.doubtful:
        if slot not in day.mistakes and day.record.at(slot):
            mistake = most_likely(day.known, slot, _xyz(day, slot), _series(day, slot))
            day = replace(day, mistakes={**day.mistakes, slot: mistake})
    return day


def _corrected(day: Day, slot: Slot, rows: list[DayRow], mistake: Mistake | None) -> list[DayRow]:
    """Rows of a state as they were meant."""
    if mistake is None or mistake.xyz is None:
        hint = "Keep it, or read it again; the angles and the load of a row can be edited in the table."
        raise InputError(Problem(f"nobody knows what {_where(day, slot)} should read", hint=hint))
    names = list(day.expected.names)
    return [replace(row, xyz=mistake.xyz[names.index(row.marker)]) if row.marker in names else row for row in rows]


def _judged(day: Day, slot: Slot) -> tuple[Day, Judged]:
    """The day with what is said of a state, noted."""
    xyz, series = _xyz(day, slot), _series(day, slot)
    rows = day.record.at(slot)
    verdict = judge(day.known, slot, xyz, series)
    mistake: Mistake | None = None
    odd = next((row for row in rows.values() if not as_planned(row, day.record)), None)
    if odd is not None:
        mistake = _other_than_planned(day, odd)
    elif not verdict.fine:
        mistake = most_likely(day.known, slot, xyz, series)
    if mistake is not None:
        record = noted(day.record, slot, "look again", mistake.kind)
        return replace(day, record=record, mistakes={**day.mistakes, slot: mistake}), Judged(slot, verdict, mistake)
    whole = all(m in rows for m in day.record.protocol.markers)
    record = noted(day.record, slot, "as expected") if whole or slot in day.record.doubtful else day.record
    day = replace(day, record=record, mistakes=_rest(day.mistakes, slot))
    return (_seen(day.experiment, day.plan, day.expected, record, day.mistakes) if whole else day), Judged(
        slot, verdict, None
    )


def _other_than_planned(day: Day, row: DayRow) -> Mistake:
    """A row whose own angles or load are not those of its state: which, and what the protocol has."""
    visit, state = day.record.visit(row.slot), day.record.state(row.slot)
    turned = np.abs(row.pendant - visit.pendant)
    if turned.max() > 1e-6:
        k = int(np.argmax(turned))
        unit = day.experiment.robot.controller.units[k]
        off = f"{unit.per * (row.pendant[k] - visit.pendant[k]):+.2f} {unit.shown}"
        return Mistake(kind="angle", what=(f"q{k + 1}", day.experiment.robot.facts.driven[k], off))
    force, told = float(np.linalg.norm(row.wrench[:3])), float(np.linalg.norm(state.wrench[:3]))
    return Mistake(kind="force", what=(f"{force:.0f} N", f"{told:.0f} N"))


def _seen(
    experiment: Experiment, plan: Plan, told: Expected, record: Record, mistakes: Mapping[Slot, Mistake] | None = None
) -> Day:
    """The day; it learns from the states that do not wait for a decision, and were not kept against its advice."""
    day = Day(
        experiment=experiment,
        plan=plan,
        expected=told,
        record=record,
        known=known(told, ()),
        mistakes={s: m for s, m in (mistakes or {}).items() if s in record.doubtful},
    )
    odd = {*record.doubtful, *(s for s, event in record.taken.items() if event == "kept")}
    slots = [s for s in dict.fromkeys(row.slot for row in record.rows) if s not in odd]
    seen = [Seen(s, _xyz(day, s), _series(day, s)) for s in slots]
    return replace(day, known=known(told, [s for s in seen if s.read.any()]))


def _xyz(day: Day, slot: Slot) -> Array:
    """Readings (M, 3) m of the judged markers of a state, NaN where not read."""
    rows = day.record.at(slot)
    nothing = np.full(3, np.nan)
    return np.array([rows[m].xyz if m in rows else nothing for m in day.expected.names])


def _series(day: Day, slot: Slot) -> str:
    return next((row.series for row in day.record.at(slot).values()), day.record.series)


def _rest(mistakes: Mapping[Slot, Mistake], slot: Slot) -> dict[Slot, Mistake]:
    return {s: m for s, m in mistakes.items() if s != slot}


def _check(day: Day, readings: Mapping[str, Array], slot: Slot) -> None:
    problems: list[Problem] = []
    markers, there = day.record.protocol.markers, day.record.at(slot)
    for marker, xyz in readings.items():
        where = f"{_where(day, slot)}, marker {marker!r}"
        if marker not in markers:
            problems.append(Problem(f"no marker {marker!r}", allowed=", ".join(markers), hint=nearest(marker, markers)))
        elif marker in there:
            hint = "Decide to read it again first; the table holds one reading of a marker in a state."
            problems.append(Problem(f"{where} was read already", hint=hint))
        elif np.shape(xyz) != (3,) or not np.isfinite(xyz).all() or np.abs(xyz).max() > _FAR:
            found = ", ".join(f"{1e3 * v:g}" for v in np.ravel(xyz)) + " mm"
            problems.append(Problem(f"{where}: no position", found=found, allowed=f"x, y, z up to {_FAR:g} m"))
    if not readings:
        problems.append(Problem("no reading was given"))
    if problems:
        raise InputError(problems)


def _where(day: Day, slot: Slot) -> str:
    visit, state = day.record.visit(slot), day.record.state(slot)
    return f"pose {visit.pose!r}, {state.load_id or 'unloaded'}, cycle {state.cycle}"
