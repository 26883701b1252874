"""One more source of error beside the readings' own: how large it is, by restricted maximum likelihood (REML).

    y = X b + Z u + e,   u ~ N(0, ratio^2 s^2),   e ~ N(0, s^2)

The columns of Z are orthogonal, so that all that is solved has the size of the fit: exact, and quick for many.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsframework.estimation.linear_fit import LinearFit
from qsframework.plugin import Array, Indices

_SMALLEST, _LARGEST = 1e-3, 1e3
"""Sizes that are looked for, in sds of a reading's own error."""
_GRID, _NEAR = 21, 1e-6
"""Places of the grid of them, and the share of it to which the likeliest is found between two of its places."""
_FITTED = 1e-6
"""Share of a fitted direction that lies beyond Z, below which Z reaches it whole."""


@dataclass(frozen=True)
class VarianceComponent:
    """ratio: sd of the coefficients u in sds of the readings' own error; gain: twice the log of how much likelier it
    makes the readings; own: squares that are then their own error's; rest, directions: squares beyond the directions
    that the source reaches, and how many these are."""

    ratio: float
    gain: float
    own: float
    rest: float
    directions: int


def with_variance(lam: Array, square: Array, total: Array | float, variances: Array, free: float) -> Array:
    """exp(-2 log L / free) (..., T, n) of readings with coefficients of these variances (T,), in units of the readings'
    own: what these leave of the squares, and the price of their directions, as factors.

    lam (..., d): squares of the columns' directions beside the fit; square (..., d, n): of n readings along unit
    directions; total: squares that the fit leaves; free: its degrees of freedom
    """
    grown = variances[:, None] * lam[..., None, :]
    left = np.maximum(total - (grown / (1.0 + grown)) @ square, np.maximum(1e-12 * total, 1e-300))
    return np.asarray(left * np.exp(np.log1p(grown).sum(axis=-1) / free)[..., None])


def variance_component(fit: LinearFit, values: Array, column: Indices) -> VarianceComponent:
    """The likeliest size of what orthogonal whitened columns Z, of coefficients of one sd, add to the errors of a fit
    whose noise may have any size. values (m, n): of Z, in each row n of them; column (m, n): where they stand.

    With D = Z'Z, W = Z'Q, t = Z'y and w = ratio^2 / (1 + ratio^2 D), for V = I + ratio^2 Z Z':

        A = Q' V^-1 Q = I - W' w W,   y' P y = y'y - t' w t - b' A^-1 b  with  b = W' w t,
        log |V| + log |A| = sum log(1 + ratio^2 D) + log |A|
    """
    from scipy.optimize import minimize_scalar

    if fit.used is not None:
        values = np.where(fit.used[:, None], values, 0.0)
    count = int(column.max()) + 1
    each = np.square(values), values * fit.white[:, None]
    D, t = (np.asarray(np.bincount(column.ravel(), v.ravel(), count), dtype=np.float64) for v in each)
    W = np.zeros((count, fit.Q.shape[1]))
    np.add.at(W, column, values[..., None] * fit.Q[:, None])

    def left(w: Array) -> tuple[Array, Array, float]:
        """A, b and what the weights w (k,) take of the squares."""
        half = np.sqrt(w)[:, None] * W
        return np.eye(W.shape[1]) - half.T @ half, (w * t) @ W, float(w @ np.square(t))

    def squares(ratio: float) -> tuple[float, float]:
        """What remains of the squares, and the price of the directions."""
        A, b, taken = left(ratio**2 / (1.0 + ratio**2 * D))
        price = float(np.log1p(ratio**2 * D).sum() + np.linalg.slogdet(A)[1])
        return max(fit.chi2 - taken - float(b @ np.linalg.solve(A, b)), 1e-12 * fit.chi2, 1e-300), price

    def deviance(ratio: float) -> float:
        rest, price = squares(ratio)
        return fit.dof * float(np.log(rest)) + price

    grid = np.geomspace(_SMALLEST, _LARGEST, _GRID)
    deviances = [deviance(ratio) for ratio in grid.tolist()]
    at = int(np.argmin(deviances))
    found = minimize_scalar(
        lambda t: deviance(float(np.exp(t))),
        bounds=(np.log(grid[max(at - 1, 0)]), np.log(grid[min(at + 1, _GRID - 1)])),
        method="bounded",
        options={"xatol": _NEAR},
    )
    ratio = float(np.exp(found.x)) if found.fun < deviances[at] else float(grid[at])
    reached = D > 0.0
    limit: Array = np.zeros(count)
    limit[reached] = 1.0 / D[reached]
    A, b, taken = left(limit)
    values, vectors = np.linalg.eigh(A)
    seen = values > _FITTED
    rest = fit.chi2 - taken - float((np.square(b @ vectors[:, seen]) / values[seen]).sum())
    directions = int(reached.sum() - (~seen).sum())
    return VarianceComponent(ratio, deviance(0.0) - deviance(ratio), squares(ratio)[0], max(rest, 0.0), directions)
