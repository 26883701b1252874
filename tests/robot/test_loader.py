"""robot.yaml and nominal.yaml: where robots are found, and every problem with its file and line."""

from __future__ import annotations

import shutil
import subprocess
import sys

import numpy as np
import pytest

from qsframework.errors import InputError
from qsframework.robot import load_robot, robot_names


def test_small_arm(small):
    robot = small.load()
    assert robot.facts.joints == ("shoulder", "elbow")
    assert robot.facts.links == ("base", "upper", "fore")
    assert robot.flange.link == 2
    np.testing.assert_allclose(robot.flange.placement[:3, 3], [0.8, 0, 0])
    assert [(p.name, p.nominal, p.sd) for p in robot.parameters] == [
        ("joint_compliance[shoulder]", pytest.approx(2e-7), pytest.approx(6e-8)),
        ("joint_compliance[elbow]", pytest.approx(3e-7), pytest.approx(1e-7)),
    ]
    assert robot.parameters[0].source == "made up"
    assert robot.shapes[0].size == (0.1, 0.2, 1.0)
    assert robot.gravity.tolist() == [0, 0, -9.81]


def test_ways_to_name_a_robot(small, monkeypatch, tmp_path):
    by_folder, by_file = load_robot(small.folder), load_robot(str(small.folder / "robot.yaml"))
    assert by_folder.name == by_file.name == "small"
    assert load_robot("small", beside=tmp_path).name == "small"
    monkeypatch.setenv("QSF_ROBOTS", str(tmp_path))
    assert load_robot("small").name == "small"
    assert "small" in robot_names()


@pytest.mark.parametrize("name", ["fanuc_m900", "../robots/nothing", "", "x" * 500, "/", "robot.yaml", "nul\x00byte"])
def test_unknown_robot(name):
    with pytest.raises(InputError) as caught:
        load_robot(name)
    text = str(caught.value)
    assert "unknown robot" in text
    assert "fanuc_m900ib" in text
    assert "robot.yaml" in text
    if name == "fanuc_m900":
        assert "Did you mean 'fanuc_m900ib'?" in text


YAML = {
    "tab": ("  shoulder:", "\tshoulder:", "a tab"),
    "unknown key": ("title:", "titel:", "unknown key 'titel'"),
    "no unit": ("limits_deg: [-90", "limits: [-90", "does not say its unit"),
    "wrong unit": ("limits_deg: [-90", "limits_kg: [-90", "ends in no unit"),
    "travel of a turn": ("limits_deg: [-90", "limits_mm: [-90", "shoulder turns and needs limits in deg"),
    "one limit": ("[-90, 90]", "[-90]", "limits must be [lower, upper]"),
    "limits swapped": ("[-90, 90]", "[90, -90]", "limits must be [lower, upper]"),
    "limit is text": ("[-90, 90]", "[-90, wide]", "finite number"),
    "expression": ("J2 + J1", "J2 + J7", "J7"),
    "joint twice": ("J2 + J1", "J1", "angles of shoulder, elbow depend on each other, so that J2 moves no joint"),
    "unknown base": ("base: base", "base: bas", "no link 'bas'"),
    "unknown flange": ("flange: tip", "flange: tp", "Did you mean 'tip'?"),
    "base above flange": ("base: base\nflange: tip", "base: tip\nflange: base", "does not hang on"),
    "nothing between": ("base: base", "base: tip", "no joint moves"),
    "unknown joint": ("  elbow:", "  elbo:", "no joint 'elbo'"),
    "fixed joint": ("  elbow:", "  mount:", "'mount' does not move the flange"),
    "name": ("name: small", "name: small/arm", "letters, digits"),
    "urdf outside": ("small.urdf", "../small/../small.urdf", "outside the robot's folder"),
    "urdf absolute": ("small.urdf", "/etc/hostname", "outside the robot's folder"),
    "urdf with a null": ("urdf: small.urdf", 'urdf: "small\\0.urdf"', "outside the robot's folder"),
    "urdf missing": ("small.urdf", "smal.urdf", "does not exist"),
    "urdf a folder": ("small.urdf", ".", "does not exist"),
    "urdf a number": ("small.urdf", "12", "urdf"),
    "nominal outside": ("nominal.yaml", "../nominal.yaml", "outside the robot's folder"),
    "nominal missing": ("nominal.yaml", "nominals.yaml", "does not exist"),
    "unknown effect": ("joint_compliance,", "joint_complience,", "Did you mean 'joint_compliance'?"),
    "no effect name": ("{effect: joint_compliance, joints: all}", "{joints: all}", "needs the key 'effect'"),
    "unknown joint in effect": ("joints: all", "joints: [shoulder, elbw]", "no joint 'elbw'"),
    "unknown effect key": ("joints: all", "joins: all", "unknown key"),
    "effect without place": (", joints: all", "", "needs joint (or joints)"),
    "effect without unit": (
        "{effect: joint_compliance, joints: all}",
        "{effect: gravity_compensator, joint: elbow, lc: 0.2, l2_m: 1}",
        "the unit is missing",
    ),
    "effect twice": ("joints: all}", "joints: all}\n  - {effect: joint_compliance, joint: elbow}", "a second time"),
    "balancer twice": (
        "joints: all}",
        "joints: all}\n  - {effect: gravity_compensator, joint: elbow, lc_m: 0.2, l2_m: 1}"
        "\n  - {effect: gravity_compensator, joint: elbow, lc_m: 0.3, l2_m: 1}",
        "give each a name of its own, such as label: left",
    ),
    "gas without volume": (
        "joints: all}",
        "joints: all}\n  - {effect: gas_balancer, joint: shoulder, lc_m: 0.2, l2_m: 0.6, length_m: 0.5, "
        "pressure_bar: 50, volume_l: 0.5, piston_area_cm^2: 50}",
        "allowed: volume above 0.662 l",
    ),
    "loop of crossed axes": (
        "joints: all}",
        "joints: all}\n  - {effect: parallelogram, driver: elbow, driven: shoulder, lever_m: 1}",
        "comes before it in the arm",
    ),
    "effects a mapping": ("  - {effect: joint_compliance, joints: all}", "  joint_compliance: all", "effects"),
    "tolerance": ("title:", "limits_tolerance_deg: 20\ntitle:", "limits_tolerance"),
    "gravity": ("title:", "gravity_m/s^2: [0, 0]\ntitle:", "three numbers"),
    "alias": ("title: A small arm", "title: &a A\nflange: *a", "anchors"),
    "list": ("name: small", "- name", ""),
}


