"""The noise as a hypothesis: gross rows, heavy tails, its true size, and errors that the markers of a pose share.

Everything is judged on what the final model leaves of the residuals, after nothing else was found in them; or on
replicates, which no physics explains.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from qsframework.estimation import LinearFit, Noise, grouped
from qsframework.estimation.axis_noise import AxisNoise
from qsframework.estimation.projection import Flags
from qsframework.estimation.tails import chi2_cdf, chi2_sf, f_sf
from qsframework.estimation.variance_component import variance_component
from qsframework.plugin import Array, Indices

REACH = 10.0
"""Columns are per typical size; a direction that not even ten of these lift above the noise needs no number."""
_DRAWS = 1000
LEVEL = 0.01
"""False-alarm probability of each statement on the noise."""
FEWEST = 10
"""Degrees of freedom below which nothing is said about the noise."""


_MISSTATED = 3.0
"""Times a stated noise from which on something else makes the readings scatter."""


@dataclass(frozen=True, eq=False, kw_only=True)
class NoiseAudit:
    """What the readings say about their noise.

    unit: true sigma / stated sigma, 1 where nothing speaks against the stated one; unit_source: "stated", "residuals"
    (of the final model) or "replicates"; measured: the estimate, NaN without any, with `dof` degrees of freedom;
    p_unit: of the stated sigma, two-sided, NaN where none is stated; shared: sd m of the error that the markers of a
    visit share, 0 where that is not significant; outliers: rows that were left out; heavy: p-value of normal tails;
    p_missing: of the model against the replicates, NaN without them; repeated: whether readings were repeated often
    enough to tell; stated: whether somebody says its size; axes: how it differs by axis and
    distance, None: it does not
    """

    unit: float
    unit_source: str
    dof: int
    measured: float
    p_unit: float
    shared: float
    p_shared: float
    outliers: Indices
    heavy: float
    p_missing: float
    repeated: bool
    stated: bool
    axes: AxisNoise | None = None

    @property
    def refuted(self) -> bool:
        """Whether the readings scatter so much more than is stated that nobody misstated an instrument's noise."""
        return self.stated and self.unit > _MISSTATED

    @property
    def heavy_tailed(self) -> bool:
        """Whether the errors of the rows that stay are plainly not normal."""
        return bool(self.heavy < LEVEL)


@dataclass(frozen=True)
class NoiseSize:
    """An estimate of the noise: a sum of squares of the rows' own error in units of the stated one, its degrees of
    freedom, the sd m that rows of one measurement share with its p-value, and the source."""

    square: float
    dof: int
    shared: float
    p_shared: float
    source: str

    @property
    def unit(self) -> float:
        return float(np.sqrt(self.square / self.dof)) if self.dof else np.nan


def audit_noise(
    white: Array,
    columns: Array,
    sigma: Array,
    stated: bool,
    measurement: Indices,
    replicate: Indices,
    *,
    unit: float,
    shared: float,
    outliers: Indices,
    mask: Flags | None = None,
    axes: AxisNoise | None = None,
) -> NoiseAudit:
    """Audit residuals `white` (R, 3) of the final model, whitened by sigma (R,) m, beside its columns (R, 3, q).

    measurement (R,): number of the visit; replicate (R,): equal where pose, load and marker are; unit, shared (m): the
    noise that was told beside the model; outliers: rows that were left out before; mask (R, 3):
    what was measured, None: all
    """
    fit = LinearFit.onto(visible(columns), white, mask)
    heavy = heavy_tails(white, fit) if fit.dof >= FEWEST else np.nan
    size, p_missing = _size(white, fit, sigma, measurement, replicate, mask)
    p_unit = _two_sided(size) if stated and size.dof else np.nan
    trusted = stated and not p_unit < LEVEL
    return NoiseAudit(
        unit=1.0 if trusted else unit,
        unit_source="stated" if trusted else size.source,
        dof=size.dof,
        measured=size.unit,
        p_unit=p_unit,
        shared=shared if size.p_shared < LEVEL else 0.0,
        p_shared=size.p_shared,
        outliers=outliers,
        heavy=heavy,
        p_missing=p_missing,
        repeated=pure_dof(replicate, mask) >= FEWEST,
        stated=stated,
        axes=axes,
    )


def _noise(sigma: Array, shared: float, measurement: Indices) -> Noise:
    """Noise of rows of three coordinates with sd sigma (R,) m, `shared` within a measurement."""
    label = (3 * measurement[:, None] + np.arange(3)).ravel()
    return grouped(np.repeat(sigma, 3), [(label, np.full(len(label), shared))])


def visible(library: Array) -> Array:
    """Orthonormal directions (3 R, k) of a library (R, 3, q) that can rise above the noise."""
    flat = library.reshape(3 * len(library), -1)
    flat = flat[:, np.linalg.norm(flat, axis=0) * REACH >= 1.0]
    if flat.shape[1] == 0:
        return flat
    U, values, _ = np.linalg.svd(flat, full_matrices=False)
    return U[:, (values * REACH >= 1.0) & (values > 1e-9 * values[0])]


