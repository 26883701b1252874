"""Whether a stored fit may be obeyed: of which robot it is, and what no arm can have.

A verb that moves an arm, certifies it or writes its values obeys no fit that another verb calls wrong. Lack of fit
alone refuses nothing: it widens what the fit promises (`StoredFit.widening`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from qsframework.errors import InputError, Problem
from qsframework.plugin import Array, Parameter, RobotFacts

if TYPE_CHECKING:
    from qsframework.identify.io import StoredFit
    from qsframework.robot import Robot

_DIGITS = 9
"""Of lengths in m and masses in kg: the trigonometry of another machine may differ in the last bits."""
_ROUNDING = 1e-9
_CORRELATION = 1e-6
"""Below zero by rounding: parameters that are hardly told apart have eigenvalues near zero."""


def robot_hash(facts: RobotFacts) -> str:
    """SHA-256 of an arm's constants: joints, axes, placements, masses and their centres, gravity; not of comments,
    limits or nominal parameters, which no fit rests on."""
    digest = hashlib.sha256(" ".join(facts.joints).encode())
    for values in (facts.sliding, facts.axes, facts.placements, facts.masses, facts.centres, facts.gravity):
        rounded = np.round(np.asarray(values, dtype=float), _DIGITS) + 0.0  # no negative zeros
        digest.update(rounded.astype("<f8").tobytes())
    return digest.hexdigest()


def check_robot(fit: StoredFit, robot: Robot) -> None:
    """InputError for the fit of a robot of another name."""
    if fit.robot and fit.robot != robot.name:
        hint = "Give the experiment of that robot, or identify this one."
        raise InputError(
            Problem("the fit is of another robot", fit.file or None, found=fit.robot, allowed=robot.name, hint=hint)
        )


def doubts(fit: StoredFit, robot: Robot, parameters: Sequence[Parameter]) -> tuple[str, ...]:
    """Why this fit is not to be obeyed, a sentence each; none where it may be.

    A value beyond its declared bound by no more than twice its sd is one that the readings do not tell from the bound.
    Where the residuals agree with a stated noise, an error at poses left out that is not below the nominal values' says
    no more than that these were right already.
    """
    known = {p.name: p for p in parameters}
    out: list[str] = []
    for name, value, sd in zip(fit.names, fit.values.tolist(), fit.sd.tolist(), strict=True):
        p = known.get(name)
        if p is not None:
            beyond = max(p.lower - value, value - p.upper, 0.0)
            if beyond > 2.0 * (sd if np.isfinite(sd) else 0.0):
                out.append(f"{name} is {value:.3g} {p.unit}".rstrip() + f", and no arm has it {_side(p, value)}")
        if name in fit.model and not np.isclose(fit.model[name], value, rtol=_ROUNDING, atol=0.0):
            out.append(f"{name} is {value:g} among the estimates and {fit.model[name]:g} in the model")
    for what, C in (("covariance", fit.covariance), ("covariance with the load's", fit.total_covariance)):
        if C is not None and not _is_covariance(C):
            out.append(f"its {what} is none: a variance would be below zero")
    if fit.unseen is not None and fit.unseen[1] >= fit.unseen[0] and not fit.agrees:
        before, after = (f"{1e3 * v:.3f} mm" for v in fit.unseen)
        out.append(f"its error at poses left out, {after}, is not below that of the nominal values, {before}")
    if fit.robot_sha256 and fit.robot_sha256 != robot_hash(robot.facts):
        out.append(f"{robot.name} has other geometry or masses now than when the fit was made")
    return tuple(out)


def obeyed(fit: StoredFit, robot: Robot, parameters: Sequence[Parameter], anyway: bool = False) -> tuple[str, ...]:
    """What to note of a fit that a verb obeys. InputError with every reason why it must not, unless `anyway`."""
    check_robot(fit, robot)
    wrong = doubts(fit, robot, parameters)
    if wrong and not anyway:
        hint = "Diagnose its readings first; it is used all the same only where that is asked for."
        raise InputError(
            [Problem(f"the fit is not to be trusted: {why}", fit.file or None) for why in wrong[:-1]]
            + [
                Problem(
                    f"the fit is not to be trusted: {wrong[-1]}", fit.file or None, hint=hint, argument=("anyway", "")
                )
            ]
        )
    out = [f"the fit is used although {why}" for why in wrong]
    if not fit.robot_sha256:
        out.append("the fit does not say of which geometry and masses it is: only the robot's name was compared")
    return tuple(out)


def _is_covariance(C: Array) -> bool:
    """Whether no combination of parameters has a variance below zero; in units of the parameters' own sds, for they
    are of many sizes."""
    variances = np.diag(C)
    sd = np.sqrt(np.where(variances > 0.0, variances, 1.0))
    return bool(np.all(variances >= 0.0)) and bool(
        not len(C) or np.linalg.eigvalsh(C / np.outer(sd, sd))[0] > -_CORRELATION
    )


def _side(p: Parameter, value: float) -> str:
    return f"below {p.lower:g}" if value < p.lower else f"above {p.upper:g}"
