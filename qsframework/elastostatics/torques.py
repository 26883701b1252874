"""The static torques of the arm: what gravity, compensators and a load ask of each actuator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from qsframework.elastostatics import loads, pulls, springs
from qsframework.elastostatics.evaluation import move_commanded
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
