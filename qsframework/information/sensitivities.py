"""Whitened, scaled sensitivities: the rows that designs and fits work on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsframework.elastostatics import Model
from qsframework.estimation import left, orthonormal, scales
from qsframework.estimation.statistics import identified_directions
from qsframework.experiment import Experiment, Plan, Readings, make_rows
from qsframework.experiment.frames import motion_count
from qsframework.experiment.observations import start_values
from qsframework.experiment.prior import priors_of
from qsframework.experiment.readings import UNSTATED
from qsframework.experiment.simulate import planned_readings
from qsframework.experiment.stations import station_frame
from qsframework.information.identifiable import REDUNDANT, choose, in_order
from qsframework.plugin import Array, Poses


def information_rows(
    model: Model,
    poses: Poses,
    names: Sequence[str],
    sigma: float,
    x: Array | None = None,
    linear: bool = False,
) -> Array:
    """Whitened rows (N, 3 K, p) of each pose, per unit of each parameter's scale (equation (4), whitened).

    x (q,): values of all parameters to take them at, the nominal ones if None; linear: of the first step from the
    commanded pose
    """
    chosen = [model.parameters[i] for i in model.index(names)]
    A = model.sensitivity(poses, x, names, linear).reshape(len(poses), -1, len(names))
    A *= scales(chosen) / sigma
    return A


def information(rows: Array) -> Array:
    """Information matrix (N, p, p) of each pose: A' A."""
    return rows.transpose(0, 2, 1) @ rows


def readings_columns(
    experiment: Experiment, readings: Readings, names: Sequence[str], x: Array | None = None, frames: bool = True
) -> Array:
    """Whitened columns (m, p) of readings, per unit of each parameter's scale, beside the frames that nobody knows.

    x (q,): values of all parameters, those of a fit's start if None; frames: whether these are found from the readings,
    else they are those of the experiment's stations
    """
    rows, model = make_rows(readings), experiment.model()
    x = start_values(experiment, names) if x is None else x
    unit = 1.0 if experiment.noise.known else UNSTATED
    found = rows.start(model, x) if frames else [station_frame(experiment, readings.frames[f]) for f in rows.estimated]
    white = rows.noise.whiten(rows.flat(rows.rates(model, x, found, names)[1])) * unit
    k = motion_count(found)
    return left(orthonormal(white[:, :k]), white[:, k:] * scales([model.parameters[i] for i in model.index(names)]))


def plan_columns(experiment: Experiment, plan: Plan, names: Sequence[str], x: Array | None = None) -> Array:
    """The same of what a plan reads."""
    start = start_values(experiment, names) if x is None else x
    return readings_columns(experiment, planned_readings(experiment, plan, start), names, start, frames=False)


def known_before(model: Model, names: Sequence[str], free: bool = False) -> Array:
    """How sharply each parameter (p,) is known before any reading: its scale over its sd; 0 of those of which nothing
    is known, and of all where what is known is not to count."""
    index = model.index(names)
    return scales([model.parameters[i] for i in index]) / (np.inf if free else priors_of(model).sd[index])


def covariance_after(model: Model, columns: Array, names: Sequence[str], free: bool = False) -> tuple[list[int], Array]:
    """What a fit takes of whitened scaled columns (m, p) beside what is known before: the places (k,) of its
    parameters among the names, and a root (k, k) of their scaled covariance B B'."""
    before = known_before(model, names, free)
    told = np.flatnonzero(before)
    open_ = [n for n in in_order(model, names) if not before[list(names).index(n)]]
    place = [list(names).index(n) for n in open_]
    own = [*(place[i] for i in choose(columns[:, place], open_)[0]), *told.tolist()]
    rows = np.concatenate([columns, np.diag(before)[told]])[:, own]
    size = np.linalg.norm(rows, axis=0)
    return own, np.linalg.inv(np.linalg.qr(rows / size, mode="r")) / size[:, None]


def sd_after(model: Model, columns: Array, names: Sequence[str], free: bool = False) -> Array:
    """Standard deviation (p,), SI, of what a fit takes of whitened scaled columns (m, p); inf of what it holds."""
    out = np.full(len(names), np.inf)
    own, half = covariance_after(model, columns, names, free)
    out[own] = np.linalg.norm(half, axis=1)
    return out * scales([model.parameters[i] for i in model.index(names)])


def identified_by(experiment: Experiment, plan: Plan, free: bool = False) -> tuple[int, int]:
    """In how many directions of the fitted parameters a plan tells more than is known before, and how many there are:
    one of each parameter of which nothing is known; free: of any."""
    model, names = experiment.model(), experiment.fit_names()
    own, half = covariance_after(model, plan_columns(experiment, plan, names), names, free)
    before = known_before(model, names, free)[own]
    known = np.flatnonzero(before)
    told = identified_directions((half @ half.T)[np.ix_(known, known)], 1.0 / before[known])
    return len(own) - len(known) + told, len(names)


def predicted_beyond(experiment: Experiment, plan: Plan) -> dict[str, float]:
    """For each parameter of the model that is not fitted: the sd, SI, that readings would tell it to, were it fitted
    too; inf where they tell nothing of it."""
    model, fitted = experiment.model(), experiment.fit_names()
    others = [name for name in model.names if name not in fitted]
    columns, first = plan_columns(experiment, plan, (*fitted, *others)), [*range(len(fitted))]
    each = [sd_after(model, columns[:, [*first, len(first) + k]], (*fitted, n))[-1] for k, n in enumerate(others)]
    after = np.array(each)
    before = priors_of(model).sd[model.index(others)]
    share = np.divide(after, before, out=np.zeros(len(others)), where=np.isfinite(before))
    told = np.maximum(1.0 - share**2, 0.0)
    alone = np.divide(after, np.sqrt(told), out=np.full(len(others), np.inf), where=told > REDUNDANT)
    return dict(zip(others, alone.tolist(), strict=True))


def predicted_sd(
    experiment: Experiment, plan: Plan, names: Sequence[str] | None = None, *, free: bool = False
) -> Array:
    """Standard deviation (p,) that a plan predicts for the experiment's parameters, SI; free: by its readings alone."""
    names = experiment.fit_names() if names is None else names
    return sd_after(experiment.model(), plan_columns(experiment, plan, names), names, free)
