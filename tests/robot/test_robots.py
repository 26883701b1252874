"""The robots of the repository: their constants, their kinematics, their nominal values."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from qsframework.robot import Robot, load_robot, robot_names

ROBOTS = ("fanuc_m900ib", "fanuc_r2000ic", "ur10")


def flange(robot: Robot, pendant_deg) -> np.ndarray:
    """Placement (4, 4) of the flange by Pinocchio."""
    data = robot.model.createData()
    q = robot.controller.to_joints(np.deg2rad(np.atleast_2d(pendant_deg).astype(float)))[0]
    pin.forwardKinematics(robot.model, data, q)
    return data.oMi[robot.flange.link].homogeneous @ robot.flange.placement


def test_names():
    assert set(ROBOTS) <= set(robot_names())


@pytest.mark.parametrize("name", ROBOTS)
def test_facts_are_those_of_the_model(name):
    robot = load_robot(name)
    facts, model = robot.facts, robot.model
    assert robot.name == facts.name == name
    assert model.nq == model.nv == facts.n == 6
    assert tuple(model.names)[1:] == facts.joints
    data = model.createData()
    rng = np.random.default_rng(0)
    for q in rng.uniform(-3, 3, (5, 6)):
        pin.forwardKinematics(model, data, q)
        T = np.eye(4)
        for k in range(6):
            R = np.eye(4)
            R[:3, :3] = pin.exp3(facts.axes[k] * q[k])
            T = T @ facts.placements[k] @ R
            np.testing.assert_allclose(T, data.oMi[k + 1].homogeneous, atol=1e-14)
    for k in range(7):
        assert model.inertias[k].mass == facts.masses[k]
        np.testing.assert_array_equal(model.inertias[k].lever, facts.centres[k])
    np.testing.assert_allclose(np.linalg.norm(facts.axes, axis=1), 1)
    for array in (facts.axes, facts.placements, facts.masses, facts.centres, robot.gravity, robot.flange.placement):
        assert not array.flags.writeable


@pytest.mark.parametrize("name", ROBOTS)
def test_urdf_limits_hold_every_pose_the_controller_allows(name):
    robot = load_robot(name)
    controller = robot.controller
    corners = np.array(np.meshgrid(*zip(controller.lower, controller.upper, strict=True))).reshape(6, -1).T
    q = controller.to_joints(corners)
    assert (q >= robot.model.lowerPositionLimit - 1e-9).all()
    assert (q <= robot.model.upperPositionLimit + 1e-9).all()


def test_m900ib_at_pendant_zeros():
    """Link 2 upright, forearm level: x = a1 + d4 + d6, z = d1 + a2 + a3."""
    T = flange(load_robot("fanuc_m900ib"), [0, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(T[:3, 3], [0.410 + 1.285 + 0.300, 0, 0.940 + 1.120 + 0.250], atol=1e-12)
    np.testing.assert_allclose(T[:3, :3], np.eye(3), atol=1e-12)


def test_m900ib_link_2_turns_and_the_forearm_keeps_its_attitude():
    """J2 = 30: axis 3 moves by a2 (sin 30, cos 30 - 1), nothing turns: J3 is the forearm's elevation."""
    T = flange(load_robot("fanuc_m900ib"), [0, 30, 0, 0, 0, 0])
    x = 0.410 + 1.120 * 0.5 + 1.285 + 0.300
    z = 0.940 + 1.120 * np.sqrt(3) / 2 + 0.250
    np.testing.assert_allclose(T[:3, 3], [x, 0, z], atol=1e-12)
    np.testing.assert_allclose(T[:3, :3], np.eye(3), atol=1e-12)


def test_m900ib_forearm_raised():
    """J3 = 30 raises the forearm by 30 deg about axis 3; J1 = 90 turns everything to +y."""
    T = flange(load_robot("fanuc_m900ib"), [90, 0, 30, 0, 0, 0])
    c, s = np.sqrt(3) / 2, 0.5
    reach = 1.285 + 0.300
    forward, up = reach * c - 0.250 * s, reach * s + 0.250 * c
    np.testing.assert_allclose(T[:3, 3], [0, 0.410 + forward, 0.940 + 1.120 + up], atol=1e-12)
    np.testing.assert_allclose(T[:3, 0], [0, c, s], atol=1e-12)


def test_m900ib_wrist():
    """J5 = 90 lifts the hand upright."""
    T = flange(load_robot("fanuc_m900ib"), [0, 0, 0, 0, 90, 0])
    np.testing.assert_allclose(T[:3, 3], [0.410 + 1.285, 0, 0.940 + 1.120 + 0.250 + 0.300], atol=1e-12)


