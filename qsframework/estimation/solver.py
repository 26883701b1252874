"""Nonlinear least squares of readings, by SciPy: on whitened residuals and scaled variables, within their bounds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import count

import numpy as np

from qsframework.errors import InputError, NotConverged, NotIdentifiable
from qsframework.estimation.noise import Scaled
from qsframework.estimation.observations import Observations
from qsframework.estimation.options import PLAIN, FitOptions
from qsframework.estimation.projection import orthonormal
from qsframework.estimation.rank import rank_test
from qsframework.estimation.reduction import Reduction, reduce
from qsframework.estimation.robust import Loss
from qsframework.plugin import Array

_STEPS = 200
"""Predictions after which a descent is given up: one that converges takes some ten."""
_SILENT = 25
"""Predictions that are not finite after which a fit is given up."""
_STILL = 1e-9
"""Relative change of the variables below which a step is rounding: linear steps after it give the digits it leaves."""
_LAST = 2
"""Linear steps after that, for the digits that a trust region leaves: each squares what is missing. The model is not
asked again after the last."""
_STUCK = 1e-2
"""Share of the residuals that a step must promise for the end of a descent to be none: a hundredth of what is there."""
_CURVED = 0.02
"""Relative change of the sensitivities over a parameter's spread above which other starts are tried."""
_ALL_AT_ONCE = 0.25
"""Share of that, for a step of several parameters together, below which none of them is looked at by itself."""
_TOGETHER = 60_000
"""Rows of which one triangular factor is taken at once."""
_ROUNDS = 50
_SETTLED = 1e-6
_ROUGH = 1e-3
"""Tolerance of the first solution, which only says how large the noise is."""
_MAD = 1.4826
_TOLD = 1e-9
"""Share of the largest singular value, of scaled sensitivities, below which a direction is not told."""
FAR = 1e9
"""Typical sizes of a parameter beyond which nothing is meant."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Solution:
    """The minimum: x (p,), whitened sensitivities (m, p) and residuals (m,) there, both without priors.

    cost is half the sum of squares, priors included (of a robust loss: half the sum of rho). covariance (p, p) is for
    noise of the stated size; rows of fixed parameters and of those at a bound are zero, for no sd can be quoted there.
    robust: factor on the covariance that a robust loss costs, 1 otherwise; weights (m,) that it gave to the readings.
    free_sd (p,): the sds that bounds aside the readings and priors would give, infinite where they cannot tell.
    unit: size of the noise that was found where it had to be known to weigh priors or gross readings, else None.
    hat (m, f): H = hat hat' is the share of each reading in its own prediction, priors counted; priors (k,): what the
    values are from before, in sds, of the k parameters of which something was known
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
    hat: Array
    priors: Array
    robust: float = 1.0
    unit: float | None = None


def solve(
    observations: Observations,
    options: FitOptions = PLAIN,
    start: Array | None = None,
    *,
    unit: float = 1.0,
    tolerance: float = 1e-7,
    seed: int = 0,
) -> Solution:
    """The parameters that fit best.

    start (p,): where it begins, and nowhere else; None: at the nominal values, and where parameters bend the model at
    others, drawn from `seed`. unit: the size of a whitened residual of good readings, for robust losses.

    Raises NotIdentifiable, naming the parameters, where the readings cannot tell them apart; NotConverged with its
    reason.
    """
    x0, more = (observations.start, options.starts) if start is None else (np.asarray(start, dtype=float), 0)
    reduction = reduce(observations.parameters, x0, options.fixed, options.tied, options.bounds)
    problem = _Problem(observations, reduction, Loss(options.loss, unit))
    best: _Minimum | None = None
    failed: NotConverged | None = None
    for z in (np.zeros(reduction.free), *_other_starts(problem, more, seed)):
        try:
            found = _descend(problem, z, tolerance)
        except _NoAnswer:
            raise
        except NotConverged as error:
            failed = failed or error
            continue
        if best is None or found.cost < best.cost * (1.0 - 1e-9):
            best = found
    if best is None:
        raise failed or NotConverged("no start of the fit led anywhere")
    return _solution(problem, best)


