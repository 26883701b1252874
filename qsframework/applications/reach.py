"""Joint angles at which a tool on the last axis stands at a point and looks in a direction; many points at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from qsframework.applications.inverse import arm_length, joint_step, rigid_jacobian
from qsframework.applications.task import TaskPath
from qsframework.elastostatics import Model, Site
from qsframework.errors import InputError, Problem
from qsframework.plugin import Array, Indices, Poses
from qsframework.plugin.facts import frozen
from qsframework.robot import Robot
from qsframework.robot.collision import Flags
from qsframework.robot.kinematics import joint_frames

_STEPS = 40
_LARGEST_STEP = 0.3
_TRIES = 24
_CLOSE = 1e-8
Free = Callable[[Array], Flags]
"""Which of N joint angles (N, n) keep the arm clear of itself and of what stands around it."""


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
    """Pendant angles (N, n) rad, which of N points are reached, and which would be if the arm could touch itself or
    the floor."""

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
        n, each = controller.axes, np.repeat(chosen, _TRIES)
        start = rng.uniform(lower, upper, (len(each), n))
        found, good = _newton(robot, model, tool, points[each], directions[each], start)
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
        pendant[chosen], good = _newton(robot, model, tool, points[chosen], directions[chosen], start)
        reached[chosen] = clear(pendant[chosen], good, chosen)
        tried[chosen] = True
    if reached.any() and not reached.all():
        randomly(np.flatnonzero(~reached))
    return Reached(pendant, reached, blocked & ~reached)


def _middle(pendant: Array, good: Flags, middle: Array) -> tuple[Array, Flags]:
    """Of the good tries at each point, the one nearest to the middle of the ranges."""
    count = len(pendant) // _TRIES
    far = np.where(good, np.abs(pendant - middle).max(axis=1), np.inf).reshape(count, _TRIES)
    best = np.arange(count) * _TRIES + far.argmin(axis=1)
    return pendant[best], good[best]


def _newton(
    robot: Robot, model: Model, tool: ReachTool, points: Array, directions: Array, start: Array
) -> tuple[Array, Flags]:
    controller, length = robot.controller, arm_length(robot)
    pendant = start.copy()
    error, size = np.zeros((len(points), 6)), np.zeros(len(points))
    for k in range(_STEPS + 1):
        q = controller.to_joints(pendant)
        placed = joint_frames(robot.facts, q)
        axis = placed.matrix(tool.site.link) @ tool.axis
        turn = np.cross(axis, directions)
        behind = np.einsum("nc,nc->n", axis, directions) < 0.0  # half a turn off has no cross product
        error = np.concatenate([points - placed.point(tool.site.link, tool.site.xyz).T, turn], axis=1)
        size = np.hypot(np.linalg.norm(error[:, :3], axis=1) / length, np.linalg.norm(turn, axis=1)) + behind
        if k == _STEPS or np.all(size < _CLOSE):
            break
        J = rigid_jacobian(robot, tool.site, q)
        J[:, 3:] -= axis[:, :, None] * (axis[:, None] @ J[:, 3:])  # a turn about the tool's axis is free
        step = joint_step(J @ controller.matrix, error, length)
        step *= np.minimum(1.0, _LARGEST_STEP / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-300))
        pendant = np.clip(pendant + step, controller.lower, controller.upper)
    poses = Poses(pendant, controller.to_joints(pendant), np.zeros((len(pendant), 6)))
    return pendant, (size < 1e3 * _CLOSE) & (model.transmission_margin(poses) >= 0.0)


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
    return Poses(found.pendant, robot.controller.to_joints(found.pendant), path.wrenches)
