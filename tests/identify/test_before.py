"""What *before* means: the values before any of these readings was used, across folders of extensions and nominals."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from remembered import diagnose
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.errors import InputError
from qsframework.experiment import load_experiment, make_plan, read_readings, simulate
from qsframework.experiment.observations import values_before
from qsframework.fits import identify, validate
from qsframework.plugin import Parameter, Poses

pytestmark = pytest.mark.usefixtures("diagnosed_once")

HIDDEN = Path(__file__).resolve().parents[2] / "examples" / "hidden_effect"


def run(*arguments: object) -> str:
    result = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_the_oldest_value_that_no_reading_at_hand_has_changed() -> None:
    p = Parameter("c", "m", nominal=3.0, earlier=((1.0, ("a",)), (2.0, ("b", "c"))))
    assert [p.before([used]) for used in ("a", "b", "d")] == [1.0, 2.0, 3.0]
    assert p.before(["c", "a"]) == 1.0
    assert p.before([]) == 3.0
    assert p.identified_by(["d"]).earlier == (*p.earlier, (3.0, ("d",)))
    assert p.identified_by(["b"]) is p, "again by the same readings: what stood before them stays"
    assert p.identified_by([]) is p


def test_the_documented_way_ends_in_a_certificate_with_the_gain_of_all_steps(tmp_path: Path) -> None:
    """Diagnosis, extension, fit, nominal values, fit again: each step says what was before the readings."""
    given = shutil.copytree(HIDDEN, tmp_path / "given")
    extended, nominal = tmp_path / "ext" / "experiment.yaml", tmp_path / "nominal.yaml"
    run("diagnose", given / "experiment.yaml", "--extend", tmp_path / "ext")
    said = run("identify", extended, "--json", tmp_path / "fit.json", "--nominal", nominal)
    own = run("identify", given / "experiment.yaml", "--json", tmp_path / "own.json")
    before = [re.search(r"[\d.]+(?= → )", text) for text in (said, own)]
    assert before[0] is not None
    assert before[1] is not None
    assert before[0][0] == before[1][0], "before is the arm as it was before these readings, extended or not"
    shutil.copy(nominal, tmp_path / "ext" / "robot" / "nominal.yaml")
    again = run("identify", extended, "--json", tmp_path / "again.json")
    assert before[0][0] in again.splitlines()[0]
    run("certificate", extended, tmp_path / "again.json", "--halves", 3, "-o", tmp_path / "c.html")
    assert "before" in (tmp_path / "c.html").read_text(encoding="utf-8")
    experiment = load_experiment(extended)
    readings = read_readings(given / "readings.csv", experiment)
    first = load_experiment(given / "experiment.yaml").model()
    found = dict(zip(experiment.model().names, values_before(experiment.model(), readings.hashes), strict=True))
    for name, value in zip(first.names, first.nominal, strict=True):
        np.testing.assert_allclose(found[name], value, rtol=1e-12)
    assert all(found[n] == 0.0 for n in found.keys() - {*first.names})


def test_other_readings_are_held_against_the_arm_before_the_fit(tmp_path: Path) -> None:
    """Not against the values of the fit itself, which the files hold by now."""
    given = shutil.copytree(HIDDEN, tmp_path / "given")
    file, halves = given / "experiment.yaml", (given / "first.csv", given / "second.csv")
    robot, head, *rows = (given / "readings.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    for half, part in zip(halves, (rows[:90], rows[90:]), strict=True):
        half.write_text(robot + head + "".join(part), encoding="utf-8")
    run("identify", file, halves[0], "--json", tmp_path / "fit.json", "--nominal", given / "n.yaml")
    own = run("validate", file, tmp_path / "fit.json", halves[1])
    file.write_text(file.read_text(encoding="utf-8") + "nominal: n.yaml\n", encoding="utf-8")
    run("identify", file, halves[0], "--json", tmp_path / "again.json")
    again = run("validate", file, tmp_path / "again.json", halves[1])
    before = [re.search(r"[\d.]+(?= → )", text) for text in (own, again)]
    assert before[0] is not None
    assert before[1] is not None
    assert before[0][0] == before[1][0] > "0.1"


def test_a_stage_that_says_nothing_is_refused(tmp_path: Path) -> None:
    given = shutil.copytree(HIDDEN, tmp_path / "given")
    with (given / "experiment.yaml").open("a", encoding="utf-8") as file:
        file.write("nominal: n.yaml\n")
    (given / "n.yaml").write_text("joint_compliance[joint_1]: {value_rad/(N m): 1e-7, earlier: [{value_m: 1}]}\n")
    with pytest.raises(InputError, match=re.escape("earlier is a list of value_rad/(N m) and readings")):
        load_experiment(given / "experiment.yaml")


RIGID = """
robot: ur10
rigid: true
markers: {m1: {xyz_mm: [60, 0, 40]}, m2: {xyz_mm: [-40, 50, 40]}}
noise: {position_sigma_mm: 0.03}
positions: {}
effects: [{effect: joint_offset, joints: all}]
fit: [joint_offset]
"""


def test_the_arm_before_a_rigid_fit_is_rigid_wherever_it_is_told(tmp_path: Path) -> None:
    """The mass of the arm bends no spring that is not fitted: identify, validate and diagnose have one error before."""
    (tmp_path / "experiment.yaml").write_text(RIGID)
    experiment = load_experiment(tmp_path / "experiment.yaml")
    rng = np.random.default_rng(0)
    pendant = np.deg2rad(rng.uniform([-90, -120, 20, -90, 30, -90], [90, -40, 120, 0, 120, 90], (12, 6)))
    poses = Poses(pendant, experiment.robot.controller.to_joints(pendant), np.zeros((12, 6)))
    readings = simulate(experiment, make_plan(poses, [""] * 12), truth="drawn", seed=2).readings
    fit = identify(experiment, readings)
    before = float(np.linalg.norm(fit.measured - fit.nominal, axis=1).mean())
    assert before > 10.0 * fit.rms
    assert validate(experiment, readings, fit).as_json()["nominal_error_mm"]["mean"] == pytest.approx(1e3 * before)
    assert diagnose(experiment, readings, repeats=1).rms.nominal == pytest.approx(fit.rms_nominal)
