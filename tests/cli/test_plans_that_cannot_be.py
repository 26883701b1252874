"""Plans of positions that cannot be, through the command line: said before any work, with what to change."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.errors import InputError, NotIdentifiable

TEXT = """
robot: ur10
rigid: true
markers:
  m1: {xyz_mm: [60, 0, 40], normal: [0, 0, 1]}
  m2: {xyz_mm: [-40, 50, 40], normal: [0, 0, 1]}
  m3: {xyz_mm: [-40, -50, 80], normal: [0, 0, 1]}
noise: {position_sigma_mm: 0.03, displacement_sigma_mm: 0.03, gauge_sigma_mm: 0.01}
stations:
  front: {xyz_mm: [3000, 500, 300]}
fit: [geometry]
"""
TASK = """
title: picking
tool_mm: 150
approach: [0, 0, -1]
path:
  - {xyz_mm: [-700, -300, 250]}
"""
GAUGE = """
load: {point_mm: [60, 0, 40]}
loads: [{name: weight, fz_N: -50, gauge: {marker: m1, along: [0, 0, 1]}}]
"""
DOWN = "constraints: {z_min_m: 0.9, of: flange, joint_limits_deg: {joint_2: [-95, -85], joint_4: [-95, -85]}}\n"


def designed(folder: Path, text: str, *more: str) -> str:
    (folder / "experiment.yaml").write_text(text)
    (folder / "task.yaml").write_text(TASK)
    given = ["design", str(folder / "experiment.yaml"), "--candidates", "60", "-o", str(folder / "plan.csv"), *more]
    done = CliRunner().invoke(app, given, env={"COLUMNS": "1000"})
    if isinstance(done.exception, InputError | NotIdentifiable):
        raise done.exception
    assert done.exit_code == 0, done.output
    return " ".join(done.output.split())


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "  front: {xyz_mm: [3000, 500, 300]}\n",
            "  below: {xyz_mm: [0, 0, -9000], incidence_max_deg: 2}\n",
            ("no station sees a marker at any of the 60 allowed poses: below", "Move a station, add one"),
        ),
        (
            "fit: [geometry]",
            'fit: [geometry, "joint_offset[joint_1]"]',
            (
                "joint_offset[joint_1]: confounded with frame[front].rz",
                "State where the base is in the tracker's frame",
            ),
        ),
        (
            "fit: [geometry]\n",
            f"fit: [joint_compliance]\n{GAUGE}",
            ("joint_compliance[joint_1]: no reading depends on it", "Under weight a dial gauge reads one direction"),
        ),
        (
            "fit: [geometry]\n",
            f"fit: [geometry]\n{GAUGE}",
            ("none of the parameters of `fit` moves the tip", "Ask for criterion D, or fit other parameters"),
        ),
        (
            "fit: [geometry]",
            'fit: [geometry, "joint_compliance[joint_1]"]',
            ("no plan of these readings identifies joint_compliance[joint_1]", "springs need `loads`"),
        ),
    ],
    ids=["unseen", "frame, --free", "dial gauge", "rigid", "springs"],
)
def test_it_is_refused_with_what_to_change(tmp_path: Path, old: str, new: str, words: tuple[str, ...]) -> None:
    text = TEXT.replace(old, new) + (DOWN if "below" in new else "")
    assert text != TEXT
    with pytest.raises((InputError, NotIdentifiable)) as error:
        designed(tmp_path, text, "-n", "20", *(["--free"] if "confounded" in words[0] else []))
    for word in words:
        assert word in str(error.value)
    assert not (tmp_path / "plan.csv").exists()


def test_an_accuracy_that_the_instrument_excludes(tmp_path: Path) -> None:
    said = designed(tmp_path, TEXT, "--for", str(tmp_path / "task.yaml"), "--accuracy-mm", "0.002", "-n", "40")
    assert said.startswith("Accuracy not reached: ")
    assert "The instrument limits it: with its noise" in said
    assert "Allow more poses (-n), add markers, a nearer station or a better instrument." in said


def test_an_accuracy_below_the_repeatability_of_the_arm(tmp_path: Path) -> None:
    text = TEXT.replace("noise: {", "noise: {repeatability_mm: 0.05, ")
    said = designed(tmp_path, text, "--for", str(tmp_path / "task.yaml"), "--accuracy-mm", "0.1")
    assert said.startswith("Accuracy not reached: ")
    assert "the arm's own repeatability alone is 0.173 mm, which no plan reduces" in said


def test_loads_that_no_pose_is_planned_under(tmp_path: Path) -> None:
    """Springs are rigid here, so that a load adds nothing."""
    text = TEXT + "load: {point_mm: [60, 0, 40]}\npositions: {}\nloads: [{name: weight, fz_N: -50}]\n"
    said = designed(tmp_path, text, "-n", "20")
    assert "Note: no pose is planned under weight: leave it out, or state its poses_min." in said


def test_the_smallest_plan_has_the_poses_that_its_loads_ask_for(tmp_path: Path) -> None:
    """And two for several parameters: a fit of one pose is refused."""
    text = TEXT.replace("rigid: true\n", "").replace(
        "fit: [geometry]", 'fit: ["joint_compliance[joint_2]", "joint_compliance[joint_3]"]'
    )
    text += "load: {point_mm: [60, 0, 40]}\nloads: [{name: weight, fz_N: -50}, {name: pull, fz_N: -40, fy_N: 25"
    asked = ["--for", str(tmp_path / "task.yaml"), "--accuracy-mm", "5", "--candidates", "60"]
    assert designed(tmp_path, text + "}]\n", *asked).startswith("Plan ready: 2 poses")
    assert designed(tmp_path, text + ", poses: 4}]\n", *asked).startswith("Plan ready: 4 poses")
