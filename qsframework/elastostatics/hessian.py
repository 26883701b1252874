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
from qsframework.elastostatics.springs import Torques, joint_rates, sandwich
from qsframework.elastostatics.state import State
from qsframework.plugin import Array
from qsframework.robot.gravity import mass_columns
from qsframework.robot.kinematics import Twists, cross


def load_hessian(
    state: State, applied: Applied, gravity: Array, torques: Torques, drawn: Sequence[Pull | None], weight: float = 1.0
) -> Array:
    """H (ne, ne, N): tip load (times `weight`, 0 for the unloaded state), gravity and compensators."""
    motion, wrench = state.motion, applied.wrench.T * weight
    pull = np.broadcast_to(gravity[:, None], wrench[:3].shape)
    acting = [(state.tip.elements, wrench[:3])] if weight else []
    acting += [(columns, pull) for columns in mass_columns(state.placed, applied.moments)]
    elements = _of_forces(acting, motion.used, wrench.shape[1])
    if weight:
        _add_moment(elements, motion.used, state.tip.elements, wrench[3:])
    place = {e: i for i, e in enumerate(motion.used)}
    coefficients = tuple(tuple((place[e], rate) for e, rate in terms) for terms in motion.coefficients)
    H = on_coordinates(coefficients, elements)
    for joints, term in torques:
        rates = joint_rates(motion, joints)
        H[np.ix_(rates.active, rates.active)] += sandwich(rates.E, term.dq.transpose(1, 2, 0), rates.E)
    drawn = [spring for spring in drawn if spring is not None and spring.acts]
    for spring in drawn:
        H -= spring.on(motion.coefficients, spring.stiffness())
    H += _turning(state, applied, weight)
    if motion.layout.loops:
        torque = sum((spring.torque() for spring in drawn), np.zeros((len(motion.layout.chain), wrench.shape[1])))
        for columns, force in acting:
            torque[: columns.upstream] += np.einsum("ecn,cn->en", columns.linear, force)
        if weight:
            columns = state.tip.elements
            torque[: columns.upstream] += np.einsum("ecn,cn->en", columns.angular, wrench[3:])
        for joints, term in torques:
            torque[[motion.layout.joint_elements[j] for j in joints]] += term.value.T
        H += _curvature(motion, torque)
    return H


def _of_forces(acting: Sequence[tuple[Twists, Array]], used: Sequence[int], batch: int) -> Array:
    """H_ab = f . (omega_a x v_b) for a <= b, symmetric (u, u, N), of the elements that elastic coordinates move."""
    total = np.zeros((len(used), len(used), batch))
    for columns, force in acting:
        own = [e for e in used if e < columns.upstream]
        lever = cross(force[None], columns.angular[own])
        total[: len(own), : len(own)] += np.einsum("acn,bcn->abn", lever, columns.linear[own])
    later, earlier = np.tril_indices(len(used), -1)
    total[later, earlier] = total[earlier, later]
    return total


def _add_moment(total: Array, used: Sequence[int], columns: Twists, moment: Array) -> None:
    """H_cd += m . (omega_d x omega_c) for d < c: not symmetric."""
    if not np.any(moment):
        return
    angular = columns.angular[[e for e in used if e < columns.upstream]]
    found = np.einsum("dkn,ckn->dcn", cross(moment[None], angular), angular)
    d, c = np.triu_indices(len(angular), 1)
    total[c, d] += found[d, c]


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
            if (index := place.input(part.kind, part.index)) is not None
        ]
        for c, u, first in inside:
            for d, v, second in inside:
                total[c, d] += first * second * bend[u, v]
    return total


def _turning(state: State, applied: Applied, weight: float) -> Array | float:
    """Loads that turn with the flange: D' (dw / d rotation) times the flange's rotation per coordinate."""
    turning = [term.d_rotation for term in applied.terms if term.d_rotation is not None]
    if not turning or not weight:
        return 0.0
    change = weight * wrench_along(applied.terms, state.tip.angular, None).transpose(0, 2, 1)
    linear = np.einsum("ekn,dkn->edn", state.tip.linear, change[:, :3])
    return linear + np.einsum("ekn,dkn->edn", state.tip.angular, change[:, 3:])
