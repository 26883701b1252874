"""The error that all readings of one visit share, sized by REML on a grid, and what a test must allow for that.

V = C + rho^2 s^2 times the sum of 1 1' over visits and axes: C the readings' own errors, s their typical sd, rho the
size of what a visit shares. A common factor of V is free: nothing of the size of the noise is taken as known. rho is
estimated under the fitted columns alone, or where visits were repeated from what the repeats differ by, so that what
repeats agree on counts as lack of fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.estimation.noise import Noise
from qsframework.estimation.projection import left
from qsframework.plugin import Array, Indices

RHOS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.35, 1.8, 2.4, 3.2, 4.2, 5.5, 7.0, 9.0)


@dataclass(frozen=True, eq=False)
class VisitNoise:
    """The noises (K,) of all sizes rho (K,) that a shared error may have; visits: how often an axis was visited; many:
    how many readings share one error, on average."""

    rhos: Array
    noises: tuple[Noise, ...]
    visits: int
    many: float

    def freedom(self, k: int, columns: int, free: int) -> float:
        """Degrees of freedom nu of the unit of this noise: 1/nu = h^2/(visits - columns) + (1 - h^2)/free, with
        h = many rho^2 / (1 + many rho^2), the share of the variance of a visit's mean that is its own."""
        h = self.many * self.rhos[k] ** 2 / (1.0 + self.many * self.rhos[k] ** 2)
        return 1.0 / (h**2 / max(self.visits - columns, 1) + (1.0 - h**2) / max(free, 1))


@dataclass(frozen=True, eq=False)
class Reml:
    """Fits of some columns in every noise: orthonormal whitened columns Q (m, f), and what the choice of rho weighs.

    free: degrees of freedom of a fit's residuals; by: the columns that rho is chosen beside, with -2 log of what they
    cost in each noise and the degrees of freedom that they leave
    """

    noise: VisitNoise
    Q: tuple[Array, ...]
    free: int
    by: tuple[Array, ...]
    cost: Array
    by_free: int

    def left(self, k: int, values: Array) -> Array:
        """What the columns leave of readings (m,) or (m, d), whitened by noise k."""
        white = self.noise.noises[k].whiten(values.reshape(len(values), -1))
        return left(self.Q[k], white).reshape(values.shape)

    def choose(self, values: Array, among: Sequence[int] | None = None) -> Indices:
        """The place in the grid that readings (m, d) make likeliest, (d,); among: places to choose from."""
        places = range(len(self.cost)) if among is None else among
        deviance: list[Array] = []
        for k in places:
            white = self.noise.noises[k].whiten(values)
            square = np.square(white).sum(axis=0) - np.square(self.by[k].T @ white).sum(axis=0)
            deviance.append(self.by_free * np.log(np.maximum(square, 1e-300)) + self.cost[k])
        return np.array(places, dtype=np.intp)[np.argmin(deviance, axis=0)]

    def unit(self, k: int, values: Array) -> float:
        """Size of the noise that readings (m,) show, in units of noise k."""
        return float(np.sqrt(np.square(self.left(k, values)).sum() / max(self.free, 1)))

    def freedom(self, k: int) -> float:
        return self.noise.freedom(k, self.Q[k].shape[1], self.free)


def reml(noise: VisitNoise, columns: Array, count: int, repeats: Array | None = None) -> Reml:
    """Fits of columns (m, f), of full rank, to `count` readings that were measured, the others' rows being zero.

    repeats (m, g): indicators of readings that repeat each other; rho is then told from what they differ by
    """
    Q, cost = _orthonormal(noise, columns)
    free = count - columns.shape[1]
    if repeats is None:
        return Reml(noise, Q, free, Q, cost, free)
    by, cost = _orthonormal(noise, repeats)
    return Reml(noise, Q, free, by, cost, count - repeats.shape[1])


def _orthonormal(noise: VisitNoise, columns: Array) -> tuple[tuple[Array, ...], Array]:
    """Whitened columns made orthonormal in every noise, and log |V| + log |X' V^-1 X| of each (K,)."""
    size: Array = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    scaled = columns / size
    out: list[Array] = []
    cost: list[float] = []
    for one in noise.noises:
        Q, R = np.linalg.qr(one.whiten(scaled))
        out.append(Q)
        cost.append(one.log_det() + 2.0 * float(np.log(np.maximum(np.abs(np.diag(R)), 1e-300)).sum()))
    return tuple(out), np.array(cost)
