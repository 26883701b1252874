"""Which poses keep the constraints of an experiment, each by its name, many poses at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from qsframework.elastostatics import Model, Site, actuator_torques, flip_margin
from qsframework.errors import InputError
from qsframework.experiment import Experiment, Plan
from qsframework.experiment.constraints import tool_shapes
from qsframework.plugin import Array, Loop, Poses
from qsframework.robot import Robot, Shape
from qsframework.robot.collision import Collider, above_floor, make_collider, obstacle_collider
from qsframework.robot.kinematics import Frames, cross, joint_frames, twists
from qsframework.robot.sight import incidence, visible

_BLOCK = 4096
Flags = npt.NDArray[np.bool_]


_MARGIN = float(np.deg2rad(2.0))
_MARGIN_SHARE = 0.02
_MOST_SHARE = 0.1
"""Margin to the controller's limits where the experiment states none: the larger of an angle and a share of the range,
no more than another share of it; for a joint that slides the share alone."""


def joint_range(experiment: Experiment) -> tuple[Array, Array]:
    """Pendant angles (n,) between which poses are planned: the allowed ones less a margin to the controller's limits.

    Joints whose limits or angles the experiment states itself are taken at its word.
    """
    lower, upper = allowed_range(experiment)
    controller, constraints = experiment.robot.controller, experiment.constraints
    ends = np.array(controller.lower), np.array(controller.upper)
    wide = ends[1] - ends[0]
    turns = ~np.array(controller.units.sliding)
    usual = np.minimum(np.maximum(_MARGIN * turns, _MARGIN_SHARE * wide), _MOST_SHARE * wide)
    margin = constraints.joint_margin
    margins = usual if margin is None else np.where(turns, margin, usual)
    own = {*constraints.joint_limits, *constraints.joint_values}
    margins *= [joint not in own for joint in experiment.robot.facts.driven]
    if np.any(2.0 * margins >= wide):
        k = int(np.argmax(2.0 * margins - wide))
        said = f"the margin of {controller.units[k].text(float(margins[k]))} to the limits of"
        raise InputError(f"{said} {experiment.robot.facts.driven[k]} leaves no range")
    return np.maximum(lower, ends[0] + margins), np.minimum(upper, ends[1] - margins)


def allowed_range(experiment: Experiment) -> tuple[Array, Array]:
    """Pendant angles (n,) that the controller's limits and the experiment's allow."""
    controller = experiment.robot.controller
    lower, upper = np.array(controller.lower), np.array(controller.upper)
    for joint, (low, high) in experiment.constraints.joint_limits.items():
        k = experiment.robot.facts.driven.index(joint)
        lower[k], upper[k] = max(lower[k], low), min(upper[k], high)
        if lower[k] >= upper[k]:
            raise InputError(
                f"constraints leave no range for {joint}: the controller's limits and joint_limits exclude each other"
            )
    return lower, upper


def check_poses(experiment: Experiment, model: Model, pendant: Array) -> dict[str, Flags]:
    """For each constraint of the experiment, which poses (N,) keep it."""
    poses, tolerance = _without_load(experiment, pendant), experiment.robot.controller.tolerance

    def within(ends: tuple[Array, Array]) -> Flags:
        return np.all((pendant >= ends[0] - tolerance) & (pendant <= ends[1] + tolerance), axis=1)

    allowed: dict[str, Flags] = {
        "joint limits": within(allowed_range(experiment)),
        "joint_margin": within(joint_range(experiment)),
        "transmission angle": model.transmission_margin(poses) >= 0.0,
    }
    allowed |= _check_places(experiment, poses.q, _check_placed)
    return allowed | _check_torques(experiment, model, poses)


def check_contact(experiment: Experiment, pendant: Array) -> dict[str, Flags]:
    """Of the constraints of `check_poses` those on contact alone."""
    return _check_places(experiment, experiment.robot.controller.to_joints(pendant), _check_contact)


def check_way(experiment: Experiment, model: Model, pendant: Array) -> dict[str, Flags]:
    """For each constraint that holds between the poses of a plan too, which poses (N,) keep it.

    Between poses nothing is read and nothing hung: torques, sight and margins are of the poses alone, and the limits
    are the controller's.
    """
    poses = _without_load(experiment, pendant)
    allowed: dict[str, Flags] = {
        "joint limits": ~np.any(experiment.robot.controller.outside(pendant), axis=1),
        "transmission angle": model.transmission_margin(poses) >= 0.0,
    }
    return allowed | _check_places(experiment, poses.q, _check_clear)


def on_one_side(experiment: Experiment, pendant: Array) -> Flags:
    """Which of N poses have every loop on the side of flat where most have it: no way leads over flat."""
    facts, q = experiment.robot.facts, experiment.robot.controller.to_joints(pendant)
    own = np.zeros(len(q), dtype=int)
    for loop in (effect for effect in experiment.model().effects if isinstance(effect, Loop)):
        joints = [facts.joint_index(joint) for joint in loop.joints(facts) if joint in facts.joints]
        own = 2 * own + (loop.side(q[:, joints], facts) > 0.0)
    return np.asarray(own == np.bincount(own).argmax())


def _without_load(experiment: Experiment, pendant: Array) -> Poses:
    return Poses(pendant, experiment.robot.controller.to_joints(pendant), np.zeros((len(pendant), 6)))


def touching(experiment: Experiment, pendant: Array) -> dict[str, tuple[str, ...]]:
    """Of each of N poses what touches what, by the constraint: `link_2 and link_5`, `link_4 and table`; "" for none."""
    robot = experiment.robot
    placed = joint_frames(robot.facts, robot.controller.to_joints(pendant))
    colliders = {"collision": collider_of(experiment), "obstacles": _around(experiment)}
    return {name: collider.named(placed, robot.facts) for name, collider in colliders.items() if len(collider.pairs)}


def broken_constraints(experiment: Experiment, plan: Plan) -> dict[str, tuple[str, ...]]:
    """The poses of a plan that break a constraint of the experiment, by the constraint's name."""
    found = check_poses(experiment, experiment.model(), plan.pendant)
    names = {c: tuple(p for p, ok in zip(plan.pose, allowed, strict=True) if not ok) for c, allowed in found.items()}
    return {constraint: poses for constraint, poses in names.items() if poses}


