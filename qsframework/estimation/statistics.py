"""What a fit says of itself: intervals, and uncertainties that no residual shows."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from qsframework.errors import InputError, NotConverged, NotIdentifiable, Problem, nearest
from qsframework.estimation.noise import Scaled
from qsframework.estimation.observations import Observations
from qsframework.estimation.options import FitOptions
from qsframework.estimation.robust import Loss
from qsframework.estimation.solver import Solution, solve
from qsframework.estimation.tails import chi2_isf, f_isf
from qsframework.files import FileRecord, null
from qsframework.plugin import Array

HALF = 0.5
"""Share of a variance that is left, from which a direction counts as identified."""
_STEPS = 60
_CLOSE = 1e-6


def identified_directions(covariance: Array, sd: Array) -> int:
    """In how many directions readings removed half or more of the variance of what was known before to sds (p,), by
    the covariance (p, p) after them."""
    return int((np.linalg.eigvalsh(covariance / np.outer(sd, sd)) <= HALF).sum())


def propagated(solution: Solution, columns: Array) -> Array:
    """How far each estimate moves (p, k) where errors common to all readings, columns (m, k) whitened, act on them:
    C J' columns, what is known before the readings counted."""
    return (solution.unit or 1.0) / solution.robust * solution.covariance @ (solution.jacobian.T @ columns)


def moments_held(solution: Solution, columns: Array, sds: Array, stated: bool) -> Array:
    """E[d d'] (k, k) of errors d of what a fit held, known to sds (k,) before the readings, columns (m, k) whitened,
    in the light of the residuals r that it leaves:

        C + C b b' C,  C = (diag(sds)^-2 + W' (I - H) W / s^2)^-1,  b = W' r / s^2

    s^2: the variance of these residuals; of noise that was stated, not below it.
    """
    W = columns / (solution.unit or 1.0) * sds
    seen = solution.hat.T @ W
    weighted = solution.weights * solution.residuals
    free = len(W) - float(np.square(solution.hat).sum())  # E[r'r] = s^2 (m - tr H), what is known counted
    square = float(weighted @ solution.residuals) / free if free > 1.0 else np.inf
    rounded = np.finfo(float).eps * float(np.square(W).sum())  # of readings that are exactly the nominal arm's
    square = max(square, float(stated), rounded, np.finfo(float).tiny)
    C = np.linalg.inv(np.eye(len(sds)) + (W.T @ W - seen.T @ seen) / square)
    mean = C @ (W.T @ weighted) / square
    return sds[:, None] * (C + np.outer(mean, mean)) * sds


@dataclass(frozen=True)
class Interval(FileRecord):
    """A profile interval, SI: all values of one parameter at which the best fit of the others is not much worse.

    An end at the parameter's bound is that bound, for the readings allow all up to it.
    linear: the ends by the covariance alone, value +- t sd; where the two differ, the model is nonlinear
    """

    name: str
    level: float
    lower: Annotated[float, null(-math.inf)]
    upper: Annotated[float, null(math.inf)]
    linear: tuple[float, float]


