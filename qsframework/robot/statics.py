"""Do an arm's kinematics and the torques of its weight hold? Against Pinocchio and by energy, with no campaign."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array
from qsframework.robot.kinematics import joint_frames
from qsframework.robot.reference import reference_flange, reference_gravity
from qsframework.robot.robot import Robot

_TRIED = 20
_STEP = 1e-4
_NOTHING = 1e-9
"""m: a lever of the whole weight that is rounding, as where axes are along gravity but for a turn by half a circle."""
WEIGHTLESS = "the URDF states no mass, so that nothing sags by its own weight: gravity terms are unavailable"


@dataclass(frozen=True)
class GravityCheck:
    """One thing that was tried: whether it held, and what was found."""

    name: str
    good: bool
    words: str


def check_statics(robot: Robot) -> tuple[GravityCheck, ...]:
    """Kinematics and gravity at 20 poses inside the limits, of an arm whose loops close everywhere."""
    control, rng = robot.controller, np.random.default_rng(0)
    q = control.to_joints(rng.uniform(control.lower, control.upper, (_TRIED, len(control.lower))))
    return GravityCheck("kinematics", *check_kinematics(robot, q)), GravityCheck("gravity", *check_gravity(robot, q))


def check_kinematics(robot: Robot, q: Array) -> tuple[bool, str]:
    """Whether the batch kernel places the flange at joint angles (N, n) where Pinocchio does; what was found."""
    error = float(np.abs(_flange(robot, q) - reference_flange(robot, q)).max())
    back = float(np.abs(robot.controller.to_joints(robot.controller.to_pendant(q)) - q).max())
    return max(error, back) < 1e-9, f"{len(q)} poses, {error:.1g} m from Pinocchio; pendant angles there and back"


def check_gravity(robot: Robot, q: Array) -> tuple[bool, str]:
    """Whether the torque that holds a link up is the slope of the potential energy, joint by joint, sign included."""
    held, slope = reference_gravity(robot, q), np.empty_like(q)
    for k in range(robot.facts.n):
        step = _STEP * np.eye(robot.facts.n)[k]
        slope[:, k] = (potential_energy(robot, q + step) - potential_energy(robot, q - step)) / (2 * _STEP)
    scale = float(np.abs(held).max())
    nothing = _NOTHING * float(robot.facts.masses.sum() * np.linalg.norm(robot.gravity))
    if not scale > nothing:
        if not robot.gravity.any():
            return False, "no joint carries any weight: gravity_m/s^2 is zero"
        if not robot.facts.masses.any():
            return True, WEIGHTLESS
        return bool(np.abs(slope).max() <= nothing), "no joint carries any weight: all axes are along gravity"
    error = float(np.abs(held - slope).max()) / scale
    return error < 1e-6, f"largest holding torque {scale:.0f} N m, slope of the energy within {error:.1g}"


def potential_energy(robot: Robot, q: Array) -> Array:
    """Energy (N,) J of the links' weight at joint angles (N, n)."""
    placed = joint_frames(robot.facts, q)
    centres = [placed.point(link, centre) for link, centre in enumerate(robot.facts.centres)]
    return -sum(
        (m * (robot.gravity @ centre) for m, centre in zip(robot.facts.masses, centres, strict=True)), np.zeros(len(q))
    )


def _flange(robot: Robot, q: Array) -> Array:
    """Placements (N, 4, 4) of the flange by the batch kernel."""
    return joint_frames(robot.facts, q).placement(robot.flange.link) @ robot.flange.placement
