"""The one iteration of least squares: Levenberg-Marquardt on scaled variables with exact active bounds.

Each step solves the linearised problem within its bounds exactly, so that a linear problem is solved in one step and a
parameter at a bound stands on it to the last digit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

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
_LAPS = 10
"""Steps in which a descent must lower what a step predicts to _LESS of it, or the cost by _FALL of it: one that does
neither goes to and fro over a kink of the model, or runs away, and 200 steps end no better."""
_LESS = 0.75
_FALL = 1e-2
_DAMPINGS = 40
_STOOD = 1e4
"""Damping beyond which a step went nowhere: the next one is tried undamped again."""
_SILENT = 25
"""Trials without a finite prediction after which a fit is given up."""
_BLUR = 1e-15
"""What rounding leaves of a prediction, of the sum of its parts' sizes; a step that changes it by less is none."""
_CURVED = 0.02
"""Relative change of the sensitivities over a parameter's spread above which other starts are tried."""
_ALL_AT_ONCE = 0.25
"""Share of that, for a step of several parameters together, below which none of them is looked at by itself."""
_NEAR = 0.3
"""Sensitivities are not taken again after a step that changes the prediction by less than so many sds of a reading."""
_SLOW = 0.05
"""How much of the last step the next one may be before they are, all the same."""
_IDLE = 4
"""Steps in a row that promise no less than half of the one before: rounding is all that is left, if they promise less
than the digits of the cost, or less than _SLOPES of the residuals."""
_SLOPES = 1e-6
"""What sensitivities err by where a law's own derivatives are taken by differences: of large residuals a step predicts
so much over and over, and keeps nothing of it."""
_TOGETHER = 60_000
"""Rows of which one triangular factor is taken at once."""
_ROUNDS = 50
_SETTLED = 1e-6
_MAD = 1.4826
_TOLD = 1e-9
"""Share of the largest singular value, of scaled sensitivities, below which a direction is not told."""
FAR = 1e9
"""Typical sizes of a parameter beyond which nothing is meant."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Solution:
    """The minimum: x (p,), whitened sensitivities (m, p) and residuals (m,) there, both per SI and without priors.

    cost is half the sum of squares, priors included (of a robust loss: half the sum of rho). covariance (p, p) is for
    noise of the stated size; rows of fixed parameters and of those at a bound are zero, for no sd can be quoted there.
    robust: factor on the covariance that a robust loss costs, 1 otherwise; weights (m,) that it gave to the readings.
    free_sd (p,): the sds that bounds aside the readings would give, infinite where they cannot tell. alone_sd (p,): the
    same without weak holds, of the readings (and stated sds that count as such) alone.
    unit: size of the noise that was found where it had to be known to weigh priors or gross readings, else None.
    hat (m, f): H = hat hat' is the share of each reading in its own prediction, priors and weak holds counted
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
    alone_sd: Array
    hat: Array
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

    start (p,), the nominal values if None; unit: the size of a whitened residual of good readings, for robust losses.
    Parameters that bend the model get more starts, drawn from `seed`.

    Raises NotIdentifiable, naming the parameters, where the readings cannot tell them apart; NotConverged with its
    reason.
    """
    x0 = observations.start if start is None else np.asarray(start, dtype=float)
    reduction = reduce(observations.parameters, x0, options.fixed, options.tied, options.bounds)
    problem = _Problem(observations, reduction, options.priors, Loss(options.loss, unit))
    best: _Minimum | None = None
    failed: NotConverged | None = None
    for z in (np.zeros(reduction.free), *_other_starts(problem, options.starts, seed)):
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
    if observations.stated or (options.loss == "linear" and not options.priors):
        return solve(observations, options, start, tolerance=tolerance)
    noise, measured = observations.noise, observations.measured
    least = observations.least
    first = noise.whiten(measured - observations.predict(observations.start if start is None else start))
    unit = max(_size(first, 0, options.loss), least)
    for _ in range(_ROUNDS):
        scaled = replace(observations, noise=Scaled(noise, unit, len(measured)))
        solution = solve(scaled, options, start, tolerance=tolerance)
        start = solution.x
        new = max(unit * _size(solution.residuals, solution.free, options.loss), least)
        if abs(new - unit) <= _SETTLED * unit + least:
            return replace(
                solution,
                covariance=solution.covariance / unit**2,
                free_sd=solution.free_sd / unit,
                alone_sd=solution.alone_sd / unit,
                unit=unit,
            )
        unit = new
    raise NotConverged(f"the size of the noise did not settle in {_ROUNDS} rounds; state sigma_mm in the experiment")


def _size(residuals: Array, free: int, loss: str) -> float:
    """Sd of residuals that `free` parameters were fitted to; of a robust loss by their median, which outliers spare."""
    share = len(residuals) / (len(residuals) - free)
    if loss == "linear":
        return float(np.sqrt(np.mean(residuals**2) * share))
    return float(_MAD * np.median(np.abs(residuals)) * np.sqrt(share))


@dataclass(frozen=True, eq=False)
class _Problem:
    """The problem in free, scaled variables z; prior rows stand below the readings'."""

    observations: Observations
    reduction: Reduction
    priors: bool
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

    def both(self, z: Array) -> tuple[Array, Array | None]:
        """`residuals` and `whole`; without the latter where the model has no answer."""
        o = self.observations
        if o.rates is None:
            r = self.residuals(z)
            return r, self.whole(z) if np.all(np.isfinite(r)) else None
        try:
            predicted, J = o.rates(self.reduction.x(z))
        except (NotConverged, InputError):
            return np.full(len(o.measured), np.inf), None
        return self._left(predicted), o.noise.whiten(J)

    def jacobian(self, z: Array) -> Array:
        """Whitened (m, q): d predicted / d z."""
        return self.whole(z) @ self.reduction.T

    def whole(self, z: Array) -> Array:
        """Whitened (m, p): d predicted / d x of all parameters."""
        try:
            return self.observations.noise.whiten(self.observations.jacobian(self.reduction.x(z)))
        except (NotConverged, InputError) as error:
            raise NotConverged(f"{error}. Of what is fitted {_farthest(self, z)}") from error

    def prior(self, z: Array) -> tuple[Array, Array]:
        """Residuals and rows of the priors and of weak holds."""
        o = self.observations
        weight, towards = o.holds(self.priors)
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


