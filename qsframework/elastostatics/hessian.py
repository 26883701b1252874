"""How the torques on the coordinates change when the arm gives: H = d(D' w + tau_0) / d eps, for (18).

For elements a <= b in chain order the tip's velocity changes by omega_a x v_b, so a force f held
fixed in the world gives H_ab = f . (omega_a x v_b); a moment m adds m . (omega_d x omega_c) to the
torque c for an element d before c. Gravity is a force at every mass centre.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsframework.elastostatics.loads import Applied, wrench_along
from qsframework.elastostatics.motion import Motion
from qsframework.elastostatics.pulls import Pull, on_coordinates
from qsframework.elastostatics.springs import Torques
from qsframework.elastostatics.state import State
from qsframework.plugin import Array
from qsframework.robot.gravity import mass_columns
from qsframework.robot.kinematics import Twists, cross


def load_hessian(
    state: State, applied: Applied, gravity: Array, torques: Torques, drawn: Sequence[Pull | None], weight: float = 1.0
) -> Array:
    """H (ne, ne, N): tip load (times `weight`, 0 for the unloaded state), gravity and compensators."""
    count, batch = len(state.motion.layout.chain), state.motion.q.shape[-1]
    elements, used = np.zeros((count, count, batch)), state.motion.used
    torque = np.zeros((count, batch))
    if weight:
        wrench = applied.wrench.T * weight
        _add_force(elements, used, state.tip.elements, wrench[:3])
        _add_moment(elements, used, state.tip.elements, wrench[3:])
        u = state.tip.elements.upstream
        torque[:u] += np.einsum("ecn,cn->en", state.tip.elements.linear, wrench[:3])
        torque[:u] += np.einsum("ecn,cn->en", state.tip.elements.angular, wrench[3:])
    pull = np.broadcast_to(gravity[:, None], (3, batch))
    for columns in mass_columns(state.placed, applied.moments):
        _add_force(elements, used, columns, pull)
        torque[: columns.upstream] += np.einsum("ecn,cn->en", columns.linear, pull)
    for joints, term in torques:
        rows = [state.motion.layout.joint_elements[j] for j in joints]
        elements[np.ix_(rows, rows)] += term.dq.transpose(1, 2, 0)
        torque[rows] += term.value.T
    for pull in drawn:
        if pull is not None and pull.acts:
            elements[np.ix_(pull.between, pull.between)] -= pull.stiffness()
            torque += pull.torque()
    return (
        on_coordinates(state.motion.coefficients, elements)
        + _curvature(state.motion, torque)
        + _turning(state, applied, weight)
    )


def _add_force(total: Array, used: Sequence[int], columns: Twists, force: Array) -> None:
    """H_ab += f . (omega_a x v_b) for a <= b, symmetric; of the elements that elastic coordinates move."""
    rows = np.array([e for e in used if e < columns.upstream], dtype=int)
    found = np.einsum("acn,bcn->abn", cross(force[None], columns.angular[rows]), columns.linear[rows])
    a, b = np.triu_indices(len(rows))
    total[rows[a], rows[b]] += found[a, b]
    a, b = np.triu_indices(len(rows), 1)
    total[rows[b], rows[a]] += found[a, b]


def _add_moment(total: Array, used: Sequence[int], columns: Twists, moment: Array) -> None:
    """H_cd += m . (omega_d x omega_c) for d < c: not symmetric."""
    if not np.any(moment):
        return
    rows = np.array([e for e in used if e < columns.upstream], dtype=int)
    found = np.einsum("dkn,ckn->dcn", cross(moment[None], columns.angular[rows]), columns.angular[rows])
    d, c = np.triu_indices(len(rows), 1)
    total[rows[c], rows[d]] += found[d, c]


def _curvature(motion: Motion, torque: Array) -> Array:
    """(dE/d eps)' torque: the loops bend the way from actuators to joints."""
    count = len(motion.coefficients)
    total = np.zeros((count, count, torque.shape[-1]))
    for place, term in zip(motion.layout.loops, motion.loops, strict=True):
        if not np.any(term.q_uu):
            continue
        joints = [motion.layout.joint_elements[j] for j in place.joints]
        bend = np.einsum("niuv,in->uvn", term.q_uu, torque[joints])
        inside = [
            (c, index, part.factor)
            for c, parts in enumerate(motion.layout.coordinates)
            for part in parts
            if (index := _position(place.joints, place.bars, part.kind, part.index)) is not None
        ]
        for c, u, first in inside:
            for d, v, second in inside:
                total[c, d] += first * second * bend[u, v]
    return total


def _position(joints: tuple[int, ...], bars: tuple[int, ...], kind: str, index: int) -> int | None:
    """Position of an actuator or bar among a loop's inputs u = (actuators, bars)."""
    if kind == "actuator" and index in joints:
        return joints.index(index)
    if kind == "bar" and index in bars:
        return len(joints) + bars.index(index)
    return None


def _turning(state: State, applied: Applied, weight: float) -> Array | float:
    """Loads that turn with the flange: D' (dw / d rotation) times the flange's rotation per coordinate."""
    turning = [term.d_rotation for term in applied.terms if term.d_rotation is not None]
    if not turning or not weight:
        return 0.0
    change = weight * wrench_along(applied.terms, state.tip.angular, None).transpose(0, 2, 1)
    linear = np.einsum("ekn,dkn->edn", state.tip.linear, change[:, :3])
    return linear + np.einsum("ekn,dkn->edn", state.tip.angular, change[:, 3:])
