"""What deserves a look in a robot's files though they can be read: balancers without values, loops unlike the arm."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from qsframework.plugin import Array, Loop, ParallelSpring
from qsframework.robot.kinematics import Frames, joint_frames
from qsframework.robot.robot import Robot
from qsframework.robot.sight import depth
from qsframework.robot.statics import GravityCheck

_BESIDE = 0.45
"""Of a lever's length: how far its pivot may stand outside what is drawn of its link; the shipped arms' do to 0.28."""


def robot_findings(robot: Robot) -> tuple[GravityCheck, ...]:
    """All that is found; none of a robot whose files agree with one another."""
    return (*_balancers(robot), *_loops(robot))


def _balancers(robot: Robot) -> Iterator[GravityCheck]:
    """Springs between two pivots, of which nothing says how strong they pull: each pair of pivots is one balancer."""
    known = {p.name: p for p in robot.parameters}
    springs = [e for e in robot.effects if isinstance(e, ParallelSpring)]
    alike: dict[object, list[ParallelSpring]] = {}
    for spring in springs:
        ends = spring.outline(robot.facts)
        if ends is not None:
            alike.setdefault(tuple((p.link, *np.round(p.xyz, 4).tolist()) for p in ends), []).append(spring)
    for balancer in alike.values():
        own = [[known[p.name] for p in spring.parameters(robot.facts)] for spring in balancer]
        empty = [[p for p in mine if p.nominal == 0.0 and p.lower == 0.0] for mine in own]
        if all(empty):
            lacking = ", ".join(f"{p.name}: {{value_{p.unit}: ..}}" for p in empty[0])
            others = [p.name for p in own[0] if p not in empty[0] and not p.source]
            more = f"; {', '.join(others)} stand at assumed values" if others else ""
            text = f"a balancer without values holds nothing: nominal.yaml lacks {lacking}{more}"
            yield GravityCheck(balancer[0].name, False, text)


def _loops(robot: Robot) -> Iterator[GravityCheck]:
    """Loops that are flat where the pendant shows zero, or whose pivot stands far from the link that carries it."""
    zero = robot.controller.to_joints(np.zeros((1, robot.controller.axes)))
    reachable = not robot.controller.outside(np.zeros((1, robot.controller.axes))).any()
    for loop in (e for e in robot.effects if isinstance(e, Loop)):
        joints = [k for k in (_index(robot, joint) for joint in loop.joints(robot.facts)) if k is not None]
        if len(joints) < 2:
            continue
        q = np.zeros((1, len(loop.joints(robot.facts))))
        q[:, : len(joints)] = zero[:, joints]
        angle, least = float(np.min(loop.transmission_angle(q, robot.facts))), loop.smallest_transmission_angle
        if reachable and angle < least:
            text = (
                f"at the pendant's zero its bars stand {np.rad2deg(angle):.0f} deg from flat, less than its margin of "
            )
            yield GravityCheck(loop.name, False, f"{text}{np.rad2deg(least):.0f} deg: look at zero_deg")
            continue
        yield from _beside(robot, loop, joints)


def _beside(robot: Robot, loop: Loop, joints: list[int]) -> Iterator[GravityCheck]:
    """The loop's farther pivot against the solids of the link that it turns, at zero joint angles."""
    ends = loop.outline(np.zeros((1, len(loop.joints(robot.facts)))), robot.facts)
    driven = joints[1] + 1
    solids = [shape for shape in robot.shapes if shape.link == driven]
    if ends is None or not solids or ends.shape[1] < 2:
        return
    placed = joint_frames(robot.facts, np.zeros((1, robot.facts.n)))
    corner = _frame(placed, joints[0]) @ robot.facts.placements[joints[0]] @ np.append(ends[0, 1, 1], 1.0)
    local = (np.linalg.inv(_frame(placed, driven)) @ corner)[:3]
    outside = -max(depth(shape, local) for shape in solids)
    lever = float(np.linalg.norm(ends[0, 0, 1] - ends[0, 0, 0]))
    if outside > _BESIDE * lever:
        text = f"at zero joint angles its pivot stands {outside:.2f} m outside all that is drawn of "
        text += f"{robot.facts.links[driven]}: look at zero_deg and lever_m, or at the solids of the URDF"
        yield GravityCheck(loop.name, False, text)


def _index(robot: Robot, joint: str) -> int | None:
    return robot.facts.joint_index(joint) if joint in robot.facts.joints else None


def _frame(placed: Frames, link: int) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = placed.rotations[link, :, :, 0].T, placed.positions[link, :, 0]
    return out
