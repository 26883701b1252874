"""Rows that do not belong to residuals, and heavy tails, judged on what columns leave of them."""

from __future__ import annotations

import numpy as np

from qsframework.estimation import LinearFit, left
from qsframework.estimation.linear_fit import Whitened, without_outliers
from qsframework.estimation.projection import Flags
from qsframework.estimation.tails import chi2_isf, chi2_sf, f_sf
from qsframework.plugin import Array, Indices

_START = 0.01
"""Level at which rows are set aside before the proper test takes them back."""
_HELD = 1e-6
"""1 / sd by which all columns are held, in sds: a row that alone tells one takes all of it, in the fit or out of it."""
_DRAWS = 1000


def find_outliers(white: Array, columns: Array, level: float, mask: Flags) -> Indices:
    """Rows (sorted) of white (R, 3) that do not belong beside columns (3 R, q), at a family-wise level; their noise
    may have any size. mask (R, 3): what was measured.

    Each is judged by the exact F test of its coordinates against the rows that belong.
    """
    at: Indices = np.flatnonzero(mask)
    row: Indices = at // 3
    axes: Indices = np.maximum(np.bincount(row, minlength=len(white)), 1)
    given = Whitened(columns[at], white.ravel()[at], held=_HELD * np.ones(columns.shape[1]))
    enough = len(at) - columns.shape[1] >= max(len(at) // 3, 6)
    most = max(1, len(white) // 4)

    def beyond(misfit: Array, wrong: Flags, fit: LinearFit | None) -> Flags:
        if fit is None:
            usual = float(np.median(misfit / chi2_isf(0.5, axes)))
            p = chi2_sf(misfit / max(usual, 1e-300), axes) if enough else np.ones(len(misfit))
            return _worst(p < _START, p, most)
        free = np.where(wrong, fit.dof, np.maximum(fit.dof - axes, 1))
        rest = np.where(wrong, fit.chi2, fit.chi2 - misfit) / free
        p = f_sf(misfit / axes / np.maximum(rest, 1e-300), axes, free)
        back = wrong & (p * len(p) >= level)
        if back.any():  # the mildest half of them: one that comes back too early hides others
            return wrong & ~(back & (p >= np.median(p[back])))
        return _worst(p * len(p) < level, p, most)

    return np.flatnonzero(without_outliers(lambda _: given, row, len(white), beyond).wrong)


def _worst(out: Flags, p: Array, most: int) -> Flags:
    """Of some rows (R,) those with the least p, at most so many."""
    return np.asarray(out & (p <= np.sort(p)[most - 1]), dtype=np.bool_)


def beside(white: Array, Q: Array, mask: Flags | None = None) -> LinearFit:
    """The fit of orthonormal columns (3 R, k) to white (R, 3); mask (R, 3): what was measured, None: all."""
    return LinearFit(Q, left(Q, white.ravel()), used=None if mask is None else mask.ravel())


def heavy_tails(white: Array, fit: LinearFit, seed: int = 0) -> float:
    """p-value of normal errors from the fourth power of what a fit leaves of them, by simulation of the same."""
    share = np.maximum(1.0 - np.einsum("ij,ij->i", fit.Q, fit.Q), 0.0)
    told = share > 0.05
    if fit.used is not None:
        told &= fit.used

    def kurtosis(flat: Array) -> Array:
        square = np.square((flat - fit.Q @ (fit.Q.T @ flat))[told]) / share[told][:, None]
        return np.mean(np.square(square), axis=0) / np.mean(square, axis=0) ** 2

    found = float(kurtosis(white.reshape(-1, 1))[0])
    drawn = kurtosis(np.random.default_rng(seed).standard_normal((white.size, _DRAWS)))
    return float((1 + np.sum(drawn >= found)) / (1 + _DRAWS))
