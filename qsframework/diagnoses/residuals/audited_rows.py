"""Rows and the noises that they may have, those that do not belong, replicates, and the lack of fit of a model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from qsframework.diagnoses.residuals.lack_of_fit import LackOfFit, arm_axes, lack_of_fit, variables_of
from qsframework.diagnoses.residuals.noise_components import FEWEST, pure_dof, replicate_basis, visible
from qsframework.errors import NotIdentifiable
from qsframework.estimation import LinearFit
from qsframework.estimation.linear_fit import Whitened, without_outliers
from qsframework.estimation.projection import Flags
from qsframework.estimation.tails import chi2_isf, chi2_sf, f_sf
from qsframework.estimation.visit_noise import RHOS, VisitNoise
from qsframework.experiment import Experiment, ObservationModel, Readings
from qsframework.experiment.observations import ReadingRows
from qsframework.hypotheses.columns import Case
from qsframework.hypotheses.exact_refit import SettledFit
from qsframework.information.selection import identifiable_names
from qsframework.plugin import Array, Indices

_MOST_REPEATS = 1500
_FAR = 1e-6
"""Chance of so little below which an exact fit proves the linear library wrong."""
_START = 0.01
"""Level at which rows are set aside before the proper test takes them back."""
_HELD = 1e-6
"""1 / sd by which all columns are held, in sds: a row that alone tells one takes all of it, in the fit or out of it."""


def replicates(readings: Readings, rows: ReadingRows) -> Indices:
    """Equal numbers (R,) where pose, load and marker are: repeats and cycles of one reading."""
    wrench = np.round(readings.poses.wrench, 6)
    _, load = np.unique(wrench, axis=0, return_inverse=True)
    keys = np.column_stack(
        [
            rows.pose,
            load.ravel()[rows.plus],
            rows.marker,
            rows.frame,
            rows.minus < 0,
            readings.to[rows.keep],
            np.where(readings.is_gauge[rows.keep], rows.keep, -1),
        ]
    )
    return np.unique(keys, axis=0, return_inverse=True)[1].ravel()


def split_told(seen: ObservationModel) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names that the readings tell, and those that they do not. NotIdentifiable where none is told.

    What few poses tell badly is fitted, too: held at its nominal value its error would look like another cause's.

    seen: the readings at the nominal arm, in its best frames
    """
    told, _ = identifiable_names(seen, known=False)
    if not told:
        raise NotIdentifiable(
            f"these readings identify none of {', '.join(seen.names)}: was the arm loaded? Else check the nominal "
            "values"
        )
    return tuple(told), tuple(n for n in seen.names if n not in told)


