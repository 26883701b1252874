"""Nonlinear weighted least squares with bounds: Levenberg-Marquardt on scaled variables with exact active bounds.

Each step solves the linearised problem within its bounds exactly, so that a linear problem is solved in one step and a
parameter at a bound stands on it to the last digit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.errors import InputError, NotConverged, NotIdentifiable, Problem, nearest
from qsframework.identify.observations import Observations
from qsframework.identify.reduction import Reduction, reduce
from qsframework.identify.robust import LOSSES, Loss
from qsframework.information import rank_test
from qsframework.plugin import Array

_STEPS = 200
_DAMPINGS = 40
_BLUR = 1e-15
"""What rounding leaves of a prediction, of the sum of its parts' sizes; a step that changes it by less is none."""
_CURVED = 0.02
"""Relative change of the sensitivities over a parameter's spread above which other starts are tried."""


@dataclass(frozen=True, eq=False)
class Solution:
    """The minimum: x (p,), whitened sensitivities (m, p) and residuals (m,) there, both per SI and without priors.

    cost is half the sum of squares, priors included (of a robust loss: half the sum of rho). covariance (p, p) is for
    noise of the stated size; rows of fixed parameters and of those at a bound are zero, for no sd can be quoted there.
    robust: factor on the covariance that a robust loss costs, 1 otherwise; weights (m,) that it gave to the readings.
    free_sd (p,): the sds that bounds aside the readings would give, infinite where they cannot tell.
    """

    x: Array
    jacobian: Array
    residuals: Array
    cost: float
    iterations: int
    at_bound: tuple[str, ...]
    covariance: Array
    free: int
    weights: Array
    free_sd: Array
    robust: float = 1.0


def solve(
    observations: Observations, start: Array | None = None, priors: bool = False, loss: str = "linear",
    fixed: Sequence[str] = (), tied: Sequence[Sequence[str]] = (), tolerance: float = 1e-9, *,
    unit: float = 1.0, starts: int = 5, seed: int = 0,
) -> Solution:  # fmt: skip
    """The parameters that fit best, within their bounds.

    start (p,), the nominal values if None; priors: nominal and sd of a parameter count as a reading of it; loss
    "linear" (squares), "huber" or "soft_l1", with `unit` the size of a whitened residual of good readings; fixed stay
    at their start; tied groups keep the ratios of their nominal values. Parameters that bend the model get `starts`
    more starts, drawn from `seed`.

    Raises NotIdentifiable, naming the parameters, where the readings cannot tell them apart; NotConverged with its
    reason.
    """
    if loss not in LOSSES:
        raise InputError(Problem(f"unknown loss {loss!r}", allowed=", ".join(LOSSES), hint=nearest(loss, LOSSES)))
    x0 = observations.start if start is None else np.asarray(start, dtype=float)
    reduction = reduce(observations.parameters, x0, fixed, tied)
    problem = _Problem(observations, reduction, priors, Loss(loss, unit))
    best: tuple[float, Array, int] | None = None
    failed: NotConverged | None = None
    for z in (np.zeros(reduction.free), *_other_starts(problem, starts, seed)):
        try:
            found = _descend(problem, z, tolerance)
        except NotConverged as error:
            failed = failed or error
            continue
        if best is None or found[0] < best[0] * (1.0 - 1e-9):
            best = found
    if best is None:
        raise failed or NotConverged("no start of the fit led anywhere")
    return _solution(problem, best)