def test_m900ib_nominal_values():
    robot = load_robot("fanuc_m900ib")
    values = {p.name: p for p in robot.parameters}
    for k, stiffness in enumerate((6.0, 7.0, 5.0, 1.2, 1.0, 0.8), start=1):
        parameter = values[f"joint_compliance[joint_{k}]"]
        assert parameter.nominal == pytest.approx(1e-6 / stiffness, rel=1e-14)
        assert parameter.sd == pytest.approx(0.3 * parameter.nominal)
        assert "assumed" in parameter.source
    assert values["gravity_compensator[joint_2].stiffness"].nominal == 1e5
    assert values["gravity_compensator[joint_2].free_length"].nominal == 0.7
    assert values["compensator_stiffness[joint_2].stiffness"].nominal == 0
    assert [e.stage for e in robot.effects] == sorted(e.stage for e in robot.effects)
    compensators = [values[f"counterweight[{link}]"].nominal for link in ("joint_3_lever", "link_3")]
    assert compensators == [200, 60]
    branches = {branch.link: branch.mass for branch in robot.facts.branches}
    assert branches == {"joint_3_lever": 60, "joint_3_bar": 40}
    assert robot.facts.masses.sum() + sum(branches.values()) + sum(compensators) == pytest.approx(2800)


# modified Denavit-Hartenberg rows of the readings: alpha, a, theta offset, d
ROWS = (
    (0, 0, 0, 0.670),
    (-np.pi / 2, 0.312, -np.pi / 2, 0),
    (0, 1.075, 0, 0),
    (-np.pi / 2, 0.225, 0, 1.280),
    (np.pi / 2, 0, 0, 0),
    (-np.pi / 2, 0, 0, 0.215),
)
TOOL = np.array([0.0069, 0.2453, 0.3193, 1.0])


def denavit_hartenberg(pendant) -> np.ndarray:
    """Placement of the last frame, written out independently of the package."""
    j = pendant
    T = np.eye(4)
    for (alpha, a, offset, d), q in zip(ROWS, (j[0], j[1], -(j[1] + j[2]), -j[3], -j[4], -j[5]), strict=True):
        (ca, sa), (ct, st) = ((np.cos(v), np.sin(v)) for v in (alpha, q + offset))
        T = T @ [[ct, -st, 0, a], [st * ca, ct * ca, -sa, -d * sa], [st * sa, ct * sa, ca, d * ca], [0, 0, 0, 1]]
    return T


def test_r2000ic_is_the_model_of_its_readings():
    robot = load_robot("fanuc_r2000ic")
    for pendant in np.random.default_rng(3).uniform(-3, 3, (100, 6)):
        T, expected = flange(robot, np.rad2deg(pendant)), denavit_hartenberg(pendant)
        np.testing.assert_allclose(T, expected, atol=1e-12)
        np.testing.assert_allclose(T @ TOOL, expected @ TOOL, atol=1e-12)


def test_r2000ic_has_no_loop():
    robot = load_robot("fanuc_r2000ic")
    assert {e.effect_name() for e in robot.effects} == {"joint_compliance"}
    assert all("assumed" in p.source for p in robot.parameters)
    assert robot.flange.link == 6
    assert set(robot.frames) == {*robot.facts.links, "flange"}


# standard Denavit-Hartenberg rows of the UR10: d, a, alpha
UR10 = (
    (0.1273, 0, np.pi / 2),
    (0, -0.612, 0),
    (0, -0.5723, 0),
    (0.163941, 0, np.pi / 2),
    (0.1157, 0, -np.pi / 2),
    (0.0922, 0, 0),
)


def test_ur10_is_its_denavit_hartenberg_model():
    robot = load_robot("ur10")
    for q in np.random.default_rng(4).uniform(-3, 3, (100, 6)):
        T = np.eye(4)
        for (d, a, alpha), angle in zip(UR10, q, strict=True):
            (ca, sa), (ct, st) = ((np.cos(v), np.sin(v)) for v in (alpha, angle))
            T = T @ [[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1]]
        np.testing.assert_allclose(flange(robot, np.rad2deg(q)), T, atol=1e-12)


def test_ur10_centres_are_the_published_ones_in_denavit_hartenberg_frames():
    """Universal Robots gives the centres in the frame behind each row; the URDF frames stand before a and alpha."""
    published = ((0.021, 0, 0.027), (0.38, 0, 0.158), (0.24, 0, 0.068), (0, 0.007, 0.018), (0, 0.007, 0.018))
    facts = load_robot("ur10").facts
    for k, ((_, a, alpha), centre) in enumerate(zip(UR10, published, strict=False), start=1):
        c, s = np.cos(alpha), np.sin(alpha)
        turned = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ centre
        np.testing.assert_allclose(facts.centres[k], turned + np.array([a, 0, 0]), atol=1e-12)
    np.testing.assert_allclose(facts.centres[6], [0, 0, -0.026])
    np.testing.assert_allclose(facts.masses[1:], [7.1, 12.7, 4.27, 2, 2, 0.365])


@pytest.mark.parametrize("name", ROBOTS)
def test_shapes_cover_every_link(name):
    robot = load_robot(name)
    assert {shape.link for shape in robot.shapes} == set(range(7))
    for shape in robot.shapes:
        assert len(shape.size) == {"box": 3, "cylinder": 2, "sphere": 1}[shape.kind]
        np.testing.assert_allclose(shape.placement[:3, :3] @ shape.placement[:3, :3].T, np.eye(3), atol=1e-12)
        assert all(0 <= v <= 1 for v in shape.rgba)


@pytest.mark.parametrize("name", ROBOTS)
def test_every_nominal_value_names_its_source(name):
    robot = load_robot(name)
    assert (robot.folder / "README.md").is_file()
    assert all(parameter.source for parameter in robot.parameters)
