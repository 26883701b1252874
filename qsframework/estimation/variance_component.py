"""One more source of error beside the readings' own: how large it is, by restricted maximum likelihood (REML).

    y = X b + Z u + e,   u ~ N(0, ratio^2 s^2),   e ~ N(0, s^2)

In the eigenvectors of what Z does beyond the fitted columns X the likelihood is a sum: exact, and one decomposition
does for all sizes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsframework.estimation.linear_fit import LinearFit
from qsframework.plugin import Array

_SMALLEST, _LARGEST = 1e-3, 1e3
"""Sizes that are looked for, in sds of a reading's own error."""
_FINE, _FINER = 41, 5
"""Places of the grid of them, and how often it is made finer: to a millionth."""
_TOGETHER = 256
"""Columns that are taken beside the fit at once."""


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


def variance_component(fit: LinearFit, Z: Array) -> VarianceComponent:
    """The likeliest size of what whitened columns Z (m, k), of coefficients of one sd, add to the errors of a fit whose
    noise may have any size. Z is overwritten."""
    if fit.used is not None:
        Z[~fit.used] = 0.0
    for first in range(0, Z.shape[1], _TOGETHER):
        part = Z[:, first : first + _TOGETHER]
        part -= fit.Q @ (fit.Q.T @ part)
    lam, V = np.linalg.eigh(Z.T @ Z)
    seen = lam > 1e-6 * max(lam[-1], 1e-300)
    lam, V = lam[seen], V[:, seen]
    square = np.square(V.T @ (Z.T @ fit.white)) / lam

    def deviance(ratio: Array) -> Array:
        return fit.dof * np.log(with_variance(lam, square[:, None], fit.chi2, ratio**2, fit.dof)[:, 0])

    ratio, low, high = 0.0, _SMALLEST, _LARGEST
    for _ in range(_FINER):  # each time between the neighbours of the best
        ratios = np.geomspace(low, high, _FINE)
        at = int(np.argmin(deviance(ratios)))
        low, ratio, high = (float(ratios[k]) for k in (max(at - 1, 0), at, min(at + 1, _FINE - 1)))
    without, beside = deviance(np.array([0.0, ratio])).tolist()
    rest = max(fit.chi2 - float(square.sum()), 0.0)
    own = rest + float((square / (1.0 + ratio**2 * lam)).sum())
    return VarianceComponent(ratio, without - beside, own, rest, len(lam))