@dataclass(frozen=True, eq=False)
class _Problem:
    """The problem in free, scaled variables z; prior rows stand below the readings'."""

    observations: Observations
    reduction: Reduction
    priors: bool
    loss: Loss

    def residuals(self, z: Array) -> Array:
        """Whitened (m,): measured minus predicted."""
        o = self.observations
        predicted = o.predict(self.reduction.x(z))
        if not np.all(np.isfinite(predicted)):
            return np.full(len(o.measured), np.inf)
        return o.noise.whiten(o.measured - predicted)

    def jacobian(self, z: Array) -> Array:
        """Whitened (m, q): d predicted / d z."""
        o = self.observations
        return o.noise.whiten(o.jacobian(self.reduction.x(z)) @ self.reduction.T)

    def prior(self, z: Array) -> tuple[Array, Array]:
        """Residuals and rows of the priors."""
        if not self.priors:
            return np.zeros(0), np.zeros((0, self.reduction.free))
        x = self.reduction.x(z)
        known = [i for i, p in enumerate(self.observations.parameters) if p.sd is not None and self.reduction.moved[i]]
        sd = np.array([self.observations.parameters[i].sd for i in known], dtype=float)
        nominal = self.observations.start[known]
        return (nominal - x[known]) / sd, self.reduction.T[known] / sd[:, None]

    def cost(self, z: Array) -> float:
        r = self.residuals(z)
        if not np.all(np.isfinite(r)):
            return np.inf
        return 0.5 * float(self.loss.rho(r).sum() + np.square(self.prior(z)[0]).sum())

    def digits(self) -> float:
        """What rounding does to the cost: readings of metres with residuals of micrometres leave it few digits.

        A step that gains less than this is neither better nor worse, and must not be refused for it.
        """
        o = self.observations
        readings = float(np.linalg.norm(o.noise.whiten(o.measured)))
        return 4.0 * np.finfo(float).eps * readings * float(np.sqrt(len(o.measured)))

    def rows(self, z: Array) -> tuple[Array, Array, Array]:
        """Rows, residuals and weights' roots of the linearised problem, priors below."""
        r, J = self.residuals(z), self.jacobian(z)
        root = np.sqrt(self.loss.weights(r))
        prior_r, prior_J = self.prior(z)
        return np.vstack([J * root[:, None], prior_J]), np.concatenate([r * root, prior_r]), root


def _other_starts(problem: _Problem, count: int, seed: int) -> list[Array]:
    """Starts in the directions in which the sensitivities change; none where the model is as good as linear."""
    if count == 0:
        return []
    reduction = problem.reduction
    zero = np.zeros(reduction.free)
    J = problem.jacobian(zero)
    size = np.linalg.norm(J)
    spread = reduction.spread
    curved: list[bool] = []
    for i in range(reduction.free):
        away = zero.copy()
        away[i] = spread[i] if spread[i] <= reduction.upper[i] else max(-spread[i], reduction.lower[i])
        moved = problem.jacobian(away)
        columns = np.maximum(np.linalg.norm(J, axis=0), 1e-9 * size)
        curved.append(bool(np.any(np.linalg.norm(moved - J, axis=0) > _CURVED * columns)))
    if not any(curved):
        return []
    draws = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, reduction.free))
    return [np.clip(d * spread * curved, reduction.lower, reduction.upper) for d in draws]


def _descend(problem: _Problem, z: Array, tolerance: float) -> tuple[float, Array, int]:
    """Levenberg-Marquardt from z: cost, minimum, steps."""
    cost, damping, digits = problem.cost(z), 0.0, problem.digits()
    if not np.isfinite(cost):
        raise NotConverged("the model has no finite prediction at the start of the fit")
    for step in range(1, _STEPS + 1):
        A, r, _ = problem.rows(z)
        plain = _bounded(A, r, z, problem.reduction, 0.0)
        gain, blur = np.linalg.norm(A @ plain), _BLUR * np.linalg.norm(np.abs(A) @ np.abs(z))
        small = gain <= max(tolerance * np.linalg.norm(r), blur)
        if np.abs(plain).max(initial=0.0) <= tolerance or small:
            final = np.clip(z + plain, problem.reduction.lower, problem.reduction.upper)
            return problem.cost(final), final, step
        size = np.maximum(np.linalg.norm(A, axis=0), 1e-12)
        for _ in range(_DAMPINGS):
            d = plain if damping == 0.0 else _bounded(A, r, z, problem.reduction, damping, size)
            trial = np.clip(z + d, problem.reduction.lower, problem.reduction.upper)
            new = problem.cost(trial)
            if new <= cost * (1.0 + 1e-13) + digits:
                z, cost = trial, new
                damping = 0.0 if damping < 1e-6 else damping / 10.0
                break
            damping = max(10.0 * damping, 1e-6)
        else:
            raise NotConverged(
                f"the fit is stuck after {step} steps: no step lowers the sum of squares, though it has a slope. "
                "Look at the readings' units, start nearer, or fix a parameter"
            )
    raise NotConverged(f"the fit did not settle in {_STEPS} steps: {_farthest(problem, z)}")


