"""The error that all readings of one visit share, sized by REML, and what a test must allow for that.

V = C + rho^2 s^2 times the sum of 1 1' over visits and axes: C the readings' own errors, s their typical sd, rho the
size of what a visit shares. A common factor of V is free: nothing of the size of the noise is taken as known. rho is
estimated under the fitted columns alone, or where visits were repeated from what the repeats differ by, so that what
repeats agree on counts as lack of fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.estimation.linear_fit import LinearFit
from qsframework.estimation.noise import Group, Noise, grouped
from qsframework.estimation.projection import left
from qsframework.estimation.tails import chi2_sf
from qsframework.plugin import Array, Indices

_LARGEST = 1e3
"""Largest shared sd that is looked for, in sds of a reading's own error."""
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
    """Whitened columns made orthonormal in every noise, and what they cost there (K,)."""
    Q, cost = zip(*(restricted(one, columns) for one in noise.noises), strict=True)
    return Q, np.array(cost)


def restricted(noise: Noise, columns: Array) -> tuple[Array, float]:
    """Whitened columns X (m, f), of full rank, made orthonormal, and log |V| + log |X' V^-1 X|, up to a constant that
    is the same in every noise V: what a restricted likelihood pays for it."""
    size: Array = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    Q, R = np.linalg.qr(noise.whiten(columns / size))
    return Q, noise.log_det() + 2.0 * float(np.log(np.maximum(np.abs(np.diag(R)), 1e-300)).sum())


@dataclass(frozen=True, eq=False)
class SharedError:
    """The error that the markers of a pose share: its sd in m, and the noise with it.

    unit: factor on the readings' own sigma, 1 where that is stated; p_value: probability that readings
    without a shared error look like this; p_known: that readings with one of a known sd do
    """

    sd: float
    unit: float
    p_value: float
    p_known: float
    noise: Noise


def shared_error(
    residuals: Array,
    jacobian: Array,
    sigma: Array,
    label: Indices,
    stated: bool = True,
    others: Sequence[Group] = (),
    known: float = 0.0,
) -> SharedError:
    """The sd of the error that readings of one label share, by restricted maximum likelihood (REML).

    residuals (m,) and jacobian (m, p) of a fit that has settled, not whitened; sigma (m,) the readings' own sd, up to
    a factor unless `stated`; others: errors that they share besides, known as sigma is; known: sd that is
    stated for it. The test is the likelihood
    ratio on its boundary, where half of the cases without a shared error give an estimate of zero.
    """
    from scipy.optimize import minimize_scalar

    typical = float(np.sqrt(np.mean(sigma**2)))

    def noise(ratio: float) -> Noise:
        return grouped(sigma, [*others, (label, np.full(len(sigma), ratio * typical))])

    def deviance(ratio: float) -> tuple[float, float]:
        """-2 log restricted likelihood, up to a constant, and the variance of unit weight."""
        V = noise(ratio)
        Q, cost = restricted(V, jacobian)
        square, free = max(LinearFit.onto(Q, V.whiten(residuals)).chi2, 1e-300), len(residuals) - Q.shape[1]
        return (square + cost, 1.0) if stated else (free * np.log(square / free) + cost, square / free)

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
    p_value = 1.0 if gain == 0.0 else 0.5 * float(chi2_sf(gain, 1))
    beyond = max(deviance(known / typical)[0] - deviance(ratio)[0], 0.0)
    return SharedError(ratio * typical * unit, unit, p_value, float(chi2_sf(beyond, 1)), noise(ratio))
