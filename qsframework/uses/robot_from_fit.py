"""A robot with identified values in the place of its nominal ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from qsframework.errors import InputError, Problem, refuse
from qsframework.fits import FitRecord
from qsframework.fits.columns import sd_of
from qsframework.fits.soundness import check_fit, check_robot, experiment_of
from qsframework.robot import Robot


def with_fit(robot: Robot, fit: FitRecord, *, anyway: bool = False) -> tuple[Robot, tuple[str, ...]]:
    """The robot with the values of a fit, and what to note of it, such as estimates that are no parameters of this
    robot: of the tracker's frame, or of effects of the experiment alone.

    Its readings are asked where its experiment lies beside it. Values are known to noise, load and what was held,
    widened where the residuals do not fit their noise. InputError for a fit of another robot, one that is not to be
    trusted unless `anyway`, and, always, for values beyond their bounds.
    """
    file, own = fit.path or None, {p.name for p in robot.parameters}
    check_robot(fit, robot)
    if not own & set(fit.names):
        raise InputError(
            Problem(f"the fit estimates no parameter of {robot.name}", file, found=", ".join(fit.names[:6]))
        )
    beyond = [
        Problem(
            f"{p.name} is beyond its bounds",
            file,
            found=f"{fit.model_values[p.name]:.4g} {p.unit}",
            allowed=f"{p.lower:g} to {p.upper:g}",
            hint="Identify within bounds.",
            argument=("bounds", ""),
        )
        for p in robot.parameters
        if p.name in fit.model_values and not p.lower <= fit.model_values[p.name] <= p.upper
    ]
    refuse(beyond)
    experiment = experiment_of(fit, robot)
    notes = check_fit(fit, robot, experiment, anyway=anyway)
    if experiment is None and fit.path:
        words = "that the fit explains its readings was not checked: its experiment is not beside it"
        notes = (*notes, f"{words}. Put both into one folder")
    sd = {e.name: float(np.sqrt(fit.widening) * sd_of(fit, e)) for e in fit.estimates}
    parameters = tuple(
        replace(
            p,
            nominal=fit.model_values[p.name],
            sd=sd[p.name] if np.isfinite(sd[p.name]) else None,
            source=f"identified: {fit.path}",
        )
        if p.name in sd
        else p
        for p in robot.parameters
    )
    others = [n for n in fit.names if n not in own]
    if others:
        notes = (*notes, f"estimates that are no effects of its robot.yaml are omitted: {', '.join(others)}")
    return replace(robot, parameters=parameters), notes
