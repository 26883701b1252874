"""Several kinds of readings in one campaign: is each weighed by noise that somebody states, and do they agree?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from qsframework.errors import MOST_PROBLEMS, InputError, Problem, refuse
from qsframework.experiment.noise import seen_from, split_covariances
from qsframework.experiment.reading_rows import MeasuredRows
from qsframework.experiment.readings import KINDS, UNSTATED, Readings
from qsframework.experiment.setup import Experiment
from qsframework.plugin import Array, Indices

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


@dataclass(frozen=True, eq=False)
class RowNoise:
    """sd (R, 3) m of the coordinates of rows, UNSTATED where nobody says anything, and what they err more along some
    directions (R, 2, 3), None where all coordinates err alike; stated: whether their size is known."""

    sigma: Array
    directed: Array | None
    stated: bool


def row_noise(rows: MeasuredRows, experiment: Experiment) -> RowNoise:
    """The noise of the rows of a table: of their column sigma, else as the experiment states it of each kind."""
    noise = experiment.noise
    known = _stated_covariances(rows, experiment)
    here = list(dict.fromkeys(rows.kind.tolist()))
    bare = rows.use & np.isnan(rows.sigma)
    if noise.sigma is not None and not noise.apart and len(here) > 1 and bare.any():
        raise InputError(_which_sigma(experiment, here))
    nobody = np.isnan(known[:, 0, 0])
    missing = bare & nobody
    if missing.any() and not missing[rows.use].all():
        i = int(np.flatnonzero(missing)[0])
        message = f"{int(missing.sum())} readings have no sigma_mm and the experiment states no noise, others have one"
        raise InputError(rows.table.problem(i, "sigma", message, hint="Give all of them or none."))
    known[nobody] = UNSTATED**2 * np.eye(3)
    sigma, directed = split_covariances(known)
    one = np.sqrt(np.mean(np.square(sigma), axis=1))
    mean = 1.0 / np.sqrt(rows.reads.count) if noise.nest else rows.reads.sigma(one) / one
    sigma, directed = sigma * mean[:, None], directed * mean[:, None, None]
    sigma = np.sqrt(np.square(sigma) + noise.nest**2)
    given = np.isfinite(rows.sigma)
    sigma[given] = rows.sigma[given][:, None]
    directed[given] = 0.0
    stated = not missing.any() and noise.known and not noise.estimated
    return RowNoise(sigma, directed if directed.any() else None, stated)


def unstated(rows: MeasuredRows, experiment: Experiment) -> npt.NDArray[np.bool_]:
    """Rows (R,) in use of which nobody states the sd."""
    return rows.use & np.isnan(rows.sigma) & np.isnan(_stated_covariances(rows, experiment)[:, 0, 0])


def _stated_covariances(rows: MeasuredRows, experiment: Experiment) -> Array:
    """Covariances (R, 3, 3) m^2 that the experiment states for one read of each row, NaN where it states none."""
    noise, out = experiment.noise, np.full((len(rows.use), 3, 3), np.nan)
    touched = np.array([bool(point) for point in rows.points])
    kinds = np.where(touched & (rows.kind == "position"), "touch", rows.kind)
    for kind in dict.fromkeys(kinds.tolist()):
        own = np.flatnonzero(kinds == kind)
        seen = _seen(rows, own, experiment) if noise.of_beam(kind) else np.nan_to_num(rows.value[own])
        found = noise.covariances(kind, seen)
        if found is not None:
            out[own] = found
    return out


def _seen(rows: MeasuredRows, own: Indices, experiment: Experiment) -> Array:
    """Where markers (n, 3) m are from the tracker: a position says it; of a displacement the arm is taken as rigid."""
    if rows.of_states:
        return np.nan_to_num(rows.value[own])
    places = experiment.rigid_places(experiment.robot.controller.to_joints(rows.pendant[own]))
    series = np.array(rows.table.text("series"))[own].tolist()
    there = zip(series, places[np.arange(len(own)), rows.marker[own]], strict=True)
    return np.stack([seen_from(experiment, name, place) for name, place in there])


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
