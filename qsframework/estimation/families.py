"""How far parameters of one kind lie from what was known of them: a factor a family, and single ones that lie far off.

About a solution, whitened readings less what the prior values say are y = X b + G s u + e: X the columns of what
nothing is known of, G those of the others per sd, u ~ N(0, 1), e ~ N(0, 1), and s = f / sqrt(w). The factor f of a
family is at least 1 and log f ~ N(0, 0.5^2), by marginal likelihood: minus its logarithm is half of
log det K + y' K^-1 y with K = 1 + G s^2 G' where X is projected out. Within a family u is Student's t of 4 degrees of
freedom, whose weights w = 5 / (4 + E[u^2] / f^2) let a single one lie far off. No sd becomes smaller than it was known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsframework.estimation.tails import chi2_sf
from qsframework.plugin import Array, Indices

LEVEL = 0.01
"""Probability of residuals this large below which they do not agree with their noise."""
_FREEDOM = 4.0
_SPREAD = 0.5
"""Of the logarithm of a factor: arms are within 2.7 times of what is declared of them in 95 of 100."""
_MOST = 100.0
_ROUNDS = 100
_STILL = 1e-3


@dataclass(frozen=True, eq=False)
class Loosened:
    """s (p,): by how much the sds of what was known are to be taken larger; factor, spread (F,): of each family, and
    the sd of its logarithm."""

    by: Array
    factor: Array
    spread: Array

    @property
    def interval(self) -> tuple[Array, Array]:
        """Ends (F,) of what holds each factor with 95 %."""
        far = np.exp(1.96 * self.spread)
        return self.factor / far, self.factor * far


def loosened(flat: Array, known: Array, y: Array, family: Indices) -> Loosened:
    """The factors by whitened columns of what nothing is known of (m, k), and of the others per sd (m, p), and by what
    the prior values leave y (m,) of the readings; family (p,): number of each one's family.

    All are 1 where no values of the parameters bring the readings to their noise: what a model lacks would pass for
    geometry. Of a family of one the factor is 1: nothing tells its size from a single value that lies far off.
    """
    R: Array = np.asarray(np.linalg.qr(np.column_stack([flat, known, y]), mode="r"))
    R = R[flat.shape[1] :, flat.shape[1] :]
    G, rest = R[:, :-1], R[:, -1]
    members, size = np.bincount(family), np.ones(len(family))
    spread = np.full(len(members), _SPREAD)
    dof = len(y) - flat.shape[1] - len(family)
    if dof <= 0 or chi2_sf(float(R[-1, -1] ** 2), dof) < LEVEL:
        return Loosened(size, np.ones(len(members)), spread)
    free = np.flatnonzero(members > 1)
    factor, weight = _settled(G, rest, family, np.ones(len(members)), size, free)
    spread[free] = [_curvature(G, rest, family, weight, factor, one) for one in free.tolist()]
    return Loosened(np.maximum(factor[family] / np.sqrt(weight), 1.0), factor, spread)


def _settled(G: Array, y: Array, family: Indices, factor: Array, weight: Array, free: Indices) -> tuple[Array, Array]:
    """The likeliest factors (F,) of the families that are free, and the weights (p,) that go with them."""
    for _ in range(_ROUNDS):
        before = factor[family] / np.sqrt(weight)
        factor = _with_likeliest(G, y, family, weight, factor, free)
        square = _second_moments(G, y, factor[family] / np.sqrt(weight)) / factor[family] ** 2
        weight = (_FREEDOM + 1.0) / (_FREEDOM + square)
        if np.allclose(factor[family] / np.sqrt(weight), before, rtol=_STILL, atol=0.0):
            break
    return factor, weight


def _second_moments(G: Array, y: Array, s: Array) -> Array:
    """E[u^2] (p,) of the values in sds, given the readings: square of the mean and variance."""
    H = G * s
    left = np.linalg.inv(np.eye(len(s)) + H.T @ H)
    return np.square(s * (left @ (H.T @ y))) + s**2 * left.diagonal()


def _cost(G: Array, y: Array, family: Indices, weight: Array, factor: Array) -> float:
    """Minus the logarithm of the marginal likelihood of factors (F,), their own prior counted."""
    H = G * (factor[family] / np.sqrt(weight))
    K = np.eye(len(y)) + H @ H.T
    fit = float(np.linalg.slogdet(K)[1] + y @ np.linalg.solve(K, y))
    return 0.5 * fit + 0.5 * float(np.square(np.log(factor) / _SPREAD).sum())


def _with_likeliest(G: Array, y: Array, family: Indices, weight: Array, factor: Array, free: Indices) -> Array:
    """The factors (F,) with the likeliest ones of the families that are free, one after the other."""
    from scipy.optimize import minimize_scalar

    factor = factor.copy()
    for one in free.tolist():

        def cost(log: float, one: int = one) -> float:
            trial = factor.copy()
            trial[one] = np.exp(log)
            return _cost(G, y, family, weight, trial)

        factor[one] = np.exp(minimize_scalar(cost, bounds=(0.0, np.log(_MOST)), method="bounded").x)
    return factor


def _curvature(G: Array, y: Array, family: Indices, weight: Array, factor: Array, one: int) -> float:
    """sd of the logarithm of one family's factor, by the curvature of the cost over a tenth either way."""
    step, costs = 0.1, list[float]()
    for by in (-step, 0.0, step):
        trial = factor.copy()
        trial[one] *= np.exp(by)
        costs.append(_cost(G, y, family, weight, trial))
    bend = (costs[0] - 2.0 * costs[1] + costs[2]) / step**2
    return float(min(1.0 / np.sqrt(max(bend, 1e-12)), _SPREAD))
