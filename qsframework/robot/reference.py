"""The arm by Pinocchio alone: what our own kinematics and gravity torques are compared with."""

from __future__ import annotations

import numpy as np

from qsframework.plugin import Array
from qsframework.robot.robot import Robot


def reference_flange(robot: Robot, q: Array) -> Array:
    """Placements (N, 4, 4) of the flange at joint angles (N, n)."""
    import pinocchio as pin

    data, out = robot.model.createData(), np.empty((len(q), 4, 4))
    for i, angles in enumerate(q):
        pin.forwardKinematics(robot.model, data, angles)
        out[i] = data.oMi[robot.flange.link].homogeneous @ robot.flange.placement
    return out


def reference_gravity(robot: Robot, q: Array) -> Array:
    """Torques (N, n) N m that hold the arm against its own weight, joint by joint, without loops and springs."""
    import pinocchio as pin

    data = robot.model.createData()
    return np.array([pin.computeGeneralizedGravity(robot.model, data, angles).copy() for angles in q])
