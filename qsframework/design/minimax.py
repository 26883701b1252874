"""Criteria with kinks, whose slopes a barrier smooths for the exchange; and criteria over several scenarios."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from qsframework.design.criteria import SMOOTHING, Criterion, Expansion, covariance, mixed, regular
from qsframework.plugin import Array


@dataclass(frozen=True, eq=False)
class SmallestEigenvalue(Criterion):
    """1 / the smallest eigenvalue of M: the variance in the worst direction (E).

    Smoothed by the barrier min over t of -log t - mu log det(M - t).
    """

    name: str = "E"
    title: str = "largest eigenvalue of cov, the variance in the worst direction"
    depends_on_scale: bool = True
    kinked: bool = True

    root: Array | None = None
    """T of M = T^-T M' T^-1 where M' is what the methods are given."""

    def unit(self, p: int) -> Array:
        """The M (p, p) of which all eigenvalues are 1."""
        return np.eye(p) if self.root is None else self.root.T @ self.root

    def _own(self, M: Array) -> Array:
        """M in the parameters' own coordinates."""
        if self.root is None:
            return M
        inverse = np.linalg.inv(self.root)
        return inverse.T @ M @ inverse

    def value(self, M: Array) -> Array:
        good, _ = regular(M)
        own = self._own(np.where(good[..., None, None], M, np.eye(M.shape[-1])))
        smallest = np.linalg.eigvalsh(own)[..., 0]
        return np.where(np.logical_and(good, smallest > 0), 1.0 / np.where(smallest > 0, smallest, 1.0), np.inf)

    def expansion(self, M: Array, mu: float = SMOOTHING) -> Expansion:
        values, vectors = np.linalg.eigh(self._own(M))
        gap = _below(values, mu)
        t, above = float(values[0]) - gap, values - values[0] + gap
        back = vectors if self.root is None else np.linalg.solve(self.root, vectors)
        P = (back / above) @ back.T
        height = -float(np.log(t)) - mu * float(np.log(above).sum())
        factor = float(values[0]) * mu * float((1.0 / above).sum())
        return Expansion(height, mu * P, factor=factor)

    def in_basis(self, T: Array) -> SmallestEigenvalue:
        return replace(self, root=T if self.root is None else self.root @ T)


def _below(values: Array, mu: float) -> float:
    """Gap min(values) - t with 1 / t = mu sum 1 / (values - t); its logarithm's equation is nearly a line."""
    from scipy.optimize import brentq

    smallest = float(values[0])
    if smallest <= 0.0:
        raise np.linalg.LinAlgError("an information matrix that is not positive definite")
    above = values - smallest

    def excess(log_gap: float) -> float:
        gap = math.exp(log_gap)
        return math.log(mu * (smallest - gap) * float((1.0 / (above + gap)).sum()))

    ends = math.log(smallest * mu * 1e-3), math.log(smallest) - 1e-12
    return math.exp(brentq(excess, *ends, xtol=1e-14, rtol=1e-14))


@dataclass(frozen=True, eq=False)
class Largest(Criterion):
    """The largest over J test poses of trace(A_j cov A_j'), rows A_j (J, k, p): G.

    Smoothed by the barrier min over u of u - mu sum log(u - log psi_j).
    """

    rows: Array
    name: str = "G"
    title: str = "the largest variance after compensation over the test poses"
    depends_on_scale: bool = False
    kinked: bool = True

    def in_basis(self, T: Array) -> Largest:
        return replace(self, rows=self.rows @ T)

    def each(self, M: Array) -> Array:
        """psi_j (..., J) at regular M."""
        return np.linalg.inv(M).reshape(*M.shape[:-2], -1) @ self.weights.T

    def with_one(self, M: Array, block: Array) -> Array:
        if block.shape[1] >= M.shape[-1]:
            return super().with_one(M, block)
        cov = covariance(M)
        turned = block @ cov
        grown = np.eye(block.shape[1]) + turned @ np.swapaxes(block, -1, -2)
        own = turned @ self.rows.reshape(-1, M.shape[-1]).T
        saved = (own * np.linalg.solve(grown, own)).sum(axis=1).reshape(len(block), *self.rows.shape[:2])
        return np.asarray((self.each(M) - saved.sum(axis=2)).max(axis=1), dtype=np.float64)

    @cached_property
    def weights(self) -> Array:
        """A_j' A_j as (J, p^2)."""
        return (np.swapaxes(self.rows, -1, -2) @ self.rows).reshape(len(self.rows), -1)

    def value(self, M: Array) -> Array:
        good, _ = regular(M)
        each = self.each(np.where(good[..., None, None], M, np.eye(M.shape[-1])))
        return np.where(np.logical_and(good, (each > 0).all(axis=-1)), each.max(axis=-1), np.inf)

    def expansion(self, M: Array, mu: float = SMOOTHING) -> Expansion:
        cov = covariance(M)
        turned = self.rows @ cov
        values = np.einsum("jkp,jkp->j", turned, self.rows)
        heights = np.log(values)
        height, shares = smoothed(heights, mu)
        counted = np.flatnonzero(shares > 1e-14)
        slopes = np.swapaxes(turned[counted], -1, -2) @ turned[counted] / values[counted, None, None]
        slope = np.asarray(np.tensordot(shares[counted], slopes, 1), dtype=np.float64)
        factor = float((shares[counted] * values[counted]).sum() / values.max())
        return Expansion(height, slope, factor=factor)


