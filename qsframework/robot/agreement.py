"""Each robot that is loaded holds the batch kernel to Pinocchio, at a few poses, in a millisecond or two."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qsframework.errors import InputError, Problem
from qsframework.plugin import Array
from qsframework.robot.gravity import element_gravity
from qsframework.robot.kinematics import joint_frames, twists
from qsframework.robot.reference import Statics, reference_branches, reference_statics
from qsframework.robot.robot import Robot

if TYPE_CHECKING:
    import pinocchio as pin

POSES = 5
ALLOWED = 1e-9
"""m, rad, m/rad, rad/rad; of torques, of the largest torque."""
_ROUNDING = 1e-13
"""What float64 itself may lose of the largest number that occurs, with room: for arms of absurd size, and for arms
whose joints bear nothing but rounding."""
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def check_agreement(robot: Robot, file: Path, tree: pin.Model | None = None) -> None:
    """InputError if positions, attitudes, Jacobians or gravity torques of the batch kernel are not Pinocchio's.

    file: the robot.yaml that the error names; tree: the arm with its branches, where it has any
    """
    q = robot.controller.to_joints(spread_poses(robot.controller.lower, robot.controller.upper))
    problems = list(_differences(robot, kernel_statics(robot, q), reference_statics(robot, q), str(file)))
    if tree is not None:
        problems += _branch_differences(robot, tree, q, str(file))
    if problems:
        hint = (
            "Nothing computed from this robot can be trusted. Its files are not to blame but the software: "
            f"this is Pinocchio (pin) {version('pin')}. Install the versions of requirements.lock with make install; "
            "if it stays, report it with the robot's folder."
        )
        raise InputError([*problems[:-1], replace(problems[-1], hint=hint)])


def spread_poses(lower: Array, upper: Array) -> Array:
    """Pendant angles (5, n): each joint visits every part of its range once, in an order of its own.

    No random numbers: to import them takes longer than the whole check.
    """
    joint, pose = np.arange(len(lower)), np.arange(POSES)[:, None]
    part = (pose * (1 + joint % (POSES - 1)) / POSES + _GOLDEN * (joint + 1)) % 1.0
    return lower + part * (upper - lower)


def kernel_statics(robot: Robot, q: Array) -> Statics:
    """What `reference_statics` says, by the batch kernel."""
    placed, link, flange = joint_frames(robot.facts, q), robot.flange.link, robot.flange.placement
    point, turned = placed.point(link, flange[:3, 3]), placed.matrix(link) @ flange[:3, :3]
    columns = twists(placed, link, point)
    return Statics(
        np.concatenate([placed.positions, point[None]]),
        np.concatenate([placed.rotations.transpose(0, 2, 1, 3), turned.transpose(1, 2, 0)[None]]),
        columns.linear,
        columns.angular,
        element_gravity(placed, robot.facts.moments, robot.gravity),
    )


def _branch_differences(robot: Robot, tree: pin.Model, q: Array, file: str) -> Iterator[Problem]:
    """The same of the arm with its branches, which stand at angles of their own: no loop holds them here."""
    drawn = tuple(branch for branch in robot.facts.branches if branch.joint in tuple(tree.names))
    facts, count = replace(robot.facts, branches=drawn), robot.facts.n + 1
    part = (_GOLDEN * np.arange(1, POSES * len(facts.branches) + 1)) % 1.0
    every = np.concatenate([q, np.pi * (2.0 * part.reshape(POSES, -1) - 1.0)], axis=1)
    placed = joint_frames(facts, every)
    torque = element_gravity(placed, facts.moments, robot.gravity)
    positions, rotations, held = reference_branches(tree, facts, every)
    turned = placed.rotations[count:].transpose(0, 2, 1, 3)
    length, links = ALLOWED * (1.0 + _largest(positions)), facts.bodies[count:]
    yield from _told(robot, "position", "m", links, placed.positions[count:], positions, length, file)
    yield from _told(robot, "attitude", "rad", links, turned, rotations, ALLOWED, file)
    weight = ALLOWED * _largest(held) + _ROUNDING * float(np.linalg.norm(robot.gravity) * facts.masses.sum())
    yield from _told(robot, "gravity torque", "N m", facts.turning, torque, held, weight, file)


def _differences(robot: Robot, ours: Statics, theirs: Statics, file: str) -> Iterator[Problem]:
    """One problem for each quantity that differs, with the links or joints where it does."""
    facts, place = robot.facts, robot.flange.placement[:3, 3]
    reach = float(np.linalg.norm(facts.placements[:, :3, 3], axis=1).sum() + np.linalg.norm(place))
    levers = reach + np.linalg.norm(facts.centres, axis=1)
    weight = float(np.linalg.norm(robot.gravity) * (facts.masses @ levers))
    links = (*facts.links, "flange")
    length, torque = ALLOWED + _ROUNDING * reach, ALLOWED * _largest(theirs.torque) + _ROUNDING * weight
    for what, unit, names, quantity, allowed in (
        ("position", "m", links, "positions", length),
        ("attitude", "rad", links, "rotations", ALLOWED),
        ("Jacobian (linear)", "m/rad", facts.joints, "linear", length),
        ("Jacobian (angular)", "rad/rad", facts.joints, "angular", ALLOWED),
        ("gravity torque", "N m", facts.joints, "torque", torque),
    ):
        yield from _told(robot, what, unit, names, getattr(ours, quantity), getattr(theirs, quantity), allowed, file)


def _told(
    robot: Robot, what: str, unit: str, names: Sequence[str], ours: Array, theirs: Array, allowed: float, file: str
) -> Iterator[Problem]:
    """The names whose values (names, ...) are farther apart than allowed, in one problem."""
    apart = np.abs(ours - theirs).reshape(len(names), -1).max(axis=1)
    where = [repr(name) for name, d in zip(names, apart, strict=True) if not d <= allowed]  # NaN differs
    if where:
        message = f"robot {robot.name}: {what} of {', '.join(where)} by the batch kernel is not Pinocchio's"
        size = f"a difference of up to {float(apart.max()):.1e} {unit}"
        yield Problem(message, file=file, found=size, allowed=f"{allowed:.1e} {unit}")


def _largest(values: Array) -> float:
    return float(np.abs(values).max())
