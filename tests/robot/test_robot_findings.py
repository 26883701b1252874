"""What `qsf check` finds in a robot's own files: balancers without values, loops that contradict the arm."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

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
