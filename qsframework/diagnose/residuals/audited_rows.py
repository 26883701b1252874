"""Rows after the audit, replicates, and the lack of fit of a fitted model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from qsframework.diagnose.linearization.columns import Case
from qsframework.diagnose.residuals.lack_of_fit import LackOfFit, arm_axes, lack_of_fit, variables_of
from qsframework.diagnose.residuals.noise_components import NoiseAudit, make_basis
from qsframework.diagnose.selection.exact_refit import Settled
from qsframework.errors import NotIdentifiable
from qsframework.estimation import left
from qsframework.experiment import Bridge, Experiment, Readings
from qsframework.experiment.observations import Rows
from qsframework.identify.selection import told_names
from qsframework.plugin import Array, Indices

_FAR = 1e-6
"""Chance of so little below which an exact fit proves the linear library wrong."""


def replicates(readings: Readings, rows: Rows) -> Indices:
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


def split_told(seen: Bridge) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names that the readings tell, and those that they do not. NotIdentifiable where none is told.

    seen: the readings at the nominal arm, in its best frames
    """
    told, _, _ = told_names(seen)
    if not told:
        raise NotIdentifiable(
            f"these readings tell none of {', '.join(seen.names)}: was the arm loaded? If it was, check the nominal "
            "values"
        )
    return tuple(told), tuple(n for n in seen.names if n not in told)


def audited_rows(rows: Rows, good: Indices, audit: NoiseAudit) -> Rows:
    """The good rows with their audited sigma, and with what a visit shares."""
    readings = rows.readings
    scaled = replace(readings, sigma=readings.sigma * audit.unit, minus_sigma=readings.minus_sigma * audit.unit)
    kept = replace(rows, readings=scaled).take(good)
    _, pose = np.unique(kept.pose, return_inverse=True)
    return replace(kept, pose=pose.astype(np.intp), shared=audit.shared)


def library_basis(case: Case) -> Array:
    """Orthonormal directions (m, q) of the fitted parameters and of every cause that rises above the noise."""
    columns = np.concatenate([case.A, *case.B], axis=1)
    return make_basis(columns.reshape(-1, 3, columns.shape[1])).Q


def far_from_linear(case: Case, fit: Settled) -> bool:
    """Whether an exact fit of some causes leaves far less than all causes together do linearly, which hold these.

    Where both leave noise, what the fit leaves more, per parameter that it has less, follows an F distribution.
    """
    from scipy.stats import f

    Q = library_basis(case)
    rest = left(Q, case.residuals)
    square, dof = float(rest @ rest), case.count - int(Q.shape[1])
    more = int(Q.shape[1]) - int(fit.jacobian.shape[1])
    if dof < 1 or more < 1:
        return False
    ratio = float((fit.chi2 - square) / more * dof / square)
    return 1.0 - float(f.sf(ratio, more, dof)) < _FAR


def misfit(experiment: Experiment, readings: Readings, rows: Rows, fit: Settled, known: bool) -> LackOfFit:
    """How far the residuals of a fit are from its noise, and what they depend on. known: the noise's size is stated."""
    shape = (len(rows.keep), 3)
    columns = fit.jacobian.reshape(*shape, -1)
    axes = rows.padded(arm_axes(experiment, rows))
    return lack_of_fit(
        fit.white.reshape(shape),
        columns,
        replicates(readings, rows),
        variables_of(experiment, rows),
        known,
        axes,
        mask=rows.mask,
    )
