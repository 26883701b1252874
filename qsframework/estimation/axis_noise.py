"""Whether errors differ by the directions in which they are counted, or grow with a distance, from what a fit leaves.

Whitened residuals e (3,) of a row, turned into axes that the rows share, have the covariance (1 - h) S (d / d0)^(2 g),
h the leverage. With the degrees of freedom n that all rows keep, -2 log likelihood is n log det S + n tr(S^-1 E) and S
is E, the mean of e e' (d / d0)^(-2 g) / (1 - h).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from qsframework.estimation.linear_fit import LinearFit
from qsframework.estimation.tails import chi2_sf
from qsframework.plugin import Array

_STEEPEST = 1.0
"""No instrument's error grows faster than the distance."""
LEVEL = 0.01
"""False-alarm probability of what is said of the axes."""
_LEAST = 10.0
"""Degrees of freedom of an axis below which nothing is said, as for the size of a noise."""


@dataclass(frozen=True, eq=False)
class AxisNoise:
    """factor (R, 3, 3): covariance of the rows' coordinates in units of the fitted one, of mean 1; sizes (3,): the sds
    along its axes at the mean distance; growth: power of the distance; p_value: of no difference."""

    factor: Array
    sizes: Array
    growth: float
    p_value: float


def axis_words(found: AxisNoise) -> str:
    """What differs, in a sentence without its end."""
    each = ", ".join(f"{size:.2f}" for size in found.sizes)
    grows = f", and grows with the distance to the power {found.growth:.1f}" if found.growth > 0.1 else ""
    return f"The noise differs by direction{grows}: {each} of its size along its axes (p = {found.p_value:.1g})"


def axis_noise(
    fit: LinearFit, systems: Sequence[Array], mask: npt.NDArray[np.bool_], distance: Array
) -> AxisNoise | None:
    """What whitened residuals say of the directions along which rows err differently.

    fit: of all 3 R coordinates, zero where `mask` (R, 3) says that nothing was measured: rows that lack a coordinate do
    not count; systems: axes (R, 3, 3), unit vectors by rows, that the rows may share; distance (R,): from the
    instrument, NaN where it is not known. None where too few degrees of freedom are left.
    """
    whole = np.flatnonzero(mask.all(axis=1))
    far = np.zeros(len(mask))
    known = whole[np.isfinite(distance[whole])]
    if len(known):
        far[known] = 2.0 * (np.log(distance[known]) - np.log(distance[known]).mean())
    told = [one for axes in systems for one in _in_axes(fit, axes, whole, far)]
    if not told:
        return None
    p, axes, E, growth = min(told, key=lambda one: one[0])
    factor = np.exp(growth * far)[:, None, None] * (axes.transpose(0, 2, 1) @ E @ axes)
    mean = float(np.einsum("rii->", factor[whole]) / (3 * len(whole)))
    sizes = np.sqrt(np.maximum(np.linalg.eigvalsh(E), 0.0) / mean)
    return AxisNoise(factor / mean, sizes, growth, min(len(told) * p, 1.0))


def _in_axes(
    fit: LinearFit, axes: Array, whole: npt.NDArray[np.intp], far: Array
) -> Iterator[tuple[float, Array, Array, float]]:
    """What speaks for a covariance in axes that rows share, along these alone and in all: the p-value of none, the
    axes, the covariance and the power of the distance."""
    turned = axes[whole]
    e = np.einsum("rij,rj->ri", turned, fit.white.reshape(-1, 3)[whole])
    lever = turned @ fit.Q.reshape(len(axes), 3, -1)[whole]
    free = len(whole) - np.square(lever).sum(axis=(0, 2))
    if free.min() >= _LEAST and np.linalg.matrix_rank(e) == 3:
        for aligned in (True, False):
            p, E, growth = _likeliest(e, free, far[whole], aligned)
            yield p, axes, E, growth


def _likeliest(e: Array, free: Array, own: Array, aligned: bool) -> tuple[float, Array, float]:
    """The p-value of errors e (n, 3) alike, their covariance, with three numbers where `aligned`, and the power of the
    distance; free (3,): degrees of freedom, own (n,): twice the logarithm of the distance, of mean 0."""
    from scipy.optimize import minimize_scalar

    count = float(free.mean())

    def covariance(growth: float) -> Array:
        near = e * np.exp(-growth * own / 2.0)[:, None]
        E = near.T @ near
        return (np.diag(np.diag(E)) if aligned else E) / np.sqrt(np.outer(free, free))

    def deviance(growth: float) -> float:
        # the logarithms of the distances have mean 0 over the rows, so that log det S alone changes
        return count * float(np.linalg.slogdet(covariance(growth))[1])

    growth, grows = 0.0, bool(np.ptp(own) > 0.0)
    if grows:
        growth = float(minimize_scalar(deviance, bounds=(0.0, _STEEPEST), method="bounded").x)
    gain = 3.0 * count * float(np.log(np.trace(covariance(0.0)) / 3.0)) - deviance(growth)
    freedom = (2 if aligned else 5) + grows
    return float(chi2_sf(max(gain, 0.0), freedom)), covariance(growth), growth
