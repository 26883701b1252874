"""The noise of readings: errors of their own, errors that groups of them share, and how large these are (REML)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from qsframework.errors import InputError
from qsframework.estimation.tails import chi2_sf
from qsframework.plugin import Array, Indices

Group = tuple[Indices, Array]
"""An error that readings share: label (m,) of the group each belongs to, -1 for none, and its sd (m,) in each."""
_LARGEST = 1e3
"""Largest shared sd that is looked for, in sds of a reading's own error."""


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

    def _each(self, values: Array, change: Callable[[Array, Array], Array]) -> Array:
        out = np.empty(values.shape)
        for rows, inverse in self.parts:
            v = values[rows]
            out[rows] = change(inverse, v if values.ndim == 2 else v[..., None]).reshape(v.shape)
        return out

    def log_det(self) -> float:
        """log det Cov."""
        return self.logarithm


def grouped(sigma: Array, groups: Sequence[Group]) -> Noise:
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
        # the symmetric root: whitened readings do not depend on the order of the rows, as those by Cholesky's do
        values, vectors = np.linalg.eigh(_covariance(sigma, groups, rows))
        logarithm += float(np.log(values).sum())
        inverse: Array = (vectors / np.sqrt(values)[:, None, :]) @ vectors.transpose(0, 2, 1)
        parts.append((rows, inverse))
    return Blocks(tuple(parts), logarithm)


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


@dataclass(frozen=True, eq=False)
class SharedError:
    """The error that the markers of a pose share: its sd in m, and the noise with it.

    unit: factor on the readings' own sigma, 1 where that is stated; p_value: probability that readings
    without a shared error look like this
    """

    sd: float
    unit: float
    p_value: float
    noise: Noise


def shared_error(
    residuals: Array, jacobian: Array, sigma: Array, label: Indices, stated: bool = True, others: Sequence[Group] = ()
) -> SharedError:
    """The sd of the error that readings of one label share, by restricted maximum likelihood (REML).

    residuals (m,) and jacobian (m, p) of a fit that has settled, not whitened; sigma (m,) the readings' own sd, up to
    a factor unless `stated`; others: errors that they share besides, known as sigma is. The test is the likelihood
    ratio on its boundary, where half of the cases without a shared error give an estimate of zero.
    """
    from scipy.optimize import minimize_scalar

    typical = float(np.sqrt(np.mean(sigma**2)))
    size = np.linalg.norm(jacobian / sigma[:, None], axis=0)
    A = jacobian / np.where(size > 0, size, 1.0)

    def noise(ratio: float) -> Noise:
        return grouped(sigma, [*others, (label, np.full(len(sigma), ratio * typical))])

    def deviance(ratio: float) -> tuple[float, float]:
        """-2 log restricted likelihood, up to a constant, and the variance of unit weight."""
        V = noise(ratio)
        Q, R = np.linalg.qr(V.whiten(A))
        r = V.whiten(residuals)
        square = max(float(r @ r - np.square(Q.T @ r).sum()), 1e-300)  # exact readings leave nothing
        free = len(r) - A.shape[1]
        both = V.log_det() + 2.0 * float(np.log(np.abs(np.diag(R))).sum())
        return (square + both, 1.0) if stated else (free * np.log(square / free) + both, square / free)

    found = minimize_scalar(
        lambda t: deviance(float(np.exp(t)))[0],
        bounds=(np.log(1e-3), np.log(_LARGEST)),
        method="bounded",
        options={"xatol": 1e-6},
    )
    ratio = float(np.exp(found.x))
    gain = deviance(0.0)[0] - deviance(ratio)[0]
    if gain <= 0.0:
        ratio, gain = 0.0, 0.0
    unit = float(np.sqrt(deviance(ratio)[1]))
    return SharedError(
        ratio * typical * unit, unit, 1.0 if gain == 0.0 else 0.5 * float(chi2_sf(gain, 1)), noise(ratio)
    )
