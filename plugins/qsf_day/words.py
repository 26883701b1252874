"""The measuring day in words: what comes next, what a reading is, and what the readings tell so far."""

from __future__ import annotations

from itertools import pairwise

from qsf_day.judge import Check
from qsf_day.mistakes import Explanation
from qsf_day.record import Slot
from qsf_day.session import Day, FloorJudged, Judged
from qsf_day.so_far import SoFar
from qsframework.errors import listed, some_of
from qsframework.plugin import Array
from qsframework.units import JointUnits

_CLOCK = 1.0
"""s by which a clock that is corrected all the time goes back at most."""
_ASKED = {
    "shape": "the markers' distances are {} off",
    "place": "the markers are {} from where this pose puts them",
    "repeat": "the markers are {} from where they were at this pose before",
    "motion": "the markers moved {} otherwise than the load should move them",
}
_CORRECTABLE = ("markers", "unit", "sign", "axes", "decimal", "sign of one", "tracker")
"""Kinds whose readings can be put right without another reading."""
_MISTAKES = {
    "markers": "Markers {both} are exchanged.",
    "unit": "The numbers are in {0}, not in mm.",
    "sign": "The sign of {both} is flipped.",
    "sign of one": "The sign of {1} of {0} is flipped: {2} mm.",
    "axes": "The columns are {all}, not x, y, z.",
    "decimal": "The decimal point of {1} of {0} is shifted: {2} mm.",
    "no load": "The load was not put on: the markers did not move as it would move them.",
    "load": "The deflection matches {0}: look at what hangs there, and on which hook.",
    "force": "The row says {0}, the plan {1}: which one hung there?",
    "exchanged": "Loaded and unloaded are exchanged.",
    "still loaded": "The load is still on: {0}.",
    "pose": "These are readings of pose {0}: does the arm stand there, or is it another row?",
    "angle": "{0} is {2} from the plan ({1}): look at the pendant.",
    "marker": "Marker {0} alone is off: does the reflector sit in its nest, was the right one taken?",
    "tracker": "All markers moved as one: the tracker was moved, or the arm's base. Read the floor reflectors.",
}
DONE = {"keep": "kept as it is", "correct": "corrected as proposed", "again": "to be read again"}
NOTHING_NEW = "taken in before, nothing in it is new."


def spoilt_words(day: Day) -> str:
    """Which lines of the journal are none, what became of the others, and whether the clock went back."""
    lines = some_of([str(line) for line in day.record.spoilt], 20)
    kept = "All other records are kept; read again what is missing. readings_before.csv is the table as it was."
    times = [float(record["time"]) for record in day.record.log if "time" in record]
    back = max((before - after for before, after in pairwise(times)), default=0.0)
    clock = (
        f"This machine's clock was set back by {back:.0f} s during the session: time_s before and after do not compare."
    )
    said = [f"day.jsonl: spoilt and not used: line {lines}. {kept}"] if lines else []
    return " ".join([*said, clock] if back > _CLOCK else said)


def slot_words(day: Day, slot: Slot) -> str:
    """Which state: `pose p03, weight, cycle 1`."""
    visit, state = day.record.visit(slot), day.record.state(slot)
    again = f" (visit {visit.repeat} of it)" if visit.repeat > 1 else ""
    if not visit.load:
        return f"pose {visit.pose}{again}, positions{f' from {visit.station}' if visit.station else ''}"
    return f"pose {visit.pose}{again}, {state.load_id or 'unloaded'}, cycle {state.cycle}"


def load_words(day: Day, slot: Slot) -> str:
    """What hangs at the load point at a state."""
    state = day.record.state(slot)
    if not state.loaded:
        return "no load"
    parts = [
        f"{name} {value:.0f} {unit}"
        for name, value, unit in zip(
            ("fx", "fy", "fz", "mx", "my", "mz"), state.wrench.tolist(), ["N"] * 3 + ["N m"] * 3, strict=True
        )
        if abs(value) > 0.5
    ]
    return f"{state.load_id}: {', '.join(parts)}"


def judged_words(day: Day, judged: Judged) -> str:
    """What is said of a state whose reading came in, in one or two sentences."""
    where = slot_words(day, judged.slot)
    if judged.mistake is None:
        missing = [m for m in day.record.visit(judged.slot).markers if m not in day.record.at(judged.slot)]
        more = f"; {', '.join(missing)} to come" if missing else ""
        return f"{where}: as expected{more}."
    reasons = [check_words(c) for c in judged.verdict.checks if c.p < 1e-5]
    why = f" ({'; '.join(reasons)})" if reasons else ""
    return f"{where}: look again{why}. {mistake_words(judged.mistake)}"


def check_words(check: Check) -> str:
    """How far off a state is."""
    return _ASKED[check.kind].format(f"{1e3 * check.off:.2f} mm")


def mistake_words(mistake: Explanation) -> str:
    """What a reading most likely is, and what to do."""
    return " Or: ".join(map(_kind_words, (mistake, *mistake.or_)))


def can_correct(mistake: Explanation) -> bool:
    """Whether the readings can be put right as they are."""
    return mistake.kind in _CORRECTABLE


def _kind_words(mistake: Explanation) -> str:
    words = _MISTAKES.get(mistake.kind, "No single mistake explains it: read the state again.")
    return words.format(*mistake.what, both=" and ".join(mistake.what), all=", ".join(mistake.what))


def floor_words(judged: FloorJudged) -> str:
    """What the floor reflectors say."""
    off = f"{1e3 * judged.off:.2f} mm"
    return {
        "first": "Floor reflectors: stored, first reading from this tracker position.",
        "still": f"Floor reflectors: where they were (within {off}): the tracker stands.",
        "tracker": f"Look again: all floor reflectors moved, by up to {off}: the tracker was moved.",
        "reflector": f"Look again: floor reflector {judged.reflector} alone moved {off}.",
    }[judged.kind]


def so_far_words(found: SoFar) -> str:
    """What the readings tell so far, in one sentence, and what would help."""
    if found.fit is None:
        return f"After {found.visits} visits the readings give no fit yet: {found.why}"
    if found.findings:
        return " ".join(f"Look at {finding.sentence}" for finding in found.findings)
    known = sum(t.enough for t in found.told)
    which = f"{known} of {len(found.told)} parameters"
    said = f"After {found.visits} visits {which} are identified as well as the plan predicted"
    if found.causes:
        said += f", of a model without {listed(found.causes)}, which the readings name: they say no more than it holds"
    if found.enough:
        return f"{said}: enough. The rest of the plan takes {found.minutes:.0f} minutes."
    worst = max((t for t in found.told), key=lambda t: t.sd / t.predicted if t.predicted > 0 else 0.0)
    said += f"; {worst.name} is furthest ({worst.sd / worst.predicted:.1f} times its sd). "
    said += f"The rest of the plan takes {found.minutes:.0f} minutes"
    if found.help is not None:
        said += f"; the three poses that would help most, {found.help_minutes:.0f} minutes, are: "
        said += "; ".join(_angles(q, found.units) for q in found.help.pendant)
    return said + "."


def _angles(pendant: Array, units: JointUnits) -> str:
    return ", ".join(f"J{k + 1} {v:.1f}" for k, v in enumerate(units.shown(pendant).tolist()))
