"""The noise of readings: errors of their own, and errors that groups of them share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from qsframework.errors import InputError
from qsframework.plugin import Array, Indices

Group = tuple[Indices, Array]
"""An error that readings share: label (m,) of the group each belongs to, -1 for none, and its sd (m,) in each."""


class Noise(Protocol):
    """Covariance of m scalar readings, up to a common factor: Cov = L L'."""

    def whiten(self, values: Array) -> Array:
        """L^-1 values, for values (m,) or (m, p)."""
        ...

    def log_det(self) -> float:
        """log det Cov."""
        ...

    def turned(self, values: Array) -> Array:
        """L'^-1 values, for values (m,) or (m, p)."""
        ...

    def colour(self, values: Array) -> Array:
        """L values, for values (m,) or (m, p): back from whitened to metres."""
        ...

    def weights(self) -> Array:
        """Diagonal (m,) of Cov^-1."""
        ...


@dataclass(frozen=True, eq=False)
class Independent:
    """Readings with errors of their own: sigma (m,), in the unit of the readings."""

    sigma: Array

    def __post_init__(self) -> None:
        if not (np.all(np.isfinite(self.sigma)) and np.all(self.sigma > 0)):
            raise InputError(
                "the noise of every reading must be a positive number; leave it out (noise: estimate, and no sigma_mm) "
                "to have it estimated from the residuals"
            )

    def whiten(self, values: Array) -> Array:
        return values / (self.sigma if values.ndim == 1 else self.sigma[:, None])

    def log_det(self) -> float:
        return float(2.0 * np.log(self.sigma).sum())

    def turned(self, values: Array) -> Array:
        return self.whiten(values)

    def colour(self, values: Array) -> Array:
        return values * (self.sigma if values.ndim == 1 else self.sigma[:, None])

    def weights(self) -> Array:
        return 1.0 / self.sigma**2

    def squares(self, at: Indices, values: Array) -> Array:
        """|L^-1 v|^2 (n,) of vectors v (m,) that are `values` (n, s) at places `at` (n, s), each once, else zero."""
        return np.square(values / self.sigma[at]).sum(axis=1)


@dataclass(frozen=True, eq=False)
class Scaled:
    """Noise `unit` times another, of `count` readings."""

    noise: Noise
    unit: float
    count: int

    def whiten(self, values: Array) -> Array:
        return self.noise.whiten(values) / self.unit

    def log_det(self) -> float:
        return self.noise.log_det() + 2.0 * self.count * float(np.log(self.unit))

    def turned(self, values: Array) -> Array:
        return self.noise.turned(values) / self.unit

    def colour(self, values: Array) -> Array:
        return self.noise.colour(values) * self.unit

    def weights(self) -> Array:
        return self.noise.weights() / self.unit**2


def rounding(noise: Noise, measured: Array, reach: float = 0.0) -> float:
    """Whitened size that rounding leaves of readings (m,): no noise is estimated below it, and none is zero.

    reach: SI, size of the numbers that their predictions are differences of
    """
    square = np.mean(noise.whiten(measured) ** 2) + reach**2 * np.mean(noise.weights())
    return float(np.finfo(float).eps * np.sqrt(square)) or 1.0