def settle(
    observations: Observations, options: FitOptions = PLAIN, start: Array | None = None, tolerance: float = 1e-7
) -> Solution:
    """`solve`, and where priors or a robust loss need the size of an unstated noise, that too."""
    weighed = options.loss != "linear" or observations.known[0].any()
    if observations.stated or not weighed:
        return solve(observations, options, start, tolerance=tolerance)
    noise, measured = observations.noise, observations.measured
    least = observations.least
    first = noise.whiten(measured - observations.predict(observations.start if start is None else start))
    unit = max(_size(first, 0.0, options.loss), least)
    for k in range(_ROUNDS):
        scaled = replace(observations, noise=Scaled(noise, unit, len(measured)))
        solution = solve(scaled, options, start, tolerance=tolerance if k else max(tolerance, _ROUGH))
        start = solution.x
        told = float(np.square(solution.hat).sum())  # E[r'r] = sigma^2 (m - tr H), priors counted
        new = max(unit * _size(solution.residuals, told, options.loss), least)
        if abs(new - unit) <= _SETTLED * unit + least:
            return replace(
                solution,
                covariance=solution.covariance / unit**2,
                free_sd=solution.free_sd / unit,
                unit=unit,
            )
        unit = new
    raise NotConverged(f"the size of the noise did not settle in {_ROUNDS} rounds; state sigma_mm in the experiment")


def _size(residuals: Array, free: float, loss: str) -> float:
    """Sd of residuals of which the fit took `free`; of a robust loss by their median, which outliers spare."""
    share = len(residuals) / (len(residuals) - free)
    if loss == "linear":
        return float(np.sqrt(np.mean(residuals**2) * share))
    return float(_MAD * np.median(np.abs(residuals)) * np.sqrt(share))


@dataclass(frozen=True, eq=False)
class _Problem:
    """The problem in free, scaled variables z; prior rows stand below the readings'."""

    observations: Observations
    reduction: Reduction
    loss: Loss

    def residuals(self, z: Array) -> Array:
        """Whitened (m,): measured minus predicted; infinite where the model has no answer."""
        o = self.observations
        try:
            predicted = o.predict(self.reduction.x(z))
        except (NotConverged, InputError):  # a load that the arm cannot bear, a loop that cannot close
            return np.full(len(o.measured), np.inf)
        return self._left(predicted)

    def _left(self, predicted: Array) -> Array:
        o = self.observations
        if not np.all(np.isfinite(predicted)):
            return np.full(len(o.measured), np.inf)
        return o.noise.whiten(o.measured - predicted)

    def jacobian(self, z: Array) -> Array:
        """Whitened (m, q): d predicted / d z."""
        return self.whole(z) @ self.reduction.T

    def whole(self, z: Array) -> Array:
        """Whitened (m, p): d predicted / d x of all parameters."""
        o = self.observations
        try:
            return o.noise.whiten(o.jacobian(self.reduction.x(z)))
        except (NotConverged, InputError) as error:
            raise NotConverged(f"{error}. Of what is fitted {_farthest(self, z)}") from error

    def prior(self, z: Array) -> tuple[Array, Array]:
        """Residuals and rows of the priors."""
        weight, towards = self.observations.known
        known = np.flatnonzero((weight > 0.0) & self.reduction.moved)
        weight = weight[known]
        return weight * (towards - self.reduction.x(z))[known], self.reduction.T[known] * weight[:, None]

    def cost(self, z: Array, r: Array | None = None) -> float:
        """Half the sum of squares, priors included; r: the residuals there, where they are known."""
        r = self.residuals(z) if r is None else r
        if not np.all(np.isfinite(r)):
            return np.inf
        return 0.5 * float(self.loss.rho(r).sum() + np.square(self.prior(z)[0]).sum())

    def digits(self) -> float:
        """What rounding does to the cost: readings of metres with residuals of micrometres leave it few digits.

        A step that gains less than this is neither better nor worse, and must not be refused for it.
        """
        o = self.observations
        readings = float(np.linalg.norm(o.noise.whiten(o.measured)))
        return 4.0 * (np.finfo(float).eps * readings + self.blur()) * float(np.sqrt(len(o.measured)))

    def blur(self) -> float:
        """What rounding does to whitened predictions that are differences of larger numbers."""
        o = self.observations
        return float(np.finfo(float).eps * o.reach * np.sqrt(o.noise.weights().sum()))

    def triangle(self, z: Array, r: Array, J: Array) -> Array:
        """The triangular factor (q + 1, q + 1) of the linearised problem, residuals in the last column: weighed by the
        loss, priors below. Of a long campaign part by part, which all at once would be its largest array."""
        root, (prior_r, prior_J) = np.sqrt(self.loss.weights(r)), self.prior(z)
        R = np.column_stack([prior_J, prior_r])
        for start in range(0, len(r), _TOGETHER):
            part = slice(start, start + _TOGETHER)
            R = _factor(np.vstack([np.column_stack([J[part], r[part]]) * root[part, None], R]))
        return R


