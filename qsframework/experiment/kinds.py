"""Several kinds of readings in one campaign: is each weighed by noise that somebody states, and do they agree?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from qsframework.errors import MOST_PROBLEMS, InputError, Problem, refuse
from qsframework.experiment.reading_rows import MeasuredRows
from qsframework.experiment.readings import KINDS, UNSTATED, Readings
from qsframework.experiment.setup import Experiment
from qsframework.plugin import Array

_APART = 1.0
"""m: a displacement and the positions of one marker that contradict each other by more are not of one arm."""
_SAME = 1e-6
"""rad: angles that differ by less are those of one pose."""


@dataclass(frozen=True, eq=False)
class Part:
    """One file's readings. own: every row has a sigma of its own; stated: those that have none get theirs from the
    experiment."""

    readings: Readings
    own: bool
    stated: bool

    @property
    def kinds(self) -> tuple[str, ...]:
        """Of the rows in use."""
        r = self.readings
        flags = (~r.is_position & ~r.is_gauge, r.is_position & ~r.is_gauge, r.is_gauge)
        return tuple(name for name, own in zip(KINDS, flags, strict=True) if (own & r.use).any())


def check_kinds(parts: Sequence[Part], whole: Readings, experiment: Experiment) -> None:
    """InputError where noise that nobody states would weigh the kinds of readings or the files against each other,
    where a gauge has no zero, or where displacements and positions contradict each other."""
    _check_noise(parts, whole, experiment)
    refuse([*_zeros(whole), *_contradictions(whole)])


def row_sigmas(rows: MeasuredRows, experiment: Experiment) -> tuple[Array, bool]:
    """sd (R,) m of one coordinate of each row, and whether it is stated; UNSTATED where nobody says anything."""
    noise, own = experiment.noise, _far_sigma(rows, experiment)
    here = list(dict.fromkeys(rows.kind.tolist()))
    if noise.sigma is not None and not noise.apart and len(here) > 1 and np.isnan(own[rows.use]).any():
        raise InputError(_which_sigma(experiment, here))
    missing = unstated(rows, experiment) & np.isnan(own)
    if missing.any() and not missing[rows.use].all():
        i = int(np.flatnonzero(missing)[0])
        message = f"{int(missing.sum())} readings have no sigma_mm and the experiment states no noise, others have one"
        raise InputError(rows.table.problem(i, "sigma", message, hint="Give all of them or none."))
    sigma = np.where(np.isnan(own), _known_sigma(rows, experiment), own)
    sigma = np.where(np.isnan(sigma), UNSTATED, sigma)
    stated = not missing.any() and (noise.sigma is not None or noise.apart)
    return np.where(np.isnan(rows.sigma), rows.reads.sigma(sigma), sigma), stated


def unstated(rows: MeasuredRows, experiment: Experiment) -> npt.NDArray[np.bool_]:
    """Rows (R,) in use of which nobody states the sd."""
    return rows.use & np.isnan(rows.sigma) & np.isnan(_known_sigma(rows, experiment))


def _known_sigma(rows: MeasuredRows, experiment: Experiment) -> Array:
    """sd (R,) m that the experiment states for each row, NaN where it states none."""
    noise = experiment.noise
    by_kind = {"displacement": noise.displacement, "position": noise.position, "gauge": noise.gauge}
    stated = [by_kind[kind] if noise.apart else noise.sigma for kind in rows.kind.tolist()]
    return np.array(stated, dtype=float)


def _far_sigma(rows: MeasuredRows, experiment: Experiment) -> Array:
    """sd (R,) m of rows, of positions that have none with what the distance from the tracker adds."""
    near, slope = experiment.noise.of_position, experiment.noise.per_distance
    if near is None or not slope:
        return rows.sigma
    far = near + slope * np.linalg.norm(rows.value, axis=1)
    return np.where(np.isnan(rows.sigma) & (rows.kind == "position") & np.isfinite(far), far, rows.sigma)


def _which_sigma(experiment: Experiment, kinds: Sequence[str]) -> Problem:
    """What is wrong with a sigma_mm that stands for several kinds of readings."""
    return Problem(
        "noise: sigma_mm does not say of which kind of reading it is",
        str(experiment.path),
        found=", ".join(kinds),
        allowed=_keys(kinds),
        hint="State each kind by itself, or give every row a sigma_mm.",
    )


def _keys(kinds: Sequence[str]) -> str:
    return ", ".join(f"{k}_sigma_mm" for k in kinds)


def _check_noise(parts: Sequence[Part], whole: Readings, experiment: Experiment) -> None:
    bare = [p for p in parts if not p.own]
    kinds = tuple(k for k in KINDS if any(k in p.kinds for p in bare))
    if experiment.noise.sigma is not None and not experiment.noise.apart and len(kinds) > 1:
        raise InputError(_which_sigma(experiment, kinds))
    silent = [p for p in bare if not p.stated]
    if silent and len(silent) < len(parts):
        hint = f"State noise: {_keys(silent[0].kinds)} in the experiment, or give every row a sigma_mm."
        message = "nobody states the sd of these readings, which weighs them against those of the other files"
        raise InputError([Problem(message, p.readings.where, hint=hint) for p in silent])
    if silent and len(kinds) > 1:
        keys = "{" + ": ..., ".join(f"{k}_sigma_mm" for k in kinds) + ": ...}"
        message = f"the sd of {' and '.join(f'{k}s' for k in kinds)} is not stated: one fit of several kinds of"
        hint = f"State noise: {keys} in the experiment, or give every row a sigma_mm."
        raise InputError(Problem(f"{message} readings weighs them by it", whole.where, hint=hint))


def _zeros(whole: Readings) -> list[Problem]:
    """Gauges that were read at one state only."""
    unpaired = whole.is_gauge & whole.is_position & whole.use & (whole.to < 0)
    message = "the gauge has no zero: its reading at one state says nothing"
    hint = "Read it loaded and unloaded (states: differences), or give to_marker for a distance."
    return [whole.problem(i, message, hint=hint) for i in np.flatnonzero(unpaired)[:MOST_PROBLEMS].tolist()]


def _contradictions(whole: Readings) -> list[Problem]:
    """Displacements of a marker beside positions of it at the same pose that moved by metres, or the other way."""
    vector = whole.use & ~whole.is_gauge & np.isfinite(whole.value).all(axis=1)
    moved = np.flatnonzero(vector & ~whole.is_position).tolist()
    if not moved or not (vector & whole.is_position).any():
        return []
    loaded = whole.states.loaded[whole.plus]
    unloaded = np.flatnonzero(vector & whole.is_position & ~loaded).tolist()
    zero = {(_place(whole, i), *_series(whole, i)): i for i in unloaded}
    told = {_place(whole, i): i for i in moved}
    problems: list[Problem] = []
    for i in np.flatnonzero(vector & whole.is_position & loaded).tolist():
        place = _place(whole, i)
        before, j = zero.get((place, *_series(whole, i))), told.get(place)
        if before is None or j is None:
            continue
        apart = float(np.linalg.norm(whole.value[i] - whole.value[before]))
        size = float(np.linalg.norm(whole.value[j]))
        if abs(apart - size) > _APART:
            line, file = int(whole.line[j]), str(whole.sources[int(whole.file[j])])
            message = f"the marker's positions loaded and unloaded (line {int(whole.line[before])}) are {apart:.3g} m "
            message += f"apart, but its displacement ({file}, line {line}) is {size:.3g} m: these are not of one arm"
            hint = "Check the pose names, the marker and the units, or put 0 in the column use of the wrong row."
            problems.append(whole.problem(i, message, hint=hint))
    return problems[:MOST_PROBLEMS]


def _place(whole: Readings, i: int) -> tuple[object, ...]:
    """Pose, angles and marker of a row."""
    s = int(whole.plus[i])
    angles = tuple(round(v / _SAME) for v in whole.poses.q[s].tolist())
    return (whole.states.pose[s], *angles, int(whole.marker[i]))


def _series(whole: Readings, i: int) -> tuple[int, str]:
    return int(whole.file[i]), whole.states.series[int(whole.plus[i])]
