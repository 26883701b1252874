"""Gross rows and heavy tails, judged on what a library of columns leaves of residuals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from qsframework.estimation.tails import chi2_isf, f_sf
from qsframework.plugin import Array, Indices

Flags = npt.NDArray[np.bool_]
_MEDIAN = 2.3659738843753377
"""Median of chi-square with three degrees of freedom."""
_STEPS = 30
_TUKEY = 4.2
"""Row length, in its sd, from which a row has no weight in the robust fit."""
_START = 0.01
"""Level at which rows are set aside before the proper test takes them back."""
_DRAWS = 1000


@dataclass(frozen=True, eq=False)
class Basis:
    """Orthonormal columns Q (3R, k) of what a library can explain; mask (R, 3): what was measured, None: all."""

    Q: Array
    mask: Flags | None = None

    @property
    def dof(self) -> int:
        missing = 0 if self.mask is None else int((~self.mask).sum())
        return self.Q.shape[0] - self.Q.shape[1] - missing

    @property
    def axes(self) -> Array:
        """Measured coordinates (R,) of each row."""
        return np.full(len(self.Q) // 3, 3.0) if self.mask is None else self.mask.sum(axis=1).astype(float)

    @cached_property
    def leverage(self) -> Array:
        """(R, 3, 3) block of each row in the projector on the columns."""
        q = self.Q.reshape(-1, 3, self.Q.shape[1])
        return q @ q.transpose(0, 2, 1)

    def left(self, white: Array) -> Array:
        """What the columns leave of (R, 3)."""
        flat = white.ravel()
        return (flat - self.Q @ (self.Q.T @ flat)).reshape(white.shape)

    def take(self, rows: Indices) -> Basis:
        """The same columns on some rows only."""
        if 3 * len(rows) == len(self.Q):
            return self
        mask = None if self.mask is None else self.mask[rows]
        part = self.Q.reshape(-1, 3, self.Q.shape[1])[rows].reshape(-1, self.Q.shape[1])
        U, values, _ = np.linalg.svd(part, full_matrices=False)
        return Basis(U[:, values > 1e-7], mask)


def find_outliers(white: Array, basis: Basis, level: float) -> Indices:
    """Rows (sorted) of white (R, 3) that do not belong, at a family-wise level; their noise may have any size.

    A robust fit sets rows aside; then the mildest of them come back and the worst others go, one by one, each by
    the exact F test of its three coordinates against the rows that stay.
    """
    out = set(_suspects(white, basis))
    most = max(1, len(white) // 4)
    for _ in range(4 * most):
        p = _row_p_values(white, basis, np.array(sorted(out), dtype=np.intp)) * len(white)
        back = max(out, key=lambda r: p[r], default=-1)
        if back >= 0 and p[back] >= level:
            out.remove(back)
            continue
        inside = [r for r in range(len(white)) if r not in out]
        worst = min(inside, key=lambda r: p[r])
        if p[worst] >= level or len(out) >= most:
            break
        out.add(worst)
    return np.array(sorted(out), dtype=np.intp)


def _row_p_values(white: Array, basis: Basis, out: Indices) -> Array:
    """p (R,) of each row against the fit of all rows that are neither in `out` nor itself; 1 where that is not told."""
    keep = np.setdiff1d(np.arange(len(white)), out)
    q = basis.Q.reshape(len(white), 3, -1)
    gone = q[out].reshape(-1, q.shape[2])
    N: Array = np.eye(q.shape[2]) - gone.T @ gone  # Q'Q of the rows that stay
    N += 1e-12 * np.eye(len(N))  # where the rows that stay do not tell a column, so that it takes all of the others
    G = np.asarray(np.linalg.inv(np.linalg.cholesky(N)), dtype=np.float64)
    z = q[keep].reshape(-1, q.shape[2]).T @ white[keep].ravel()
    left: Array = white - q @ (G.T @ (G @ z))
    h = q @ G.T
    H = h @ h.transpose(0, 2, 1)
    spread = np.eye(3) - H
    spread[out] = np.eye(3) + H[out]
    told = np.linalg.eigvalsh(spread)[:, 0] > 1e-6
    square = np.zeros(len(white))
    square[told] = np.einsum("ri,ri->r", left[told], np.linalg.solve(spread[told], left[told][..., None])[..., 0])
    columns = round(float(np.trace(H[keep], axis1=1, axis2=2).sum()))  # those that the rows that stay tell
    axes = basis.axes
    total, free = float(np.square(left[keep]).sum()), int(axes[keep].sum()) - columns
    inside = np.isin(np.arange(len(white)), keep)
    rest = np.where(inside, total - square, total) / np.where(inside, free - axes, free)
    p = f_sf(square / axes / np.maximum(rest, 1e-300), axes, np.where(inside, free - axes, free))
    return np.where(told, p, 1.0)


def _suspects(white: Array, basis: Basis) -> list[int]:
    """Rows without weight in a robust fit (Tukey's biweight of a row's length, started from Huber's)."""
    flat, Q = white.ravel(), basis.Q
    if basis.dof < len(flat) // 3 or basis.dof < 6:
        return []
    freedom = np.maximum(basis.axes - np.trace(basis.leverage, axis1=1, axis2=2), 0.3)
    weight = np.ones(len(white))
    z = Q.T @ flat
    length = np.ones(len(white))
    for step in range(_STEPS):
        W = np.repeat(weight, 3)
        z_new = np.linalg.solve(Q.T @ (W[:, None] * Q) + 1e-9 * np.eye(Q.shape[1]), Q.T @ (W * flat))
        left = (flat - Q @ z_new).reshape(white.shape)
        square = np.square(left).sum(axis=1) * 3.0 / freedom
        scale = max(float(np.median(square)) / _MEDIAN, 1e-300)
        length = np.sqrt(square / scale)
        if step < _STEPS // 2:
            weight = np.minimum(1.0, 2.0 / np.maximum(length, 1e-300))
        else:
            weight = np.square(np.maximum(1.0 - (length / _TUKEY) ** 2, 0.0))
        if step > _STEPS // 2 and np.allclose(z, z_new, rtol=0, atol=1e-3 * np.sqrt(scale)):
            break
        z = z_new
    suspects = np.flatnonzero(length**2 > chi2_isf(_START, 3))
    return [int(r) for r in suspects[np.argsort(-length[suspects])][: len(white) // 4]]


def heavy_tails(white: Array, basis: Basis, seed: int = 0) -> float:
    """p-value of normal errors from the fourth power of the residuals, by simulation of the same residuals."""
    share = np.maximum(1.0 - np.einsum("ij,ij->i", basis.Q, basis.Q), 0.0)
    told = share > 0.05
    if basis.mask is not None:
        told &= basis.mask.ravel()

    def kurtosis(flat: Array) -> Array:
        square = np.square((flat - basis.Q @ (basis.Q.T @ flat))[told]) / share[told][:, None]
        return np.mean(np.square(square), axis=0) / np.mean(square, axis=0) ** 2

    found = float(kurtosis(white.reshape(-1, 1))[0])
    drawn = kurtosis(np.random.default_rng(seed).standard_normal((white.size, _DRAWS)))
    return float((1 + np.sum(drawn >= found)) / (1 + _DRAWS))
