"""What is wrong with readings or files stands in the fit's account, and whatever uses the fit stops with its words."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.cli.check import experiment_lines
from qsframework.diagnoses import diagnose
from qsframework.errors import InputError
from qsframework.estimation import FitOptions
from qsframework.experiment import (
    Experiment,
    Readings,
    example,
    load_experiment,
    make_plan,
    read_readings,
    simulate,
    write_readings,
)
from qsframework.fits import identify, read_fit, validate, write_fit
from qsframework.fits.soundness import check_fit
from qsframework.report.words.headline import headline
from tests.applications.test_compensate import angles, posed

LOAD = np.array([0.0, 1500.0, -4000.0, 0.0, 0.0, 0.0])
STOPPED = {
    "validate": ["validate", "experiment.yaml", "fit.json", "readings.csv"],
    "compensate": ["compensate", "experiment.yaml", "fit.json", "targets.csv", "-o", "corrected.csv"],
    "kinematics": ["kinematics", "experiment.yaml", "fit.json", "--urdf", "corrected.urdf"],
    "certificate": ["certificate", "experiment.yaml", "fit.json", "readings.csv", "-o", "certificate.html"],
    "show": ["show", "experiment.yaml", "fit.json", "--html", "show.html"],
}


def said(folder: Path, *command: str) -> tuple[int, str]:
    """The exit code of a command in a folder, and its words in one line."""
    inside = [str(folder / a) if "." in a and not a.startswith("-") else a for a in command]
    done = CliRunner().invoke(app, inside)
    refused = isinstance(done.exception, InputError)  # `main` prints it and ends with 2
    return 2 if refused else done.exit_code, " ".join(f"{done.output} {done.exception if refused else ''}".split())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of which the loads stand in kilograms where the header says newtons, and its fit."""
    made = tmp_path_factory.mktemp("kilograms")
    source = example("m900ib")
    shutil.copy(source / "experiment.yaml", made)
    shutil.copy(source / "targets.csv", made)
    plan = CliRunner().invoke(
        app, ["design", str(made / "experiment.yaml"), "-n", "8", "--candidates", "60", "-o", str(made / "plan.csv")]
    )
    assert plan.exit_code == 0, plan.output
    simulated = ["simulate", str(made / "experiment.yaml"), str(made / "plan.csv"), "-o", str(made / "right.csv")]
    assert CliRunner().invoke(app, simulated).exit_code == 0
    lines = (made / "right.csv").read_text().splitlines()
    head = next(k for k, line in enumerate(lines) if line.startswith("pose"))
    names = lines[head].split(",")
    for k in range(head + 1, len(lines)):
        cells = lines[k].split(",")
        for name in ("fx_N", "fy_N", "fz_N"):
            cells[names.index(name)] = f"{float(cells[names.index(name)]) / 9.80665:.4f}"
        lines[k] = ",".join(cells)
    (made / "readings.csv").write_text("\n".join(lines) + "\n")
    code, words = said(made, "identify", "experiment.yaml", "readings.csv", "--json", "fit.json")
    assert code == 0
    assert words.startswith("Not to be used before it is looked at: load unit")
    return made


def test_check_names_it_and_ends_with_1(folder: Path) -> None:
    code, words = said(folder, "check", "experiment.yaml", "readings.csv")
    assert (code, "perhaps the load is in kg" in words) == (1, True)


def test_check_of_right_readings_ends_with_0(folder: Path) -> None:
    assert said(folder, "check", "experiment.yaml", "right.csv")[0] == 0


def test_check_of_what_cannot_be_read_ends_with_2(folder: Path) -> None:
    assert said(folder, "check", "nowhere.yaml")[0] == 2


def test_diagnose_begins_with_it(folder: Path) -> None:
    code, words = said(folder, "diagnose", "experiment.yaml", "readings.csv")
    assert code == 0
    assert words.startswith("Look first at the load unit: all compliances come out about")


@pytest.mark.parametrize("verb", STOPPED)
def test_what_uses_the_fit_stops_with_its_words(verb: str, folder: Path) -> None:
    code, words = said(folder, *STOPPED[verb])
    assert code == 2
    assert "perhaps the load is in kg" in words
    assert "Correct the unit in the table's header" in words


@pytest.mark.parametrize("verb", ["validate", "compensate"])
def test_anyway_goes_on_and_notes_it(verb: str, folder: Path) -> None:
    code, words = said(folder, *STOPPED[verb], "--anyway")
    assert code == 0, words
    assert "the fit is used although load unit: all compliances" in words


def test_a_certificate_knows_no_such_way(folder: Path) -> None:
    assert said(folder, *STOPPED["certificate"], "--anyway")[0] == 2


