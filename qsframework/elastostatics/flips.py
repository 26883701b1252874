"""Does a load press a loop's passive joints on the other side than the arm's own weight does?

A passive joint passes on what lies beyond it, seen from the loop's actuator: the joint of bar and driven link the
torque of the arm, that of lever and bar the bar's weight too; what hangs on the lever the actuator holds alone. The
torque vanishes where the vertical through the mass centre of all that lies beyond crosses the joint on which it
turns. If the load changes its sign, the play of the joint is crossed, the displacement jumps by it, and the reading
says nothing about stiffness (section 3.3 of the paper). Such poses are left out of plans, with a margin.
"""

from __future__ import annotations

import numpy as np

from qsframework.elastostatics.layout import LoopPlace, Member
from qsframework.elastostatics.motion import Motion
from qsframework.elastostatics.structure import Structure, chunks
from qsframework.elastostatics.torques import element_torques
from qsframework.plugin import Array, Poses


def flip_margin(model: Structure, poses: Poses) -> Array:
    """Torque (N,) N m that keeps the passive joints of every loop pressed on the unloaded side.

    The smallest of the torques that they pass on to the driven actuator, unloaded and loaded, counted in the unloaded
    direction: negative where the load flips a joint; infinite for an arm without loops.
    """
    return np.concatenate([_margin(model, chunk, model.nominal) for _, chunk in chunks(poses)])


def _margin(model: Structure, poses: Poses, x: Array) -> Array:
    margin = np.full(len(poses), np.inf)
    passive = [
        (number, place, member, _near(model, place, member, beyond))
        for number, place in enumerate(model.layout.loops)
        for member in place.members
        for beyond in member.loop.carried(model.facts)
    ]
    if not passive:
        return margin
    motion, every, added = element_torques(model, poses, x, [near for _, _, _, near in passive])
    for (number, place, member, _), own in zip(passive, every, strict=True):
        unloaded, load = (_passed_on(model, motion, number, place, member, torque) for torque in (own, added))
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
