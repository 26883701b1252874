"""Identify from absolute positions: trackers' frames, markers, geometry, and what gravity bends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from qsframework.errors import InputError
from qsframework.experiment import Experiment, StateReadings
from qsframework.experiment.setup import GEOMETRY, expand_name
from qsframework.files import sha256
from qsframework.identify.adjust import BROAD, Problem, Solved
from qsframework.identify.choice import LeftAside
from qsframework.identify.fit import Estimate, Fit
from qsframework.identify.frames import Frame
from qsframework.identify.linear import status_in_positions, studentised
from qsframework.identify.positions import Mask, Positions, make_positions
from qsframework.identify.single import single_pose
from qsframework.identify.uncertainty import load_sds, position_columns
from qsframework.information import rank_test
from qsframework.plugin import Array, Geometry, Parameter, Sensor, Spring

GROSS = 7.0
"""A reading is a gross error beyond so many robust standard deviations of one coordinate."""
_ROUNDS = 10
_LOUD = 10.0
"""Gross errors so many times larger than the rest: the choice of parameters is made again without them."""
_MANY = 0.1
"""Share of the readings beyond which it is the model that is wrong, not they."""


@dataclass(frozen=True, eq=False)
class PositionFit(Fit):
    """A fit of absolute positions; `nominal` is the nominal arm in fitted frames, with fitted markers.

    frames: the base in each tracker's frame; left_aside: parameters not estimated and why;
    masked: rows of the file that the fit found to be gross errors and did not use
    """

    frames: tuple[Frame, ...] = ()
    left_aside: tuple[LeftAside, ...] = ()
    masked: tuple[int, ...] = ()
    displaced: int = 0
    """How many of the last rows are displacements of a joint fit, and no positions."""

    @property
    def masked_rows(self) -> tuple[int, ...]:
        """Rows of the positions' file that were found wrong, before the fit or by it, and not used."""
        before = {row for one in self.cleaned or () if one.readings == "positions" for row in one.rows}
        return tuple(sorted(before | set(self.masked)))

    @property
    def absolute(self) -> slice:
        """The rows that are positions."""
        return slice(0, len(self.rows) - self.displaced)

    def error_of(self, residuals: Array) -> float:
        """RMS of the norms of position errors (R, 3), m."""
        return float(np.sqrt((residuals**2).sum(axis=1).mean()))

    def predict(self, states: StateReadings) -> tuple[Array, Array]:
        """Other readings in the same trackers' frames: predicted and measured positions (R, 3) m of their used rows."""
        positions = make_positions(self.model, states)
        known = {frame.series: frame for frame in self.frames}
        missing = [name for name, _ in positions.series if name not in known]
        if missing:
            raise InputError(f"the fit knows no tracker frame of series {', '.join(missing)}")
        return positions.predict(self.x, [known[name] for name, _ in positions.series]), positions.measured

    def as_json(self) -> dict[str, Any]:
        """What `fit.json` holds (SI units)."""
        content = super().as_json()
        content["frames"] = {
            f.series: {"rotation": f.rotation.tolist(), "origin_m": f.origin.tolist()} for f in self.frames
        }
        content["left_aside"] = [entry.words() for entry in self.left_aside]
        content["rms_norm_mm"] = self.error_of(self.residuals[self.absolute]) * 1e3
        return content


