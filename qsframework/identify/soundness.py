"""Whether a stored fit may be obeyed: of which robot it is, and what no arm can have.

A verb that moves an arm, certifies it or writes its values obeys no fit that another verb calls wrong. Lack of fit
alone refuses nothing: it widens what the fit promises (`FitRecord.widening`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from qsframework.errors import InputError, Problem
from qsframework.plugin import Array, Parameter, RobotFacts

if TYPE_CHECKING:
    from qsframework.identify.record import FitRecord
    from qsframework.robot import Robot

_DIGITS = 9
"""Of lengths in m and masses in kg: the trigonometry of another machine may differ in the last bits."""
_ROUNDING = 1e-9
_CORRELATION = 1e-6
"""Below zero by rounding: parameters that are hardly told apart have eigenvalues near zero."""


def robot_hash(facts: RobotFacts) -> str:
    """SHA-256 of an arm's constants: joints, axes, placements, flange, masses and their centres, gravity; not of
    comments, limits or nominal parameters, which no fit rests on."""
    digest = hashlib.sha256(" ".join(facts.joints).encode())
    placed = facts.sliding, facts.axes, facts.placements, facts.flange_placement
    for values in (*placed, facts.masses, facts.centres, facts.gravity):
        rounded = np.round(np.asarray(values, dtype=float), _DIGITS) + 0.0  # no negative zeros
        digest.update(rounded.astype("<f8").tobytes())
    return digest.hexdigest()


def check_robot(fit: FitRecord, robot: Robot) -> None:
    """InputError for the fit of a robot of another name."""
    if fit.robot != robot.name:
        words, hint = "the fit is of another robot", "Give the experiment of that robot, or identify this one."
        raise InputError(Problem(words, fit.path or None, found=fit.robot, allowed=robot.name, hint=hint))


def doubts(fit: FitRecord, robot: Robot, parameters: Sequence[Parameter]) -> tuple[str, ...]:
    """Why this fit is not to be obeyed, a sentence each; none where it may be.

    A value beyond its declared bound by no more than twice its sd is one that the readings do not tell from the bound.
    Where the residuals agree with a stated noise, an error at poses left out that is not below the nominal values' says
    no more than that these were right already.
    """
    known = {p.name: p for p in parameters}
    out: list[str] = []
    for e in fit.estimates:
        p, held = known.get(e.name), fit.model_values.get(e.name, e.value)
        if p is not None:
            beyond = max(p.lower - e.value, e.value - p.upper, 0.0)
            if beyond > 2.0 * (e.sd if np.isfinite(e.sd) else 0.0):
                out.append(f"{e.name} is {e.value:.3g} {p.unit}".rstrip() + f", and no arm has it {_side(p, e.value)}")
        if not np.isclose(held, e.value, rtol=_ROUNDING, atol=0.0):
            out.append(f"{e.name} is {e.value:g} among the estimates and {held:g} in the model")
    for what, C in (("covariance", fit.covariance), ("covariance with the load's", fit.total_covariance)):
        if C is not None and not _is_covariance(C):
            out.append(f"its {what} is none: a variance would be below zero")
    if fit.held_out_error >= fit.held_out_nominal and not fit.agrees:
        before, after = (f"{1e3 * v:.3f} mm" for v in (fit.held_out_nominal, fit.held_out_error))
        out.append(f"its error at poses left out, {after}, is not below that of the nominal values, {before}")
    if fit.robot_sha256 != robot_hash(robot.facts):
        out.append(f"{robot.name} has other geometry or masses now than when the fit was made")
    return tuple(out)


def obeyed(fit: FitRecord, robot: Robot, parameters: Sequence[Parameter], anyway: bool = False) -> tuple[str, ...]:
    """What to note of a fit that a verb obeys. InputError with every reason why it must not, unless `anyway`."""
    check_robot(fit, robot)
    wrong = doubts(fit, robot, parameters)
    if wrong and not anyway:
        hint = "Diagnose its readings first; it is used all the same only where that is asked for."
        problems = [Problem(f"the fit is not to be trusted: {why}", fit.path or None) for why in wrong]
        raise InputError([*problems[:-1], replace(problems[-1], hint=hint, argument=("anyway", ""))])
    return tuple(f"the fit is used although {why}" for why in wrong)


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
