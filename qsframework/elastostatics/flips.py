"""Does a load press a parallelogram's passive joints on the other side than the arm's own weight does?

The coupling bar carries the torque of the loop's driven actuator. If the load changes its sign, the
play of the passive joints is crossed, the displacement jumps by it, and the reading says nothing
about stiffness (section 3.3 of the paper). Such poses are left out of plans, with a margin.
"""

from __future__ import annotations

import numpy as np

from qsframework.elastostatics.structure import CHUNK, Structure
from qsframework.elastostatics.torques import element_torques
from qsframework.plugin import Array, Poses


def flip_margin(model: Structure, poses: Poses, x: Array | None = None) -> Array:
    """Torque (N,) N m that keeps the passive joints of every loop pressed on the unloaded side.

    The smaller of the torques of the driven actuator, unloaded and loaded, counted in the unloaded
    direction: negative where the load flips the joint; infinite for an arm without loops.
    """
    x = model.nominal if x is None else x
    parts = [_margin(model, poses.take(slice(s, s + CHUNK)), x) for s in range(0, len(poses), CHUNK)]
    return np.concatenate(parts) if parts else np.zeros(0)


def _margin(model: Structure, poses: Poses, x: Array) -> Array:
    motion, own, added = element_torques(model, poses, x)
    margin = np.full(len(poses), np.inf)
    for place, term in zip(model.layout.loops, motion.loops, strict=True):
        joints = [model.layout.joint_elements[j] for j in place.joints]
        for member in place.members:
            if not member.bars:  # a coupling without passive joints
                continue
            rate = term.q_u[:, :, member.joints[-1]].T  # the driven actuator is the loop's last
            unloaded = np.einsum("jn,jn->n", rate, own[joints])
            loaded = unloaded + np.einsum("jn,jn->n", rate, added[joints])
            margin = np.minimum(margin, np.minimum(np.abs(unloaded), np.sign(unloaded) * loaded))
    return margin
