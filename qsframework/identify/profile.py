"""Profile intervals: how far a parameter may go while the others make up for it as well as they can."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from qsframework.errors import InputError, NotConverged, NotIdentifiable, Problem, nearest
from qsframework.identify.fit import Interval
from qsframework.identify.observations import Observations
from qsframework.identify.solve import Solution, solve

_STEPS = 60
_CLOSE = 1e-6


def profile_interval(
    observations: Observations, solution: Solution, name: str, level: float = 0.95, stated: bool = True,
    fixed: Sequence[str] = (),
) -> Interval:  # fmt: skip
    """All values of one parameter at which the best fit of the others, but the fixed ones, is not significantly worse.

    The sum of squares may grow by the chi-square quantile of one degree of freedom; where the noise is estimated
    (`stated` False) by that of F times the residuals' variance, which for a linear model is exactly value +- t sd.
    """
    names = observations.names
    if name not in names:
        raise InputError(Problem(f"no parameter {name!r} in this fit", allowed=", ".join(names),
                                 hint=nearest(name, names)))  # fmt: skip
    i = names.index(name)
    sd = float((solution.free_sd if name in solution.at_bound else np.sqrt(np.diag(solution.covariance)))[i])
    if sd == 0.0 or name in fixed:
        raise InputError(f"{name} is fixed: there is no interval around it")
    if not np.isfinite(sd):
        raise NotIdentifiable(f"{name}: the readings cannot tell it at all, so that it has no interval")
    rise, quantile = _allowed(solution, level, stated)
    best = float(solution.x[i])
    parameter = observations.parameters[i]
    cost = _profile(observations, solution, i, fixed)
    ends: list[float] = []
    for side, bound in ((-1.0, parameter.lower), (1.0, parameter.upper)):
        ends.append(_end(lambda v: 2.0 * (cost(v) - solution.cost) - rise, best, side * quantile * sd, bound, name))
    return Interval(name, level, ends[0], ends[1], (best - quantile * sd, best + quantile * sd))


def _allowed(solution: Solution, level: float, stated: bool) -> tuple[float, float]:
    """How much the sum of squares may grow, and by how many sds (of the stated noise) that is in a linear model."""
    from scipy.stats import chi2, f

    if stated:
        rise = float(chi2.ppf(level, 1))
    else:
        dof = len(solution.residuals) - solution.free
        rise = float(f.ppf(level, 1, dof)) * 2.0 * solution.cost / dof
    return rise, float(np.sqrt(rise))


def _profile(
    observations: Observations, solution: Solution, i: int, fixed: Sequence[str] = ()
) -> Callable[[float], float]:
    """The cost of the best fit with parameter i held at a value; each fit starts where the last one ended."""
    others = [solution.x]
    name = observations.names[i]
    tangent = solution.covariance[:, i] / (solution.covariance[i, i] or 1.0)  # a parameter at its bound has none
    lower = np.array([p.lower for p in observations.parameters])
    upper = np.array([p.upper for p in observations.parameters])

    def cost(value: float) -> float:
        start = np.clip(others[-1] + tangent * (value - others[-1][i]), lower, upper)
        start[i] = value
        if {*observations.names} <= {name, *fixed}:
            r = observations.noise.whiten(observations.measured - observations.predict(start))
            return 0.5 * float(r @ r)
        found = solve(observations, start=start, fixed=(*fixed, name), starts=0)
        others.append(found.x)
        return found.cost

    return cost


def _end(excess: Callable[[float], float], best: float, step: float, bound: float, name: str) -> float:
    """Where the excess of the cost passes zero: from `best` outwards, doubled steps, then between the last two."""
    from scipy.optimize import root_scalar

    inside, outside = best, best
    for _ in range(_STEPS):
        outside = best + (outside - best) * 2.0 if outside != best else best + 0.7 * step
        beyond = outside <= bound if step < 0 else outside >= bound
        if beyond:
            outside = bound + _CLOSE * (best - bound)  # at the bound itself the others may be untold
        if excess(outside) > 0.0:
            found = root_scalar(excess, bracket=(inside, outside), xtol=_CLOSE * abs(step), rtol=1e-12)
            return float(found.root)
        if beyond:
            return bound
        inside = outside
    raise NotConverged(f"{name}: no end of its interval within {2.0**_STEPS:.0e} sds; the readings do not tell it")
