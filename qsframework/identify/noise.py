"""Errors that readings share: the robot's repeatability within a pose, one unloaded reading under several loads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.errors import InputError
from qsframework.experiment import Readings
from qsframework.identify.observations import Independent, Noise
from qsframework.plugin import Array, Indices

Group = tuple[Indices, Array]
"""An error that readings share: label (m,) of the group each belongs to, -1 for none, and its sd (m,) in each."""
_LARGEST = 1e3
"""Largest shared sd that is looked for, in sds of a reading's own error."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """A covariance of blocks: for each size s, the readings of B blocks (B, s) and their factors L^-1 (B, s, s)."""

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
            v = values[rows] if values.ndim == 2 else values[rows][..., None]
            out[rows] = change(inverse, v).reshape(values[rows].shape)
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
    block = _connected(len(sigma), groups)
    counts = np.bincount(block)
    order, first = np.argsort(block, kind="stable"), np.cumsum(counts) - counts
    logarithm = 0.0
    parts: list[tuple[Indices, Array]] = []
    for size in np.unique(counts):
        rows = order[first[counts == size][:, None] + np.arange(size)]
        L = np.linalg.cholesky(_covariance(sigma, groups, rows))
        logarithm += 2.0 * float(np.log(np.diagonal(L, axis1=1, axis2=2)).sum())
        inverse = np.linalg.solve(L, np.broadcast_to(np.eye(size), L.shape))
        parts.append((rows, np.asarray(inverse, dtype=np.float64)))
    return Blocks(tuple(parts), logarithm)


def _covariance(sigma: Array, groups: Sequence[Group], rows: Indices) -> Array:
    """Covariances (B, s, s) of the blocks of readings (B, s)."""
    cov = np.square(sigma[rows])[..., None] * np.eye(rows.shape[1])
    for label, sd in groups:
        one = (label[rows][:, :, None] == label[rows][:, None, :]) & (label[rows] >= 0)[:, :, None]
        cov += one * sd[rows][:, :, None] * sd[rows][:, None, :]
    return cov


def _connected(count: int, groups: Sequence[Group]) -> Indices:
    """Number (m,) of the block of each reading: readings that share an error, directly or through others."""
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


def pose_groups(readings: Readings, keep: Indices) -> Indices:
    """Label (3 R,) of the error that the markers of one measurement share, for each axis, of the kept rows."""
    return (3 * readings.measurement[keep][:, None] + np.arange(3)).ravel()


def reference_groups(readings: Readings, keep: Indices) -> Indices:
    """Label (3 R,) of the unloaded reading behind each kept row, for each axis; -1 where no other row shares it.

    Rows with one `reference` and one marker are measured against one unloaded reading.
    """
    if readings.reference is None:
        return np.full(3 * len(keep), -1, dtype=np.intp)
    keys = [(readings.reference[int(i)], int(readings.marker[i])) for i in keep]
    number: dict[tuple[str, int], int] = {}
    label = np.array([number.setdefault(k, len(number)) if k[0] else -1 for k in keys], dtype=np.intp)
    return np.where(label[:, None] < 0, -1, 3 * label[:, None] + np.arange(3)).ravel()


def left_out_together(readings: Readings, keep: Indices, pose: Indices) -> Indices:
    """Number (R,) of the set that each kept row is left out with: its pose, and all that shares its unloaded reading.

    What is left in the fit then knows nothing of the errors of what is left out.
    """
    reference = reference_groups(readings, keep)[::3]
    none = np.zeros(len(keep))
    return _connected(len(keep), [(pose, none), (reference, none)])


def readings_noise(readings: Readings, keep: Indices, sigma: Array, shared: float = 0.0) -> Noise:
    """Noise of the kept rows' 3 R scalars: sigma (R,) m of a displacement, `shared` m the error within a pose.

    Half the variance of a displacement is the unloaded reading's, unless `reference_share` says how much: rows that
    have it in common share that part. Where halves differ, the unloaded one has half the smallest variance.
    """
    own, groups = noise_parts(readings, keep, sigma)
    return grouped(own, [*groups, (pose_groups(readings, keep), np.full(len(own), shared))])


def noise_parts(readings: Readings, keep: Indices, sigma: Array) -> tuple[Array, list[Group]]:
    """sd (3 R,) of the kept rows' own errors, and the errors that unloaded readings bring to several of them."""
    each = np.repeat(sigma, 3)
    label = reference_groups(readings, keep)
    sd = np.zeros(len(each))
    if readings.reference_share is not None:
        sd = np.where(label >= 0, each * np.sqrt(np.repeat(readings.reference_share[keep], 3)), 0.0)
        return np.sqrt(each**2 - sd**2), [(label, sd)]
    for one in np.unique(label[label >= 0]):
        rows = label == one
        if rows.sum() > 1:
            sd[rows] = each[rows].min() / np.sqrt(2.0)
    return np.sqrt(each**2 - sd**2), [(label, sd)]


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

    def words(self, level: float = 0.01) -> str:
        """What was found, in one sentence."""
        if self.p_value > level:
            return f"No error shared by the markers of a pose is seen (p = {self.p_value:.2g})."
        size = f"{self.sd * 1e3:.4f} mm a coordinate (p = {self.p_value:.2g})"
        return f"The markers of a pose share an error of {size}: the robot's repeatability, or what the model misses."


def shared_error(
    residuals: Array, jacobian: Array, sigma: Array, label: Indices, stated: bool = True, others: Sequence[Group] = ()
) -> SharedError:  # fmt: skip
    """The sd of the error that readings of one label share, by restricted maximum likelihood (REML).

    residuals (m,) and jacobian (m, p) of a fit that has settled, not whitened; sigma (m,) the readings' own sd, up to
    a factor unless `stated`; others: errors that they share besides, known as sigma is. The test is the likelihood
    ratio on its boundary, where half of the cases without a shared error give an estimate of zero.
    """
    from scipy.optimize import minimize_scalar
    from scipy.stats import chi2

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

    found = minimize_scalar(lambda t: deviance(float(np.exp(t)))[0], bounds=(np.log(1e-3), np.log(_LARGEST)),
                            method="bounded", options={"xatol": 1e-6})  # fmt: skip
    ratio = float(np.exp(found.x))
    gain = deviance(0.0)[0] - deviance(ratio)[0]
    if gain <= 0.0:
        ratio, gain = 0.0, 0.0
    unit = float(np.sqrt(deviance(ratio)[1]))
    return SharedError(
        ratio * typical * unit, unit, 1.0 if gain == 0.0 else 0.5 * float(chi2.sf(gain, 1)), noise(ratio)
    )
