"""Names in messages: the first of many, and near spellings alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.errors import near_name, some_of
from qsframework.experiment import Experiment, make_plan, write_plan
from qsframework.plugin import Poses


def test_the_first_of_many() -> None:
    assert some_of(["a", "b"]) == "a, b"
    assert some_of(list("abcd"), 2, "; ") == "a; b and 2 more"


def test_only_near_spellings_are_proposed() -> None:
    known = ["pose", "q1_deg", "temperature_K", "wrist_centre"]
    assert [near_name(name, known) for name in ("Q1_DEG", "operator", "wrist", "temp")] == [
        "q1_deg",
        None,
        "wrist_centre",
        "temperature_K",
    ]


def test_a_large_plan_is_not_named_pose_by_pose(m900ib: Experiment, tmp_path: Path) -> None:
    """Forty poses in which the load lies deep in the floor."""
    pendant = np.deg2rad(np.tile([0.0, 80.0, -60.0, 0.0, 0.0, 0.0], (40, 1)) + np.arange(40)[:, None] * 0.1)
    poses = Poses(pendant, m900ib.robot.controller.to_joints(pendant), np.tile([0, 0, -2e3, 0, 0, 0.0], (40, 1)))
    write_plan(tmp_path / "plan.csv", make_plan(poses, [""] * 40), m900ib)
    line = ["simulate", str(m900ib.path), str(tmp_path / "plan.csv"), "-o", str(tmp_path / "readings.csv")]
    said = " ".join(CliRunner().invoke(app, line, catch_exceptions=False).output.split())
    assert "p07, p08 and 32 more break the constraint" in said
    assert "p09" not in said
