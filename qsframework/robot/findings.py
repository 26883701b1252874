"""What deserves a look in a robot's files though they can be read: values, limits and loops unlike the arm."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from qsframework.errors import InputError
from qsframework.plugin import Array, Context, Loop, ParallelSpring, Parameter, Poses, TensionTerm, TorqueTerm
from qsframework.robot.agreement import kernel_statics, spread_poses
from qsframework.robot.kinematics import joint_frames, twists
from qsframework.robot.robot import Robot
from qsframework.robot.sight import depth
from qsframework.robot.statics import GravityCheck
from qsframework.units import SLIDES, TURNS

_BESIDE = 0.45
"""Of a lever's length: how far its pivot may stand outside what is drawn of its link; the shipped arms' do to 0.28."""

_NATURAL, _WEAKER, _WIDER = (1e-4, 100.0), 0.05, 2.5
"""Shares beyond which values are unlikely: of a parameter's typical size (of the shipped arms 0.03 to 6.4); of the
links' own torque, for an actuator; of the URDF's range (1)."""
_NOTHING, _STRONGER = 0.15, 1.5
"""Shares of gravity's torque at its joints beyond which a balancer is impossible: of the links' alone, below (of the
shipped balancers 0.45 to 1.22, so that a tenth is seen), and of the links' with the payload at full reach, above (0.19
to 0.46, so that a tenfold one is seen). The share of the links' torque that it takes off over the range, by least
squares, is 0.41 to 1.30 of the shipped ones: below zero it pulls with the weight."""
_ROUNDING = 1e-9
"""Of a balancer's largest torque: what it exerts on joints that it does not span."""


def robot_findings(robot: Robot) -> tuple[GravityCheck, ...]:
    """All that is found; none of a robot whose files agree with one another."""
    return (*_balancers(robot), *_sizes(robot), *_strengths(robot), *_limits(robot), *_loops(robot), *_pendant(robot))


def _sizes(robot: Robot) -> Iterator[GravityCheck]:
    """Compliances, stiffnesses and masses far from what an arm of this size has."""
    for p in robot.parameters:
        if p.lower == 0.0 and p.nominal and not _NATURAL[0] <= p.nominal / p.typical <= _NATURAL[1]:
            low, high = (share * p.typical for share in _NATURAL)
            text = (
                f"nominal.yaml has {p.nominal:.3g} {p.unit}; an arm of this size has {low:.1g} to {high:.1g} {p.unit}"
            )
            yield GravityCheck(p.name, False, f"{text}: look at the unit and the digits")


def _strengths(robot: Robot) -> Iterator[GravityCheck]:
    """Balancers that exert far more than there is to balance, next to nothing of it, or that pull with the weight, and
    actuators that bear far less than the arm weighs."""
    facts, q = robot.facts, robot.controller.to_joints(spread_poses(robot.controller.lower, robot.controller.upper))
    gravity = kernel_statics(robot, q).torque[: facts.n]
    weight = np.abs(gravity).max(axis=1)
    for spring in (e for e in robot.effects if isinstance(e, ParallelSpring)):
        torque = _exerted(robot, spring, q) if set(spring.joints(facts)) <= set(facts.joints) else np.zeros((0, 0))
        most = float(np.abs(torque).max(initial=0.0))
        if not (most and facts.masses.any()):
            continue  # it pulls at a bar of a loop, or stands at no values; or the arm weighs nothing
        joints = np.abs(torque).max(axis=1) > _ROUNDING * most
        links = float(weight[joints].max())
        needed = links + facts.sizes.torque
        relieves = float(np.sum(torque[joints] * gravity[joints])) < 0.0
        if not relieves or most > _STRONGER * needed or most < _NOTHING * links:
            values = ", ".join(_stated(p) for p in robot.parameters if p.name.startswith(f"{spring.name}."))
            with_it = "" if relieves else " and pulls with the weight"
            text = f"it exerts up to {most:.3g} N m{with_it}; gravity's torque there is {links:.3g} N m of the links"
            yield GravityCheck(spring.name, False, f"{text}, {needed:.3g} N m with the payload: look at {values}")
    for k, limit in enumerate(robot.torque_limits if robot.torque_limits is not None else ()):
        if limit < _WEAKER * weight[k]:
            unit = (SLIDES if facts.slides(facts.joints[k]) else TURNS).load
            text = f"its actuator bears {limit:.3g} {unit}, but the links alone load it with {weight[k]:.3g} {unit}"
            yield GravityCheck(facts.joints[k], False, f"{text}: look at the unit; it is that behind the gear")