def _farthest(problem: _Problem, z: Array) -> str:
    """Which parameter has run away, and what to do about it."""
    k = int(np.argmax(np.abs(z) / problem.reduction.spread))
    name = problem.reduction.names[k][0]
    i = problem.observations.names.index(name)
    p = problem.observations.parameters[i]
    value = f"{name} is at {problem.reduction.x(z)[i]:.3g} {p.unit}, nominal {p.nominal:.3g}"
    return f"{value}. Look at the units of readings and loads; else fix this parameter or state priors"


def _bounded(A: Array, r: Array, z: Array, reduction: Reduction, damping: float, size: Array | None = None) -> Array:
    """The step (q,) that minimises |r - A d|^2 + damping |size d|^2 with z + d within the bounds, exactly."""
    if damping > 0.0 and size is not None:
        A = np.vstack([A, np.sqrt(damping) * np.diag(size)])
        r = np.concatenate([r, np.zeros(len(z))])
    scale = np.linalg.norm(A, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    free = np.linalg.lstsq(A / scale, r, rcond=None)[0] / scale
    lower, upper = reduction.lower - z, reduction.upper - z
    if np.all(free >= lower) and np.all(free <= upper):
        return free
    from scipy.optimize import lsq_linear

    tight = np.maximum(upper, lower + 1e-14)
    found = lsq_linear(A / scale, r, (lower * scale, tight * scale), method="bvls", tol=1e-14, max_iter=500)
    d = found.x / scale
    return np.where(found.active_mask < 0, lower, np.where(found.active_mask > 0, upper, d))


def _solution(problem: _Problem, best: tuple[float, Array, int]) -> Solution:
    cost, z, steps = best
    reduction, o = problem.reduction, problem.observations
    A, _, _ = problem.rows(z)
    bound = (z <= reduction.lower) | (z >= reduction.upper)
    inside = np.flatnonzero(~bound)
    stopped = tuple(n for i in np.flatnonzero(bound) for n in reduction.names[i])
    check_rank(A[:, inside], [" = ".join(reduction.names[i]) for i in inside], stopped)
    x, r = reduction.x(z), problem.residuals(z)
    robust = problem.loss.price(r, len(inside))
    plain = np.vstack([problem.jacobian(z), problem.prior(z)[1]])[:, inside]
    R = np.linalg.qr(plain, mode="r")
    half = np.linalg.inv(R) if len(inside) else np.zeros((0, 0))
    T = reduction.T[:, inside]
    return Solution(
        x, o.noise.whiten(o.jacobian(x)), r, cost, steps, stopped, robust * T @ half @ half.T @ T.T, len(inside),
        problem.loss.weights(r), _free_sd(problem, z) * np.sqrt(robust), robust,
    )  # fmt: skip


def _free_sd(problem: _Problem, z: Array) -> Array:
    """Sds (p,) of all that is not fixed, bounds aside; infinite where rows cannot tell all of them."""
    rows = np.vstack([problem.jacobian(z), problem.prior(z)[1]])
    T = problem.reduction.T
    if not rank_test(rows, [str(i) for i in range(rows.shape[1])]).full:
        return np.where(problem.reduction.moved, np.inf, 0.0)
    return np.linalg.norm(T @ np.linalg.inv(np.linalg.qr(rows, mode="r")), axis=1)


def check_rank(rows: Array, names: Sequence[str], stopped: Sequence[str] = ()) -> None:
    """NotIdentifiable, in words, where scaled whitened rows (m, p) cannot tell the parameters apart."""
    test = rank_test(rows, names)
    if not test.full:
        at = f" (with {', '.join(stopped)} at its bound)" if stopped else ""
        raise NotIdentifiable(f"these readings cannot tell the parameters{at}: {test.words()}")
