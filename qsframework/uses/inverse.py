"""Where the controller's own kinematics put the load point, and back: joint angles of a pose, or of a pointing tool.

The kinematics are those of the URDF, rigid and without errors, as the controller uses them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from qsframework.elastostatics import Model, Site
from qsframework.errors import InputError, Problem
from qsframework.plugin import Array, Conditions, Indices, Poses
from qsframework.plugin.facts import frozen
from qsframework.robot import Robot
from qsframework.robot.collision import Flags
from qsframework.robot.kinematics import joint_frames, twists
from qsframework.uses.task import TaskPath

_STEPS = 60
_LARGEST_STEP = 0.3
"""rad, or m, of any joint in one step: a metre of travel counts as a radian."""
_DAMPING = 1e-6
_CLOSE = 1e-10
"""Error left, translations per length of the arm."""
_TRIES = 200
_NEWTON_STEPS = 40
_STARTS = 24
_NEAR = 1e-8
Free = Callable[[Array], Flags]
"""Which of N joint angles (N, n) keep the arm clear of itself and of what stands around it."""


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

    @property
    def near(self) -> str:
        """How far off it is, in words."""
        return f"{self.away * 1e3:.1f} mm and {np.rad2deg(self.turned):.2f} deg away at the nearest"


def poses_at(robot: Robot, pendant: Array, wrench: Array) -> Poses:
    """Poses at N pendant values (N, n) under wrenches (N, 6), of the arm as its last readings found it, at 20 degC, the
    reference of ISO 1, and reached from the positive side."""
    one = np.ones(len(pendant))
    last = Conditions(order=one, temperature=293.15 * one, approach=one)
    return Poses(pendant, robot.controller.to_joints(pendant), wrench, last, last)


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
    controller, length = robot.controller, arm_length(robot)
    lower, upper = controller.once_around()
    scale = np.array([1.0 / length] * 3 + [1.0] * 3)

    def state(pendant: Array) -> tuple[Array, Array, Callable[[], Array]]:
        q = controller.to_joints(pendant)
        error = pose_error(wanted.take([0] * len(q)), rigid_tip(robot, site, q))
        return error, np.abs(error * scale).max(axis=1), lambda: rigid_jacobian(robot, site, q)

    def solutions(starts: Array) -> list[InverseSolution]:
        pendant, error, _ = newton_steps(robot, starts, _STEPS, _CLOSE, state)
        away, turned = np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)
        return [
            InverseSolution(frozen(p), float(a), float(t), bool(a < 1e-7 * length and t < 1e-7))
            for p, a, t in zip(pendant, away, turned, strict=True)
        ]

    tried = solutions(start[None])
    if not tried[0].reached:
        tried += solutions(rng.uniform(lower, np.maximum(lower, upper), (_TRIES, controller.axes)))
    if reached := [s for s in tried if s.reached]:
        return min(reached, key=lambda s: float(np.abs(s.pendant - start).max()))
    return min(tried, key=lambda s: s.away / length + s.turned)


def newton_steps(
    robot: Robot,
    pendant: Array,
    steps: int,
    close: float,
    state: Callable[[Array], tuple[Array, Array, Callable[[], Array]]],
) -> tuple[Array, Array, Array]:
    """Pendant values (N, n) after damped Newton steps, kept inside the limits, until all errors are small.

    state: of pendant values, the errors (N, 6), their sizes (N,) and what gives their Jacobian (N, 6, n) by the joints;
    the errors and sizes of the last are returned too
    """
    controller, length = robot.controller, arm_length(robot)
    error, size, jacobian = state(pendant)
    for _ in range(steps):
        if np.all(size < close):
            break
        step = joint_step(jacobian() @ controller.matrix, error, length)
        step *= np.minimum(1.0, _LARGEST_STEP / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-300))
        pendant = np.clip(pendant + step, controller.lower, controller.upper)
        error, size, jacobian = state(pendant)
    return pendant, error, size


@dataclass(frozen=True, eq=False)
class ReachTool:
    """The load point and the way the tool points, (3,) in the frame of the last link."""

    site: Site
    axis: Array


def tool_of(robot: Robot, length: float) -> ReachTool:
    """A tool along the last axis, pointing away from the wrist; `length` m beyond the flange."""
    facts = robot.facts
    axis = np.array(facts.axes[-1], dtype=float)
    flange = robot.flange.placement[:3, 3] + facts.placements[-1][:3, :3].T @ facts.placements[-1][:3, 3]
    axis = axis if axis @ flange >= 0.0 else -axis
    on_axis = axis * float(axis @ robot.flange.placement[:3, 3])
    return ReachTool(Site(robot.flange.link, frozen(on_axis + length * axis)), frozen(axis))


@dataclass(frozen=True, eq=False)
class Reached:
    """Pendant angles (N, n) rad, which of N points are reached, and which would be if contact with itself or
    the floor did not count."""

    pendant: Array
    good: Flags
    blocked: Flags


def reach(
    robot: Robot,
    model: Model,
    tool: ReachTool,
    points: Array,
    directions: Array,
    seed: int = 0,
    free: Free | None = None,
) -> Reached:
    """Pendant angles of N points within the limits, the loops' margins and what `free` says.

    Points are reached from the solution of a neighbour where there is one, so that a map shows one posture as far as
    it goes; elsewhere from random poses.
    """
    count, controller = len(points), robot.controller
    lower, upper = controller.once_around()
    rng = np.random.default_rng(seed)
    pendant, reached = np.zeros((count, controller.axes)), np.zeros(count, dtype=bool)
    blocked = np.zeros(count, dtype=bool)

    def clear(found: Array, good: Flags, whose: Indices) -> Flags:
        """Those of the good that are free too; the points of the others are noted."""
        if free is not None and good.any():
            kept = good.copy()
            kept[good] = free(robot.controller.to_joints(found[good]))
            blocked[whose[good & ~kept]] = True
            return kept
        return good

    def randomly(chosen: Indices) -> None:
        n, each = controller.axes, np.repeat(chosen, _STARTS)
        start = rng.uniform(lower, upper, (len(each), n))
        found, good = _pointed(robot, model, tool, points[each], directions[each], start)
        good = clear(found, good, each)
        pendant[chosen], reached[chosen] = _middle(found, good, 0.5 * (lower + upper))

    for i in np.argsort(np.linalg.norm(points - points.mean(axis=0), axis=1)):
        randomly(np.array([i]))
        if reached[i]:
            break
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    tried = reached.copy()
    while reached.any() and not tried.all():
        left = np.flatnonzero(~tried)
        near = np.argmin(np.where(reached[None], distance[left], np.inf), axis=1)
        ring = distance[left, near] <= 1.01 * distance[left, near].min()
        chosen = left[ring]
        start = pendant[near[ring]]
        pendant[chosen], good = _pointed(robot, model, tool, points[chosen], directions[chosen], start)
        reached[chosen] = clear(pendant[chosen], good, chosen)
        tried[chosen] = True
    if reached.any() and not reached.all():
        randomly(np.flatnonzero(~reached))
    return Reached(pendant, reached, blocked & ~reached)


def _middle(pendant: Array, good: Flags, middle: Array) -> tuple[Array, Flags]:
    """Of the good tries at each point, the one nearest to the middle of the ranges."""
    count = len(pendant) // _STARTS
    far = np.where(good, np.abs(pendant - middle).max(axis=1), np.inf).reshape(count, _STARTS)
    best = np.arange(count) * _STARTS + far.argmin(axis=1)
    return pendant[best], good[best]


def _pointed(
    robot: Robot, model: Model, tool: ReachTool, points: Array, directions: Array, start: Array
) -> tuple[Array, Flags]:
    controller, length = robot.controller, arm_length(robot)

    def state(pendant: Array) -> tuple[Array, Array, Callable[[], Array]]:
        q = controller.to_joints(pendant)
        placed = joint_frames(robot.facts, q)
        axis = placed.matrix(tool.site.link) @ tool.axis
        turn = np.cross(axis, directions)
        behind = np.einsum("nc,nc->n", axis, directions) < 0.0  # half a turn off has no cross product
        error = np.concatenate([points - placed.point(tool.site.link, tool.site.xyz).T, turn], axis=1)
        size = np.hypot(np.linalg.norm(error[:, :3], axis=1) / length, np.linalg.norm(turn, axis=1)) + behind

        def jacobian() -> Array:
            J = rigid_jacobian(robot, tool.site, q)
            J[:, 3:] -= axis[:, :, None] * (axis[:, None] @ J[:, 3:])  # a turn about the tool's axis is free
            return J

        return error, size, jacobian

    pendant, _, size = newton_steps(robot, start, _NEWTON_STEPS, _NEAR, state)
    poses = poses_at(robot, pendant, np.zeros((len(pendant), 6)))
    return pendant, (size < 1e3 * _NEAR) & (model.transmission_margin(poses) >= 0.0)


def standing(robot: Robot, model: Model, tool: ReachTool, path: TaskPath, where: str, seed: int = 0) -> Poses:
    """Poses (P,) at the points of a path, with its wrenches. InputError with the points that the arm does not reach."""
    found = reach(robot, model, tool, path.points, path.directions, seed)
    if not found.good.all():
        problems = [
            Problem(
                f"path, point {i + 1}: the arm does not reach it with the tool pointing that way",
                where,
                hint="Move the point, or let the tool point another way (approach).",
            )
            for i in np.flatnonzero(~found.good).tolist()
        ]
        raise InputError(problems)
    return poses_at(robot, found.pendant, path.wrenches)
