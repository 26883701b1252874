"""What `qsf check` finds in a robot's own files: balancers without values, loops that contradict the arm."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from qsframework.errors import InputError
from qsframework.robot import load_robot, robot_names
from qsframework.robot.findings import robot_findings


@pytest.mark.parametrize("name", robot_names())
def test_the_shipped_robots_agree_with_themselves(name: str) -> None:
    assert robot_findings(load_robot(name)) == ()


def edited(root: Path, folder: Path, robot: str, file: str, old: str, new: str) -> tuple[str, ...]:
    """Kinds and words found in a copy of a robot with one edit."""
    shutil.copytree(root / "robots" / robot, folder / robot)
    text = (folder / robot / file).read_text()
    assert old in text
    (folder / robot / file).write_text(text.replace(old, new))
    return tuple(f"{found.name}: {found.words}" for found in robot_findings(load_robot(folder / robot)))


@pytest.mark.parametrize("angle", ["0", "180", "10"])
def test_a_loop_that_is_flat_at_zero(angle: str, root: Path, tmp_path: Path) -> None:
    (said,) = edited(root, tmp_path, "fanuc_m900ib", "robot.yaml", "zero_deg: -90", f"zero_deg: {angle}")
    assert said.startswith("parallelogram[joint_3]: at the pendant's zero its bars stand")
    assert "less than its margin of 15 deg: look at zero_deg" in said


def test_a_pivot_far_from_its_link(root: Path, tmp_path: Path) -> None:
    """The lever drawn on the wrong side of a long arm: no part of the forearm is there."""
    (said,) = edited(root, tmp_path, "abb_irb760", "robot.yaml", "zero_deg: -90", "zero_deg: 150")
    assert "its pivot stands 0.2" in said or "its pivot stands 0.3" in said
    assert "outside all that is drawn of" in said


def test_a_balancer_without_values(root: Path, tmp_path: Path) -> None:
    """Two effects between the same pivots are one balancer: it is empty where both are."""
    old = "gravity_compensator[joint_2].stiffness:"
    text = (root / "robots" / "kuka_kr270" / "nominal.yaml").read_text()
    start = text.index(old)
    entry = text[start : text.index("gravity_compensator[joint_2].free_length:")]
    assert edited(root, tmp_path, "kuka_kr270", "nominal.yaml", entry, "") == ()
    both = text[text.index("compensator_stiffness[joint_2].stiffness:") :]
    both = both[: both.index("compensator_stiffness[joint_2].free_length:")]
    shutil.rmtree(tmp_path / "kuka_kr270")
    shutil.copytree(root / "robots" / "kuka_kr270", tmp_path / "kuka_kr270")
    (tmp_path / "kuka_kr270" / "nominal.yaml").write_text(text.replace(entry, "").replace(both, ""))
    (found,) = robot_findings(load_robot(tmp_path / "kuka_kr270"))
    assert found.name == "gravity_compensator[joint_2]"
    assert "nominal.yaml lacks gravity_compensator[joint_2].stiffness: {value_N/m: ..}" in found.words


JOINT_2, LOOP = "joint_2: {limits_deg: [-64, 90]", "joint_3: {equals: J3 + J2, limits"
UNLIKELY = {
    "compliance": ("nominal.yaml", "1.0   ", "2.0e4", "joint_compliance[joint_5]: nominal.yaml has 0.02"),
    "spring": ("nominal.yaml", "value_N/m: 1.0e5", "value_N/m: 1.0e8", "stiffness: nominal.yaml has 1e+08"),
    "long spring": ("nominal.yaml", "value_m: 0.70", "value_m: 40", "gravity_compensator[joint_2]: it exerts up to"),
    "mass": ("nominal.yaml", "value_kg: 200", "value_kg: 40000", "counterweight[joint_3_lever]: nominal.yaml has"),
    "range": (
        "robot.yaml",
        JOINT_2,
        "joint_2: {limits_deg: [-640, 900]",
        "joint_2: limits span 1540 deg in robot.yaml",
    ),
    "torque": (
        "robot.yaml",
        JOINT_2,
        f"{JOINT_2}, torque_limit_Nm: 5",
        "joint_2: its actuator bears 5 N m",
    ),
    "missing": ("robot.yaml", LOOP, "joint_3: {limits", "write equals: J3 + J2"),
    "wrong": ("robot.yaml", LOOP, LOOP.replace("+", "-"), "adds -1 J2, so the loop does not close"),
}


@pytest.mark.parametrize("case", UNLIKELY)
def test_values_unlike_the_arm(case: str, root: Path, tmp_path: Path) -> None:
    file, old, new, words = UNLIKELY[case]
    assert any(words in said for said in edited(root, tmp_path, "fanuc_m900ib", file, old, new))


def test_a_gas_balancer_far_too_strong(root: Path, tmp_path: Path) -> None:
    said = edited(root, tmp_path, "kuka_kr600_r2830", "nominal.yaml", "value_bar: 90", "value_bar: 9000")
    assert any("gas_balancer[joint_2]: it exerts up to" in words for words in said)


SPRING, POINTS = "gravity_compensator[joint_2]", "point_spring[link_1/link_2]"


@pytest.mark.parametrize(
    ("robot", "old", "new", "name", "words"),
    [
        ("fanuc_m900ib", "value_N/m: 1.0e5", "value_N/m: 100", SPRING, "up to 7.81 N m;"),
        ("fanuc_m900ib", "value_N/m: 1.0e5", "value_N/m: 1.0e6", SPRING, "up to 7.81e+04 N m;"),
        ("fanuc_m900ib", "value_m: 0.70", "value_m: 1.4", SPRING, "pulls with the weight"),
        ("kuka_kr270", "value_m: 0.458", "value_m: 1.458", SPRING, "pulls with the weight"),
        ("abb_irb6640_185_280", "value_N/m: 60000.0", "value_N/m: 60", POINTS, "up to 3.24 N m;"),
        ("abb_irb6640_185_280", "value_N/m: 60000.0", "value_N/m: 6.0e5", POINTS, "up to 3.24e+04 N m;"),
        ("abb_irb6640_185_280", "value_m: 0.4", "value_m: 0.9", POINTS, "pulls with the weight"),
    ],
)
def test_impossible_balancers(
    robot: str, old: str, new: str, name: str, words: str, root: Path, tmp_path: Path
) -> None:
    """A thousandth, ten times and the other way round, of springs at one joint and between any two points: with both
    torques, and the values to look at."""
    said = [found for found in edited(root, tmp_path, robot, "nominal.yaml", old, new) if found.startswith(name)]
    assert len(said) == 1
    assert words in said[0]
    assert "gravity's torque there is" in said[0]
    assert "look at stiffness" in said[0]
    assert "free_length" in said[0]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("lc_m: 0.80", "lc_m: 80", r"robot.yaml, line 16.*lc_m is no lc of an arm; found 80; allowed: 0, 0.01 to 5 m"),
        ("pressure_bar: 90", "pressure_bar: 90000", r"pressure_bar is no pressure of an arm; found 90000"),
        ("volume_l: 8", "volume_l: 0.008", r"volume_l is no volume"),
        ("length_m: 0.585", "length_m: 15", r"length_m is no length of an arm"),
    ],
)
def test_no_balancer_has_these(old: str, new: str, words: str, root: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        edited(root, tmp_path, "kuka_kr600_r2830", "robot.yaml", old, new)