@dataclass(frozen=True, eq=False, kw_only=True)
class _State:
    """Where a descent stands: z (q,), whitened residuals (m,), their cost, sensitivities J (m, q).

    fresh: these were taken here, not at an earlier step; damping: of the next step; last_gain, last_moved: `gain` and
    `moved` of the last step; idle: steps in a row of no less than half of the one before; silent: trials so far without
    a finite prediction
    """

    problem: _Problem
    z: Array
    residuals: Array
    cost: float
    J: Array
    fresh: bool = True
    damping: float = 0.0
    last_gain: float = np.inf
    last_moved: float = np.inf
    idle: int = 0
    silent: int = 0

    @cached_property
    def linear(self) -> tuple[Array, Array]:
        """The linear least squares A d = b (q + 1, q) of a step d from here, weighed by the loss, priors included: the
        triangular factor of its rows."""
        R = self.problem.triangle(self.z, self.residuals, self.J)
        return R[:, :-1], R[:, -1]

    @cached_property
    def step(self) -> Array:
        """The undamped step (q,): its solution within the bounds."""
        return _bounded(*self.linear, self.z, self.problem.reduction, 0.0)

    @cached_property
    def gain(self) -> float:
        """By how much that step is to change the residuals: the norm of A step."""
        return float(np.linalg.norm(self.linear[0] @ self.step))

    @property
    def moved(self) -> float:
        """The same in sds of a reading, by the root mean square of the residuals."""
        unit = float(np.linalg.norm(self.linear[1])) / np.sqrt(len(self.residuals))
        return self.gain / max(unit, 1e-300)

    def stale(self, damping: float) -> bool:
        """Whether sensitivities are no longer good after the step, with such damping of the next one."""
        return self.moved > _NEAR or self.moved > _SLOW * self.last_moved or damping > 0.0

    def seen(self, whole: Array | None = None) -> _State:
        """The same state with sensitivities of its own; `whole`: where they are known."""
        whole = self.problem.whole(self.z) if whole is None else whole
        return replace(self, J=whole @ self.problem.reduction.T, fresh=True)


def _descend(problem: _Problem, z: Array, tolerance: float) -> _Minimum:
    """Levenberg-Marquardt from z; where it ends, sensitivities are those of that place."""
    r, whole = problem.both(z)
    if whole is None and np.all(np.isfinite(problem.residuals(z))):
        whole = problem.whole(z)  # says what is wrong with sensitivities alone
    if whole is None or not np.all(np.isfinite(r)):
        raise NotConverged("the model has no finite prediction at the start of the fit: check the nominal values")
    at = _State(problem=problem, z=z, residuals=r, cost=problem.cost(z, r), J=whole @ problem.reduction.T)
    step, trace = 0, list[tuple[float, float]]()
    for step in range(1, _STEPS + 1):
        trace.append((at.gain, at.cost))
        if not _settled(at, tolerance):
            at = _stepped(at, step)
        elif at.fresh:
            final = np.clip(at.z + at.step, problem.reduction.lower, problem.reduction.upper)
            r, whole = problem.both(final)
            whole = problem.whole(final) if whole is None else whole
            return _Minimum(problem.cost(final, r), final, r, whole, step)
        else:
            at = replace(at.seen(), damping=0.0)
        far = np.any(np.abs(at.z) > FAR * np.maximum(problem.reduction.spread, 1.0))
        if far or _goes_nowhere(trace, problem.digits()):
            break
    raise NotConverged(f"the fit did not settle in {step} steps: {_farthest(problem, at.z)}")