class Removal(NamedTuple):
    """Of the poses tried: how many a constraint removed after those before it, by itself, and as the only one."""

    in_order: int
    alone: int
    only: int


def count_removed(allowed: Mapping[str, Flags]) -> dict[str, Removal]:
    """What each constraint removed of the poses that `check_poses` looked at.

    `in_order` counts poses that no constraint before it had removed; `alone` all that break it;
    `only` those that break nothing else, which dropping the constraint would win.
    """
    broken = {name: ~flags for name, flags in allowed.items()}
    total = sum((b.astype(int) for b in broken.values()), np.zeros(1, dtype=int))
    gone = np.zeros(1, dtype=bool)
    out: dict[str, Removal] = {}
    for name, b in broken.items():
        out[name] = Removal(int((b & ~gone).sum()), int(b.sum()), int((b & (total == 1)).sum()))
        gone = gone | b
    return out


def reference_point(experiment: Experiment, model: Model, q: Array) -> Array:
    """Base-frame position (N, 3) of the point that the workspace constraints speak of."""
    site = _site(experiment)
    points = [placed.point(site.link, site.xyz).T for placed in _blocks(experiment.robot, q)]
    return np.concatenate([np.zeros((0, 3)), *points])


def singularity_margin(robot: Robot, placed: Frames) -> Array:
    """Smallest singular value (N,) of the Jacobian at the wrist centre, translations per length of the arm.

    The wrist centre is the origin of the last link but one; the length of the arm is the sum of the
    distances from joint to joint, from the second one to there.
    """
    facts = robot.facts
    centre = placed.positions[facts.n - 1]
    columns = twists(placed, facts.n, centre)
    length = float(np.linalg.norm(facts.placements[2 : facts.n - 1, :3, 3], axis=1).sum())
    J = np.concatenate([columns.linear / (length or 1.0), columns.angular], axis=1).transpose(2, 1, 0)
    if facts.passive:
        J = J @ robot.controller.following
    return np.asarray(np.linalg.svd(J, compute_uv=False)[:, -1], dtype=np.float64)


def collider_of(experiment: Experiment) -> Collider:
    """The pairs of the arm's solids, and of the tool's sphere, that keep apart; none with `collision: false`."""
    limits, site = experiment.constraints, experiment.load_site
    if limits.collision is False:
        return Collider((), np.zeros((0, 2), dtype=np.intp), limits.clearance, ())
    return _collider(experiment.robot, limits.clearance, limits.tool_radius, site.link, tuple(site.xyz.tolist()))


@lru_cache(maxsize=8)
def _collider(
    robot: Robot, clearance: float, radius: float | None, link: int, xyz: tuple[float, float, float]
) -> Collider:
    return make_collider(robot, clearance, tool_shapes(radius, link, np.array(xyz)))


def _around(experiment: Experiment) -> Collider:
    """The pairs of obstacles and of what moves."""
    limits = experiment.constraints
    return obstacle_collider(experiment.robot, limits.obstacles, limits.clearance, _tool(experiment))


def _tool(experiment: Experiment) -> tuple[Shape, ...]:
    site = experiment.load_site
    return tool_shapes(experiment.constraints.tool_radius, site.link, site.xyz)


def _site(experiment: Experiment) -> Site:
    robot, of = experiment.robot, experiment.constraints.of
    if of == "wrist_centre":
        return Site(robot.facts.n - 1, np.zeros(3))
    if of == "load_point":
        return experiment.load_site
    frame = robot.flange if of == "flange" else robot.frames[of]
    return Site(frame.link, frame.placement[:3, 3])


