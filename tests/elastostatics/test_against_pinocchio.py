"""The batch model against a plain loop over Pinocchio, one pose at a time."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from qsframework.elastostatics import Model, Site, make_model
from qsframework.elastostatics.loads import gravity_torque
from qsframework.elastostatics.motion import move, nominal_actuators
from qsframework.elastostatics.state import State, place
from qsframework.plugin import Context, Poses
from qsframework.robot import Robot, load_robot

TIP = np.array([0.15, 0.0, 0.2])
MARKERS = (np.array([0.15, 0.1, 0.25]), np.array([-0.1, 0.2, 0.3]))


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("fanuc_m900ib")


@pytest.fixture(scope="module")
def model(robot: Robot) -> Model:
    markers = [(f"m{i}", Site(6, xyz)) for i, xyz in enumerate(MARKERS)]
    return make_model(robot.facts, robot.effects, robot.parameters, Site(6, TIP), markers, robot.gravity)


@pytest.fixture(scope="module")
def poses(robot: Robot) -> Poses:
    rng = np.random.default_rng(3)
    controller = robot.controller
    pendant = rng.uniform(controller.lower, controller.upper, (200, 6))
    wrench = rng.normal(0.0, 1.0, (200, 6)) * np.array([3e3] * 3 + [500.0] * 3)
    return Poses(pendant, controller.to_joints(pendant), wrench)


def jacobian(robot: Robot, data: pin.Data, q: np.ndarray, xyz: np.ndarray) -> np.ndarray:
    """Base-aligned Jacobian (6, 6) of a point of the last link, straight from Pinocchio."""
    pin.computeJointJacobians(robot.model, data, q)
    J = pin.getJointJacobian(robot.model, data, robot.model.njoints - 1, pin.LOCAL_WORLD_ALIGNED)
    arm = data.oMi[robot.model.njoints - 1].rotation @ xyz
    out = J.copy()
    out[:3] += np.cross(J[3:].T, arm).T
    return out


def test_the_model_agrees_with_a_plain_pinocchio_loop(robot: Robot, model: Model, poses: Poses) -> None:
    """t = D (diag(1/c) + K_par)^-1 D' w with D = J G, linear, G of the M-900iB's parallelogram written by hand."""
    data = robot.model.createData()
    G = np.eye(6)
    G[2, 1] = 1.0
    compliance = np.array([1 / 6e6, 1 / 7e6, 1 / 5e6, 1 / 1.2e6, 1e-6, 1 / 0.8e6])
    x = model.nominal
    x[model.index([f"joint_compliance[joint_{k}]" for k in range(1, 7)])] = compliance
    x[model.index(["compensator_stiffness[joint_2].stiffness"])] = 4e6
    predicted = model.predict(poses, x, linear=True)
    for i, q in enumerate(poses.q):
        D = jacobian(robot, data, q, TIP) @ G
        b, lc, l2, s0 = q[1], 0.235, 1.12, 0.70
        s = np.sqrt(lc**2 + l2**2 - 2 * lc * l2 * np.cos(b))
        eta = np.cos(b) + s0 * lc * l2 / s**3 * np.sin(b) ** 2 - s0 / s * np.cos(b)
        K = np.diag(1 / compliance)
        K[1, 1] += (4e6 + 1e5) * lc * l2 * eta
        eps = np.linalg.solve(K, D.T @ poses.wrench[i])
        for k, xyz in enumerate(MARKERS):
            plain = (jacobian(robot, data, q, xyz) @ G @ eps)[:3]
            assert np.abs(predicted[i, k] - plain).max() < 1e-12


def state_of(model: Model, poses: Poses) -> State:
    layout = model.layout
    phi = nominal_actuators(layout, np.ascontiguousarray(poses.q.T))
    motion = move(layout, Context(model.facts, poses), phi, np.zeros((layout.bars, len(poses))))
    return place(motion, model.tip, model.markers)


def test_positions_and_jacobians_agree_with_pinocchio(robot: Robot, model: Model, poses: Poses) -> None:
    state = state_of(model, poses)
    data = robot.model.createData()
    for i, q in enumerate(poses.q):
        J = jacobian(robot, data, q, TIP)
        tip = data.oMi[6].act(TIP)
        assert np.abs(state.tip.position[:, i] - tip).max() < 1e-12
        ours = np.concatenate([state.tip.elements.linear[..., i], state.tip.elements.angular[..., i]], axis=1).T
        assert np.abs(ours - J).max() < 1e-12


def test_gravity_torque_agrees_with_pinocchio(robot: Robot, model: Model, poses: Poses) -> None:
    """Joint torques of gravity, G' g(q): the masses load actuator 2 through the parallelogram too.

    Lever (60 kg, 0.75 m) and bar (40 kg) by their heights: their middles stand -0.375 sin J3 and
    -0.75 sin J3 + 0.56 cos J2 above axis 2.
    """
    state = state_of(model, poses)
    torque = gravity_torque(state, robot.facts.moments, np.asarray(robot.gravity))
    data = robot.model.createData()
    G = np.eye(6)
    G[2, 1] = 1.0
    for i, q in enumerate(poses.q):
        plain = -G.T @ pin.computeGeneralizedGravity(robot.model, data, q)
        J2, J3 = poses.pendant[i, 1:3]
        plain[1] += 9.81 * 40 * 0.56 * np.sin(J2)
        plain[2] += 9.81 * (60 * 0.375 + 40 * 0.75) * np.cos(J3)
        assert np.abs(torque[:, i] - plain).max() < 1e-9 * max(np.abs(plain).max(), 1.0)


def test_load_hessian_agrees_with_pinocchio(robot: Robot, model: Model, poses: Poses) -> None:
    """Derivatives of the Jacobian along a joint against Pinocchio's kinematic Hessian."""
    from qsframework.robot.kinematics import twists_along

    state = state_of(model, poses)
    data = robot.model.createData()
    joint = robot.model.njoints - 1
    frame = (
        robot.model.addFrame(pin.Frame("test_tip", joint, 0, pin.SE3(np.eye(3), TIP), pin.FrameType.OP_FRAME))
        if not robot.model.existFrame("test_tip")
        else robot.model.getFrameId("test_tip")
    )
    data = robot.model.createData()
    for j in range(6):
        rates = np.zeros((6, len(poses)))
        rates[j] = 1.0
        slope = twists_along(state.tip.elements, rates)
        for i, q in enumerate(poses.q[:40]):
            pin.computeJointJacobians(robot.model, data, q)
            pin.computeJointKinematicHessians(robot.model, data, q)
            H = pin.getFrameKinematicHessian(robot.model, data, frame, pin.LOCAL_WORLD_ALIGNED).transpose(2, 1, 0)
            assert np.abs(slope.linear[..., i].T - H[:3, :, j]).max() < 1e-11
            assert np.abs(slope.angular[..., i].T - H[3:, :, j]).max() < 1e-11
