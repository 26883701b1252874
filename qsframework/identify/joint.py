"""Absolute positions with priors, robust losses, fixed and tied parameters, alone or together with displacements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.errors import InputError, Problem, nearest
from qsframework.experiment import Experiment, Readings, StateReadings
from qsframework.files import sha256
from qsframework.identify.absolute import PositionFit, fit_order, identify_positions, position_sigma
from qsframework.identify.adjust import limits_of
from qsframework.identify.choice import LeftAside, choose
from qsframework.identify.fit import Estimate
from qsframework.identify.identify import displacement_observations, orthonormal, settled, words_of
from qsframework.identify.linear import Rows, fit_rows, left_out, status_in_positions, studentised
from qsframework.identify.observations import Observations
from qsframework.identify.positions import Positions, joint_observations, make_positions, position_observations
from qsframework.identify.reduction import reduce
from qsframework.identify.solve import Solution
from qsframework.identify.uncertainty import load_columns, load_sds, position_columns
from qsframework.information import rank_test
from qsframework.plugin import Array, Indices


@dataclass(frozen=True)
class Choices:
    """How to fit: as `identify` takes them."""

    priors: bool = False
    loss: str = "linear"
    fixed: tuple[str, ...] = ()
    tied: tuple[tuple[str, ...], ...] = ()


@dataclass(frozen=True, eq=False)
class _Data:
    """Both kinds of readings, and the plain fit of the positions; `sigma` (R,) of the positions."""

    plain: PositionFit
    positions: Positions
    sigma: Array
    displacements: Readings | None
    rows: Rows | None
    stated: bool

    @property
    def motions(self) -> int:
        """Parameters of the trackers' frames."""
        return 6 * len(self.plain.frames)

    def observations(self, x: Array, names: Sequence[str]) -> Observations:
        """All readings as scalars; what is not named stays as in x."""
        absolute = position_observations(self.positions, self.plain.frames, x, names, self.sigma)
        if self.displacements is None or self.rows is None:
            return absolute
        displaced = displacement_observations(self.plain.model, self.displacements, self.rows, names, x)
        return joint_observations([absolute, displaced])

    def nominal(self) -> Array:
        """What the nominal arm says (R, 3): in the best frames for it, and displaced."""
        if self.displacements is None or self.rows is None:
            return self.plain.nominal
        model = self.plain.model
        return np.concatenate(
            [self.plain.nominal, self.rows.of(model.predict(self.displacements.poses, model.nominal))]
        )


def identify_jointly(
    experiment: Experiment, states: StateReadings, fit: Sequence[str] | None = None,
    displacements: Readings | None = None, how: Choices | None = None,
) -> PositionFit:  # fmt: skip
    """Estimate from absolute positions within bounds, with what `how` asks for; `displacements` join the same fit.

    Parameters are shared by both kinds of readings, which are weighed by their own sds. It starts at, and masks the
    gross errors of, the plain fit of the positions. What neither kind tells is left aside by name.

    Raises InputError where a name is unknown, or where two kinds of readings have no stated sds; NotConverged.
    """
    how = how or Choices()
    experiment = experiment if fit is None else experiment.with_(fit=tuple(fit))
    names = fit_order(experiment)
    _check_names(how, names)
    data = _data(experiment, states, displacements)
    model = data.plain.model
    x = data.plain.x.copy()
    fixed = model.index(list(how.fixed))
    x[fixed] = model.nominal[fixed]
    free = [n for n in names if n not in how.fixed]
    told, left = _told(data, x, free, how)
    untold = model.index([n for n in free if n not in told])
    x[untold] = model.nominal[untold]
    groups = tuple(group for group in how.tied if set(group) <= set(told))
    observations = data.observations(x, told)
    start = np.clip(x[model.index(told)], *_bounds(observations)[data.motions :].T)
    start = np.concatenate([np.zeros(data.motions), start])
    solution, unit = settled(observations, how.priors, how.loss, (), groups, not data.stated, start, starts=0)
    x[model.index(told)] = solution.x[data.motions :]
    found = _result(
        data, observations, solution, unit, x, (*words_of(how.priors, how.loss, how.fixed, groups, solution),), left
    )
    sds = load_sds(experiment, told)
    if not sds.any() or (displacements is None and not data.positions.loaded[data.positions.state].any()):
        return found
    return replace(found, total_covariance=found.covariance + _of_load(data, observations, solution, found, sds))


def _of_load(data: _Data, o: Observations, solution: Solution, found: PositionFit, sds: Array) -> Array:
    """Covariance (p, p) that the load's scale and rotations, of sds (4,) and alike for both kinds, bring."""
    L = position_columns(data.positions, found.frames, found.x).reshape(-1, len(sds))
    if data.displacements is not None and data.rows is not None:
        moved = data.rows.of(load_columns(found.model, data.displacements, found.x))
        L = np.concatenate([L, moved.reshape(-1, len(sds))])
    rows = o.noise.whiten(o.jacobian(solution.x))
    G = solution.covariance / solution.robust @ (rows.T @ o.noise.whiten(L * sds))
    return G @ G.T


def _check_names(how: Choices, names: Sequence[str]) -> None:
    for name in (*how.fixed, *(n for group in how.tied for n in group)):
        if name not in names:
            raise InputError(Problem(f"the fit has no parameter {name!r}", allowed=", ".join(names),
                                     hint=nearest(name, names)))  # fmt: skip


