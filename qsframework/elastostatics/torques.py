"""The static torques of the arm, of gravity, compensators and a load; and does a load flip a joint of a loop?

A passive joint passes on what lies beyond it, seen from the loop's actuator: the joint of bar and driven link the
torque of the arm, that of lever and bar the bar's weight too; what hangs on the lever the actuator holds alone. The
torque vanishes where the vertical through the mass centre of all that lies beyond crosses the joint on which it
turns. If the load changes its sign, the play of the joint is crossed, the displacement jumps by it, and the reading
says nothing about stiffness (section 3.3 of the paper). Such poses are left out of plans, with a margin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from qsframework.elastostatics import loads, pulls, springs
from qsframework.elastostatics.evaluation import move_commanded
from qsframework.elastostatics.layout import LoopPlace, Member
from qsframework.elastostatics.motion import Motion
from qsframework.elastostatics.state import State, place
from qsframework.elastostatics.structure import Structure, chunks
from qsframework.plugin import Array, Load, ParallelSpring, Poses
from qsframework.robot.gravity import element_gravity


def element_torques(
    model: Structure, poses: Poses, x: Array, without: Sequence[Sequence[int]]
) -> tuple[Motion, list[Array], Array]:
    """The motion, and the torques (m, N) N m on every element: of gravity and compensators, and of the load.

    without: sets of bodies whose weight is left out; the first torques are those of each
    """
    _, motion = move_commanded(model, poses, x)
    state = place(motion, model.tip, ())
    applied = loads.apply_loads(model.of_kind(Load, x), state.tip.rotation, motion.context)
    own: list[Array] = []
    for some in without:
        hung = applied.moments.copy()
        hung[list(some)] = 0.0
        own.append(_own_torque(model, state, replace(applied, moments=hung), x))
    tip = state.tip.elements
    wrench = applied.wrench.T
    added = np.zeros_like(own[0])
    added[: tip.upstream] = np.einsum("ecn,cn->en", tip.linear, wrench[:3])
    added[: tip.upstream] += np.einsum("ecn,cn->en", tip.angular, wrench[3:])
    return motion, own, added


def actuator_torques(model: Structure, poses: Poses, x: Array | None = None) -> Array:
    """Torque (N, n) N m of gravity, compensators and load that each actuator holds, at the commanded pose.

    The actuator of a loop's driven joint holds what the bars bring to it.
    """
    x = model.nominal if x is None else model.checked(x)
    return np.concatenate([_actuator_torques(model, chunk, x) for _, chunk in chunks(poses)])


def _actuator_torques(model: Structure, poses: Poses, x: Array) -> Array:
    motion, (own,), added = element_torques(model, poses, x, [()])
    joints = (own + added)[list(model.layout.joint_elements)]
    out = joints.copy()
    for loop, term in zip(model.layout.loops, motion.loops, strict=True):
        tied = list(loop.joints)
        out[tied] = np.einsum("njk,jn->kn", term.q_u[:, :, : len(tied)], joints[tied])
    return np.ascontiguousarray(out[: model.facts.n].T)


def _own_torque(model: Structure, state: State, applied: loads.Applied, x: Array) -> Array:
    """Torque (m, N) of gravity and compensators on every element of the chain."""
    torque = element_gravity(state.placed, applied.moments, model.gravity)
    for joints, term in springs.torques(model.of_kind(ParallelSpring, x), state.motion):
        torque[[model.layout.joint_elements[j] for j in joints]] += term.value.T
    for pull in pulls.pulls(model.of_kind(ParallelSpring, x), state.placed, state.motion.context):
        if pull is not None:
            torque += pull.torque()
    return torque


def flip_margin(model: Structure, poses: Poses) -> Array:
    """Torque (N,) N m that keeps the passive joints of every loop pressed on the unloaded side.

    The smallest of the torques that they pass on to the driven actuator, unloaded and loaded, counted in the unloaded
    direction: negative where the load flips a joint; infinite for an arm without loops.
    """
    return np.concatenate([_margin(model, chunk, model.nominal) for _, chunk in chunks(poses)])


def _margin(model: Structure, poses: Poses, x: Array) -> Array:
    margin = np.full(len(poses), np.inf)
    passive = [
        (number, at, member, _near(model, at, member, beyond))
        for number, at in enumerate(model.layout.loops)
        for member in at.members
        for beyond in member.loop.carried(model.facts)
    ]
    if not passive:
        return margin
    motion, every, added = element_torques(model, poses, x, [near for _, _, _, near in passive])
    for (number, at, member, _), own in zip(passive, every, strict=True):
        unloaded, load = (_passed_on(model, motion, number, at, member, torque) for torque in (own, added))
        held = np.minimum(np.abs(unloaded), np.sign(unloaded) * (unloaded + load))
        margin = np.minimum(margin, held)
    return margin


def _near(model: Structure, place: LoopPlace, member: Member, beyond: tuple[str, ...]) -> list[int]:
    """The bodies of a loop's own branches that do not lie beyond a joint."""
    facts = model.facts
    turned = [place.joints[j] for j in member.own]
    return [j + 1 for j in turned if j >= facts.n and facts.turning[j] not in beyond]


def _passed_on(model: Structure, motion: Motion, number: int, place: LoopPlace, member: Member, torque: Array) -> Array:
    """The driven actuator's share (N,) of torques (m, N) on every element."""
    driven = max(place.joints[j] for j in member.own if place.joints[j] < model.facts.n)
    rate = motion.loops[number].q_u[:, :, place.joints.index(driven)].T
    return np.einsum("jn,jn->n", rate, torque[[model.layout.joint_elements[j] for j in place.joints]])