@pytest.mark.parametrize("case", YAML)
def test_problems_of_robot_yaml(small, case):
    old, new, words = YAML[case]
    small.edit("robot.yaml", (old, new))
    problems = small.problems()
    assert any(words in str(p) for p in problems), list(map(str, problems))
    for problem in problems:
        assert problem.file.endswith((".yaml", ".urdf"))
        assert problem.line is not None or "the URDF" in problem.message or "key: value" in problem.message, str(
            problem
        )


NOMINAL = {
    "unknown parameter": (
        "joint_compliance[elbow]",
        "joint_compliance[elbo]",
        5,
        "Did you mean 'joint_compliance[elbow]'?",
    ),
    "no unit": ("value_rad/(N m)", "value", 6, "does not say its unit"),
    "wrong unit": ("value_rad/(N m)", "value_mm", 6, "does not end in a unit of rad/(N m)"),
    "nonsense unit": ("value_rad/(N m)", "value_ra/(N m)", 6, "does not end in a unit"),
    "unknown key": ("sd_percent", "std_percent", 3, "unknown key"),
    "text": ("3.0e-7", "soft", 6, "finite number"),
    "infinite": ("3.0e-7", ".inf", 6, "finite number"),
    "true": ("3.0e-7", "true", 6, "finite number"),
    "negative": ("3.0e-7", "-3.0e-7", 5, "outside its bounds"),
    "sd zero": ("sd_percent: 30", "sd_percent: 0", 1, "sd must be positive"),
    "sd of zero": ("value_urad/(N m): 0.2", "value_urad/(N m): 0", 1, "A share of zero is zero"),
    "sd twice": ("sd_percent: 30", "sd_percent: 30\n  sd_urad/(N m): 1", 4, "sd is given twice"),
    "value twice": ("sd_percent: 30", "value_rad/(N m): 1", 3, "value is given twice"),
    "no value": ("value_urad/(N m): 0.2\n", "source: none\n", 3, "stands here twice"),
    "only sd": ("  value_rad/(N m): 3.0e-7\n", "", 5, "needs its value"),
    "a number": ("  value_rad/(N m): 3.0e-7\n  sd_urad/(N m): 0.1\n", "  3\n", 5, "must be a mapping"),
}


@pytest.mark.parametrize("case", NOMINAL)
def test_problems_of_nominal_yaml(small, told, case):
    old, new, line, words = NOMINAL[case]
    small.edit("nominal.yaml", (old, new))
    problem = small.problem()
    assert words in str(problem), str(problem)
    assert problem.file.endswith("nominal.yaml")
    if case != "no value":
        assert problem.line == line, str(problem)


GAS = (
    "  - {effect: gas_balancer, joint: shoulder, lc_m: 0.2, l2_m: 0.6, length_m: 0.5, pressure_bar: 50, volume_l: 1, "
    "piston_area_cm^2: 50}\n"
)
COMPENSATOR = "  - {effect: gravity_compensator, joint: shoulder, lc_m: 0.2, l2_m: 0.6}\n"
VALUES = {
    "volume": (GAS, "gas_balancer[shoulder].volume:\n  value_l: 0.5\n", "no volume left within the joint's limits"),
    "angle": (GAS, "gas_balancer[shoulder].zero:\n  value_deg: 90\n", "at shoulder = 90.0 deg"),
    "lc is l2": (COMPENSATOR, "gravity_compensator[shoulder].lc:\n  value_m: 0.6\n", "above 0 and differ"),
    "lc below 0": (COMPENSATOR, "gravity_compensator[shoulder].lc:\n  value_m: -0.6\n", "outside its bounds"),
}


