"""What makes a plan good: convex functions of the information matrix, smaller is better.

All are homogeneous of degree -1 in M, so that a ratio of values is an efficiency and the certificate
of `information.certificate` holds. Parameters are scaled before; D and I do not depend on the scaling.
A solver asks a criterion for its `expansion` at one M: slope and curvature of log psi.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np

from qsframework.plugin import Array


@dataclass(frozen=True, eq=False)
class Expansion:
    """log psi near one M: slope G = -d log psi / d M, curvature d2 log psi [M_i, M_j] as

        sum of c tr(P M_i Q M_j) over `pairs` (c, P, Q)  +  sum of c tr(V M_i) tr(V M_j) over `ranks` (c, V)

    psi is convex, so psi(M) / psi(M*) <= <G, M*> for every M* >= 0. height: log psi
    """

    height: float
    slope: Array
    pairs: tuple[tuple[float, Array, Array], ...] = ()
    ranks: tuple[tuple[float, Array], ...] = ()


class Criterion(ABC):
    """A criterion psi(M) of information matrices (p, p)."""

    name: str
    title: str
    depends_on_scale: bool = True

    @abstractmethod
    def value(self, M: Array) -> Array:
        """psi of information matrices (..., p, p); inf where M is singular."""

    @abstractmethod
    def expansion(self, M: Array) -> Expansion:
        """Slope and curvature at one regular M."""

    def with_one(self, M: Array, block: Array) -> Array:
        """psi (m,) of M + A_i' A_i for the rows (m, k, p) of m candidates."""
        return self.value(M + np.swapaxes(block, -1, -2) @ block)

    @abstractmethod
    def in_basis(self, T: Array) -> Criterion:
        """The same criterion of T' M T, T (p, p) regular."""


def covariance(M: Array) -> Array:
    """Inverse of information matrices (..., p, p), symmetric; scaled, so that units cost no accuracy."""
    size = np.sqrt(np.diagonal(M, axis1=-2, axis2=-1))
    outer = size[..., :, None] * size[..., None, :]
    cov = np.linalg.inv(M / outer) / outer
    return 0.5 * (cov + np.swapaxes(cov, -1, -2))


def regular(M: Array) -> tuple[Array, Array]:
    """Which of the matrices (..., p, p) are regular, whatever their size, and their log determinants (0 where not)."""
    sign, logdet = np.linalg.slogdet(M)
    size = np.log(np.maximum(np.diagonal(M, axis1=-2, axis2=-1), 1e-300)).sum(axis=-1)
    good = (sign > 0) & np.isfinite(logdet) & (logdet - size > -36.0 * M.shape[-1])
    return good, np.where(good, logdet, 0.0)


@dataclass(frozen=True, eq=False)
class Determinant(Criterion):
    """det(K' cov K)^(1/s) with K (p, s): all parameters (D) where K is None, or those of interest (D_s).

    shift is added to log psi: what a change of coordinates takes away
    """

    name: str = "D"
    title: str = "det(cov)^(1/p), the volume of the confidence ellipsoid"
    directions: Array | None = None
    shift: float = 0.0
    depends_on_scale: bool = False

    def value(self, M: Array) -> Array:
        good, logdet = regular(M)
        size = M.shape[-1]
        if self.directions is not None:
            size = self.directions.shape[1]
            safe = np.where(good[..., None, None], M, np.eye(M.shape[-1]))
            logdet = -np.linalg.slogdet(self.directions.T @ covariance(safe) @ self.directions)[1]
        return np.where(good, np.exp(self.shift - logdet / size), np.inf)

    def with_one(self, M: Array, block: Array) -> Array:
        if block.shape[1] >= M.shape[-1]:
            return super().with_one(M, block)
        turned = block @ covariance(M)
        grown = np.eye(block.shape[1]) + turned @ np.swapaxes(block, -1, -2)
        if self.directions is None:
            return float(self.value(M)) * np.linalg.det(grown) ** (-1.0 / M.shape[-1])
        own = turned @ self.directions
        S = self.directions.T @ covariance(M) @ self.directions
        beside = grown - own @ np.linalg.solve(S, np.swapaxes(own, -1, -2))
        ratio = np.maximum(np.linalg.det(beside), 1e-300) / np.linalg.det(grown)
        return float(self.value(M)) * ratio ** (1.0 / self.directions.shape[1])

    def expansion(self, M: Array) -> Expansion:
        cov = covariance(M)
        height = float(np.log(self.value(M)))
        if self.directions is None:
            p = M.shape[-1]
            return Expansion(height, cov / p, ((1.0 / p, cov, cov),))
        turned = cov @ self.directions
        size = self.directions.shape[1]
        Q = turned @ np.linalg.solve(self.directions.T @ turned, turned.T)
        Q = 0.5 * (Q + Q.T)
        return Expansion(height, Q / size, ((2.0 / size, cov, Q), (-1.0 / size, Q, Q)))

    def in_basis(self, T: Array) -> Determinant:
        if self.directions is not None:
            return replace(self, directions=T.T @ self.directions)
        return replace(self, shift=self.shift + 2.0 * float(np.linalg.slogdet(T)[1]) / len(T))


