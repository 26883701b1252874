"""The tip where springs, weight and a force are in balance, by Pinocchio and Newton on the slope of the energy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

JointMap = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Joint angles (nq,) of a model and their rates (nq, n) by the actuators (n,)."""


def energy_tip(
    model: pin.Model, q_of: JointMap, c: np.ndarray, force: np.ndarray, phi: np.ndarray, joint: int, tool: np.ndarray
) -> np.ndarray:
    """Position (3,) m of a point of a joint's link; c: compliances (n,), 0 for rigid; phi: commanded actuators (n,)."""
    data = model.createData()
    soft = np.flatnonzero(c)
    eps = np.zeros(len(c))

    def slope(eps: np.ndarray) -> np.ndarray:
        q, G = q_of(phi + eps)
        pin.computeJointJacobians(model, data, q)
        J = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
        arm = data.oMi[joint].rotation @ tool
        load = J[:3].T @ force + J[3:].T @ np.cross(arm, force)
        return (eps / np.where(c > 0, c, 1) - G.T @ (load - pin.computeGeneralizedGravity(model, data, q)))[soft]

    for _ in range(30):
        H = np.empty((len(soft), len(soft)))
        for j, k in enumerate(soft):
            h = np.zeros(len(c))
            h[k] = 1e-6
            H[:, j] = (slope(eps + h) - slope(eps - h)) / 2e-6
        step = np.linalg.solve(H, slope(eps))
        eps[soft] -= step
        if np.abs(step).max() < 1e-14:
            break
    pin.forwardKinematics(model, data, q_of(phi + eps)[0])
    return data.oMi[joint].act(tool)