def estimate(fit: LinearFit, sigma: Array, measurement: Indices, source: str) -> NoiseSize:
    """The rows' own error and the one that rows of a measurement share, from what a fit leaves of them.

    The test is the likelihood ratio on its boundary.
    """
    total, dof = fit.chi2, fit.dof
    plain = NoiseSize(total, dof, 0.0, 1.0, source)
    if dof < FEWEST or np.unique(measurement, return_counts=True)[1].max() < 2:
        return plain
    typical = float(np.sqrt(np.mean(sigma**2)))
    label = np.unique((3 * measurement[:, None] + np.arange(3)).ravel(), return_inverse=True)[1]
    found = variance_component(fit, np.repeat(typical / sigma, 3)[:, None], label[:, None])
    if dof - found.directions < FEWEST:
        return plain
    p = 0.5 * float(chi2_sf(found.gain, 1)) if found.gain > 0.0 else 1.0
    shared = found.ratio * typical * float(np.sqrt(found.own / dof))
    if p >= LEVEL:
        return replace(plain, shared=shared if found.gain > 0.0 else 0.0, p_shared=p)
    # beyond what measurements share there is only the rows' own error: exactly chi-square
    return NoiseSize(found.rest, dof - found.directions, shared, p, source)


def pure_dof(replicate: Indices, mask: Flags | None = None) -> int:
    """Degrees of freedom of what replicates differ by: measured coordinates less the groups that an axis has."""
    measured = np.ones((len(replicate), 3), dtype=bool) if mask is None else mask
    row, axis = np.nonzero(measured)
    return len(row) - len(np.unique(3 * replicate[row] + axis))


def replicate_basis(replicate: Indices, mask: Flags | None = None) -> Array:
    """Orthonormal columns (3 R, g), a mean for every group of replicates: what they leave is pure error."""
    _, group, count = np.unique(replicate, return_inverse=True, return_counts=True)
    Q = np.zeros((len(group), len(count)))
    Q[np.arange(len(group)), group] = 1.0 / np.sqrt(count[group])
    columns = np.asarray(np.kron(Q, np.eye(3)), dtype=np.float64)
    if mask is not None:
        columns[~mask.ravel()] = 0.0
        size = np.linalg.norm(columns, axis=0)
        columns = columns[:, size > 0.0] / size[size > 0.0]
    return columns


def _size(
    white: Array,
    fit: LinearFit,
    sigma: Array,
    measurement: Indices,
    replicate: Indices,
    mask: Flags | None,
) -> tuple[NoiseSize, float]:
    """The noise to believe, and the p-value of the library against the replicates."""
    fromlibrary = estimate(fit, sigma, measurement, "residuals")
    if pure_dof(replicate, mask) < FEWEST:
        return (fromlibrary if fit.dof >= FEWEST else replace(fromlibrary, square=0.0, dof=0)), np.nan
    pure = LinearFit.onto(replicate_basis(replicate, mask), white, mask)
    repeats = estimate(pure, sigma, measurement, "replicates")
    p = lack_p_value(white, fit, pure, _noise(sigma, repeats.shared, measurement), sigma)
    return (fromlibrary if p >= LEVEL else repeats), p


def lack_p_value(white: Array, fit: LinearFit, pure: LinearFit, noise: Noise, sigma: Array) -> float:
    """F test of what a fit leaves beyond replicates against what these leave; NaN where its columns span all."""
    each = np.repeat(sigma, 3)
    here, there = (LinearFit.of(f.Q * each[:, None], white.ravel() * each, noise) for f in (fit, pure))
    dof, free = fit.dof - pure.dof, pure.dof
    if dof <= 0:
        return np.nan
    return float(f_sf(max(here.chi2 - there.chi2, 0.0) / dof / (there.chi2 / free), dof, free))


def heavy_tails(white: Array, fit: LinearFit) -> float:
    """p-value of normal errors from the fourth power of what a fit leaves of them, by simulation of the same."""
    share = np.maximum(1.0 - np.einsum("ij,ij->i", fit.Q, fit.Q), 0.0)
    told = share > 0.05
    if fit.used is not None:
        told &= fit.used

    def kurtosis(flat: Array) -> Array:
        square = np.square((flat - fit.Q @ (fit.Q.T @ flat))[told]) / share[told][:, None]
        return np.mean(np.square(square), axis=0) / np.mean(square, axis=0) ** 2

    found = float(kurtosis(white.reshape(-1, 1))[0])
    drawn = kurtosis(np.random.default_rng(0).standard_normal((white.size, _DRAWS)))
    return float((1 + np.sum(drawn >= found)) / (1 + _DRAWS))


def _two_sided(size: NoiseSize) -> float:
    low = float(chi2_cdf(size.square, size.dof))
    return 2.0 * min(low, float(chi2_sf(size.square, size.dof)))
