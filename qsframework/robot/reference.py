"""The arm by Pinocchio alone: what our own kinematics and gravity torques are compared with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qsframework.plugin import Array, RobotFacts
from qsframework.robot.robot import Robot

if TYPE_CHECKING:
    import pinocchio as pin


@dataclass(frozen=True, eq=False)
class Statics:
    """Where the arm is at N poses, how its flange moves, and what its weight does. Base axes, SI.

    positions (n + 2, 3, N) and rotations (n + 2, 3, 3, N) of the base, of the n links and of the flange;
    linear and angular (n, 3, N) of the flange per unit rate of each joint; torque (n, N) of the weight on each joint
    """

    positions: Array
    rotations: Array
    linear: Array
    angular: Array
    torque: Array


def reference_statics(robot: Robot, q: Array) -> Statics:
    """All of it at joint angles (N, n), pose by pose."""
    import pinocchio as pin

    model, data, n = robot.model, robot.model.createData(), robot.facts.n
    name = robot.facts.flange
    flange, aligned = model.getFrameId(name, pin.FrameType.BODY), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    places, columns, held = np.empty((n + 2, 4, 4, len(q))), np.empty((6, n, len(q))), np.empty((n, len(q)))
    for i, angles in enumerate(q):
        pin.computeJointJacobians(model, data, angles)
        columns[..., i] = pin.getFrameJacobian(model, data, flange, aligned).reshape(6, n)  # (6,) of one joint
        places[..., i] = [place.homogeneous for place in (*data.oMi, pin.updateFramePlacement(model, data, flange))]
        held[:, i] = pin.computeGeneralizedGravity(model, data, angles)
    linear, angular = columns[:3].transpose(1, 0, 2), columns[3:].transpose(1, 0, 2)
    return Statics(places[:, :3, 3], places[:, :3, :3], linear, angular, -held)


def reference_branches(tree: pin.Model, facts: RobotFacts, q: Array) -> tuple[Array, Array, Array]:
    """Of the whole tree at the angles (N, n + b) of arm and branches: where the branches are, and what all weighs.

    positions (b, 3, N), rotations (b, 3, 3, N), and the torque (n + b, N) of the weight on each joint
    """
    import pinocchio as pin

    names, data = list(tree.names), tree.createData()
    joints = [names.index(joint) for joint in facts.turning]
    places, held = np.empty((len(facts.branches), 4, 4, len(q))), np.empty((len(joints), len(q)))
    for i, angles in enumerate(q):
        own = np.empty(tree.nq)
        own[[k - 1 for k in joints]] = angles
        pin.forwardKinematics(tree, data, own)
        places[..., i] = [data.oMi[k].homogeneous for k in joints[facts.n :]]
        held[:, i] = pin.computeGeneralizedGravity(tree, data, own)[[k - 1 for k in joints]]
    return places[:, :3, 3], places[:, :3, :3], -held


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
