"""A robot with identified values in the place of its nominal ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from qsframework.errors import InputError, Problem
from qsframework.identify.io import StoredFit
from qsframework.robot import Robot


def with_fit(robot: Robot, fit: StoredFit) -> tuple[Robot, tuple[str, ...]]:
    """The robot with the values of a fit, and the names of its estimates that are no parameters of this robot, such as
    the tracker's frame or effects of the experiment alone. InputError for a fit of another robot."""
    file, own = fit.file or None, {p.name for p in robot.parameters}
    if fit.robot and fit.robot != robot.name:
        raise InputError(Problem("the fit is of another robot", file, found=fit.robot, allowed=robot.name))
    if not own & set(fit.names):
        raise InputError(
            Problem(f"the fit estimates no parameter of {robot.name}", file, found=", ".join(fit.names[:6]))
        )
    beyond = [
        Problem(
            f"{p.name} is beyond its bounds",
            file,
            found=f"{fit.model[p.name]:.4g} {p.unit}",
            allowed=f"{p.lower:g} to {p.upper:g}",
            hint="Identify within bounds.",
            argument=("bounds", ""),
        )
        for p in robot.parameters
        if p.name in fit.model and not p.lower <= fit.model[p.name] <= p.upper
    ]
    if beyond:
        raise InputError(beyond)
    sd = {name: float(s) for name, s in zip(fit.names, fit.sd, strict=True)}
    parameters = tuple(
        replace(
            p,
            nominal=fit.model[p.name],
            sd=sd[p.name] if np.isfinite(sd[p.name]) else None,
            source=f"identified: {fit.file}",
        )
        if p.name in sd
        else p
        for p in robot.parameters
    )
    return replace(robot, parameters=parameters), tuple(n for n in fit.names if n not in own)
