"""Where the controller's own kinematics put the load point, and back: joint angles of a wanted pose.

The kinematics are those of the URDF, rigid and without errors, as the controller uses them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from qsframework.elastostatics import Site
from qsframework.plugin import Array
from qsframework.plugin.facts import frozen
from qsframework.robot import Robot
from qsframework.robot.kinematics import joint_frames, twists

_STEPS = 60
_LARGEST_STEP = 0.3
"""rad, or m, of any joint in one step: a metre of travel counts as a radian."""
_DAMPING = 1e-6
_CLOSE = 1e-10
"""Error left, translations per length of the arm."""
_TRIES = 200


@dataclass(frozen=True, eq=False)
class TipPose:
    """Where the load point stands (N, 3) m, and the rotation (N, 3, 3) of the flange, base frame."""

    position: Array
    rotation: Array

    def __len__(self) -> int:
        return len(self.position)

    def take(self, index: Any) -> TipPose:
        """The poses at an index, slice or mask."""
        return TipPose(self.position[index], self.rotation[index])


@dataclass(frozen=True, eq=False)
class InverseSolution:
    """Pendant angles (n,) of one pose, and how far the load point is off it: m and rad."""

    pendant: Array
    away: float
    turned: float
    reached: bool


def rigid_tip(robot: Robot, site: Site, q: Array) -> TipPose:
    """The load point at URDF joint angles (N, n), undeflected."""
    placed = joint_frames(robot.facts, q)
    return TipPose(placed.point(site.link, site.xyz).T, site.rotation(placed))


def rigid_jacobian(robot: Robot, site: Site, q: Array) -> Array:
    """Twist (N, 6, n) of the load point per joint angle, base axes, translation first."""
    placed = joint_frames(robot.facts, q)
    columns = twists(placed, site.link, placed.point(site.link, site.xyz))
    J = np.zeros((len(q), 6, robot.facts.n))
    J[:, :, : columns.upstream] = np.concatenate([columns.linear, columns.angular], axis=1).transpose(2, 1, 0)
    return J


def arm_length(robot: Robot) -> float:
    """Sum of the distances from joint to joint, m: what makes translations and turns comparable."""
    return float(np.linalg.norm(robot.facts.placements[:, :3, 3], axis=1).sum()) or 1.0


def pose_error(wanted: TipPose, now: TipPose) -> Array:
    """Small motion (N, 6), translation m and rotation vector rad, from where it stands to where it should."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(wanted.rotation @ now.rotation.transpose(0, 2, 1)).as_rotvec()
    return np.concatenate([wanted.position - now.position, turn], axis=1)


def joint_step(J: Array, error: Array, length: float) -> Array:
    """Angles (N, n) that move the load point by the error (N, 6): damped least squares."""
    scale = np.array([1.0 / length] * 3 + [1.0] * 3)
    A, b = J * scale[:, None], (error * scale)[..., None]
    normal = A.transpose(0, 2, 1) @ A + _DAMPING**2 * np.eye(A.shape[2])
    return np.asarray(np.linalg.solve(normal, A.transpose(0, 2, 1) @ b)[..., 0], dtype=np.float64)


def find_joints(robot: Robot, site: Site, wanted: TipPose, start: Array, rng: np.random.Generator) -> InverseSolution:
    """Pendant angles within the limits at which the load point stands at one pose: near `start` (n,) if it can.

    Damped Newton steps, kept inside the limits; where they do not end at the pose, they begin again at random poses,
    and of those that end there the one with the smallest turn of any joint from the start counts.
    """
    found = _newton(robot, site, wanted, start[None])
    if found[0].reached:
        return found[0]
    controller = robot.controller
    lower, upper = controller.once_around()
    found += _newton(robot, site, wanted, rng.uniform(lower, np.maximum(lower, upper), (_TRIES, controller.axes)))
    reached = [f for f in found if f.reached]
    if reached:
        return min(reached, key=lambda f: float(np.abs(f.pendant - start).max()))
    return min(found, key=lambda f: f.away / arm_length(robot) + f.turned)


def _newton(robot: Robot, site: Site, wanted: TipPose, start: Array) -> list[InverseSolution]:
    controller, length, count = robot.controller, arm_length(robot), len(start)
    goal = TipPose(np.repeat(wanted.position, count, axis=0), np.repeat(wanted.rotation, count, axis=0))
    pendant, scale = start.copy(), np.array([1.0 / length] * 3 + [1.0] * 3)
    error = np.zeros((count, 6))
    for _ in range(_STEPS):
        q = controller.to_joints(pendant)
        error = pose_error(goal, rigid_tip(robot, site, q))
        if (np.abs(error * scale).max(axis=1) < _CLOSE).all():
            break
        step = joint_step(rigid_jacobian(robot, site, q) @ controller.matrix, error, length)
        size = np.abs(step).max(axis=1, keepdims=True)
        step *= np.minimum(1.0, _LARGEST_STEP / np.maximum(size, 1e-300))
        pendant = np.clip(pendant + step, controller.lower, controller.upper)
    error = pose_error(goal, rigid_tip(robot, site, controller.to_joints(pendant)))
    away, turned = np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)
    return [
        InverseSolution(frozen(p), float(a), float(t), bool(a < 1e-7 * length and t < 1e-7))
        for p, a, t in zip(pendant, away, turned, strict=True)
    ]
