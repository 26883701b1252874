"""The audit of the noise, and what a model leaves beyond it, in words."""

from __future__ import annotations

import numpy as np

from qsframework.diagnoses.residuals.lack_of_fit import LackOfFit, Trend
from qsframework.diagnoses.residuals.noise_components import LEVEL, NoiseAudit
from qsframework.estimation.axis_noise import axis_words

SOURCE = {
    "stated": "stated",
    "repeats": "from repeats",
    "data sheet": "from the data sheet of the instrument",
    "estimated": "estimated",
}
"""Where the size of a noise is from."""


def audit_words(audit: NoiseAudit, rows: bool = True) -> tuple[str, ...]:
    """The size of the noise, and what is not as usual of it; rows: how many were left out, too."""
    said = [_unit(audit)]
    if rows and len(audit.outliers):
        count = len(audit.outliers)
        many = f"{count} rows are outliers and are not used."
        said.append(many if count > 1 else "1 row is an outlier and is not used.")
    if audit.axes is not None:
        said.append(f"{axis_words(audit.axes)}: the instrument's, and counted so.")
    if audit.p_shared < LEVEL:
        size = f"{audit.shared * 1e3:.4f} mm a coordinate (p = {audit.p_shared:.2g})"
        why = "the robot's repeatability"
        if not audit.repeated:
            why += ", or something unknown: repeat some poses to find out"
        said.append(f"The markers of a pose share an error of {size}: {why}.")
    if audit.heavy < LEVEL:
        said.append(f"Errors have heavier tails than normal ones (p = {audit.heavy:.2g}).")
    if audit.p_missing < LEVEL:
        said.append(f"The model does not explain all that is beyond the replicates (p = {audit.p_missing:.2g}).")
    return tuple(said)


def _unit(audit: NoiseAudit) -> str:
    """Where the size of the noise was taken from, with its degrees of freedom."""
    if not audit.dof:
        if audit.stated:
            return (
                "The stated noise is taken as it is: the model uses up every reading and nothing was measured twice, "
                "so nothing is known about it without replicates."
            )
        return (
            "The noise is unknown, and nothing is known about it without replicates: the residuals' size is used, "
            "which is its upper limit."
        )
    source = "replicates" if audit.unit_source == "replicates" else "the residuals"
    basis = f"from {source}, {audit.dof} degrees of freedom"
    if audit.unit_source == "stated":
        return (
            f"The stated noise holds: measured {audit.measured:.2f} times as large (p = {audit.p_unit:.2g}; {basis})."
        )
    if not audit.stated:
        return f"The noise is not stated; it was estimated {basis}."
    return f"The noise is {audit.unit:.2f} times the stated one (p = {audit.p_unit:.1g}; {basis})."


def misfit_words(found: LackOfFit) -> tuple[str, ...]:
    """Whether residuals fit the replicates, and on what they depend."""
    said: list[str] = []
    if np.isfinite(found.p_replicates):
        verdict = "larger than" if found.p_replicates < LEVEL else "as large as"
        free = f"p = {found.p_replicates:.2g}, {found.free_replicates} degrees of freedom of the replicates"
        said.append(f"The residuals are {verdict} the replicates' scatter ({free}).")
    said += [_trend(t) for t in found.trends if t.p_value < LEVEL]
    return tuple(said)


def _trend(t: Trend) -> str:
    squares = f"{100 * t.share:.0f} % of their squares with {t.dof} of {t.free} degrees of freedom"
    return f"Residuals depend on {t.variable}: it takes {squares} (adjusted p = {t.p_value:.2g})."
