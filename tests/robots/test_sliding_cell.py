"""A small arm on a track goes the whole way of a campaign on the command line, in mm and deg."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from sliding_arms import ARMS, write_arm
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.errors import InputError
from qsframework.experiment import load_experiment, make_rows, read_readings
from qsframework.hypotheses.catalogue.generic_laws import motions
from qsframework.hypotheses.catalogue.law import Law
from qsframework.hypotheses.catalogue.place_motions import variables
from qsframework.report.words.law import variable_words
from qsframework.robot import Robot, load_robot
from qsframework.robot.kinematics import joint_frames
from qsframework.uses.conformance import check_robot

EXPERIMENT = """robot: tracked
load: {point_mm: [100, 0, 100]}
markers: {m1: {xyz_mm: [150, 200, 100]}, m2: {xyz_mm: [-100, 150, 200]}, m3: {xyz_mm: [100, -200, -50]}}
noise: {sigma_mm: 0.01}
loads: [{name: weight, fz_N: -500}, {name: side_pull, fz_N: -300, fy_N: 400}]
constraints: {collision: true, joint_limits_mm: {j1: [-500, 1300]}, joint_limits_deg: {j2: [-90, 90]}}
"""
TARGETS = """target,q1_mm,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,q7_deg,fx_N,fy_N,fz_N
t01,600,20,30,40,10,60,0,0,0,-500
"""
CARTESIAN = "target,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg,fx_N,fy_N,fz_N\n"


def qsf(*arguments: object) -> str:
    result = CliRunner().invoke(app, list(map(str, arguments)), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def refused(*arguments: object) -> str:
    result = CliRunner().invoke(app, list(map(str, arguments)))
    assert isinstance(result.exception, InputError)
    return str(result.exception)


def rows(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(line for line in path.read_text().splitlines() if not line.startswith("#")))


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the arm, its experiment, plan, readings and fit."""
    folder = tmp_path_factory.mktemp("cell")
    write_arm(folder, "tracked")
    experiment, plan, readings = folder / "experiment.yaml", folder / "plan.csv", folder / "readings.csv"
    experiment.write_text(EXPERIMENT)
    qsf("check", experiment)
    qsf("design", experiment, "--poses", 8, "--candidates", 100, "-o", plan, "--report", folder / "plan.html")
    qsf("simulate", experiment, plan, "-o", readings, "--truth", "drawn", "--json", folder / "truth.json")
    qsf("identify", experiment, readings, "--json", folder / "fit.json", "--report", folder / "fit.html")
    return folder


def test_tables_have_the_track_in_millimetres_inside_the_experiments_limits(cell: Path) -> None:
    for name in ("plan.csv", "readings.csv"):
        read = rows(cell / name)
        assert [k for k in read[0] if k.startswith("q")] == ["q1_mm", *(f"q{k}_deg" for k in range(2, 8))]
        assert all(-500.0 <= float(r["q1_mm"]) <= 1300.0 for r in read)
        assert all(-90.0 <= float(r["q2_deg"]) <= 90.0 for r in read)
    assert len({r["q1_mm"] for r in rows(cell / "plan.csv")}) > 1
    assert "J1 mm" in (cell / "plan.html").read_text()


def test_a_law_may_follow_the_travel_of_the_track(cell: Path) -> None:
    experiment = load_experiment(cell / "experiment.yaml")
    rows, model = make_rows(read_readings(cell / "readings.csv", experiment)), experiment.model()
    moved = motions(model, rows, model.nominal, ())
    own = {v.name: v.features for v in variables(moved)}
    assert [name for name in own if name.startswith("travel")] == ["travel j1"]
    travel = moved.plus.q[:, 0]
    X = np.column_stack([np.ones(len(travel)), own["travel j1"][moved.plus.state]])
    off = travel - X @ np.linalg.lstsq(X, travel, rcond=None)[0]
    assert np.abs(off).max() < 0.1 * np.ptp(travel), "smooth functions of where the track stands"
    assert variable_words(Law("link", "l1", ("loaded", "travel j1"))) == "the travel of j1 (once a load hangs)"


def test_the_fit_has_the_track_in_micrometres_per_newton(cell: Path) -> None:
    estimate = json.loads((cell / "fit.json").read_text())["estimates"]["joint_compliance[j1]"]
    assert estimate["unit"] == "m/N"
    truth = json.loads((cell / "truth.json").read_text())["truth"]["joint_compliance[j1]"]
    assert abs(estimate["value"] - truth) < 4.0 * estimate["sd"]
    assert "um/N" in (cell / "fit.html").read_text()


def test_a_clean_simulation_is_diagnosed_with_nothing(cell: Path) -> None:
    told = qsf("diagnose", cell / "experiment.yaml", cell / "readings.csv", "--json", cell / "diagnosis.json")
    assert json.loads((cell / "diagnosis.json").read_text())["verdict"] == "none", told


