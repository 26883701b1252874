"""A mistake in the table in words: which row, what stands there, and what was probably meant."""

from __future__ import annotations

import numpy as np

from qsframework.experiment import Readings
from qsframework.hypotheses.catalogue.blocks import FORCE, FRAME, LOST
from qsframework.hypotheses.catalogue.edits import DECIMAL, MISSING, OFF, OTHER, SIGN, UNIT, Edit
from qsframework.hypotheses.catalogue.rows import lines
from qsframework.screening.table_mistakes import Mend

_SLIPS = {
    SIGN: "the sign is reversed",
    DECIMAL: "the decimal is shifted",
    UNIT: "it is in another unit",
    MISSING: "it is missing",
    OTHER: "it is that of another load",
}


def mistake_words(readings: Readings, mistake: Mend) -> str:
    """Row and pose, what was found, what was meant; other edits that fit about as well."""
    first = mistake.edits[0]
    rows = np.concatenate([e.rows if e.touched is None else e.touched for e in mistake.edits])
    said = f"{lines(readings, np.sort(rows))}: {_what(readings, first)}"
    others = [o for o in mistake.others if (o.kind, o.column, o.slip) != (first.kind, first.column, first.slip)]
    more = list(dict.fromkeys(_what(readings, o) for o in others))[:2]
    return said + (f" (about as well: {'; '.join(more)})" if more else "")


def _what(readings: Readings, e: Edit) -> str:
    if e.kind == "block":
        return f"a block of another setting: {_block(e)}"
    if e.kind == "swapped_markers":
        return "the names of the markers are exchanged"
    if e.kind == "states_exchanged":
        return "loaded and unloaded are exchanged"
    if e.kind in ("poses_exchanged", "loads_exchanged"):
        pose = readings.states.pose[int(e.states[0])]
        what = {"pose": "the readings", "q": "the angles", "force": "the loads"}[e.column]
        return f"{what} of poses {pose} and {e.other} are exchanged"
    if e.kind == "repeated_readings":
        return f"the readings are those of pose {e.other} once more; what was read here is lost"
    why = "" if e.slip == OFF else f": {_SLIPS[e.slip]}"
    if not np.isfinite(e.found):
        return f"{e.column} of this {'pose' if e.touched is None else 'row'} do not stand as they were meant{why}"
    unit, factor = _unit_of(e)
    return f"{e.column} is {factor * e.found:.6g} {unit}, {factor * e.meant:.6g} was probably meant{why}"


def _block(e: Edit) -> str:
    if e.slip == FORCE:
        said = f"that of load {e.other}" if e.other else f"{e.meant:.4g} times what the table says"
        return f"the force there is {said}"
    if e.slip == FRAME:
        return "the tracker stood elsewhere, so that these rows are a series of their own"
    if e.slip == LOST:
        return "no other load, unit, sign or place of the tracker that was tried mends it; the rows are not used"
    return "the readings have the other sign" if e.slip == SIGN else f"the unit differs by a factor of {e.meant:.4g}"


def _unit_of(e: Edit) -> tuple[str, float]:
    """In which unit people read the column, and its factor from SI."""
    if e.column.startswith("q"):
        return e.unit.shown, e.unit.per
    if e.column.startswith("f"):
        return "N", 1.0
    return ("N m", 1.0) if e.column.startswith("m") else ("mm", 1e3)