@pytest.mark.parametrize("case", VALUES)
def test_values_that_do_not_fit_each_other(small, told, case):
    """What only the values of nominal.yaml break is told at their line there."""
    entry, values, words = VALUES[case]
    small.edit("robot.yaml", ("nominal: nominal.yaml", entry + "nominal: nominal.yaml"))
    assert len(small.load().effects) == 3
    small.edit("nominal.yaml", ("joint_compliance[elbow]", values + "joint_compliance[elbow]"))
    told(small.problem(), "nominal.yaml", 5, words)


def test_limits_of_the_joints_are_those_of_the_pendant_through_the_controller(small):
    """The elbow is J2 + J1: -120 - 90 to 30 + 90 deg."""
    np.testing.assert_allclose(np.rad2deg(small.load().facts.limits), [[-90, 90], [-210, 120]])


def test_problems_of_all_three_parts_come_together(small):
    small.edit("robot.yaml", ("J2 + J1", "J2 + J9"), ("joint_compliance,", "joint_compliances,"))
    small.edit("nominal.yaml", ("joint_compliance[elbow]", "joint_compliance[elbo]"))
    text = "\n".join(map(str, small.problems()))
    assert "J9" in text
    assert "joint_compliances" in text
    assert "elbo]" not in text, "the parameters are not known, so the name is not told to be wrong"


def test_missing_joint_in_the_controller(small, told):
    small.edit("robot.yaml", ("  shoulder: {limits_deg: [-90, 90]}\n", ""))
    told(small.problem(), "robot.yaml", 6, "no limits for 'shoulder'")


def test_gravity_of_a_hanging_arm(small):
    small.edit("robot.yaml", ("title:", "gravity_m/s^2: [0, 0, 9.81]\ntitle:"))
    robot = small.load()
    assert robot.gravity.tolist() == [0, 0, 9.81]
    assert robot.model.gravity.linear.tolist() == [0, 0, 9.81]


def test_continuous_joint_is_one_angle(small):
    small.edit("small.urdf", ('name="elbow" type="revolute"', 'name="elbow" type="continuous"'))
    assert small.load().model.nq == 2


def test_base_below_the_root(small):
    """What stands under the base, a floor or a track, is no part of the arm."""
    ends = '<parent link="world"/><child link="base"/><origin xyz="1 2 3"/>'
    world = f'<link name="world"/><joint name="floor" type="fixed">{ends}</joint>'
    small.edit("small.urdf", ('<link name="base"/>', '<link name="base"/>' + world))
    robot = small.load()
    np.testing.assert_allclose(robot.facts.placements[0][:3, 3], [0, 0, 0.5])
    assert "world" not in robot.frames


def test_axes_are_unit_vectors(small):
    small.edit("small.urdf", ('xyz="0 -1 0"', 'xyz="0 -3 4"'))
    np.testing.assert_allclose(small.load().facts.axes[1], [0, -0.6, 0.8], atol=1e-15)


def test_robots_do_not_share_state(small):
    first = small.load()
    small.edit("small.urdf", ('value="10"', 'value="11"'))
    assert small.load().facts.masses[1] == 11
    assert first.facts.masses[1] == 10


@pytest.mark.parametrize("name", ["fanuc_m900ib", "fanuc_r2000ic"])
@pytest.mark.parametrize("seed", range(12))
def test_spoilt_copies_end_in_a_robot_or_a_message(tmp_path, name, seed):
    """Delete, double or garble a stretch of one file: never another exception than InputError."""
    source = load_robot(name).folder
    rng = np.random.default_rng(seed)
    for k in range(5):
        folder = tmp_path / str(k)
        shutil.copytree(source, folder)
        files = sorted(p for p in folder.iterdir() if p.suffix in (".yaml", ".xacro"))
        path = files[rng.integers(len(files))]
        data = path.read_bytes()
        start = int(rng.integers(len(data)))
        piece = data[start : start + int(rng.integers(1, 60))]
        put = (b"", piece + piece, bytes(rng.integers(32, 127, len(piece)).tolist()))[rng.integers(3)]
        path.write_bytes(data[:start] + put + data[start + len(piece) :])
        try:
            load_robot(folder)
        except InputError as error:
            assert error.problems  # noqa: PT017
            assert str(error)  # noqa: PT017


def test_import_is_light():
    code = (
        "import sys, qsframework.robot; print([m for m in ('pinocchio', 'xacro', 'pint', 'cvxpy') if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=None)
    assert out.stdout.strip() == "[]"
