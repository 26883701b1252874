"""How far a design is from the best possible: the equivalence theorem, recomputed in float64.

A criterion is psi(M), smaller is better, convex and homogeneous of degree -1 in the information
matrix M (trace of the covariance, det(cov)^(1/p), ...). With G = -d psi / d M, 1/psi is concave, so
for every design M* that the experiment allows

    psi(M) / psi(M*) <= <G, M*> / psi(M)

and the largest <G, M*> over all allowed designs is a linear programme with a closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Indices


@dataclass(frozen=True, eq=False)
class Allowed:
    """Designs over N candidates: in each group (indices) the weights sum to its share and none exceeds `cap`."""

    groups: tuple[Indices, ...]
    shares: tuple[float, ...]
    cap: float = 1.0

    def best(self, scores: Array) -> float:
        """Largest sum of w_i scores_i over the allowed designs."""
        total = 0.0
        for members, share in zip(self.groups, self.shares, strict=True):
            values = scores[members]
            full = int(np.floor(share / self.cap + 1e-9))
            rest = share - full * self.cap
            count = min(full + 1, len(values))
            top = -np.sort(-np.partition(values, len(values) - count)[len(values) - count :])
            total += self.cap * top[:full].sum() + (rest * top[full] if rest > 1e-12 and full < len(top) else 0.0)
        return float(total)


def everything(count: int) -> Allowed:
    """All designs over `count` candidates."""
    return Allowed((np.arange(count),), (1.0,))


def scores(rows: Array, gradient: Array) -> Array:
    """tr(G M_i) = |A_i B|_F^2 for every candidate (N,), with G = B B'."""
    values, vectors = np.linalg.eigh(gradient)
    B = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.einsum("nkp,nkp->n", rows @ B, rows @ B)


def efficiency_bound(value: float, gradient: Array, rows: Array, allowed: Allowed) -> float:
    """Lower bound in [0, 1] on the efficiency psi(best) / psi(M) of a design of value psi(M)."""
    best = allowed.best(scores(rows, gradient))
    return float(min(value / best, 1.0)) if best > 0 else 0.0


def weighted_information(rows: Array, weights: Array | Indices) -> Array:
    """M(w) = sum of w_i A_i' A_i, (p, p)."""
    used = np.flatnonzero(np.asarray(weights))
    scaled = rows[used] * np.sqrt(np.asarray(weights)[used])[:, None, None]
    flat = scaled.reshape(-1, rows.shape[-1])
    return flat.T @ flat
