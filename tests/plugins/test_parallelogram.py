"""The parallelogram: attitude of the forearm, transmission angle, equation (16)."""

from __future__ import annotations

import numpy as np
import pytest

from qsframework.elastostatics import Site, make_model
from qsframework.plugin import Loop, LoopTerm, Poses
from qsframework.plugin.check import sample_context
from qsframework.plugin.loops import follow
from qsframework.robot import Robot, load_robot


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("fanuc_m900ib")


def loop_of(robot: Robot) -> Loop:
    return next(e for e in robot.effects if isinstance(e, Loop))


def test_the_forearm_keeps_its_attitude_when_the_shoulder_turns(robot: Robot) -> None:
    import pinocchio as pin

    loop = loop_of(robot)
    data = robot.model.createData()
    lever = 0.3
    rotations = []
    for shoulder in (-0.4, 0.0, 0.9):
        q = np.zeros(6)
        actuators = np.array([[shoulder, lever, 0.0, 0.0]])  # the last two are lever and bar, which no motor turns
        term = loop.closure(actuators, np.zeros((1, 1)), sample_context(robot.facts))
        assert isinstance(term, LoopTerm)
        q[[1, 2]] = term.q[0, :2]
        pin.forwardKinematics(robot.model, data, q)
        rotations.append(data.oMi[3].rotation.copy())
    assert np.allclose(rotations[0], rotations[1], atol=1e-15)
    assert np.allclose(rotations[0], rotations[2], atol=1e-15)


def test_the_actuator_of_joint_3_is_what_the_pendant_shows(robot: Robot) -> None:
    """FANUC shows J3 absolute, which is the lever's angle: the two maps cancel."""
    pendant = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 6))
    q = robot.controller.to_joints(pendant)
    loop = loop_of(robot)
    tied = follow([loop], q, robot.facts)[:, [robot.facts.turning_index(joint) for joint in loop.joints(robot.facts)]]
    actuators = loop.actuators(tied, robot.facts)
    assert np.allclose(actuators[:, :2], pendant[:, 1:3])
    assert np.allclose(actuators[:, 2:], 0.0)


def test_transmission_angle_is_the_angle_between_link_2_and_the_lever(robot: Robot) -> None:
    """From positions: link 2 runs from axis 2 to axis 3, the lever's copy from axis 3 to the bar's pivot."""
    import pinocchio as pin

    loop = loop_of(robot)
    data = robot.model.createData()
    for pendant in np.deg2rad([[0, 0, 0, 0, 0, 0], [0, 55, 30, 0, 0, 0], [0, 40, -60, 0, 0, 0], [0, 90, -30, 0, 0, 0]]):
        q = robot.controller.to_joints(pendant[None])[0]
        pin.forwardKinematics(robot.model, data, q)
        link = data.oMi[3].translation - data.oMi[2].translation
        lever = data.oMi[3].act(np.array([-0.75, 0, 0])) - data.oMi[3].translation
        cosine = link @ lever / np.linalg.norm(link) / np.linalg.norm(lever)
        angle = np.arccos(np.clip(abs(cosine), 0, 1))
        assert np.isclose(loop.transmission_angle(q[None, 1:3], robot.facts)[0], angle, atol=1e-7)


def test_table_5_breaks_the_margin_where_the_loop_is_flat(robot: Robot) -> None:
    """Rows 7 and 8 (q2 = 35, q3 = 30): 5 degrees from flat."""
    pendant = np.deg2rad([[-90.0, 55.0, 30.0, 135.0, 30.0, 135.0]])
    q = robot.controller.to_joints(pendant)
    model = make_model(robot.facts, robot.effects, robot.parameters, Site(6, np.zeros(3)), [], robot.gravity)
    margin = model.transmission_margin(Poses(pendant, q, np.zeros((1, 6))))
    assert np.isclose(np.rad2deg(margin[0]), 5.0 - 15.0)


def test_equation_16_corrected_keeps_the_determinant() -> None:
    """Compliances of joints 2 and 3 seen from the serial arm: T diag(k2, k3) T' with T = [[1, 0], [-1, 1]]."""
    k2, k3 = 0.14e-6, 0.2e-6
    T = np.array([[1.0, 0.0], [-1.0, 1.0]])
    ours = T @ np.diag([k2, k3]) @ T.T
    assert np.allclose(ours, [[k2, -k2], [-k2, k2 + k3]], rtol=1e-14, atol=0.0)
    assert np.isclose(np.linalg.det(ours), k2 * k3, atol=0.0)
    printed = np.array([[k2, -k3], [-k3, k3]])
    assert not np.isclose(np.linalg.det(printed), k2 * k3, atol=0.0)