def test_programmes_are_tables_in_millimetres_and_other_formats_are_refused(cell: Path) -> None:
    arguments = ("export", cell / "experiment.yaml", cell / "plan.csv")
    qsf(*arguments, "--to", "csv", "-o", cell / "programme.csv", "--json", cell / "programme.json")
    planned = {r["pose"]: float(r["q1_mm"]) for r in rows(cell / "plan.csv")}
    stops = [r for r in rows(cell / "programme.csv") if r["pose"]]
    assert all(abs(float(r["q1_mm"]) - planned[r["pose"]]) < 1e-3 for r in stops)
    assert "q2_deg" in json.loads((cell / "programme.json").read_text())["stops"][0]
    told = refused(*arguments, "--to", "krl", "-o", cell / "programme.src")
    assert "krl holds turning axes only so far, and J1 of this arm slides" in told


def test_targets_are_corrected_in_millimetres_and_degrees(cell: Path) -> None:
    for text, name in ((TARGETS, "joints"), (CARTESIAN + "t01,1300,400,1200,5,60,10,0,0,-500\n", "places")):
        (cell / f"{name}.csv").write_text(text)
        out = cell / f"{name}_corrected.csv"
        qsf("compensate", cell / "experiment.yaml", cell / "fit.json", cell / f"{name}.csv", "-o", out)
        (row,) = rows(out)
        assert 0.01 < float(row["uncorrected_mm"]) < 20.0
        assert float(row["expected_error_mm"]) < 0.5 * float(row["uncorrected_mm"])
    beyond = TARGETS.replace("t01,600", "t01,6000")
    (cell / "beyond.csv").write_text(beyond)
    told = refused("compensate", cell / "experiment.yaml", cell / "fit.json", cell / "beyond.csv", "-o", cell / "x.csv")
    assert "j1 is outside its limits" in told
    assert "6000 mm" in told
    assert "-600 to 1400 mm" in told


def test_a_column_of_the_wrong_kind_says_what_is_allowed(cell: Path) -> None:
    (cell / "wrong.csv").write_text((cell / "plan.csv").read_text().replace("q1_mm", "q1_deg"))
    told = refused("simulate", cell / "experiment.yaml", cell / "wrong.csv", "-o", cell / "x.csv")
    assert "'deg' is no unit of this kind" in told
    assert "q1_mm, q1_m, q1_um" in told


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("joint_limits_mm: {j1", "joint_limits_mm: {j3", "joint_limits: j3 turns; allowed: joint_limits_deg"),
        ("joint_limits_deg: {j2", "joint_limits_deg: {j1", "joint_limits: j1 slides; allowed: joint_limits_mm"),
        ("[-500, 1300]", "[1500, 1600]", "leave nothing of its range; allowed: -600 to 1400 mm"),
    ],
)
def test_constraints_are_in_the_unit_of_their_joint(cell: Path, old: str, new: str, words: str) -> None:
    wrong = cell / "wrong.yaml"
    wrong.write_text(EXPERIMENT.replace(old, new))
    told = refused("check", wrong)
    assert words in told
    assert "line 6" in told


def test_it_is_shown_and_stiff_where_the_pose_says(cell: Path) -> None:
    qsf("show", cell / "tracked", "--pose", "700,10,20,30,0,40,0", "--html", cell / "show.html")
    told = qsf("stiffness", cell / "tracked", "--pose", "700,10,20,30,0,40,0", "--load", "0,0,-500")
    assert "The load point moves by" in told


@pytest.mark.parametrize("name", sorted(ARMS))
def test_new_keeps_what_slides(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "arm.urdf").write_text(ARMS[name])
    monkeypatch.chdir(tmp_path)
    qsf("new", "mine", "--urdf", "arm.urdf", "--payload", 60)
    robot = load_robot(tmp_path / "mine")
    assert robot.facts.sliding == load_robot(write_arm(tmp_path, name)).facts.sliding


def flange(robot: Robot, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    placed = joint_frames(robot.facts, q)
    return placed.positions[-1].T, placed.matrix(robot.facts.n)


def test_the_robot_on_the_track_is_the_robot_moved_along() -> None:
    alone, moved = load_robot("kuka_kr500_r2800_2"), load_robot("kuka_kr500_on_kl4000")
    q = np.random.default_rng(0).uniform(-2.0, 2.0, (20, 7))
    (there, turned), (here, still) = flange(moved, q), flange(alone, q[:, 1:])
    assert np.allclose(there, here + np.outer(q[:, 0], [0, 1, 0]) + [0, 0, 0.69], atol=1e-12)
    assert np.allclose(turned, still, atol=1e-12)
    assert np.allclose(moved.facts.masses[2:], alone.facts.masses[1:])
    assert moved.controller.external == (0,)


def test_a_gantry_passes_the_conformance_test(tmp_path: Path) -> None:
    assert all(check.good for check in check_robot(write_arm(tmp_path, "gantry")))
