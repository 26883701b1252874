"""`qsf diagnose` from files to files, on the example whose effect is hidden."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from qsframework.errors import InputError
from qsframework.experiment import example, load_experiment, make_plan, read_readings, write_plan
from tests.cli.test_commands import M900IB, R2000IC, run
from tests.diagnose.cases import poses

HIDDEN = str(example("hidden_effect") / "experiment.yaml")
TRUTH = -1.94e-16


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder of all files that a diagnosis writes, and what it prints."""
    to = tmp_path_factory.mktemp("hidden")
    files = ("--json", str(to / "r.json"), "--report", str(to / "r.html"), "--extend", str(to / "out"))
    return to, run("diagnose", HIDDEN, *files, "--follow-up", "5", "-o", str(to / "day2.csv"))


def test_the_hidden_effect_is_named_extended_and_simulated(ran: tuple[Path, str], tmp_path: Path) -> None:
    (folder, output) = ran
    result, report, out = folder / "r.json", folder / "r.html", folder / "out"
    assert "Explained by joint_hardening[joint_3]: held-out error " in output
    assert "\nCertain:\n  - joint_hardening[joint_3]: " in output
    found = json.loads(result.read_text())
    assert [c["id"] for c in found["causes"]] == ["joint_hardening[joint_3]"]
    value = found["causes"][0]["parameters"]["joint_hardening[joint_3]"]
    assert abs(value["value"] - TRUTH) < 3 * value["sd"]
    assert found["error_mm"]["heldout_extended"] < 0.8 * found["error_mm"]["heldout_identified"]
    assert "joint_hardening[joint_3]" in report.read_text()
    for words in ("urad/(kN m)^3", "no", "upper limits (95 %)", "not tested", "`--verbose`"):
        assert words in output

    extended = load_experiment(out / "experiment.yaml")
    p = next(p for p in extended.robot.parameters if p.name == "joint_hardening[joint_3]")
    assert p.nominal == value["value"]
    assert p.sd == pytest.approx(value["sd"], rel=1e-12)
    assert p.source.startswith("diagnosed: s = ")
    assert "sha256" in p.source
    assert "joint_hardening[joint_3]" in extended.fit_names()
    (data,) = extended.data
    assert data.resolve() == example("hidden_effect") / "readings.csv"

    plan, readings = tmp_path / "plan.csv", tmp_path / "again.csv"
    write_plan(plan, make_plan(poses(1, 20), ["weight"] * 20), extended)
    run("simulate", str(out / "experiment.yaml"), str(plan), "-o", str(readings))
    assert readings.read_text().count("\n") > 60
    fit = tmp_path / "fit.json"
    run("identify", str(out / "experiment.yaml"), "--json", str(fit))
    again = json.loads(fit.read_text())
    assert again["chi2"] < 1.1 * again["dof"], "the extended model fits the noise that is stated"
    assert "joint_hardening[joint_3]" in again["parameters"]


def test_other_readings_than_the_experiments_own(tmp_path: Path) -> None:
    """Those of the first 14 poses."""
    given, data = (Path(HIDDEN).parent / "readings.csv").read_text().splitlines(), tmp_path / "readings.csv"
    head = next(i for i, line in enumerate(given) if line.startswith("pose,")) + 1
    kept = list(dict.fromkeys(line.split(",")[0] for line in given[head:]))[:14]
    data.write_text("\n".join([*given[:head], *(line for line in given[head:] if line.split(",")[0] in kept)]) + "\n")
    result = tmp_path / "r.json"
    output = run("diagnose", M900IB, str(data), "--json", str(result), "--seed", "2", "--verbose")
    for words in ("above (95 %)", "arcmin", "Nothing is said about", "invisible here"):
        assert words in output
    assert "`--verbose`" not in output
    assert [c["id"] for c in json.loads(result.read_text())["causes"]] == ["joint_hardening[joint_3]"]