def identify_positions(
    experiment: Experiment, states: StateReadings, fit: Sequence[str] | None = None
) -> PositionFit:  # fmt: skip
    """Estimate the parameters that `fit` names from absolute positions, and the frame of each series.

    Effects are expanded to all their parameters; those that the readings cannot tell are left aside by
    name, with what absorbs them. Gross errors are masked and named. Where the experiment says
    `rigid: true`, springs that are not estimated count as rigid.

    Raises InputError where there are too few readings or poses that do not spread; NotIdentifiable where all are of
    one pose; NotConverged where the steps do not settle.
    """
    experiment = experiment if fit is None else experiment.with_(fit=tuple(fit))
    model = experiment.model()
    names = fit_order(experiment)
    x0 = model.nominal
    if experiment.rigid:
        effects = zip(model.effects, model.slices, strict=True)
        springs = [n for e, part in effects if isinstance(e, Spring) for n in model.names[part]]
        x0[model.index([n for n in springs if n not in names])] = 0.0
    positions = make_positions(model, states)
    sigma, stated = position_sigma(experiment, states, positions)
    problem, left = _begin(positions, x0, names, sigma)
    _check_geometry(experiment, problem, left)
    lonely = single_pose(
        positions.poses.q[np.unique(positions.state)], len(problem.names), " beside the tracker's frame"
    )
    solved = problem.solve()
    masked: list[int] = []
    for _ in range(_ROUNDS):
        wrong = _gross(solved.residuals / sigma[:, None])
        if not wrong.any() or wrong.mean() > _MANY:
            break
        masked += positions.rows[wrong].tolist()
        loud = _rms((problem.at - positions.measured)[wrong]) > _LOUD * _rms((problem.at - positions.measured)[~wrong])
        positions, sigma = positions.take(~wrong), sigma[~wrong]
        if loud:  # it hid what the others can tell
            problem, left = _begin(positions, x0, names, sigma)
        else:
            problem = problem.without(wrong, solved)
        solved = problem.solve()
    found = replace(_result(solved, left, sigma, stated, tuple(sorted(masked)), states), notes=lonely)
    sds = load_sds(experiment, problem.names)
    if not sds.any() or not positions.loaded[positions.state].any():
        return found
    return replace(found, total_covariance=found.covariance + _of_load(solved, sigma, sds))


def _begin(
    positions: Positions, x0: Array, names: Sequence[str], sigma: Array
) -> tuple[Problem, tuple[LeftAside, ...]]:
    frames, x = positions.started(x0, names, BROAD)
    return Problem.chosen(positions, frames, x, names, sigma)


def _check_geometry(experiment: Experiment, problem: Problem, left: Sequence[LeftAside]) -> None:
    """InputError where `geometry` is to be fitted and the readings tell nothing of it."""
    if GEOMETRY not in (experiment.fit or ()):
        return
    wanted = expand_name(GEOMETRY, problem.positions.model)
    if not set(wanted).intersection(problem.names):
        reasons = "; ".join(entry.words() for entry in left if entry.name in wanted[:6])
        raise InputError(
            f"fit: {GEOMETRY}: these readings tell none of its {len(wanted)} numbers ({reasons}; ...); "
            f"measure poses that move every joint, or leave {GEOMETRY} out"
        )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def fit_order(experiment: Experiment) -> list[str]:
    """The names to fit, physically simple ones first: markers, zeros and sag, springs, placements, others."""
    wanted = set(experiment.fit_names())
    ranked: list[tuple[int, str]] = []
    model = experiment.model()
    for effect, part in zip(model.effects, model.slices, strict=True):
        rank = 4
        if isinstance(effect, Sensor):
            rank = 0
        elif isinstance(effect, Geometry):
            rank = 3 if effect.moves_placements else 1
        elif isinstance(effect, Spring):
            rank = 2
        ranked += [(rank, name) for name in model.names[part] if name in wanted]
    return [name for _, name in sorted(ranked, key=lambda entry: entry[0])]


def position_sigma(experiment: Experiment, states: StateReadings, positions: Positions) -> tuple[Array, bool]:
    """sd (R,) of one coordinate, and whether it is stated; 1 mm stands for what is to be estimated."""
    sigma = np.where(np.isnan(states.sigma), experiment.noise.sigma or np.nan, states.sigma)[positions.keep]
    missing = np.isnan(sigma)
    if missing.any() and not missing.all():
        raise InputError(f"{states.source or 'state readings'}: {int(missing.sum())} readings have no sigma_mm and the "
                         "experiment states no noise; give all of them or none")  # fmt: skip
    stated = not missing.any() and experiment.noise.sigma is not None
    return (np.full(len(sigma), 1e-3) if missing.any() else sigma), stated


