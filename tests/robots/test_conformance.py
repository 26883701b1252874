"""Every robot of the repository works with everything, and is the arm that its README's table says."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from qsframework.elastostatics import Site, actuator_torques, make_model
from qsframework.errors import InputError
from qsframework.plugin import Loop, Poses
from qsframework.plugin.loops import follow
from qsframework.robot import load_robot
from qsframework.robot.reference import reference_flange
from qsframework.uses.conformance import STEPS, check_robot

ROOT = Path(__file__).resolve().parents[2]
ROBOTS = sorted(p.parent.name for p in ROOT.glob("robots/*/robot.yaml"))

# d1, a1, a2, a3, d4, d6 (m); pendant signs of the elevation of link 2 and forearm, of joint 1 and of the wrist
ARMS = {
    "fanuc_m900ib": ((0.940, 0.410, 1.120, 0.250, 1.285, 0.300), "fanuc"),
    "fanuc_r2000ic": ((0.670, 0.312, 1.075, 0.225, 1.280, 0.215), "fanuc"),
    "fanuc_m900ia_260l": ((0.950, 0.370, 1.050, 0.200, 1.705, 0.270), "fanuc"),
    "abb_irb6640_185_280": ((0.780, 0.320, 1.075, 0.200, 1.392, 0.200), "abb"),
    "abb_irb2400": ((0.615, 0.100, 0.705, 0.135, 0.755, 0.085), "abb parallel"),
    "kuka_kr500_r2800_2": ((0.800, 0.500, 1.250, 0.150, 1.0395, 0.286), "kuka"),
    "kuka_kr600_r2830": ((1.045, 0.500, 1.300, -0.055, 1.025, 0.290), "kuka"),
    "kuka_kr270": ((0.750, 0.350, 1.250, -0.055, 1.100, 0.230), "kuka"),
}


def attitudes(kind: str, j: np.ndarray) -> tuple[float, float, float, float, float, float]:
    """Azimuth, elevation of link 2, elevation of the forearm, wrist angles about the forearm's own axes +x, -y, +x."""
    if kind == "fanuc":  # J2 leans forward from upright, J3 is the forearm's elevation
        return j[0], np.pi / 2 - j[1], j[2], -j[3], j[4], -j[5]
    if kind == "abb":  # J3 follows link 2, positive down
        return j[0], np.pi / 2 - j[1], -j[1] - j[2], j[3], -j[4], j[5]
    if kind == "abb parallel":  # J3 is the forearm's own inclination, positive down
        return j[0], np.pi / 2 - j[1], -j[2], j[3], -j[4], j[5]
    return -j[0], -j[1], -j[1] - j[2], -j[3], -j[4], -j[5]  # KUKA: A1 clockwise, A2 and A3 positive down