@dataclass(frozen=True, eq=False)
class Blocks:
    """A covariance of blocks: for each size s, the readings of B blocks (B, s) and their roots L^-1 (B, s, s)."""

    parts: tuple[tuple[Indices, Array], ...]
    logarithm: float

    def whiten(self, values: Array) -> Array:
        """L^-1 values, for values (m,) or (m, p)."""
        return self._each(values, lambda inverse, v: inverse @ v)

    def turned(self, values: Array) -> Array:
        """L'^-1 values, for values (m,) or (m, p)."""
        return self._each(values, lambda inverse, v: inverse.transpose(0, 2, 1) @ v)

    def colour(self, values: Array) -> Array:
        """L values, for values (m,) or (m, p)."""
        return self._each(values, lambda inverse, v: np.asarray(np.linalg.solve(inverse, v), dtype=np.float64))

    def weights(self) -> Array:
        """Diagonal (m,) of Cov^-1."""
        out = np.empty(sum(rows.size for rows, _ in self.parts))
        for rows, inverse in self.parts:
            out[rows] = np.square(inverse).sum(axis=1)
        return out

    def squares(self, at: Indices, values: Array) -> Array:
        """|L^-1 v|^2 (n,) of vectors v (m,) that are `values` (n, s) at places `at` (n, s), each once, else zero."""
        out = np.zeros(len(at))
        for rows, inverse in self.parts:
            place = np.full(sum(own.size for own, _ in self.parts), -1, dtype=np.intp)
            place[rows] = np.arange(rows.size).reshape(rows.shape)
            vector, column = np.nonzero(place[at] >= 0)
            block, inside = np.divmod(place[at[vector, column]], rows.shape[1])
            pairs, which = np.unique(np.stack([vector, block]), axis=1, return_inverse=True)
            own = np.zeros((pairs.shape[1], rows.shape[1], 1))
            own[which.ravel(), inside, 0] = values[vector, column]
            out += np.bincount(pairs[0], np.square(inverse[pairs[1]] @ own).sum(axis=(1, 2)), len(at))
        return out

    def _each(self, values: Array, change: Callable[[Array, Array], Array]) -> Array:
        out = np.empty(values.shape)
        for rows, inverse in self.parts:
            v = values[rows]
            out[rows] = change(inverse, v if values.ndim == 2 else v[..., None]).reshape(v.shape)
        return out

    def log_det(self) -> float:
        """log det Cov."""
        return self.logarithm


def grouped(sigma: Array, groups: Sequence[Group]) -> Independent | Blocks:
    """Readings with errors of their own, sd sigma (m,), and errors that groups of them share.

    Cov_ij = [i = j] sigma_i^2 + the sum over groups of sd_i sd_j where i and j have one label.
    """
    groups = [(label, np.where(label < 0, 0.0, sd)) for label, sd in groups]
    if not any(np.any(sd != 0.0) for _, sd in groups):
        return Independent(sigma)
    if not (np.all(np.isfinite(sigma)) and np.all(sigma > 0)):
        raise InputError("the noise of every reading must be a positive number")
    block = connected(len(sigma), groups)
    counts = np.bincount(block)
    order, first = np.argsort(block, kind="stable"), np.cumsum(counts) - counts
    logarithm = 0.0
    parts: list[tuple[Indices, Array]] = []
    for size in np.unique(counts):
        rows = order[first[counts == size][:, None] + np.arange(size)]
        inverse, log_det = inverse_roots(_covariance(sigma, groups, rows))
        logarithm += log_det
        parts.append((rows, inverse))
    return Blocks(tuple(parts), logarithm)


def inverse_roots(covariances: Array) -> tuple[Array, float]:
    """C^-1/2 (B, s, s) of covariances, and the sum of their log det.

    The symmetric root: whitened readings do not depend on the order of the rows, as those by Cholesky's do.
    """
    values, vectors = np.linalg.eigh(covariances)
    return (vectors / np.sqrt(values)[:, None, :]) @ vectors.transpose(0, 2, 1), float(np.log(values).sum())


def _covariance(sigma: Array, groups: Sequence[Group], rows: Indices) -> Array:
    """Covariances (B, s, s) of the blocks of readings (B, s)."""
    cov = np.square(sigma[rows])[..., None] * np.eye(rows.shape[1])
    for label, sd in groups:
        one = (label[rows][:, :, None] == label[rows][:, None, :]) & (label[rows] >= 0)[:, :, None]
        cov += one * sd[rows][:, :, None] * sd[rows][:, None, :]
    return cov


def connected(count: int, groups: Sequence[Group]) -> Indices:
    """Number (m,) of the block of each reading: readings that share an error, directly or through others."""
    sharing = [label for label, _ in groups if np.bincount(label[label >= 0]).max(initial=0) > 1]
    if len(sharing) < 2:  # nothing to follow, and nothing to load for it
        alone = np.arange(-count, 0, dtype=np.intp)
        return np.unique(np.where(sharing[0] < 0, alone, sharing[0]) if sharing else alone, return_inverse=True)[1]
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    i, j = [np.zeros(0, dtype=np.intp)], [np.zeros(0, dtype=np.intp)]
    for label, _ in groups:
        order = np.argsort(label, kind="stable")
        chain = (np.diff(label[order]) == 0) & (label[order][1:] >= 0)
        i.append(order[:-1][chain])
        j.append(order[1:][chain])
    ends = np.concatenate(i), np.concatenate(j)
    graph = coo_array((np.ones(len(ends[0])), ends), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.intp)
