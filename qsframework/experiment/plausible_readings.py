"""Can these readings be? The loads of the states, and the markers beside where a rigid arm puts them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from qsframework.errors import MOST_PROBLEMS, InputError, Problem, refuse
from qsframework.experiment.columns import FORCE, WRENCH, Table
from qsframework.experiment.frames import PLANE, POINT
from qsframework.experiment.reading_rows import MeasuredRows
from qsframework.experiment.readings import Readings
from qsframework.experiment.setup import Experiment
from qsframework.plugin import Array

_TOUCHED = 0.1
"""m that a rigid nominal arm may put a marker from the point that it touched."""
_UNIT_SLIP = 100.0
"""Measured positions spread this many times wider or narrower than the arm's own are in a wrong unit."""


def no_load(table: Table, experiment: Experiment) -> None:
    """InputError where the readings are of a load but the experiment does not say where it acts."""
    if not experiment.has_load:
        message = f"holds readings under load, but {experiment.path.name} does not say where the load acts"
        raise InputError(Problem(message, str(table.path), hint="Add for example load: {point_mm: [150, 0, 200]}."))


def load_problems(rows: MeasuredRows) -> list[Problem]:
    """States whose wrench is not that of a loaded, or of an unloaded state."""
    if not rows.of_states:
        return []
    table, acts = rows.table, np.any(rows.wrench != 0.0, axis=1)
    loaded, unloaded = (np.array(table.text("state")) == state for state in ("loaded", "unloaded"))
    missing = [f for f in FORCE if f not in table.numbers]
    out: list[Problem] = []
    if missing and (loaded.any() or len(missing) < 3):
        column, allowed = f"{missing[0]}_N", "the columns fx_N, fy_N, fz_N"
        out.append(Problem("a loaded state needs its force", str(table.path), column=column, allowed=allowed))
    empty = np.isnan(table.columns(WRENCH, 0.0)) & loaded[:, None]
    unclear = {(p.line, p.column) for p in table.problems}
    for i, k in ((int(i), int(k)) for i, k in np.argwhere(empty)[:MOST_PROBLEMS]):
        problem = table.problem(i, WRENCH[k], "is empty, but the state is loaded", "''", "a finite number")
        out += [] if (problem.line, problem.column) in unclear else [problem]
    idle = loaded & ~empty.any(axis=1) & ~acts & (not missing)
    out += table.each(idle, "fx", "the state is loaded, but every force is zero")
    for i in np.flatnonzero(unloaded & acts)[:MOST_PROBLEMS].tolist():
        k = int(np.flatnonzero(rows.wrench[i])[0])
        message, hint = "an unloaded state has no force", "Leave its force empty or 0, or call the state loaded."
        out.append(table.problem(i, WRENCH[k], message, f"{rows.wrench[i, k]:g}", "0 or nothing", hint))
    return out


def idle_problems(rows: MeasuredRows) -> list[Problem]:
    """Displacements from nothing: under no load, or all zero."""
    table, acts = rows.table, np.any(rows.wrench, axis=1)
    if rows.of_states:
        return []
    nothing = "a displacement under no load carries no information"
    if not acts.any():
        return [Problem(f"every force is zero; {nothing}", str(table.path))]
    if rows.use.any() and not np.any(np.nan_to_num(rows.value[rows.use])):
        return [Problem("every displacement is zero; nothing was measured", str(table.path))]
    hint = "Give the row its load, or mask it with use = 0."
    return table.each(rows.use & ~acts, "fx", f"no force and no moment: {nothing}", hint)


def check_places(table: Table, experiment: Experiment, found: Readings) -> None:
    """InputError where positions do not spread as the arm does, or touched points are not where it puts markers."""
    places = experiment.rigid_places(found.poses.q)[found.plus, found.marker]
    for f, name in enumerate(found.frames):
        if not name.startswith((POINT, PLANE)):
            _check_spread(table, name, found, found.frame == f, places)
    refuse([p for f in range(len(found.frames)) for p in _far_touched(table, found, f, places)])


def _check_spread(table: Table, series: str, found: Readings, own: npt.NDArray[np.bool_], places: Array) -> None:
    """Within a series positions spread as far as the arm's own, in whatever frame; a wrong unit shows."""
    rows = own & np.isfinite(found.value).all(axis=1) & found.use
    measured, there = (float(np.sqrt(p[rows].var(axis=0).sum())) if rows.any() else 0.0 for p in (found.value, places))
    if there < 1e-3 or measured == 0.0 or 1.0 / _UNIT_SLIP < measured / there < _UNIT_SLIP:
        return
    where = f" of series {series!r}" if series else ""
    told, allowed = f"a spread of {measured:.3g} m", f"about the arm's own, {there:.3g} m"
    message = f"the positions{where} do not fit the poses; is their unit right?"
    raise InputError(Problem(message, str(table.path), column=table.names["x"], found=told, allowed=allowed))


def _far_touched(table: Table, found: Readings, f: int, places: Array) -> list[Problem]:
    """Rows whose marker a rigid arm puts far from where most others put the same point."""
    kind, _, name = found.frames[f].partition(":")
    known, rows = found.known[f], np.flatnonzero((found.frame == f) & found.use)
    if f"{kind}:" not in (POINT, PLANE) or not len(rows):
        return []
    there = places[rows] if known is None else places[rows] @ known.rotation[:1].T
    there = there - found.value[rows][:, : there.shape[1]]
    off = np.linalg.norm(there - np.median(there, axis=0), axis=1)
    message = "the marker lies {:.0f} mm from where the others touch {!r}"
    allowed = f"up to {1e3 * _TOUCHED:.0f} mm"
    hint = "Is it another point, another marker or another pose? Else put 0 in the column use."
    return [
        table.problem(i, "point", message.format(1e3 * far, name), allowed=allowed, hint=hint)
        for i, far in zip(rows.tolist(), off.tolist(), strict=True)
        if far > _TOUCHED
    ]