def about_x(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def up(angle: float) -> np.ndarray:
    """Turns x towards z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])


def hand(lengths: tuple[float, ...], kind: str, pendant: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and direction of the flange in the words of the drawing: no URDF, no joint axes."""
    d1, a1, a2, a3, d4, d6 = lengths
    turn, link, fore, roll, bend, spin = attitudes(kind, pendant)
    forearm = up(fore) @ about_x(roll)
    tool = forearm @ up(bend) @ about_x(spin)
    planar = np.array([a1 + a2 * np.cos(link), 0, d1 + a2 * np.sin(link)]) + up(fore) @ np.array([d4, 0, a3])
    c, s = np.cos(turn), np.sin(turn)
    Z = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return Z @ (planar + d6 * tool[:, 0]), Z @ tool


@pytest.mark.parametrize("name", sorted(ARMS))
def test_the_arm_is_that_of_its_table(name: str) -> None:
    robot, (lengths, kind) = load_robot(name), ARMS[name]
    rng = np.random.default_rng(5)
    pendant = rng.uniform(robot.controller.lower, robot.controller.upper, (50, 6))
    T = reference_flange(robot, robot.controller.to_joints(pendant))
    for one, placed in zip(pendant, T, strict=True):
        position, tool = hand(lengths, kind, one)
        np.testing.assert_allclose(placed[:3, 3], position, atol=1e-12)
        if name != "fanuc_r2000ic":  # whose flange frame has its z out of the flange
            np.testing.assert_allclose(placed[:3, :3], tool, atol=1e-12)
    readme = (robot.folder / "README.md").read_text()
    assert all(f"{length:.3f}" in readme or f"{length:g}" in readme for length in lengths)


PALLETIZER = (0.8145, 0.300, 1.280, 1.350, 0.290, 0.269)


def test_the_palletizers_flange_is_level_and_where_its_lengths_put_it() -> None:
    """In the words of the drawing: the lower arm leans by J2 from upright, the upper arm dips by J3, the rest stays."""
    robot = load_robot("abb_irb760")
    rng = np.random.default_rng(5)
    pendant = rng.uniform(robot.controller.lower, robot.controller.upper, (50, 4))
    q = robot.controller.to_joints(pendant)
    assert q.shape == (50, 5)
    np.testing.assert_allclose(q[:, 3], -pendant[:, 2], atol=1e-12)
    d1, a1, a2, a3, a4, d6 = PALLETIZER
    for (j1, j2, j3, j4), placed in zip(pendant, reference_flange(robot, q), strict=True):
        reach = a1 + a2 * np.sin(j2) + a3 * np.cos(j3) + a4
        height = d1 + a2 * np.cos(j2) - a3 * np.sin(j3) - d6
        np.testing.assert_allclose(placed[:3, 3], [reach * np.cos(j1), reach * np.sin(j1), height], atol=1e-12)
        np.testing.assert_allclose(placed[:3, 2], [0, 0, -1], atol=1e-12)
        np.testing.assert_allclose(placed[:3, 0], [np.cos(j1 - j4), np.sin(j1 - j4), 0], atol=1e-12)
    readme = (robot.folder / "README.md").read_text()
    assert all(f"{length:.3f}" in readme or f"{length:g}" in readme for length in PALLETIZER)


def test_the_rods_of_the_second_parallelogram_stay_beside_the_arm() -> None:
    """One leans as the lower arm does, one dips as the upper arm does, the triangle between them stays level."""
    robot = load_robot("abb_irb760")
    joints = {branch.joint: branch for branch in robot.facts.branches}
    rng = np.random.default_rng(6)
    pendant = rng.uniform(robot.controller.lower, robot.controller.upper, (20, 4))
    q = robot.controller.to_joints(pendant)
    every = follow([e for e in robot.effects if isinstance(e, Loop)], q, robot.facts)
    turned = {name: every[:, robot.facts.turning_index(name)] for name in joints}
    np.testing.assert_allclose(turned["lower_rod_joint"], pendant[:, 1], atol=1e-12)
    np.testing.assert_allclose(turned["triangle_joint"], -pendant[:, 1], atol=1e-12)
    np.testing.assert_allclose(turned["upper_rod_joint"], pendant[:, 2], atol=1e-12)
    assert sum(branch.mass for branch in joints.values()) == pytest.approx(60 + 45 + 40 + 40 + 35)
    assert robot.facts.masses.sum() == pytest.approx(2030)


def test_the_gas_balancer_keeps_axis_2_inside_its_largest_torque() -> None:
    """The claim of the KR 600's README, arm level: 14.4 kN m is the file's; without the gas the payload is beyond."""
    robot = load_robot("kuka_kr600_r2830")
    gas = [e for e in robot.effects if e.effect_name() == "gas_balancer"]
    point, level = Site(6, np.array([0.2, 0.0, 0.0])), np.zeros((1, 6))
    held = []
    for effects in (robot.effects, tuple(e for e in robot.effects if e not in gas)):
        own = {p.name for e in effects for p in e.parameters(robot.facts)}
        parameters = [p for p in robot.parameters if p.name in own]
        model = make_model(robot.facts, effects, parameters, point, [], robot.gravity)
        for weight in (0.0, 600 * 9.81):
            wrench = np.array([[0.0, 0.0, -weight, 0.0, 0.0, 0.0]])
            held.append(actuator_torques(model, Poses(level, robot.controller.to_joints(level), wrench))[0, 1])
    assert held[1] == pytest.approx(14.3e3, abs=100)
    assert held[0] == pytest.approx(-2.3e3, abs=100)
    assert held[3] > 1.8 * 14.4e3


def test_no_arm_is_left_out() -> None:
    own = {"ur10", "abb_irb760", "kuka_kr500_on_kl4000"}  # these have tests of their own
    assert set(ROBOTS) - own == set(ARMS)


@pytest.mark.parametrize("name", ROBOTS)
def test_conformance(name: str) -> None:
    checks = check_robot(name)
    assert [c.name for c in checks] == list(STEPS)
    assert all(c.good for c in checks), "\n".join(f"{c.name}: {c.words}" for c in checks if not c.good)


@pytest.mark.parametrize("name", ROBOTS)
def test_every_number_has_a_source(name: str) -> None:
    robot = load_robot(name)
    assert all(p.source for p in robot.parameters)
    rows = [line for line in (robot.folder / "README.md").read_text().splitlines() if line.startswith("| ")][1:]
    assert len(rows) >= 8
    assert all(cell.strip() for row in rows for cell in row.strip("|").split("|")[:2])
    assert {shape.link for shape in robot.shapes} == set(range(len(robot.facts.links)))


@pytest.mark.parametrize("name", ROBOTS)
def test_urdf_limits_hold_every_pose_the_controller_allows(name: str) -> None:
    robot = load_robot(name)
    control = robot.controller
    corners = np.array(np.meshgrid(*zip(control.lower, control.upper, strict=True))).reshape(len(control.lower), -1).T
    q = control.to_joints(corners)
    assert (q >= robot.model.lowerPositionLimit - 1e-9).all()
    assert (q <= robot.model.upperPositionLimit + 1e-9).all()


def copied(name: str, where: Path) -> Path:
    shutil.copytree(ROOT / "robots" / name, where / name)
    return where / name


def test_a_robot_without_springs_is_told(tmp_path: Path) -> None:
    folder = copied("kuka_kr500_r2800_2", tmp_path)
    (folder / "nominal.yaml").write_text("{}\n")
    found = {c.name: c for c in check_robot(folder)}
    assert found["kinematics"].good
    assert not found["model"].good
    assert "joint_compliance[joint_1]" in found["model"].words
    (folder / "robot.yaml").write_text(
        (folder / "robot.yaml").read_text().replace("  - {effect: joint_compliance, joints: all}\n", "  []\n")
    )
    found = {c.name: c for c in check_robot(folder)}
    assert "joint_compliance" in found["model"].words
    assert not found["identify"].good


def test_a_loop_that_never_closes_is_told(tmp_path: Path) -> None:
    folder = copied("fanuc_m900ia_260l", tmp_path)
    file = folder / "robot.yaml"
    file.write_text(file.read_text().replace("margin_deg: 15", "margin_deg: 95"))
    found = {c.name: c for c in check_robot(folder)}
    assert not found["kinematics"].good
    assert "margin" in found["kinematics"].words


def test_files_that_are_wrong_raise(tmp_path: Path) -> None:
    folder = copied("abb_irb2400", tmp_path)
    (folder / "robot.yaml").write_text("name: x\n")
    with pytest.raises(InputError):
        check_robot(folder)
