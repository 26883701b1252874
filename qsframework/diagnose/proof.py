"""Rows after the audit, replicates, and the lack of fit of a fitted model."""

from __future__ import annotations

import numpy as np

from qsframework.diagnose.case import Case
from qsframework.diagnose.fitted import Settled
from qsframework.diagnose.lack_of_fit import LackOfFit, arm_axes, lack_of_fit, variables_of
from qsframework.diagnose.noise_audit import NoiseAudit, make_basis
from qsframework.errors import NotIdentifiable
from qsframework.experiment import Experiment, Readings
from qsframework.identify.linear import Rows
from qsframework.identify.observations import Noise
from qsframework.information import rank_test, scales
from qsframework.plugin import Array, Indices

_FAR = 1e-6
"""Chance of so little below which an exact fit proves the linear library wrong."""


def replicates(readings: Readings, rows: Rows) -> Indices:
    """Equal numbers (R,) where pose, load and marker are: repeats and cycles of one reading."""
    wrench = np.round(readings.poses.wrench, 6)
    _, load = np.unique(wrench, axis=0, return_inverse=True)
    keys = np.column_stack([rows.pose, load.ravel()[rows.measurement], rows.marker])
    return np.unique(keys, axis=0, return_inverse=True)[1].ravel()


def told_names(
    experiment: Experiment, readings: Readings, rows: Rows, noise: Noise
) -> tuple[tuple[str, ...], tuple[str, ...]]:  # fmt: skip
    """The experiment's parameters that the readings tell, and those that they do not: of a tied group the last ones.

    Raises NotIdentifiable where none is told.
    """
    model, names = experiment.model(), list(experiment.fit_names())
    columns = rows.of(model.sensitivity(readings.poses, model.nominal, names)).reshape(-1, len(names))
    white = noise.whiten(columns * scales([model.parameters[i] for i in model.index(names)]))
    kept = list(range(len(names)))
    while kept:
        test = rank_test(white[:, kept], [names[i] for i in kept])
        if test.full:
            break
        lost = {*test.unseen, *(group[-1] for group in test.tied)}
        kept = [i for i in kept if names[i] not in lost] if lost else kept[:-1]
    if not kept:
        raise NotIdentifiable(f"these readings tell none of {', '.join(names)}: was the arm loaded?")
    return tuple(names[i] for i in kept), tuple(n for i, n in enumerate(names) if i not in kept)


def audited_rows(readings: Readings, rows: Rows, good: Indices, audit: NoiseAudit) -> tuple[Rows, Noise]:
    """The good rows with their audited sigma, and the noise with what a pose shares."""
    sigma = rows.sigma[good] * audit.unit
    _, pose = np.unique(rows.pose[good], return_inverse=True)
    kept = Rows(
        rows.keep[good], rows.measured[good], sigma, rows.measurement[good], rows.marker[good], pose.astype(np.intp)
    )
    return kept, audit.of(readings, kept.keep, rows.sigma[good])


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
    left = case.residuals - Q @ (Q.T @ case.residuals)
    square, dof = float(left @ left), len(left) - int(Q.shape[1])
    more = int(Q.shape[1]) - len(fit.names)
    if dof < 1 or more < 1:
        return False
    ratio = float((fit.chi2 - square) / more * dof / square)
    return 1.0 - float(f.sf(ratio, more, dof)) < _FAR


def misfit(experiment: Experiment, readings: Readings, rows: Rows, fit: Settled, known: bool) -> LackOfFit:
    """How far the residuals of a fit are from its noise, and what they depend on. known: the noise's size is stated."""
    shape = (len(rows.keep), 3)
    columns = fit.jacobian.reshape(*shape, -1)
    variables = variables_of(experiment, readings, rows.keep)
    axes = arm_axes(experiment, readings, rows.keep)
    return lack_of_fit(fit.white.reshape(shape), columns, replicates(readings, rows), variables, known, axes)