def _other_starts(problem: _Problem, count: int, seed: int) -> list[Array]:
    """Starts in the directions in which the sensitivities change; none where the model is as good as linear."""
    if count == 0:
        return []
    reduction = problem.reduction
    zero = np.zeros(reduction.free)
    J = problem.jacobian(zero)
    columns = np.maximum(np.linalg.norm(J, axis=0), max(1e-9 * float(np.linalg.norm(J)), 1e-300))
    spread = reduction.spread
    far = np.where(spread <= reduction.upper, spread, np.maximum(-spread, reduction.lower))

    def changed(away: Array) -> float:
        """By which share of itself a column changes, the largest; infinite too far for the model."""
        try:
            there = problem.jacobian(away)
        except NotConverged:
            return np.inf
        return float(np.max(np.linalg.norm(there - J, axis=0) / columns, initial=0.0))

    # many at once, each by a share of its own so that no two cancel: one step tells that they are as good as linear
    shares = np.random.default_rng(seed).uniform(0.5, 1.0, reduction.free)
    curved, together = np.zeros(reduction.free, dtype=bool), [np.arange(reduction.free)]
    while together:
        some = together.pop()
        away = np.zeros(reduction.free)
        away[some] = far[some] * (shares[some] if len(some) > 1 else 1.0)
        if len(some) == 1:
            curved[some] = changed(away) > _CURVED
        elif changed(away) > _ALL_AT_ONCE * _CURVED:
            together += np.array_split(some, 2)
    if not curved.any():
        return []
    draws = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, reduction.free))
    return [np.clip(d * spread * curved, reduction.lower, reduction.upper) for d in draws]


class _NoAnswer(NotConverged):
    """The model had no finite prediction over and over: no other start will mend that."""


@dataclass(frozen=True, eq=False)
class _Minimum:
    """Where the steps settled: cost, z, whitened residuals and sensitivities `whole` (m, p) there, steps."""

    cost: float
    z: Array
    residuals: Array
    whole: Array
    steps: int