def _data(experiment: Experiment, states: StateReadings, displacements: Readings | None) -> _Data:
    plain = identify_positions(experiment, states)
    states = replace(states, use=states.use & ~np.isin(states.rows, plain.masked))
    positions = make_positions(plain.model, states)
    sigma, stated = position_sigma(experiment, states, positions)
    if displacements is None:
        return _Data(plain, positions, sigma, None, None, stated)
    rows, _ = fit_rows(experiment, displacements, 0)
    unknown = [
        kind
        for kind, values in (
            ("positions", states.sigma[positions.keep]),
            ("displacements", displacements.sigma[rows.keep]),
        )
        if experiment.noise.sigma is None and np.isnan(values).any()
    ]
    if unknown:
        raise InputError(
            f"the sd of the {' and of the '.join(unknown)} is not stated: one fit of two kinds of readings weighs "
            "them by it. State noise: {sigma_mm: ...} in the experiment, or a column sigma_mm in both files"
        )
    return _Data(plain, positions, sigma, displacements, rows, True)


def _bounds(observations: Observations) -> Array:
    return np.array([(p.lower, p.upper) for p in observations.parameters])


def _told(data: _Data, x: Array, names: Sequence[str], how: Choices) -> tuple[list[str], tuple[LeftAside, ...]]:
    """The names that the readings, with the priors, can tell, seen from the nominal arm's errors."""
    o = data.observations(x, names)
    start = np.concatenate([np.zeros(data.motions), x[data.plain.model.index(names)]])
    reduction = reduce(o.parameters, np.clip(start, *_bounds(o).T), (), how.tied)
    rows = o.noise.whiten(o.jacobian(start) @ reduction.T)
    nominal = o.noise.whiten(data.nominal().ravel() - o.measured)
    count = 3 * len(data.sigma)
    for part in (slice(0, count), slice(count, None)):
        if rows[part].size:
            rows[part] /= max(float(np.sqrt(np.mean(nominal[part] ** 2))), 1e-300)
    if how.priors:
        known = [i for i, p in enumerate(o.parameters) if p.sd is not None]
        sds = np.array([o.parameters[i].sd for i in known], dtype=float)
        rows = np.vstack([rows, reduction.T[known] / sds[:, None]])
    limits = np.array(
        [np.inf] * data.motions + limits_of(data.plain.model, [g[0] for g in reduction.names[data.motions :]])
    )
    taken, left = choose(rows, [" = ".join(g) for g in reduction.names], limits)
    chosen = {n for k in taken for n in reduction.names[k]}
    return [n for n in names if n in chosen], left


def _result(
    data: _Data, o: Observations, solution: Solution, unit: float | None, x: Array, notes: tuple[str, ...],
    left: tuple[LeftAside, ...],
) -> PositionFit:  # fmt: skip
    plain, positions, count = data.plain, data.positions, len(data.sigma)
    moved = np.flatnonzero(np.diag(solution.covariance) > 0.0)
    free = solution.jacobian[:, moved] * [o.parameters[i].scale for i in moved]
    Q = orthonormal(free, solution.free)
    white = solution.residuals.reshape(-1, 3) * (1.0 if unit is None else unit)
    dof = white.size - Q.shape[1]
    chi2 = float((white**2).sum())
    size = 1.0 if data.stated else float(np.sqrt(chi2 / dof)) if unit is None else unit
    covariance = solution.covariance * size**2
    frames = tuple(f.moved(solution.x[6 * i : 6 * i + 6]) for i, f in enumerate(plain.frames))
    values = np.concatenate([*(f.pose for f in frames), solution.x[data.motions :]])
    measured = o.measured.reshape(-1, 3)
    predicted = o.predict(solution.x).reshape(-1, 3)
    outside = o.noise.colour(left_out(white, Q, _together(data, o)).ravel()).reshape(-1, 3)
    notes = (*plain.notes, *notes)
    poses, more, sigma = positions.pose, notes, data.sigma
    if data.displacements is not None and data.rows is not None:
        r = data.displacements
        poses += tuple(f"{r.pose[m]} (displacement)" for m in data.rows.measurement)
        sigma = np.concatenate([sigma, data.rows.sigma])
        digest = sha256(r.source) if r.source is not None else "not from a file"
        more = (
            f"{count} positions and {len(measured) - count} displacements in one fit (displacements: {digest}).",
            *notes,
        )
    return PositionFit(
        "positions" if data.displacements is None else "joint", plain.model, x,
        _estimates(o, values, covariance, solution),
        covariance, rank_test(free, [o.names[i] for i in moved]), size * float(np.sqrt(np.mean(sigma**2))),
        "stated" if data.stated else "estimated", o.rows[::3], poses, measured, predicted, data.nominal(),
        measured - predicted, studentised(white, Q, Q.shape[1], o.noise), outside, chi2 / size**2, dof,
        plain.data_sha256, more, frames=frames, left_aside=left, masked=plain.masked, displaced=len(measured) - count,
    )  # fmt: skip


def _together(data: _Data, o: Observations) -> Indices:
    """Number of the pose (R,) with which a reading is left out."""
    block = o.block[::3].copy()
    if data.rows is not None and data.rows.together is not None:
        count = len(data.sigma)
        block[count:] = block[:count].max() + 1 + data.rows.together
    return block


def _estimates(o: Observations, values: Array, covariance: Array, solution: Solution) -> tuple[Estimate, ...]:
    out: list[Estimate] = []
    for p, v, s in zip(o.parameters, values.tolist(), np.sqrt(np.diag(covariance)).tolist(), strict=True):
        bound = p.name in solution.at_bound
        end = f"at its {'lower' if v <= p.lower else 'upper'} bound {v:g}: it errs to one side only, so no sd is quoted"
        sd = float("nan") if bound else s
        said = end if bound else status_in_positions(p, v, s)
        out.append(Estimate(p.name, p.unit, v, sd, p.nominal, p.lower, p.upper, said))
    return tuple(out)