def find_outliers(white: Array, columns: Array, level: float, mask: Flags) -> Indices:
    """Rows (sorted) of white (R, 3) that do not belong beside columns (3 R, q), at a family-wise level; their noise
    may have any size. mask (R, 3): what was measured.

    Each is judged by the exact F test of its coordinates against the rows that belong.
    """
    at: Indices = np.flatnonzero(mask)
    row: Indices = at // 3
    axes: Indices = np.maximum(np.bincount(row, minlength=len(white)), 1)
    given = Whitened(columns[at], white.ravel()[at], held=_HELD * np.ones(columns.shape[1]))
    enough = len(at) - columns.shape[1] >= max(len(at) // 3, 6)
    most = max(1, len(white) // 4)

    def beyond(misfit: Array, wrong: Flags, fit: LinearFit | None) -> Flags:
        if fit is None:
            usual = float(np.median(misfit / chi2_isf(0.5, axes)))
            p = chi2_sf(misfit / max(usual, 1e-300), axes) if enough else np.ones(len(misfit))
            return _worst(p < _START, p, most)
        free = np.where(wrong, fit.dof, np.maximum(fit.dof - axes, 1))
        rest = np.where(wrong, fit.chi2, fit.chi2 - misfit) / free
        p = f_sf(misfit / axes / np.maximum(rest, 1e-300), axes, free)
        back = wrong & (p * len(p) >= level)
        if back.any():  # the mildest half of them: one that comes back too early hides others
            return wrong & ~(back & (p >= np.median(p[back])))
        return _worst(p * len(p) < level, p, most)

    return np.flatnonzero(without_outliers(lambda _: given, row, len(white), beyond).wrong)


def visit_shifts(rows: ReadingRows, some: Indices) -> Array:
    """Columns (3 R, 3 v), whitened, of a shift of all readings of a visit together: of each visit that some rows are of
    and that has others, too."""
    shared = [rows.plus == visit for visit in np.unique(rows.plus[some])]
    moved = np.array([of for of in shared if of.sum() > 1], dtype=float).reshape(-1, len(rows.keep)).T
    return rows.padded_noise.whiten(np.einsum("rv,xy->rxvy", moved, np.eye(3)).reshape(3 * len(rows.keep), -1))


def _worst(out: Flags, p: Array, most: int) -> Flags:
    """Of some rows (R,) those with the least p, at most so many."""
    return np.asarray(out & (p <= np.sort(p)[most - 1]), dtype=np.bool_)


def visit_noise(rows: ReadingRows) -> VisitNoise:
    """The noises that rows may have, by the size of the error that the markers of a visit share.

    Where every visit has one marker, that error cannot be told from the marker's own: rho is 0. Where the arm's
    repeatability is stated, rho is known.
    """
    shared, typical = np.unique(rows.label[rows.label >= 0], return_counts=True)[1], _typical(rows)
    known = rows.readings.repeatability if rows.stated else None
    rhos = np.array([known / typical]) if known else np.array(RHOS[:1] if rows.lone_visits else RHOS)
    noises = tuple(rows.sharing(float(rho) * typical).padded_noise for rho in rhos)
    return VisitNoise(rhos, noises, len(shared), float(shared.mean()) if len(shared) else 1.0)


def bic(rows: ReadingRows, fit: SettledFit, at: Indices | None = None) -> float:
    """BIC of an exact fit to rows, in the likeliest of the noises that they may have, its size free; at: their places
    among those of the fit, None: all."""
    residuals = fit.residuals if at is None else fit.residuals[at]
    count = len(rows.at)
    costs = (
        count * float(np.log(max(np.square(noise.whiten(residuals.ravel())).sum(), 1e-300))) + noise.log_det()
        for noise in visit_noise(rows).noises
    )
    return min(costs) + fit.basis().shape[1] * float(np.log(count))


def _typical(rows: ReadingRows) -> float:
    """Typical sd m of a coordinate."""
    return float(np.sqrt(np.mean(rows.sigma[rows.mask] ** 2)))


def repeats(rows: ReadingRows) -> Array | None:
    """Indicators (3 R, g) of the readings that repeat each other; None where too few do, or more than can be held."""
    alike = replicates(rows.readings, rows)
    pure = pure_dof(alike, rows.mask)
    few = pure < FEWEST or int(rows.mask.sum()) - pure > _MOST_REPEATS
    return None if few else replicate_basis(alike, rows.mask)


def in_noise(rows: ReadingRows, unit: float, rho: float) -> ReadingRows:
    """Rows whose own errors are `unit` times as stated, and that share rho of these in a visit.

    Poses are numbered anew.
    """
    readings = rows.readings
    other = replace(readings, sigma=readings.sigma * unit, minus_sigma=readings.minus_sigma * unit)
    _, pose = np.unique(rows.pose, return_inverse=True)
    return replace(rows, readings=other, shared=rho * unit * _typical(rows), pose=pose.astype(np.intp))


def library_basis(case: Case) -> Array:
    """Orthonormal directions (m, q) of the fitted parameters and of every cause that rises above the noise."""
    own = [B for B, c in zip(case.B, case.causes, strict=True) if not c.group]
    columns = np.concatenate([case.A - case.fit.given(case.A), *own], axis=1)
    return visible(columns.reshape(-1, 3, columns.shape[1]))


def far_from_linear(case: Case, fit: SettledFit) -> bool:
    """Whether an exact fit of some causes leaves far less than all causes together do linearly, which hold these.

    Where both leave noise, what the fit leaves more, per parameter that it has less, follows an F distribution.
    """
    library = LinearFit.onto(library_basis(case), case.residuals)
    dof, more = case.count - library.Q.shape[1], library.Q.shape[1] - fit.basis().shape[1]
    if dof < 1 or more < 1:
        return False
    ratio = float((fit.chi2 - library.chi2) / more * dof / library.chi2)
    return 1.0 - float(f_sf(ratio, more, dof)) < _FAR


def misfit(experiment: Experiment, readings: Readings, rows: ReadingRows, fit: SettledFit) -> LackOfFit:
    """How far the residuals of a fit are from the repeats, and what they depend on."""
    shape = (len(rows.keep), 3)
    columns = fit.basis().reshape(*shape, -1)
    axes = rows.padded(arm_axes(experiment, rows))
    return lack_of_fit(
        fit.white.reshape(shape),
        columns,
        replicates(readings, rows),
        variables_of(experiment, rows),
        axes,
        mask=rows.mask,
    )
