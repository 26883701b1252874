"""The noise as a hypothesis: gross rows, heavy tails, its true size, and errors that the markers of a pose share.

Everything is judged on what the final model leaves of the residuals, after nothing else was found in them; or on
replicates, which no physics explains.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from qsframework.diagnose.residuals.gross_rows import Basis, Flags, heavy_tails
from qsframework.estimation import Noise, grouped
from qsframework.estimation.tails import chi2_cdf, chi2_sf, f_sf
from qsframework.plugin import Array, Indices

REACH = 10.0
"""Columns are per typical size; a direction that not even ten of these lift above the noise needs no number."""
FEWEST = 10
"""Degrees of freedom below which nothing is said about the noise."""
_SMALLEST, _LARGEST = 1e-3, 1e3
"""Shared sds that are looked for, in sds of a reading's own error."""
_FINE, _FINER = 41, 5
"""Places of the grid of them, and how often it is made finer: to a millionth."""
_TOGETHER = 256
"""Columns that are taken beside the fit at once."""


@dataclass(frozen=True, eq=False, kw_only=True)
class NoiseAudit:
    """What the readings say about their noise.

    unit: true sigma / stated sigma, 1 where nothing speaks against the stated one; unit_source: "stated", "residuals"
    (of the final model) or "replicates"; measured: the estimate, NaN without any, with `dof` degrees of freedom;
    p_unit: of the stated sigma, two-sided, NaN where none is stated; shared: sd m of the error that the markers of a
    visit share, 0 where that is not significant; outliers: rows that were left out; heavy: p-value of normal tails;
    p_missing: of the model against the replicates, NaN without them; repeated: whether readings were repeated often
    enough to tell; stated: whether somebody says its size; level: of each alarm
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
    level: float

    @property
    def heavy_tailed(self) -> bool:
        """Whether the errors of the rows that stay are plainly not normal."""
        return bool(self.heavy < self.level)


@dataclass(frozen=True)
class Size:
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
    level: float = 0.01,
    mask: Flags | None = None,
) -> NoiseAudit:
    """Audit residuals `white` (R, 3) of the final model, whitened by sigma (R,) m, beside its columns (R, 3, q).

    measurement (R,): number of the visit; replicate (R,): equal where pose, load and marker are; unit, shared (m): the
    noise that was told beside the model; outliers: rows that were left out before; level: of each alarm; mask (R, 3):
    what was measured, None: all
    """
    basis = make_basis(columns, mask)
    heavy = heavy_tails(white, basis) if basis.dof >= FEWEST else np.nan
    size, p_missing = _size(white, basis, sigma, measurement, replicate, level)
    p_unit = _two_sided(size) if stated and size.dof else np.nan
    trusted = stated and not p_unit < level
    return NoiseAudit(
        unit=1.0 if trusted else unit,
        unit_source="stated" if trusted else size.source,
        dof=size.dof,
        measured=size.unit,
        p_unit=p_unit,
        shared=shared if size.p_shared < level else 0.0,
        p_shared=size.p_shared,
        outliers=outliers,
        heavy=heavy,
        p_missing=p_missing,
        repeated=pure_dof(replicate, mask) >= FEWEST,
        stated=stated,
        level=level,
    )


def _noise(sigma: Array, shared: float, measurement: Indices) -> Noise:
    """Noise of rows of three coordinates with sd sigma (R,) m, `shared` within a measurement."""
    label = (3 * measurement[:, None] + np.arange(3)).ravel()
    return grouped(np.repeat(sigma, 3), [(label, np.full(len(label), shared))])


def make_basis(library: Array, mask: Flags | None = None) -> Basis:
    """Orthonormal directions of a library (R, 3, q) that can rise above the noise."""
    flat = library.reshape(3 * len(library), -1)
    size = np.linalg.norm(flat, axis=0)
    flat = flat[:, size * REACH >= 1.0]
    if flat.shape[1] == 0:
        return Basis(np.zeros((len(flat), 0)), mask)
    U, values, _ = np.linalg.svd(flat, full_matrices=False)
    return Basis(U[:, (values * REACH >= 1.0) & (values > 1e-9 * values[0])], mask)


def estimate(white: Array, basis: Basis, sigma: Array, measurement: Indices, source: str, level: float) -> Size:
    """The rows' own error and the one that rows of a measurement share, from what a basis leaves of white (R, 3).

    Restricted maximum likelihood in the eigenvectors of what groups share beyond the columns: exact, and one
    decomposition does for all sizes. The test is the likelihood ratio on its boundary.
    """
    left = basis.left(white)
    total = float(np.sum(left**2))
    plain = Size(total, basis.dof, 0.0, 1.0, source)
    if basis.dof < FEWEST or np.unique(measurement, return_counts=True)[1].max() < 2:
        return plain
    typical = float(np.sqrt(np.mean(sigma**2)))
    label = np.unique((3 * measurement[:, None] + np.arange(3)).ravel(), return_inverse=True)[1]
    Z = np.zeros((left.size, label.max() + 1))
    Z[np.arange(left.size), label] = np.repeat(typical / sigma, 3)
    if basis.mask is not None:
        Z[~basis.mask.ravel()] = 0.0
    for first in range(0, Z.shape[1], _TOGETHER):
        part = Z[:, first : first + _TOGETHER]
        part -= basis.Q @ (basis.Q.T @ part)
    lam, V = np.linalg.eigh(Z.T @ Z)
    seen = lam > 1e-6 * max(lam[-1], 1e-300)
    lam, V = lam[seen], V[:, seen]
    square = np.square(V.T @ (Z.T @ left.ravel())) / lam
    rest = max(total - float(square.sum()), 0.0)
    if basis.dof - len(lam) < FEWEST:
        return plain

    def deviance(ratio: Array) -> Array:
        grown = 1.0 + ratio[:, None] ** 2 * lam
        return np.asarray(basis.dof * np.log(rest + (square / grown).sum(axis=1)) + np.log(grown).sum(axis=1))

    ratio, low, high = 0.0, _SMALLEST, _LARGEST
    for _ in range(_FINER):  # each time between the neighbours of the best
        ratios = np.geomspace(low, high, _FINE)
        at = int(np.argmin(deviance(ratios)))
        low, ratio, high = (float(ratios[k]) for k in (max(at - 1, 0), at, min(at + 1, _FINE - 1)))
    without, beside = deviance(np.array([0.0, ratio])).tolist()
    gain = without - beside
    p = 0.5 * float(chi2_sf(gain, 1)) if gain > 0.0 else 1.0
    own = rest + float((square / (1.0 + ratio**2 * lam)).sum())
    shared = ratio * typical * float(np.sqrt(own / basis.dof))
    if p >= level:
        return replace(plain, shared=shared if gain > 0.0 else 0.0, p_shared=p)
    # beyond what measurements share there is only the rows' own error: exactly chi-square
    return Size(rest, basis.dof - len(lam), shared, p, source)


def pure_dof(replicate: Indices, mask: Flags | None = None) -> int:
    """Degrees of freedom of what replicates differ by: measured coordinates less the groups that an axis has."""
    measured = np.ones((len(replicate), 3), dtype=bool) if mask is None else mask
    row, axis = np.nonzero(measured)
    return len(row) - len(np.unique(3 * replicate[row] + axis))


def replicate_basis(replicate: Indices, mask: Flags | None = None) -> Basis:
    """The columns that let every group of replicates have its own mean: what they leave is pure error."""
    _, group, count = np.unique(replicate, return_inverse=True, return_counts=True)
    Q = np.zeros((len(group), len(count)))
    Q[np.arange(len(group)), group] = 1.0 / np.sqrt(count[group])
    columns = np.asarray(np.kron(Q, np.eye(3)), dtype=np.float64)
    if mask is not None:
        columns[~mask.ravel()] = 0.0
        size = np.linalg.norm(columns, axis=0)
        columns = columns[:, size > 0.0] / size[size > 0.0]
    return Basis(columns, mask)


def _size(
    white: Array, basis: Basis, sigma: Array, measurement: Indices, replicate: Indices, level: float
) -> tuple[Size, float]:
    """The noise to believe, and the p-value of the library against the replicates."""
    fromlibrary = estimate(white, basis, sigma, measurement, "residuals", level)
    if pure_dof(replicate, basis.mask) < FEWEST:
        usable = basis.dof >= FEWEST
        return (fromlibrary if usable else replace(fromlibrary, square=0.0, dof=0)), np.nan
    pure = replicate_basis(replicate, basis.mask)
    repeats = estimate(white, pure, sigma, measurement, "replicates", level)
    p = lack_p_value(white, basis, pure, _noise(sigma, repeats.shared, measurement), sigma)
    return (fromlibrary if p >= level else repeats), p


def lack_p_value(white: Array, basis: Basis, pure: Basis, noise: Noise, sigma: Array) -> float:
    """F test of what a basis leaves beyond replicates against what these leave; NaN where the basis spans all."""
    each = np.repeat(sigma, 3)
    y = noise.whiten(white.ravel() * each)
    squares: list[tuple[float, int]] = []
    for b in (basis, pure):
        Q = np.linalg.qr(noise.whiten(b.Q * each[:, None]))[0]
        squares.append((float(y @ y - np.square(Q.T @ y).sum()), b.dof))
    (rest, dof), (error, free) = squares
    if dof <= free:
        return np.nan
    return float(f_sf(max(rest - error, 0.0) / (dof - free) / (error / free), dof - free, free))


def _two_sided(size: Size) -> float:
    low = float(chi2_cdf(size.square, size.dof))
    return 2.0 * min(low, float(chi2_sf(size.square, size.dof)))
