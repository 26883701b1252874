"""Runs of poses that belong to another setting: under another load, in another unit, from another place of the tracker.

One such run is no handful of slips: it is looked for before single poses are, and told as a block.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from qsframework.estimation import left, orthonormal
from qsframework.experiment import Readings
from qsframework.experiment.frames import motion_rows, procrustes
from qsframework.hypotheses.catalogue.edits import (
    SIGN,
    VALUES,
    Edit,
    PoseVisits,
    copied,
    factor,
    group_of,
    misfits,
    plain,
    vanishes,
)
from qsframework.hypotheses.catalogue.rows import among, as_series
from qsframework.hypotheses.standing_out import Standing

_LEAST = 3
"""Poses of a run below which it is no block."""
_INSIDE = 0.75
"""Share of the poses of a run that stand out at least."""
_CHANCE = 2e-3
"""Level at which visits that stand out here and there make such a run."""
_CLEAR = 2.0
"""Times the largest misfit elsewhere that those of a run have, where nothing says what is other."""
_STEPS = 6
_SMALL = 1e-3
FORCE, VALUE, FRAME, LOST = "force", "unit", "frame", "setting"
"""What is other in a block: its force, its unit or sign, the tracker's place, or what no change of the table mends."""


def block(standing: Standing) -> tuple[Edit, float] | None:
    """The run that stands out, as the edit that mends it, and the fall of the sum of squares; None without one."""
    run = _run(standing)
    if run is None:
        return None
    group = group_of(standing, run)
    start = plain(standing.readings, group, "block")
    before = float(misfits(standing, [start])[0])
    count = int(np.isfinite(start.value).sum())
    edits = [*_forces(standing, group), *_values(start)]
    after = misfits(standing, edits)
    for i in map(int, np.argsort(after)):
        if after[i] > standing.usual(count):
            break
        if not vanishes(standing, edits[i], float(after[i])):
            return edits[i], before - float(after[i])
    framed = _framed(standing, start)
    if framed is not None:
        return replace(start, slip=FRAME, masked=False, free=6), before - framed
    others = np.setdiff1d(standing.rows.keep, start.rows)
    if not np.isin(standing.readings.marker[start.rows], standing.readings.marker[others]).all():
        return None  # of a marker that is read nowhere else nobody knows what it would do in another setting
    elsewhere = np.delete(standing.misfit, run).max(initial=0.0)
    if np.median(standing.misfit[list(run)]) < _CLEAR * elsewhere:
        return None
    return replace(start, slip=LOST, masked=True), before


def _run(standing: Standing) -> tuple[int, ...] | None:
    """The visits of a run of poses of one file with the largest excess of those that stand out."""
    visits, rows = standing.visits, standing.rows
    first = np.unique(visits.of, return_index=True)[1]
    pose, file = rows.pose[first], standing.readings.file[rows.keep[first]]
    runs: list[tuple[float, list[int]]] = []
    for f in np.unique(file):
        names = list(dict.fromkeys(pose[file == f].tolist()))
        wrong = np.array([standing.wrong[(pose == p) & (file == f)].any() for p in names])
        excess = np.concatenate([[0.0], np.cumsum(np.where(wrong, 1.0, -1.0 / (1.0 - _INSIDE)))])
        low = np.minimum.accumulate(excess)
        end = int(np.argmax(excess - low))
        start = int(np.argmin(excess[: end + 1]))
        if end - start >= _LEAST:
            inside = np.isin(pose, names[start:end]) & (file == f)
            runs.append((float(excess[end] - excess[start]), np.flatnonzero(inside).tolist()))
    _, run = max(runs, key=lambda run: run[0], default=(0.0, list[int]()))
    if len(run) in (0, len(visits)):
        return None
    outside = np.delete(standing.wrong, run)
    share = (float(outside.sum()) + 0.5) / (len(outside) + 1.0)
    return tuple(run) if len(visits) * share ** int(standing.wrong[run].sum()) < _CHANCE else None


def _forces(standing: Standing, group: PoseVisits) -> Iterator[Edit]:
    """The force of all poses that of a load of the experiment, or so many times as large, as the readings tell it."""
    readings = standing.readings
    start = plain(readings, group, "block", FORCE)
    loaded = readings.states.loaded[group.states]
    if not start.wrench[loaded].any():
        return
    whitened = factor(standing, start)
    for load in standing.experiment.loads:
        hung = np.where(loaded[:, None], load.wrench, start.wrench)
        if not np.allclose(hung, start.wrench):
            yield replace(start, wrench=hung, column="force", other=load.name)

    def scaled(c: float) -> Edit:
        wrench = np.where(loaded[:, None], c * start.wrench, start.wrench)
        return replace(start, wrench=wrench, column="force", found=1.0, meant=c, free=1)

    for c in (1.0, -1.0):
        for _ in range(_STEPS):
            both = standing.missed(copied(standing, [scaled(c), scaled(c + _SMALL)])).reshape(2, -1) @ whitened.T
            slope = (both[1] - both[0]) / _SMALL
            c -= float(slope @ both[0]) / max(float(slope @ slope), 1e-300)
        yield scaled(c)


def _values(start: Edit) -> Iterator[Edit]:
    for number, slip in VALUES:
        yield replace(start, slip=SIGN if slip == SIGN else VALUE, value=start.value * number, found=1.0, meant=number)


def _framed(standing: Standing, start: Edit) -> float | None:
    """The misfit of a block whose readings stand in a frame of their own; None where that does not mend it."""
    readings = standing.readings
    if (readings.minus[start.rows] >= 0).any() or len(np.unique(readings.frame[start.rows])) > 1:
        return None
    # about its own place: the rigid motion that brings the readings to what is foretold, then what is left of it
    whitened = factor(standing, start)
    size = standing.unit * readings.sigma[start.rows]
    error = standing.missed(copied(standing, [start])) * size
    measured = readings.value[start.rows]
    foretold = measured - error
    frame = procrustes(measured, foretold)
    rest = (measured @ frame.rotation.T + frame.origin - foretold) / size
    columns = whitened @ (motion_rows(foretold) / size.reshape(-1, 1))
    square = float(np.sum(left(orthonormal(columns), whitened @ rest.ravel()) ** 2))
    return square if square <= standing.usual(error.size) else None


def in_frame(readings: Readings, edit: Edit) -> Readings:
    """The rows of a block as a series of their own, whose frame is found."""
    lines = readings.line[edit.rows]
    return as_series(readings, among(readings, edit.rows), f"rows {lines.min()} to {lines.max()}")