def test_what_the_finding_says_is_to_be_done_mends_it(folder: Path, tmp_path: Path) -> None:
    """Where the loads are right, the compliances of the fit become the values before: nothing is found then."""
    robot = shutil.copytree(load_experiment(folder / "experiment.yaml").robot.folder, tmp_path / "fanuc_m900ib")
    shutil.copy(folder / "experiment.yaml", tmp_path)
    shutil.copy(folder / "readings.csv", tmp_path)
    command = ["identify", "experiment.yaml", "readings.csv"]
    assert said(tmp_path, *command, "--nominal", "nominal.yaml")[0] == 2
    assert said(tmp_path, *command, "--nominal", "nominal.yaml", "--anyway")[0] == 0
    shutil.copy(tmp_path / "nominal.yaml", robot / "nominal.yaml")
    code, words = said(tmp_path, *command)
    assert (code, "load unit" in words) == (0, False), words


def test_an_impossible_balancer_stops_what_uses_the_fit(folder: Path, tmp_path: Path) -> None:
    """100 N/m where 1e5 belongs, at nominal: every verb begins or stops with it, with both torques and the value."""
    robot = shutil.copytree(load_experiment(folder / "experiment.yaml").robot.folder, tmp_path / "fanuc_m900ib")
    nominal = (robot / "nominal.yaml").read_text()
    (robot / "nominal.yaml").write_text(nominal.replace("value_N/m: 1.0e5", "value_N/m: 100"))
    for name in ("experiment.yaml", "targets.csv"):
        shutil.copy(folder / name, tmp_path)
    shutil.copy(folder / "right.csv", tmp_path / "readings.csv")
    words = (
        "gravity compensator[joint 2]: it exerts up to 7.81 N m; gravity's torque there is 1.49e+04 N m of the links"
    )
    code, checked = said(tmp_path, "check", "experiment.yaml", "readings.csv")
    assert (code, checked.count("it exerts up to")) == (1, 1)
    code, fitted = said(tmp_path, "identify", "experiment.yaml", "readings.csv", "--json", "fit.json")
    assert (code, "Not to be used before it is looked at: gravity compensator[joint 2]" in fitted) == (0, True)
    assert f"Look at {words}" in fitted
    code, diagnosed = said(tmp_path, "diagnose", "experiment.yaml", "readings.csv")
    assert (code, f"Look first at the {words}" in diagnosed) == (0, True)
    for verb in STOPPED:
        code, stopped = said(tmp_path, *STOPPED[verb])
        assert (code, words in stopped, "look at stiffness 100 N/m" in stopped) == (2, True, True), verb


@pytest.mark.parametrize("stays", [False, True], ids=["taken out", "said to stop nothing"])
def test_findings_edited_by_hand_are_refused(folder: Path, stays: bool, tmp_path: Path) -> None:
    """Without them the fit is not the one that its readings give."""
    for name in ("experiment.yaml", "readings.csv", "targets.csv"):
        shutil.copy(folder / name, tmp_path)
    stored = json.loads((folder / "fit.json").read_text())
    (one,) = stored["account"]["findings"]
    stored["account"]["findings"] = [one | {"stops": False}] if stays else []
    (tmp_path / "fit.json").write_text(json.dumps(stored))
    code, words = said(tmp_path, *STOPPED["compensate"])
    assert code == 2
    assert "what was found wrong in its readings and files is not what is found there now" in words


def test_a_fit_file_keeps_them(folder: Path, tmp_path: Path) -> None:
    fit = read_fit(folder / "fit.json")
    (one,) = fit.account.findings
    assert (one.name, one.rows, np.isnan(one.evidence) or one.evidence == 0.0) == ("load_unit", (), True)
    again = read_fit(write_fit(fit, tmp_path / "again.json"))
    assert [f.sentence for f in again.account.findings] == [one.sentence]


@pytest.mark.parametrize(
    ("stated_mm", "names"),
    [
        (0.03, set[str]()),
        (0.2, {"small_residuals"}),
        (30.0, {"noise", "small_residuals", "nothing_identified"}),
        (3e-4, {"noise", "large_residuals"}),
    ],
)
def test_a_stated_noise_that_the_residuals_contradict(
    m900ib: Experiment, stated_mm: float, names: set[str], tmp_path: Path
) -> None:
    fit = identify(*stated(m900ib, stated_mm, tmp_path))
    assert {f.name for f in fit.account.findings if not f.rows} == names


@pytest.mark.parametrize(
    ("stated_mm", "first"), [(0.2, "Look first at the small residuals: "), (3e-4, "Look first at the noise: ")]
)
def test_a_diagnosis_begins_with_such_a_noise(m900ib: Experiment, stated_mm: float, first: str, tmp_path: Path) -> None:
    assert headline(diagnose(*stated(m900ib, stated_mm, tmp_path), repeats=1)).startswith(first)


