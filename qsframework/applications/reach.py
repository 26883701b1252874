"""Joint angles at which a tool on the last axis stands at a point and looks in a direction; many points at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsframework.applications.inverse import arm_length, joint_step, rigid_jacobian
from qsframework.elastostatics import Model, Site
from qsframework.plugin import Array, Indices, Poses
from qsframework.plugin.facts import frozen
from qsframework.robot import Robot
from qsframework.robot.collision import Flags
from qsframework.robot.kinematics import joint_frames

_STEPS = 40
_LARGEST_STEP = 0.3
_TRIES = 24
_CLOSE = 1e-8


@dataclass(frozen=True, eq=False)
class Tool:
    """The load point and the way the tool points, (3,) in the frame of the last link."""

    site: Site
    axis: Array


def tool_of(robot: Robot, length: float) -> Tool:
    """A tool along the last axis, pointing away from the wrist; `length` m beyond the flange."""
    facts = robot.facts
    axis = np.array(facts.axes[-1], dtype=float)
    flange = robot.flange.placement[:3, 3] + facts.placements[-1][:3, :3].T @ facts.placements[-1][:3, 3]
    axis = axis if axis @ flange >= 0.0 else -axis
    on_axis = axis * float(axis @ robot.flange.placement[:3, 3])
    return Tool(Site(robot.flange.link, frozen(on_axis + length * axis)), frozen(axis))


def reach(
    robot: Robot, model: Model, tool: Tool, points: Array, directions: Array, seed: int = 0
) -> tuple[Array, Flags]:
    """Pendant angles (N, n) and which of N points are reached, within the limits and the loops' margins.

    Points are reached from the solution of a neighbour where there is one, so that a map shows one posture as far as
    it goes; elsewhere from random poses.
    """
    count, controller = len(points), robot.controller
    lower, upper = np.maximum(controller.lower, -np.pi), np.minimum(controller.upper, np.pi)
    rng = np.random.default_rng(seed)
    pendant, reached = np.zeros((count, robot.facts.n)), np.zeros(count, dtype=bool)

    def randomly(chosen: Indices) -> None:
        pendant[chosen], reached[chosen] = _random(
            robot, model, tool, points[chosen], directions[chosen], lower, upper, rng
        )

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
        pendant[chosen], reached[chosen] = _newton(robot, model, tool, points[chosen], directions[chosen], start)
        tried[chosen] = True
    if reached.any() and not reached.all():
        randomly(np.flatnonzero(~reached))
    return pendant, reached


def _random(
    robot: Robot, model: Model, tool: Tool, points: Array, directions: Array, lower: Array, upper: Array,
    rng: np.random.Generator,
) -> tuple[Array, Flags]:  # fmt: skip
    """From random poses; of those that end at the point, the one nearest to the middle of the ranges."""
    count, n = len(points), robot.facts.n
    start = rng.uniform(lower, upper, (count * _TRIES, n))
    each = np.repeat(np.arange(count), _TRIES)
    pendant, good = _newton(robot, model, tool, points[each], directions[each], start)
    far = np.abs(pendant - 0.5 * (lower + upper)).max(axis=1)
    far = np.where(good, far, np.inf).reshape(count, _TRIES)
    best = np.arange(count) * _TRIES + far.argmin(axis=1)
    return pendant[best], good[best]


def _newton(
    robot: Robot, model: Model, tool: Tool, points: Array, directions: Array, start: Array
) -> tuple[Array, Flags]:  # fmt: skip
    controller, length = robot.controller, arm_length(robot)
    back, pendant = np.linalg.inv(controller.matrix), start.copy()
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
        step = joint_step(J, error, length) @ back.T
        step *= np.minimum(1.0, _LARGEST_STEP / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-300))
        pendant = np.clip(pendant + step, controller.lower, controller.upper)
    poses = Poses(pendant, controller.to_joints(pendant), np.zeros((len(pendant), 6)))
    return pendant, (size < 1e3 * _CLOSE) & (model.transmission_margin(poses) >= 0.0)