def _goes_nowhere(trace: Sequence[tuple[float, float]], digits: float) -> bool:
    """Whether the last steps promised as much as those before them, and the cost hardly fell meanwhile."""
    if len(trace) < 2 * _LAPS:
        return False
    gains, costs = zip(*trace, strict=True)
    slower = min(gains[-_LAPS:]) > _LESS * min(gains[:-_LAPS])
    return slower and costs[-_LAPS] - costs[-1] < _FALL * costs[-_LAPS] and gains[-1] ** 2 > digits


def _settled(at: _State, tolerance: float) -> bool:
    """Whether the next step changes nothing that is more than rounding, or far below the noise."""
    if np.abs(at.step).max(initial=0.0) <= tolerance:
        return True
    A, b = at.linear
    size = float(np.linalg.norm(b))
    if at.idle >= _IDLE and (at.gain**2 <= at.problem.digits() or at.gain <= _SLOPES * size):
        return True
    still = tolerance * size
    blur = max(at.problem.blur(), _BLUR * float(np.linalg.norm(np.abs(A) @ np.abs(at.z))))
    return at.gain <= max(still, blur)


def _stepped(at: _State, step: int) -> _State:
    """The state after one step, as damped as it must be, or with its own sensitivities where none is any good.

    It has the sensitivities of the one before where these are still good.
    """
    problem, reduction, (A, b) = at.problem, at.problem.reduction, at.linear
    worst = at.cost * (1.0 + 1e-13) + problem.digits()
    size = np.maximum(np.linalg.norm(A, axis=0), 1e-12)
    idle = at.idle + 1 if at.gain > 0.5 * at.last_gain else 0
    left = replace(at, fresh=False, last_gain=at.gain, last_moved=at.moved, idle=idle)
    damping, silent = at.damping, at.silent
    for trial in range(_DAMPINGS):
        d = at.step if damping == 0.0 else _bounded(A, b, at.z, reduction, damping, size)
        z = np.clip(at.z + d, reduction.lower, reduction.upper)
        after = damping / 10.0 if 1e-6 <= damping <= _STOOD else 0.0
        stale = at.stale(after)
        first = trial == 0  # hardly ever refused
        r, whole = problem.both(z) if stale and first else (problem.residuals(z), None)
        cost = problem.cost(z, r)
        if cost <= worst:
            there = replace(left, z=z, residuals=r, cost=cost, damping=after, silent=silent)
            return there.seen(whole) if stale else there
        silent += not np.isfinite(cost)
        if silent > _SILENT:
            raise _NoAnswer(f"the model has no answer where the fit leads: {_farthest(problem, z)}")
        damping = max(10.0 * damping, 1e-6)
    if not at.fresh:
        return replace(at.seen(), damping=0.0, silent=silent)
    raise NotConverged(
        f"the fit is stuck after {step} steps: no step lowers the sum of squares, though it has a slope. "
        "Look at the readings' units, start nearer, or fix a parameter"
    )


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


def _solution(problem: _Problem, best: _Minimum) -> Solution:
    z, r = best.z, best.residuals
    reduction = problem.reduction
    x, whole = reduction.x(z), best.whole
    told = _factor(whole @ reduction.T)
    R = _factor(np.vstack([told, problem.prior(z)[1]]))
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
        alone_sd=_sds(_alone(problem, told), reduction.T) * np.sqrt(robust),
        hat=whole @ (T @ half),
        robust=robust,
    )


def _factor(rows: Array) -> Array:
    """The triangular factor (q, q) of rows (m, q); the rows themselves where they are few."""
    return np.asarray(np.linalg.qr(rows, mode="r")) if len(rows) > rows.shape[1] else rows


def _alone(problem: _Problem, J: Array) -> Array:
    """Rows of the readings J (m, q), or their factor, and of stated sds that count as such, with no weak hold."""
    o, T = problem.observations, problem.reduction.T
    stated = [i for i, p in enumerate(o.parameters) if problem.priors and p.sd is not None and np.any(T[i])]
    return np.vstack([J, *(T[i : i + 1] / (o.parameters[i].sd or 1.0) for i in stated)])


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
        alone_sd=sd,
        hat=hat,
    )


def check_rank(rows: Array, names: Sequence[str], stopped: Sequence[str] = ()) -> None:
    """NotIdentifiable where scaled whitened rows (m, p) cannot tell the parameters apart."""
    test = rank_test(rows, names)
    if not test.full:
        raise NotIdentifiable(unseen=test.unseen, groups=test.tied, at_bound=tuple(stopped))