def _blocks(robot: Robot, q: Array) -> Iterator[Frames]:
    return (joint_frames(robot.facts, q[start : start + _BLOCK]) for start in range(0, len(q), _BLOCK))


def _check_places(
    experiment: Experiment, q: Array, check: Callable[[Experiment, Frames], dict[str, Flags]]
) -> dict[str, Flags]:
    """The constraints that only ask where the arm stands."""
    parts = [check(experiment, placed) for placed in _blocks(experiment.robot, q)]
    return {name: np.concatenate([part[name] for part in parts]) for name in (parts[0] if parts else {})}


def _check_placed(experiment: Experiment, placed: Frames) -> dict[str, Flags]:
    limits = experiment.constraints
    allowed = _check_clear(experiment, placed)
    if limits.singularity_margin is not None:
        allowed["singularity_margin"] = singularity_margin(experiment.robot, placed) >= limits.singularity_margin
    if limits.sight is not None:
        allowed["sight"] = _check_sight(experiment, placed)
    return allowed


def _check_clear(experiment: Experiment, placed: Frames) -> dict[str, Flags]:
    """The constraints on where the arm is, which the way keeps too."""
    limits, site = experiment.constraints, _site(experiment)
    point = placed.point(site.link, site.xyz)
    allowed: dict[str, Flags] = {}
    for k, axis in enumerate("xyz"):
        low, high = getattr(limits, f"{axis}_min"), getattr(limits, f"{axis}_max")
        if low is not None:
            allowed[f"{axis}_min"] = point[k] >= low
        if high is not None:
            allowed[f"{axis}_max"] = point[k] <= high
    if limits.axis1_distance_min is not None:
        allowed["axis1_distance_min"] = axis1_distance(experiment.robot, placed, point) >= limits.axis1_distance_min
    if limits.floor is not None:
        allowed["floor"] = above_floor((*experiment.robot.shapes, *_tool(experiment)), placed, limits.floor)
    return allowed | _check_contact(experiment, placed)


def _check_contact(experiment: Experiment, placed: Frames) -> dict[str, Flags]:
    """The constraints on what touches what, which take longest to tell."""
    allowed: dict[str, Flags] = {}
    if len((own := collider_of(experiment)).pairs):
        allowed["collision"] = ~own.collides(placed)
    if experiment.constraints.obstacles:
        allowed["obstacles"] = ~_around(experiment).collides(placed)
    return allowed


def axis1_distance(robot: Robot, placed: Frames, point: Array) -> Array:
    """Distance (N,) m of a point from the base's z axis, of an arm that slides from the first axis that turns."""
    facts = robot.facts
    if not facts.sliding[0] or all(facts.sliding):
        return np.hypot(point[0], point[1])
    first = facts.sliding.index(False)
    return np.asarray(
        np.linalg.norm(cross(placed.axes[first], point - placed.origins[first]), axis=0), dtype=np.float64
    )


def _check_sight(experiment: Experiment, placed: Frames) -> Flags:
    sight, robot = experiment.constraints.sight, experiment.robot
    good = np.ones(placed.positions.shape[-1], dtype=bool)
    for marker in experiment.markers:
        if sight is not None and (sight.markers is None or marker.name in sight.markers):
            site = experiment.site(marker.link, marker.xyz)
            good &= visible(robot.shapes, placed, sight.station, site.link, site.xyz, sight.clearance)
            if sight.incidence_max is not None and marker.normal is not None:
                normal = experiment.frame_of(marker.link).placement[:3, :3] @ marker.normal
                good &= incidence(placed, sight.station, site.link, site.xyz, normal) <= sight.incidence_max
    return good


def _check_torques(experiment: Experiment, model: Model, poses: Poses) -> dict[str, Flags]:
    """The constraints on torques, under no load and every load of the experiment."""
    limits, robot = experiment.constraints, experiment.robot
    wrenches = [load.wrench for load in experiment.loads]
    allowed: dict[str, Flags] = {}
    if limits.flip_margin is not None:
        margin = flip_margin(model, _under(poses, wrenches)).reshape(len(wrenches), len(poses))
        allowed["flip_margin"] = np.all(margin >= limits.flip_margin, axis=0)
    if limits.load_capacity and robot.torque_limits is not None:
        torque = np.abs(actuator_torques(model, _under(poses, [np.zeros(6), *wrenches])))
        light = (torque <= robot.torque_limits).all(axis=1)
        allowed["load_capacity"] = np.all(light.reshape(1 + len(wrenches), len(poses)), axis=0)
    return allowed


def _under(poses: Poses, wrenches: Sequence[Array]) -> Poses:
    """All poses under each of several loads, load by load."""
    count = len(wrenches)
    loaded = np.repeat(np.reshape(wrenches, (count, 6)), len(poses), axis=0)
    return Poses(np.tile(poses.pendant, (count, 1)), np.tile(poses.q, (count, 1)), loaded)