def smoothed(heights: Array, mu: float) -> tuple[float, Array]:
    """The smoothed largest of heights, and its weights."""
    logs = heights - heights.max()
    u = _above(logs, mu)
    height = float(heights.max()) + u - mu * float(np.log(u - logs).sum())
    shares = mu / (u - logs)
    return height, shares / shares.sum()


def highest(parts: list[Expansion], values: Array, mu: float) -> Expansion:
    """Expansion of the smoothed largest of the parts, whose true values are given, with the mixture that bounds it."""
    height, shares = smoothed(np.array([part.height for part in parts]), mu)
    slope = np.sum([share * part.slope for share, part in zip(shares, parts, strict=True)], axis=0)
    factor = float((shares * values * [part.factor for part in parts]).sum() / values.max())
    return Expansion(height, slope, factor=factor)


def _above(logs: Array, mu: float) -> float:
    """u > max(logs) with mu sum 1 / (u - logs) = 1, by bisection; logs <= 0 with maximum 0."""
    low, high = mu * 0.5, mu * len(logs) * 2.0
    for _ in range(100):
        u = np.sqrt(low * high)
        low, high = (u, high) if mu * float((1.0 / (u - logs)).sum()) > 1.0 else (low, u)
    return float(np.sqrt(low * high))


@dataclass(frozen=True, eq=False)
class Robust:
    """A criterion over S scenarios of the parameters: M is (S, p, p); the mean of psi, or its largest."""

    inner: Criterion
    worst: bool = False

    @property
    def name(self) -> str:
        return self.inner.name

    @property
    def kinked(self) -> bool:
        return self.worst or self.inner.kinked

    def in_basis(self, T: Array) -> Robust:
        """The same criterion of T' M T."""
        return replace(self, inner=self.inner.in_basis(T))

    def value(self, M: Array) -> Array:
        """psi of (..., S, p, p): mean or largest over the scenarios."""
        each = self.inner.value(M)
        return each.max(axis=-1) if self.worst else each.mean(axis=-1)

    def with_one(self, M: Array, block: Array) -> Array:
        """psi (m,) of M + A_i' A_i for the rows (m, S, k, p) of m candidates."""
        each = np.stack([self.inner.with_one(m, block[:, s]) for s, m in enumerate(M)], axis=-1)
        return each.max(axis=-1) if self.worst else each.mean(axis=-1)

    def expansion(self, M: Array, mu: float = SMOOTHING) -> Expansion:
        """Expansion with slopes (S, p, p)."""
        count = len(M)
        each = [_in_scenario(self.inner.expansion(m, mu), s, count) for s, m in enumerate(M)]
        if count == 1:
            return each[0]
        values = np.atleast_1d(self.inner.value(M))
        return highest(each, values, mu) if self.worst else mixed(each, np.zeros(count), values)


def _in_scenario(part: Expansion, s: int, count: int) -> Expansion:
    def spread(matrix: Array) -> Array:
        if count == 1:
            return matrix[None]
        out = np.zeros((count, *matrix.shape))
        out[s] = matrix
        return out

    return Expansion(
        part.height,
        spread(part.slope),
        tuple((c, one := spread(P), one if Q is P else spread(Q)) for c, P, Q in part.pairs),
        tuple((c, spread(V)) for c, V in part.ranks),
        part.factor,
    )