def profile_interval(
    observations: Observations, solution: Solution, name: str, options: FitOptions, level: float = 0.95
) -> Interval:
    """All values of one parameter at which the best fit of the others is not significantly worse.

    The sum of squares may grow by the chi-square quantile of one degree of freedom; where the noise is estimated by
    that of F times the residuals' variance, which for a linear model is exactly value +- t sd. Priors and losses count
    as in the fit.
    """
    names = observations.names
    if name not in names:
        raise InputError(
            Problem(f"no parameter {name!r} in this fit", allowed=", ".join(names), hint=nearest(name, names))
        )
    i = names.index(name)
    if solution.unit is not None:  # priors and losses weighed by the noise that was found
        noise = Scaled(observations.noise, solution.unit, len(observations.measured))
        observations = replace(observations, noise=noise)
        scaled = solution.covariance * solution.unit**2
        solution = replace(solution, covariance=scaled, free_sd=solution.free_sd * solution.unit)
    sd = float((solution.free_sd if name in solution.at_bound else np.sqrt(np.diag(solution.covariance)))[i])
    if sd == 0.0 or name in options.fixed:
        raise InputError(f"{name} is fixed: there is no interval around it")
    if any(name in group for group in options.tied):
        raise InputError(f"{name} is tied: ask for the interval of a parameter that moves by itself")
    if not np.isfinite(sd):
        raise NotIdentifiable(unseen=(name,))
    rise, quantile = _allowed(observations, solution, level)
    best = float(solution.x[i])
    parameter = observations.parameters[i]
    cost = _profile(observations, solution, i, options)
    ends: list[float] = []
    for side, bound in ((-1.0, parameter.lower), (1.0, parameter.upper)):
        end = bound if options.bounds else side * np.inf
        ends.append(_end(lambda v: 2.0 * (cost(v) - solution.cost) - rise, best, side * quantile * sd, end, name))
    return Interval(name, level, ends[0], ends[1], (best - quantile * sd, best + quantile * sd))


def _allowed(observations: Observations, solution: Solution, level: float) -> tuple[float, float]:
    """How much the sum of squares may grow, and by how many sds (of the stated noise) that is in a linear model."""
    if observations.stated:
        rise = float(chi2_isf(1.0 - level, 1))
    else:
        dof = len(solution.residuals) + len(solution.priors) - solution.free
        variance = 2.0 * solution.cost / dof if solution.unit is None else 1.0  # of the noise that was found
        rise = float(f_isf(1.0 - level, 1, dof)) * variance
    return rise, float(np.sqrt(rise))


def _profile(observations: Observations, solution: Solution, i: int, options: FitOptions) -> Callable[[float], float]:
    """The cost of the best fit with parameter i held at a value; each fit starts where the last one ended."""
    others = [solution.x]
    name = observations.names[i]
    tangent = solution.covariance[:, i] / (solution.covariance[i, i] or 1.0)  # a parameter at its bound has none
    ends = [(p.lower, p.upper) if options.bounds else (-np.inf, np.inf) for p in observations.parameters]
    lower, upper = np.array(ends).T
    weight, towards = (float(v[i]) for v in observations.known)
    held = replace(options, fixed=(*options.fixed, name))

    def cost(value: float) -> float:
        alone = 0.5 * (weight * (value - towards)) ** 2  # held, its own prior is none of the others' fit
        start = np.clip(others[-1] + tangent * (value - others[-1][i]), lower, upper)
        start[i] = value
        if {*observations.names} <= {*held.fixed}:
            r = observations.noise.whiten(observations.measured - observations.predict(start))
            return alone + 0.5 * float(Loss(options.loss).rho(r).sum())
        found = solve(observations, held, start)
        others.append(found.x)
        return alone + found.cost

    return cost


def _end(excess: Callable[[float], float], best: float, step: float, bound: float, name: str) -> float:
    """Where the excess of the cost passes zero: from `best` outwards, doubled steps, then between the last two."""
    from scipy.optimize import root_scalar

    inside, outside = best, best
    for _ in range(_STEPS):
        outside = best + (outside - best) * 2.0 if outside != best else best + 0.7 * step
        beyond = outside <= bound if step < 0 else outside >= bound
        if beyond:
            outside = bound + _CLOSE * (best - bound)  # at the bound itself the others may be unidentifiable
        if excess(outside) > 0.0:
            found = root_scalar(excess, bracket=(inside, outside), xtol=_CLOSE * abs(step), rtol=1e-12)
            return float(found.root)
        if beyond:
            return bound
        inside = outside
    raise NotConverged(f"{name}: no end of its interval within {2.0**_STEPS:.0e} sds; the readings do not identify it")


def rms(values: Array) -> float:
    """Root mean square over all numbers; those that were not measured (NaN) do not count."""
    told = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(np.square(told)))) if told.size else float("nan")