def _descend(problem: _Problem, z: Array, tolerance: float) -> _Minimum:
    """SciPy's trust region from z, the first step as long as the linear problem asks; it ends where a step gains less
    than `tolerance` of the residuals, or than rounding."""
    from scipy.optimize import least_squares

    reduction = problem.reduction

    @lru_cache(maxsize=1)
    def whole(at: bytes) -> Array:
        return problem.whole(np.frombuffer(at))

    @lru_cache(maxsize=1)
    def whitened(at: bytes) -> Array:
        return problem.residuals(np.frombuffer(at))

    r, silent = whitened(z.tobytes()), count()
    if not np.all(np.isfinite(r)):
        raise NotConverged("the model has no finite prediction at the start of the fit: check the nominal values")
    R, step = _linear_step(problem, z, r, whole(z.tobytes()))
    size = np.linalg.norm(R[:, :-1], axis=0)
    if not step.any():  # the best is where it begins, or nothing depends on what is fitted
        return _Minimum(problem.cost(z, r), z, r, whole(z.tobytes()), 1)
    size = np.maximum(size, 1e-12 * size.max())
    left = 0.5 * float(np.square(R[:, -1] - R[:, :-1] @ step).sum())

    def residuals(at: Array) -> Array:
        """Predicted minus measured, priors below."""
        r = whitened(at.tobytes())
        if not np.all(np.isfinite(r)) and next(silent) >= _SILENT:
            raise _NoAnswer(f"the model has no answer where the fit leads: {_farthest(problem, at)}")
        return -np.concatenate([r, problem.prior(at)[0]])

    if np.linalg.norm(R[:, :-1] @ step) <= tolerance * np.linalg.norm(R[:, -1]):  # it begins as good as there
        return _ended(problem, z, r, whole, 1)
    found = least_squares(
        residuals,
        z,
        lambda at: np.vstack([whole(at.tobytes()) @ reduction.T, problem.prior(at)[1]]),
        bounds=(reduction.lower, reduction.upper),
        method="dogbox" if np.isfinite([reduction.lower, reduction.upper]).any() else "trf",
        ftol=max(tolerance**2, min(problem.digits() / max(left, 1e-300), tolerance)),
        xtol=_STILL,
        gtol=None,
        x_scale=float(np.linalg.norm(size * step)) / size,
        loss=problem.loss.of_squares(len(r)),
        max_nfev=_STEPS,
    )
    if not found.success or np.any(np.abs(found.x) > FAR * np.maximum(reduction.spread, 1.0)):
        raise NotConverged(f"the fit did not settle in {found.nfev} steps: {_farthest(problem, found.x)}")
    return _ended(problem, found.x, -found.fun[: len(r)], whole, found.nfev)


def _ended(problem: _Problem, z: Array, r: Array, whole: Callable[[bytes], Array], steps: int) -> _Minimum:
    """The minimum that linear steps from z, near it, end at."""
    reduction, left = problem.reduction, _LAST
    while True:
        J, left = whole(z.tobytes()), left - 1
        R, step = _linear_step(problem, z, r, J)
        gain = float(np.linalg.norm(R[:, :-1] @ step))
        if gain > _STUCK * np.linalg.norm(R[:, -1]) and gain**2 > problem.digits():
            raise NotConverged(
                f"the fit is stuck after {steps} steps: no step lowers the sum of squares, though it has a slope. "
                "Look at the units of readings and loads, start nearer, or fix a parameter"
            )
        last = np.clip(z + step, reduction.lower, reduction.upper)
        if left == 0 or gain <= problem.digits():  # so near that the residuals follow it linearly
            r = r - J @ (reduction.T @ (last - z))
            return _Minimum(problem.cost(last, r), last, r, J, steps)
        there = problem.residuals(last)
        if not np.all(np.isfinite(there)):
            return _Minimum(problem.cost(z, r), z, r, J, steps)
        z, r = last, there


def _linear_step(problem: _Problem, z: Array, r: Array, whole: Array) -> tuple[Array, Array]:
    """The triangular factor (q + 1, q + 1) of the linearised problem, and the step (q,) that solves it in bounds."""
    from scipy.optimize import lsq_linear

    reduction = problem.reduction
    R = problem.triangle(z, r, whole @ reduction.T)
    size = np.linalg.norm(R[:, :-1], axis=0)
    size = np.where(size > 0.0, size, 1.0)
    ends = size * (reduction.lower - z), size * np.maximum(reduction.upper - z, reduction.lower - z + 1e-14)
    return R, lsq_linear(R[:, :-1] / size, R[:, -1], ends, method="bvls").x / size


def _farthest(problem: _Problem, z: Array) -> str:
    """Which parameter has run away, and what to do about it."""
    k = int(np.argmax(np.abs(z) / problem.reduction.spread))
    name = problem.reduction.names[k][0]
    i = problem.observations.names.index(name)
    p = problem.observations.parameters[i]
    value = f"{name} is at {problem.reduction.x(z)[i]:.3g} {p.unit}, nominal {p.nominal:.3g}"
    return f"{value}. Look at the units of readings and loads; else fix this parameter or state its sd"