def test_options_that_do_not_go_together_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a plan goes without --extend"):
        run("diagnose", M900IB, str(example("m900ib") / "table5.csv"), "--extend", str(tmp_path / "o"))
    with pytest.raises(InputError, match="a plan goes without --follow-up"):
        run("diagnose", M900IB, str(example("m900ib") / "table5.csv"), "--follow-up", "4")
    with pytest.raises(InputError, match="would overwrite an input"):
        run("diagnose", R2000IC, "--json", R2000IC)
    with pytest.raises(InputError, match="no readings"):
        run("diagnose", M900IB)


def test_a_folder_with_files_is_refused_before_anything_is_computed(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="holds other files"):
        run("diagnose", HIDDEN, "--extend", str(tmp_path), "--json", str(tmp_path / "r.json"))
    assert not (tmp_path / "r.json").exists()


def test_a_wrong_convention_is_named_and_written_with_the_robot(tmp_path: Path) -> None:
    """The R-2000iC whose J3 is read as relative."""
    source = load_experiment(R2000IC).robot.folder
    shutil.copytree(source, tmp_path / "robot")
    robot = tmp_path / "robot" / "robot.yaml"
    text = robot.read_text()
    assert "equals: J3 + J2, " in text
    robot.write_text(text.replace("equals: J3 + J2, ", ""))
    shutil.copy(Path(R2000IC).parent / "readings.csv", tmp_path)
    wrong = tmp_path / "experiment.yaml"
    wrong.write_text(Path(R2000IC).read_text().replace("robot: fanuc_r2000ic", "robot: ./robot"))
    out = tmp_path / "out"
    output = run("diagnose", str(wrong), "--extend", str(out), "--json", str(tmp_path / "r.json"))
    assert json.loads((tmp_path / "r.json").read_text())["conventions"] == ["controller_coupling[joint_3]"]
    assert "set to 1" in output
    extended = load_experiment(out / "experiment.yaml")
    values = {p.name: p.nominal for p in extended.robot.parameters}
    assert values["controller_coupling[joint_3]"] == 1.0
    assert extended.data == (out / "readings.csv",), "a copy without the row that the audit took out"
    (problem,) = (p for p in json.loads((tmp_path / "r.json").read_text())["data_problems"] if p["id"] == "outliers")
    readings = read_readings(extended.data, extended)
    assert readings.line[~readings.use].tolist() == problem["rows"]


def test_a_second_day_is_in_json_and_report(ran: tuple[Path, str]) -> None:
    (folder, output) = ran
    result, report = folder / "r.json", folder / "r.html"
    day = json.loads(result.read_text())["follow_up"]
    assert day["visits"] == 5
    assert 0.0 < day["place_before"] <= day["place_after"] <= 1.0
    assert "joint_hardening[joint_3]" in [x["explanation"] for x in day["open"]]
    assert "5 visits bring the chance of naming the right place" in " ".join(output.split())
    text = report.read_text()
    assert "A second day" in text
    assert "remaining explanation" in text
    assert output.index("plan: ") < output.index("diagnosis: ")


def test_the_other_files_are_written_where_nothing_is_open(tmp_path: Path) -> None:
    """Readings of the model itself without any cause: no name, so no second day."""
    plan, readings, result = tmp_path / "plan.csv", tmp_path / "null.csv", tmp_path / "r.json"
    write_plan(plan, make_plan(poses(1, 20), ["weight"] * 20), load_experiment(M900IB))
    run("simulate", M900IB, str(plan), "-o", str(readings), "--seed", "2")
    with pytest.raises(InputError, match="nothing is open"):
        run("diagnose", M900IB, str(readings), "--json", str(result), "--follow-up", "4", "-o", str(tmp_path / "d.csv"))
    told = json.loads(result.read_text())
    assert told["verdict"] == "none"
    assert told["follow_up"] is None
    assert not (tmp_path / "d.csv").exists()