def _gross(white: Array) -> Mask:
    """Rows (R,) whose error is far beyond what the others' median allows; the largest first, for they bend the fit."""
    size = np.linalg.norm(white, axis=1)
    middle = float(np.sort(size)[len(size) // 2])  # np.median would import masked arrays, which takes 10 ms
    robust = max(middle / 1.538, 1e-3)  # median of the norm of three unit normals
    return size > max(GROSS * robust, 0.3 * float(size.max()))


def _of_load(solved: Solved, sigma: Array, sds: Array) -> Array:
    """Covariance (p, p) that the load's scale and rotations, of sds (4,), bring to the estimates."""
    positions, scale = solved.problem.positions, solved.problem.scale
    L = position_columns(positions, solved.frames, solved.x) * (sds / sigma[:, None, None])
    rows = (solved.J * (scale / sigma[:, None, None])).reshape(-1, len(scale))
    inverse = np.linalg.inv(solved.R)
    G = scale[:, None] * (inverse @ (inverse.T @ (rows.T @ L.reshape(-1, len(sds)))))
    return G @ G.T


def _result(
    solved: Solved, left: tuple[LeftAside, ...], sigma: Array, stated: bool, masked: tuple[int, ...],
    states: StateReadings,
) -> PositionFit:  # fmt: skip
    problem, positions, scale = solved.problem, solved.problem.positions, solved.problem.scale
    inverse = np.linalg.inv(solved.R)
    white = solved.residuals / sigma[:, None]
    dof = white.size - len(scale)
    chi2 = float((white**2).sum())
    unit = 1.0 if stated else float(np.sqrt(chi2 / dof))
    covariance = inverse @ inverse.T * np.outer(scale, scale) * unit**2
    rows = (solved.J * (scale / sigma[:, None, None])).reshape(white.size, -1)
    Q = rows @ inverse
    names = [p.name for p in problem.parameters]
    poses = [f.pose for f in solved.frames]
    values = np.concatenate([*poses, solved.x[positions.model.index(problem.names)]])
    return PositionFit(
        "positions", positions.model, solved.x, _estimates(problem.parameters, values, np.sqrt(np.diag(covariance))),
        covariance, rank_test(solved.R, names), unit * float(np.sqrt(np.mean(sigma**2))),
        "stated" if stated else "estimated", positions.rows, positions.pose, positions.measured, solved.predicted,
        problem.nominal, solved.residuals, studentised(white, Q, len(scale)),
        _left_out(white, Q, positions.pose) * sigma[:, None], chi2 / unit**2, dof,
        sha256(states.source) if states.source is not None else "",
        frames=solved.frames, left_aside=left, masked=masked,
    )  # fmt: skip


def _estimates(parameters: Sequence[Parameter], values: Array, sds: Array) -> tuple[Estimate, ...]:
    out: list[Estimate] = []
    for p, v, s in zip(parameters, values, sds, strict=True):
        said = status_in_positions(p, float(v), float(s))
        out.append(Estimate(p.name, p.unit, float(v), float(s), p.nominal, p.lower, p.upper, said))
    return tuple(out)


def _left_out(white: Array, Q: Array, pose: Sequence[str]) -> Array:
    """Whitened errors (R, 3) at each pose when all its rows are left out, the poses of one size at a time."""
    out = np.full_like(white, np.nan)
    blocks = Q.reshape(len(white), 3, -1)
    number = {name: i for i, name in enumerate(dict.fromkeys(pose))}
    of = np.array([number[name] for name in pose], dtype=np.intp)
    order, counts = np.argsort(of, kind="stable"), np.bincount(of)
    first = np.cumsum(counts) - counts
    for size in sorted(set(counts.tolist())):
        rows = order[first[counts == size][:, None] + np.arange(size)]
        q = blocks[rows].reshape(len(rows), 3 * size, -1)
        rest = np.eye(3 * size) - q @ q.transpose(0, 2, 1)
        told = np.linalg.cond(rest) < 1e12
        error = np.linalg.solve(rest[told], white[rows[told]].reshape(-1, 3 * size, 1))
        out[rows[told]] = error.reshape(-1, size, 3)
    return out
