"""A load above the wrist's is never driven: shipped robots state a payload, and one that states none is told of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from qsf_day.protocol import make_protocol
from qsframework.cli.app import app
from qsframework.errors import InputError
from qsframework.experiment import Experiment, Plan, example, load_experiment, make_plan, read_readings, write_plan
from qsframework.plans.programme import check_plan, make_programme
from qsframework.plugin import Array, Poses
from qsframework.robot import load_robot

ROBOTS = sorted(p.parent.name for p in (Path(__file__).parents[2] / "robots").glob("*/robot.yaml"))
POSE = np.deg2rad([[0.0, 20.0, -10.0, 0.0, -60.0, 0.0], [30.0, 20.0, -10.0, 0.0, -60.0, 0.0]])


def plan_of(experiment: Experiment, pendant: Array, force: float) -> Plan:
    wrench = np.tile([0.0, 0.0, -force, 0.0, 0.0, 0.0], (len(pendant), 1))
    return make_plan(Poses(pendant, experiment.robot.controller.to_joints(pendant), wrench), ["w"] * len(pendant))


@pytest.mark.parametrize("name", ROBOTS)
def test_every_shipped_robot_states_its_payload(name: str) -> None:
    payload = load_robot(name).payload
    assert payload is not None
    assert 10 <= payload <= 700


@pytest.mark.parametrize(("name", "most"), [("r2000ic", 165 * 9.81), ("ur10", 10 * 9.81)])
def test_a_load_above_it_is_refused(name: str, most: float) -> None:
    experiment = load_experiment(example(name) / "design.yaml")
    pendant = POSE if name == "r2000ic" else np.deg2rad([[0.0, -70.0, 60.0, -80.0, -90.0, 0.0]])
    check_plan(experiment, plan_of(experiment, pendant, 0.999 * most))
    for make in (make_programme, make_protocol):
        with pytest.raises(InputError, match="pose 'p01': the load is above the wrist's payload; found 90000 N"):
            make(experiment, plan_of(experiment, pendant, 90e3))


def test_the_loads_of_the_shipped_readings_are_driven() -> None:
    """The 43 cable pulls, of up to 1166 N, pass as a plan."""
    experiment = load_experiment(example("r2000ic") / "experiment.yaml")
    states = read_readings(example("r2000ic") / "readings.csv", experiment).states
    poses = states.poses.take(np.flatnonzero(states.loaded))
    assert np.linalg.norm(poses.wrench[:, :3], axis=1).max() == pytest.approx(1166, abs=1)
    plan = make_plan(poses, ["pull"] * len(poses.q))
    check_plan(experiment, plan)
    assert make_protocol(experiment, plan).notes == ()


def test_a_robot_that_states_none(tmp_path: Path) -> None:
    """Export and protocol say the same of it, on the terminal and on the sheet."""
    stated = load_experiment(example("r2000ic") / "design.yaml")
    silent = replace(stated, robot=replace(stated.robot, payload=None))
    notes = make_programme(silent, plan_of(silent, POSE, 90e3)).notes
    (note,) = make_protocol(silent, plan_of(silent, POSE, 90e3)).notes
    assert note in notes
    folder = tmp_path / "silent"
    folder.mkdir()
    for file in stated.robot.folder.iterdir():
        text = "\n".join(line for line in file.read_text().splitlines() if not line.startswith("payload_kg"))
        (folder / file.name).write_text(text)
    experiment = tmp_path / "experiment.yaml"
    experiment.write_text(
        (example("r2000ic") / "design.yaml").read_text().replace("robot: fanuc_r2000ic", "robot: silent")
    )
    write_plan(tmp_path / "plan.csv", plan_of(silent, POSE, 900.0), silent)
    sheet = tmp_path / "sheet.html"
    made = ["protocol", str(experiment), str(tmp_path / "plan.csv"), "-o", str(sheet)]
    run = CliRunner().invoke(app, [*made, "--readings", str(tmp_path / "r.csv")], catch_exceptions=False)
    assert f"note: {note}\n" in run.output
    assert f"Note: {note}." in sheet.read_text()