@dataclass(frozen=True, eq=False)
class Linear(Criterion):
    """trace(W cov) with W (p, p) positive semidefinite; A has W = 1, c and L a chosen W, I that of test poses."""

    name: str = "A"
    title: str = "trace(cov), the sum of the variances of the scaled parameters"
    weight: Array | None = None
    depends_on_scale: bool = True

    def value(self, M: Array) -> Array:
        good, _ = regular(M)
        safe = np.where(good[..., None, None], M, np.eye(M.shape[-1]))
        cov = np.linalg.inv(safe)
        if self.weight is None:
            total = np.trace(cov, axis1=-2, axis2=-1)
        else:
            total = np.einsum("...ij,ij->...", cov, self.weight)
        return np.where(good & (total > 0), total, np.inf)

    def with_one(self, M: Array, block: Array) -> Array:
        if block.shape[1] >= M.shape[-1]:
            return super().with_one(M, block)
        psi, cov, twice = self.parts(M)
        turned = np.swapaxes(block, -1, -2)
        saved = np.linalg.solve(np.eye(block.shape[1]) + block @ cov @ turned, block @ twice @ turned)
        return psi - np.trace(saved, axis1=-2, axis2=-1)

    def in_basis(self, T: Array) -> Linear:
        return replace(self, weight=T.T @ (T if self.weight is None else self.weight @ T))

    def parts(self, M: Array) -> tuple[float, Array, Array]:
        """psi, cov and cov W cov."""
        cov = covariance(M)
        if self.weight is None:
            return float(np.trace(cov)), cov, cov @ cov
        return float((cov * self.weight).sum()), cov, cov @ self.weight @ cov

    def expansion(self, M: Array) -> Expansion:
        psi, cov, twice = self.parts(M)
        return Expansion(float(np.log(psi)), twice / psi, ((2.0 / psi, cov, twice),), ((-1.0, twice / psi),))


@dataclass(frozen=True, eq=False)
class Sum(Criterion):
    """Weighted sum of criteria: the paper's O3 is half of A and half of D."""

    parts: tuple[tuple[float, Criterion], ...]
    name: str = "O3"
    title: str = "the paper's (trace(cov) + det(cov)^(1/p)) / 2"

    def value(self, M: Array) -> Array:
        values = [share * part.value(M) for share, part in self.parts]
        return np.sum(values, axis=0)

    def expansion(self, M: Array) -> Expansion:
        return mixed([part.expansion(M) for _, part in self.parts], np.array([share for share, _ in self.parts]))

    def in_basis(self, T: Array) -> Sum:
        return replace(self, parts=tuple((share, part.in_basis(T)) for share, part in self.parts))


def mixed(parts: list[Expansion], weights: Array) -> Expansion:
    """Expansion of log sum of weight exp(height) over the parts."""
    heights = np.array([part.height for part in parts]) + np.log(weights)
    height = float(np.logaddexp.reduce(heights))
    shares = np.exp(heights - height)
    slope = np.sum([share * part.slope for share, part in zip(shares, parts, strict=True)], axis=0)
    pairs = [(share * c, P, Q) for share, part in zip(shares, parts, strict=True) for c, P, Q in part.pairs]
    ranks = [(share * c, V) for share, part in zip(shares, parts, strict=True) for c, V in part.ranks]
    ranks += [(float(share), part.slope) for share, part in zip(shares, parts, strict=True)]
    return Expansion(height, slope, tuple(pairs), (*ranks, (-1.0, slope)))


@dataclass(frozen=True, eq=False)
class Mean:
    """The mean of a criterion over S samples of the parameters: M is (S, p, p)."""

    inner: Criterion

    @property
    def name(self) -> str:
        return self.inner.name

    def in_basis(self, T: Array) -> Mean:
        """The same criterion of T' M T."""
        return Mean(self.inner.in_basis(T))

    def value(self, M: Array) -> Array:
        """Mean of psi of (..., S, p, p) over the samples."""
        return self.inner.value(M).mean(axis=-1)

    def with_one(self, M: Array, block: Array) -> Array:
        """Mean of psi (m,) of M + A_i' A_i for the rows (m, S, k, p) of m candidates."""
        return np.stack([self.inner.with_one(m, block[:, s]) for s, m in enumerate(M)], axis=-1).mean(axis=-1)

    def expansion(self, M: Array) -> Expansion:
        """Expansion with slopes (S, p, p)."""
        count = len(M)
        parts = [_of_sample(self.inner.expansion(m), s, count) for s, m in enumerate(M)]
        return parts[0] if count == 1 else mixed(parts, np.full(count, 1.0 / count))


def _of_sample(part: Expansion, s: int, count: int) -> Expansion:
    def spread(matrix: Array) -> Array:
        out = np.zeros((count, *matrix.shape))
        out[s] = matrix
        return out

    return Expansion(
        part.height,
        spread(part.slope),
        tuple((c, left := spread(P), left if Q is P else spread(Q)) for c, P, Q in part.pairs),
        tuple((c, spread(V)) for c, V in part.ranks),
    )
