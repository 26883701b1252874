"""A fit in words: how readings were taken, whether residuals fit the noise, how trackers stand."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from qsframework.experiment.readings import Alignment
from qsframework.identify import Fit


def first_words(fit: Fit) -> tuple[str, ...]:
    """What is said before anything else: how readings were taken, and that they were made by another model."""
    out: list[str] = []
    if fit.made is not None:
        own = "linear" if fit.linear else "equilibrium"
        if fit.made.model != own:
            names = {"linear": "the linear model", "equilibrium": "the full equilibrium"}
            out.append(
                f"These readings were simulated by {names[fit.made.model]} and are fitted by {names[own]}: what "
                "differs between the two is not noise."
            )
    if fit.alignments:
        out.append("States are read as differences, loaded minus unloaded.")
    elif fit.position.any():
        out.append("States are read as positions.")
    return tuple(out)


def verdict_words(fit: Fit) -> str:
    """Whether the residuals fit the noise, and what to do if they do not."""
    p = fit.p_value
    if p is None:
        return "The noise is estimated from the residuals, so they cannot say whether the model is right."
    ratio = float(np.sqrt(fit.chi2 / fit.dof))
    said = f"chi-square {fit.chi2:.1f} on {fit.dof} degrees of freedom, p = {p:.2g}"
    if p > 1.0 - fit.significance:
        return (
            f"The residuals are only {ratio:.2g} of the stated noise ({said}): the noise is less than stated, rows "
            "were copied, or the displacements are in a larger unit than their columns say."
        )
    if p >= fit.significance:
        return f"The residuals agree with the stated noise ({said})."
    order = np.argsort(-np.nan_to_num(np.abs(fit.studentised)).max(axis=1))[:3]
    file = [f", {Path(source).name}" for source in fit.sources] if len(fit.sources) > 1 else [""]
    rows = ", ".join(f"{fit.rows[i]} (pose {fit.poses[i]}{file[fit.file[i]]})" for i in order)
    return (
        f"The residuals are {ratio:.1f} times the stated noise ({said}): the model or a reading is wrong, and the "
        f"standard deviations are too small by that factor. Largest residuals: rows {rows}. Check the unit of the "
        "load, the load point, the markers' names and places, and the noise."
    )


def alignment_words(alignments: Sequence[Alignment]) -> tuple[str, ...]:
    """How series of states lie to the base, and what their unloaded markers then miss."""
    out: list[str] = []
    for a in alignments:
        name = f"series {a.series!r}" if a.series else "the tracker"
        if not a.count:
            out.append(
                f"Whether {name} has the axes of the base cannot be told from its unloaded markers; it is taken "
                "so. State its frame under frames: otherwise."
            )
            continue
        angle = f"{np.rad2deg(a.angle):.2f} deg"
        turned = f"has the axes of the base ({angle})"
        if a.turned:
            turned = f"is turned {angle} to the base, and its displacements with it"
        out.append(
            f"By {a.count} unloaded markers {name} {turned}; they then miss by {1e3 * a.rms:.3f} mm RMS, "
            f"{1e3 * a.largest:.3f} mm at most."
        )
    return tuple(out)