def _exerted(robot: Robot, spring: ParallelSpring, q: Array) -> Array:
    """The torque (n, N) on the joints, N m, of a balancer with its nominal values at joint angles q (N, n)."""
    facts, placed = robot.facts, joint_frames(robot.facts, q)
    known = {p.name: p.nominal for p in robot.parameters}
    x = np.array([known[p.name] for p in spring.parameters(facts)])
    context = Context(facts, Poses(q, q, np.zeros((len(q), 6))), False)
    torque, ends = np.zeros((facts.n, len(q))), spring.ends(facts)
    if ends is None:
        joints = [facts.joint_index(joint) for joint in spring.joints(facts)]
        term = spring.torque(q[:, joints], x, context)
        if term is not None:
            torque[joints] = (term.value if isinstance(term, TorqueTerm) else term).T
        return torque
    speed, apart = np.zeros((facts.n, 3, len(q))), np.zeros((3, len(q)))
    for end, sign in zip(ends, (-1.0, 1.0), strict=True):
        link, frame = facts.frame_of(end.link)
        point = placed.point(link, (frame @ np.append(end.xyz, 1.0))[:3])
        columns = twists(placed, link, point).linear[: facts.n]
        apart += sign * point
        speed[: len(columns)] += sign * columns
    length = np.linalg.norm(apart, axis=0)
    pull = spring.tension(length, x, context)
    return -(pull.value if isinstance(pull, TensionTerm) else pull) * np.einsum("cn,ecn->en", apart / length, speed)


def _stated(p: Parameter) -> str:
    return f"{p.name.rpartition('.')[2]} {p.nominal:.4g} {p.unit}".rstrip()


def _limits(robot: Robot) -> Iterator[GravityCheck]:
    """Joints that turn or slide much farther by robot.yaml than by the URDF."""
    control = robot.controller
    for i, joint in enumerate(robot.facts.driven):
        k, unit = robot.facts.joint_index(joint), control.units[i]
        own = robot.model.joints[k + 1]
        if own.nq != 1:
            continue  # it turns without an end
        stated = float(robot.model.upperPositionLimit[own.idx_q] - robot.model.lowerPositionLimit[own.idx_q])
        span = float(control.upper[i] - control.lower[i])
        if np.isfinite(stated) and span > _WIDER * stated:
            text = f"limits span {span * unit.per:.4g} {unit.shown} in robot.yaml, {stated * unit.per:.4g} in the URDF"
            yield GravityCheck(joint, False, f"{text}: compare both with the manual")


def _pendant(robot: Robot) -> Iterator[GravityCheck]:
    """Parallelograms whose actuator shows an angle that `equals` does not make of the pendant's."""
    facts = robot.facts
    for loop in (e for e in robot.effects if isinstance(e, Loop)):
        joints = loop.joints(facts)
        if len(joints) < 2 or not set(joints[:2]) <= set(facts.driven):
            continue
        q = np.zeros((3, len(joints)))
        q[1:, 0] = 0.1, 0.2
        try:
            shown = loop.actuators(q, facts)[:, 1]
        except InputError:
            continue  # its bars turn the actuator in no proportion
        slopes = np.diff(shown) / 0.1
        if not np.allclose(np.abs(slopes), 1.0):
            continue
        first, second = (facts.driven.index(joint) for joint in joints[:2])
        found = float(robot.controller.matrix[facts.joint_index(joints[1]), first])
        if not np.isclose(found, -slopes[0]):
            write = f"equals: J{second + 1} {'-' if slopes[0] > 0.0 else '+'} J{first + 1}"
            has = f"adds {found:g} J{first + 1}" if found else "has no equals"
            text = f"{joints[1]} {has}, so the loop does not close as its actuator turns: write {write}"
            yield GravityCheck(loop.name, False, f"{text}, where the forearm keeps its attitude as J{first + 1} turns")


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
        joints = [robot.facts.joint_index(j) for j in loop.joints(robot.facts) if j in robot.facts.joints]
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
    corner = placed.placement(joints[0])[0] @ robot.facts.placements[joints[0]] @ np.append(ends[0, 1, 1], 1.0)
    local = np.asarray(np.linalg.solve(placed.placement(driven)[0], corner), dtype=np.float64)[:3]
    outside = -max(depth(shape, local) for shape in solids)
    lever = float(np.linalg.norm(ends[0, 0, 1] - ends[0, 0, 0]))
    if outside > _BESIDE * lever:
        text = f"at zero joint angles its pivot stands {outside:.2f} m outside all that is drawn of "
        text += f"{robot.facts.links[driven]}: look at zero_deg and lever_m, or at the solids of the URDF"
        yield GravityCheck(loop.name, False, text)