def _solution(problem: _Problem, best: _Minimum) -> Solution:
    z, r = best.z, best.residuals
    reduction = problem.reduction
    x, whole = reduction.x(z), best.whole
    away, known = problem.prior(z)
    R = _factor(np.vstack([whole @ reduction.T, known]))
    bound = (z <= reduction.lower) | (z >= reduction.upper)
    inside = np.flatnonzero(~bound)
    stopped = tuple(n for i in np.flatnonzero(bound) for n in reduction.names[i])
    check_rank(R[:, inside], [" = ".join(reduction.names[i]) for i in inside], stopped)
    robust = problem.loss.price(r, len(inside))
    half = np.linalg.inv(np.linalg.qr(R[:, inside], mode="r")) if len(inside) else np.zeros((0, 0))
    T = reduction.T[:, inside]
    return Solution(
        x=x,
        jacobian=whole,
        residuals=r,
        cost=best.cost,
        iterations=best.steps,
        at_bound=stopped,
        covariance=robust * T @ half @ half.T @ T.T,
        free=len(inside),
        weights=problem.loss.weights(r),
        free_sd=_sds(R, reduction.T) * np.sqrt(robust),
        hat=whole @ (T @ half),
        priors=away,
        robust=robust,
    )


def _factor(rows: Array) -> Array:
    """The triangular factor (q, q) of rows (m, q); the rows themselves where they are few."""
    return np.asarray(np.linalg.qr(rows, mode="r")) if len(rows) > rows.shape[1] else rows


def _sds(rows: Array, T: Array) -> Array:
    """sd (p,) of parameters T z by whitened rows (m, q) of z; infinite in directions that they do not tell, 0 of what
    is fixed."""
    size = np.linalg.norm(rows, axis=0)
    safe = np.where(size > 0.0, size, 1.0)
    _, values, V = np.linalg.svd(rows / safe, full_matrices=len(rows) < len(safe))
    values = np.pad(values, (0, len(V) - len(values)))
    told = values > _TOLD * values.max(initial=0.0)
    back = (T / safe) @ V.T
    sd = np.sqrt(np.square(back[:, told] / values[told]).sum(axis=1))
    lost = np.square(back[:, ~told]).sum(axis=1) > _TOLD * np.square(back).sum(axis=1)
    return np.where(lost, np.inf, sd)


def sds_at(observations: Observations, x: Array) -> Array:
    """sd (p,) of each parameter by the linear problem at x (p,) and what is known, infinite where neither tells it."""
    rows = np.vstack([observations.noise.whiten(observations.jacobian(x)), np.diag(observations.known[0])])
    return _sds(rows, np.eye(len(x)))


def solution_at(observations: Observations, x: Array, covariance: Array) -> Solution:
    """The solution of a method of its own, which ended at x (p,) with a covariance (p, p) for noise of stated size."""
    noise = observations.noise
    r = noise.whiten(observations.measured - observations.predict(x))
    sd = np.sqrt(np.diag(covariance))
    jacobian = noise.whiten(observations.jacobian(x))
    hat = orthonormal(jacobian * np.where(sd > 0.0, sd, 1.0))
    return Solution(
        x=x,
        jacobian=jacobian,
        residuals=r,
        cost=0.5 * float(r @ r),
        iterations=2,
        at_bound=(),
        covariance=covariance,
        free=len(x),
        weights=np.ones(len(r)),
        free_sd=sd,
        hat=hat,
        priors=np.zeros(0),
    )


def check_rank(rows: Array, names: Sequence[str], stopped: Sequence[str] = ()) -> None:
    """NotIdentifiable where scaled whitened rows (m, p) cannot tell the parameters apart."""
    test = rank_test(rows, names)
    if not test.full:
        raise NotIdentifiable(unseen=test.unseen, groups=test.tied, at_bound=tuple(stopped))