def test_check_notes_residuals_that_the_held_out_error_carries(m900ib: Experiment, tmp_path: Path) -> None:
    """Of an arm whose tracker is better than the model nothing is to be mended: a note, and exit code 0."""
    lines = experiment_lines(*stated(m900ib, 0.002, tmp_path, "drawn"))
    assert not any(good is False for good, _, _ in lines)
    (words,) = (words for _, kind, words in lines if kind == "residuals")
    assert re.match(r"The residuals are 1\d\.\d times the stated noise", words)


def stated(
    experiment: Experiment, sigma_mm: float, folder: Path, truth: Literal["nominal", "drawn"] = "nominal"
) -> tuple[Experiment, Readings]:
    """A campaign of 14 poses with another noise stated than it has."""
    plan = make_plan(posed(experiment, angles(14, 3), LOAD), ["a"] * 14)
    made = simulate(experiment, plan, truth=truth, seed=2).readings
    text = re.sub(r"sigma_mm: [\d.e-]+", f"sigma_mm: {sigma_mm}", experiment.path.read_text())
    (folder / "experiment.yaml").write_text(text)
    sigma = np.full(made.sigma.shape, 1e-3 * sigma_mm)
    return load_experiment(folder / "experiment.yaml"), replace(made, sigma=sigma, stated=True)


def test_a_balancer_that_cannot_be_is_found(tmp_path: Path) -> None:
    source = example("m900ib")
    experiment = load_experiment(source / "experiment.yaml")
    robot = shutil.copytree(experiment.robot.folder, tmp_path / "fanuc_m900ib")
    shutil.copy(source / "experiment.yaml", tmp_path)
    text = (robot / "nominal.yaml").read_text()
    weak = re.sub(r"(gravity_compensator\[joint_2\].stiffness:\n  value_N/m: )\S+", r"\g<1>100", text)
    assert weak != text
    (robot / "nominal.yaml").write_text(weak)
    weakened = load_experiment(tmp_path / "experiment.yaml")
    plan = make_plan(posed(weakened, angles(14, 3), LOAD), ["a"] * 14)
    fit = identify(weakened, simulate(weakened, plan, seed=2).readings)
    (found,) = fit.account.findings
    assert found.name == "gravity_compensator[joint_2]"
    with pytest.raises(InputError, match="Correct the robot's files"):
        check_fit(fit, weakened.robot, weakened)


def test_rows_that_are_said_to_be_right_are_no_finding(m900ib: Experiment) -> None:
    """An angle that is mistyped at one pose stops what uses the fit; `keep_all` says that the row is right."""
    made = simulate(m900ib, make_plan(posed(m900ib, angles(14, 3), LOAD), ["a"] * 14), seed=2).readings
    pendant = np.array(made.poses.pendant)
    of_pose = np.array([name == "p04" for name in made.states.pose])
    pendant[of_pose, 2] -= np.deg2rad(20.0)
    q = m900ib.robot.controller.to_joints(pendant)
    wrong = made.with_poses(replace(made.poses, pendant=pendant, q=q))
    fit, kept = (identify(m900ib, wrong, options=FitOptions(keep_all=keep)) for keep in (False, True))
    rows = {int(line) for line in wrong.line[of_pose[wrong.plus]]}
    assert rows <= {*fit.masked, *(row for f in fit.account.findings for row in f.rows)}
    assert not kept.masked
    assert not any(f.rows for f in kept.account.findings)


def test_nothing_is_found_in_the_shipped_examples(r2000ic: Experiment) -> None:
    for name in ("r2000ic", "hidden_effect", "mixed", "unknown_effect"):
        experiment = load_experiment(example(name) / "experiment.yaml")
        fit = identify(experiment, read_readings(experiment.data, experiment, "positions"))
        assert fit.account.findings == (), name
        assert validate(experiment, read_readings(experiment.data, experiment, "positions"), fit).seen


@pytest.mark.parametrize("verb", ["check", "identify", "diagnose"])
def test_of_joints_that_stand_still_nothing_is_said_but_what_they_hide(
    m900ib: Experiment, verb: str, tmp_path: Path
) -> None:
    """How the controller shows a joint that never moves is no cause and no mistake; what that hides stands once."""
    shutil.copy(m900ib.path, tmp_path / "experiment.yaml")
    pendant = angles(14, 3)
    pendant[:, 3:] = np.deg2rad([0.0, -60.0, 0.0])
    plan = make_plan(posed(m900ib, pendant, LOAD), ["a"] * 14)
    write_readings(tmp_path / "readings.csv", simulate(m900ib, plan, seed=2).readings, m900ib)
    code, words = said(tmp_path, verb, "experiment.yaml", "readings.csv")
    assert code == 0, words
    assert words.count("joint_4, joint_5, joint_6 stand still in all readings") == 1
    assert not re.search(r"(controller_coupling|joint_sign)\[joint_[456]", words)
