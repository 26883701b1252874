"""How stiff an arm is at one pose: deflection, the share of each spring, Cartesian stiffness, linear against full."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from qsframework.arguments import checked
from qsframework.elastostatics import Model, cartesian_compliance, equilibrium, make_model, range_notes
from qsframework.elastostatics.frozen import frozen_states
from qsframework.elastostatics.state import site_in
from qsframework.errors import InputError, Problem
from qsframework.plausible import TOOL, too_strong
from qsframework.plugin import Array, Parameter, Poses
from qsframework.robot import Robot, as_robot
from qsframework.uses.inverse import poses_at
from qsframework.viewed import Viewed


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Stiffness(Viewed):
    """One pose under one load.

    springs: the compliances, in the order of shares (ne, 3) m: the translation that each adds in the linear model;
    linear, full (3,) m: translation of the load point, loaded minus unloaded; rotation (3,) rad: of its link, full;
    compliance, compliance_without_load (6, 6): tip twist per unit wrench with the whole Hessian of
    equation (18), and with the compensators' part alone; notes: what was asked beyond where a law holds
    """

    springs: tuple[Parameter, ...]
    shares: Array
    linear: Array
    full: Array
    rotation: Array
    compliance: Array
    compliance_without_load: Array
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Of the springs."""
        return tuple(p.name for p in self.springs)

    @property
    def linear_error(self) -> float:
        """Error of the linear model, relative to the deflection; 0 where nothing gives."""
        whole = float(np.linalg.norm(self.full))
        return float(np.linalg.norm(self.full - self.linear)) / whole if whole > 0.0 else 0.0

    def stiffness(self, with_load: bool = True) -> Array | None:
        """K_C (6, 6), None where the tip is rigid in one direction."""
        compliance = self.compliance if with_load else self.compliance_without_load
        scale = np.sqrt(np.maximum(np.abs(np.diag(compliance)), 1e-300))
        if np.linalg.cond(compliance / np.outer(scale, scale)) > 1e13:
            return None
        return np.asarray(np.linalg.inv(compliance), dtype=np.float64)

    def as_json(self) -> dict[str, Any]:
        """SI units but for the millimetres in the names."""
        K = self.stiffness()
        return {
            "deflection_mm": (self.full * 1e3).tolist(),
            "deflection_linear_mm": (self.linear * 1e3).tolist(),
            "linear_error": self.linear_error,
            "rotation_mrad": (self.rotation * 1e3).tolist(),
            "shares_mm": {n: (s * 1e3).tolist() for n, s in zip(self.names, self.shares, strict=True)},
            "stiffness": None if K is None else K.tolist(),
            "notes": list(self.notes),
        }


@checked
def stiffness_at(
    robot: Robot | str | Path, pendant: ArrayLike, wrench: ArrayLike, point: ArrayLike = (0.0, 0.0, 0.0)
) -> Stiffness:
    """The stiffness of a robot at one pose under one load.

    Args:
        robot: a Robot, or its name or path.
        pendant: (n,) what the pendant shows, rad, or m where a joint slides.
        wrench: (6,) force, N, and moment, N m, base frame; (3,) a force alone.
        point: (3,) where the load acts, m, flange frame.

    Returns:
        The deflection, the share of each spring and the Cartesian stiffness.

    Raises:
        InputError: where the robot is not found, an argument has another shape, or nothing of the arm is compliant.
    """
    robot = as_robot(robot)
    pendant, point = as_vector("pendant", pendant, robot.controller.axes), as_vector("point", point, 3)
    wrench = as_vector("wrench", wrench, 6, 3)
    if (off := float(np.linalg.norm(point))) > TOOL:
        allowed = f"up to {TOOL:g} m of the flange; lengths are in m"
        raise InputError(Problem("point: too far for a tool", found=f"{off:g} m", allowed=allowed))
    site = site_in(robot.flange, point)
    model = make_model(robot.facts, robot.effects, robot.parameters, site, [("tip", site)], robot.gravity)
    check_asked(robot, pendant[None], wrench[None])
    poses = poses_at(robot, pendant[None], wrench[None])
    if not model.compliance_rows:
        raise InputError(f"robot {robot.name} has no spring, so nothing gives: its effects list no compliance")
    unloaded, loaded = equilibrium(model, poses, loaded=False), equilibrium(model, poses)
    turn = loaded.tip_rotation[0] @ unloaded.tip_rotation[0].T
    rotation = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return Stiffness(
        springs=tuple(model.parameters[i] for i in model.compliance_rows),
        shares=spring_shares(model, poses)[0],
        linear=model.predict(poses, linear=True)[0, 0],
        full=(loaded.tip - unloaded.tip)[0],
        rotation=rotation,
        compliance=cartesian_compliance(model, poses)[0],
        compliance_without_load=cartesian_compliance(model, poses, hessian=False)[0],
        notes=range_notes(model, poses, ["this pose"]),
    )


def as_vector(name: str, values: ArrayLike, size: int, shorter: int = 0) -> Array:
    """An argument as a vector (size,); one of the shorter size is filled up with zeros. InputError for others."""
    try:
        vector = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        vector = np.full(0, np.nan)
    if vector.shape not in ((size,), (shorter or size,)) or not np.isfinite(vector).all():
        raise InputError(Problem(f"{name} must be {size} numbers", found=repr(values)[:80]))
    return np.concatenate([vector, np.zeros(size - len(vector))])


def check_asked(robot: Robot, pendant: Array, wrench: Array) -> None:
    """InputError where pendant values (N, n) are outside the limits or forces of wrenches (N, 6) beyond any test."""
    controller = robot.controller
    outside = controller.outside(pendant)
    if outside.any():
        i, k = (int(at) for at in np.argwhere(outside)[0])
        unit, (low, high) = controller.units[k], controller.range_of(k)
        of = f"target {i + 1}: " if len(pendant) > 1 else ""
        in_degrees = not controller.outside(np.where(controller.units.sliding, pendant, np.deg2rad(pendant))).any()
        hint = "The values would be inside in degrees; angles are in rad: use numpy.deg2rad." if in_degrees else None
        words = f"{of}{robot.facts.driven[k]} is outside its limits"
        found = unit.text(pendant[i, k])
        raise InputError(Problem(words, found=found, allowed=unit.between(low, high), hint=hint, argument=("pose", "")))
    for load in wrench.tolist():
        if (far := too_strong(load, robot.payload, float(np.linalg.norm(robot.gravity)))) is not None:
            allowed = f"{far.allowed} of {robot.name}"
            raise InputError(Problem("wrench: beyond any test of the arm", found=far.found, allowed=allowed))


def spring_shares(model: Model, poses: Poses, x: Array | None = None) -> Array:
    """Translation (N, ne, 3) m of the tip that each spring's deflection makes at N poses, linear model."""
    ev = frozen_states(model, poses, model.nominal if x is None else x, (True, False))
    return np.asarray((ev.state.tip.linear * ev.deflection[:, None, :]).transpose(2, 0, 1))
