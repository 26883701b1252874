"""The command line: every command, its files, its exit code."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app, main
from qsframework.errors import InputError
from qsframework.experiment import example

R2000IC = str(example("r2000ic") / "experiment.yaml")
M900IB = str(example("m900ib") / "experiment.yaml")


def run(*arguments: str, code: int = 0) -> str:
    result = CliRunner().invoke(app, list(arguments), catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result.output


def test_robots() -> None:
    output = run("robots")
    assert "fanuc_m900ib" in output
    assert "fanuc_r2000ic" in output


def test_check() -> None:
    output = run("check", "fanuc_m900ib", R2000IC, M900IB)
    assert "43 readings at 43 poses, ok" in output


def test_check_tells_the_problems_of_all_files(tmp_path: Path) -> None:
    for name in "ab":
        (tmp_path / f"{name}.yaml").write_text("robot: nobody\n")
    with pytest.raises(InputError) as caught:
        run("check", str(tmp_path / "a.yaml"), str(tmp_path / "b.yaml"))
    assert {p.file for p in caught.value.problems} == {str(tmp_path / "a.yaml"), str(tmp_path / "b.yaml")}


def test_check_says_what_reads_other_files(root: Path) -> None:
    for name, words in (("table5.csv", "found plan. qsf simulate"), ("targets.csv", "found targets. qsf compensate")):
        with pytest.raises(InputError) as caught:
            run("check", str(root / "examples" / "m900ib" / name))
        assert words in str(caught.value)


def test_check_finds_a_wrong_sign_and_a_wrong_unit(tmp_path: Path) -> None:
    """Before any fit; rows are judged with the sign set right, so that one wrong sign is one line, not a hundred."""
    text = (example("hidden_effect") / "experiment.yaml").read_text()
    lines = (example("hidden_effect") / "readings.csv").read_text().splitlines()
    head = next(i for i, line in enumerate(lines) if line.startswith("pose,"))
    for name, factor in (("right", 1.0), ("turned", -1.0), ("metres", 1e-3)):
        (tmp_path / f"{name}.yaml").write_text(text.replace("readings.csv", f"{name}.csv"))
        rows = [line.split(",") for line in lines[head + 1 :]]
        rows = [[*row[:-3], *(repr(factor * float(v)) for v in row[-3:])] for row in rows]
        (tmp_path / f"{name}.csv").write_text("\n".join([lines[head], *map(",".join, rows)]) + "\n")
    files = {name: str(tmp_path / f"{name}.yaml") for name in ("right", "turned", "metres")}
    right, turned, metres = (run("check", path, code=int(name != "right")) for name, path in files.items())
    assert "displacement_sign" not in right
    assert "load_unit" not in right
    assert "the sign of one of them is reversed" in turned
    assert turned.count("gross:") == right.count("gross:")
    assert "perhaps the displacements are in m where the file says mm" in metres


def test_design_simulate_identify(tmp_path: Path) -> None:
    plan, readings, fit = (str(tmp_path / n) for n in ("plan.csv", "readings.csv", "fit.json"))
    report = str(tmp_path / "r.html")
    output = run(
        "design",
        M900IB,
        "-n",
        "8",
        "--candidates",
        "150",
        "-o",
        plan,
        "--json",
        str(tmp_path / "p.json"),
        "--report",
        report,
    )
    assert "certified to an efficiency of 0.9999" in output
    assert json.loads((tmp_path / "p.json").read_text())["certificate"]["relaxed_efficiency"] >= 0.9999
    run("simulate", M900IB, plan, "-o", readings, "--truth", "drawn", "--seed", "3", "--json", str(tmp_path / "s.json"))
    output = run("identify", M900IB, readings, "--json", fit, "--report", report)
    assert "held-out (leave one pose out)" in output
    result = json.loads(Path(fit).read_text())
    truth = json.loads((tmp_path / "s.json").read_text())["truth"]
    for name, e in result["estimates"].items():
        assert abs(e["value"] - truth[name]) < 5 * e["sd"]
    assert result["sigma_source"] == "stated"


def test_identify_some_parameters_only() -> None:
    output = run("identify", R2000IC, "--fit", "joint_compliance[joint_1]", "--fit", "joint_compliance[joint_2]")
    rows = {line.split()[0] for line in output.splitlines() if " ± " in line}
    assert rows - {"parameter"} == {"joint_compliance[joint_1]", "joint_compliance[joint_2]"}


def test_the_same_seed_gives_the_same_readings(tmp_path: Path) -> None:
    plan = str(example("m900ib") / "table5.csv")
    texts = []
    for name in ("a.csv", "b.csv"):
        run("simulate", M900IB, plan, "-o", str(tmp_path / name), "--seed", "5")
        texts.append((tmp_path / name).read_text())
    assert texts[0] == texts[1]
    run("simulate", M900IB, plan, "-o", str(tmp_path / "c.csv"), "--seed", "6")
    assert (tmp_path / "c.csv").read_text() != texts[0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["identify", "nothing.yaml"], "no such file"),
        (["identify", M900IB], "no readings; add `data: readings.csv` or give FILE..."),
        (["identify", R2000IC, "--fit", "joint_complianse[joint_1]"], "Did you mean 'joint_compliance[joint_1]'?"),
        (["design", R2000IC], "a design needs `loads`"),
        (["design", M900IB, "--criterion", "Z"], "unknown criterion 'Z'"),
        (["simulate", M900IB, "nothing.csv"], "no such file"),
        (["simulate", M900IB, str(example("m900ib") / "table5.csv"), "--truth", "secret"], "unknown truth 'secret'"),
        (["check", "fanuc_m9000"], "Did you mean 'fanuc_m900ib'?"),
    ],
)
def test_bad_input_ends_with_code_2(
    arguments: list[str],
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["qsf", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert words in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["-o", "p.csv", "--json", "p.json"], "would overwrite what is written beside p.csv"),
        (["-o", "p.csv", "--report", "p.csv"], "would overwrite another output"),
        (["-o", M900IB], "would overwrite an input"),
    ],
)
def test_outputs_do_not_overwrite_each_other(
    options: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=words):
        run("design", M900IB, *options)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["robot.yaml", "nominal.yaml", "abb_irb2400.urdf.xacro", "meshes/link.stl"])
def test_no_output_overwrites_a_file_of_a_robot(root: Path, name: str, tmp_path: Path) -> None:
    shutil.copytree(root / "robots" / "abb_irb2400", tmp_path / "arm")
    (tmp_path / "arm" / "meshes").mkdir(exist_ok=True)
    (tmp_path / "arm" / "meshes" / "link.stl").write_text("solid")
    before = (tmp_path / "arm" / name).read_bytes()
    pose = ["stiffness", "fanuc_m900ib", "--pose=0,20,-10,0,40,0", "--load=0,0,-4000", "--json"]
    with pytest.raises(InputError, match=r"would overwrite a file of the robot in .*arm; choose another name"):
        run(*pose, str(tmp_path / "arm" / name))
    assert (tmp_path / "arm" / name).read_bytes() == before
    for _ in range(2):
        run(*pose, str(tmp_path / "arm" / "s.json"))  # what is no robot's file may stand there
    assert (tmp_path / "arm" / "s.json").is_file()


def test_a_hard_link_to_an_input_is_seen(tmp_path: Path) -> None:
    plan, other = Path(shutil.copy(example("m900ib") / "table5.csv", tmp_path / "plan.csv")), tmp_path / "r.csv"
    other.hardlink_to(plan)
    before = plan.read_bytes()
    with pytest.raises(InputError, match=r"r\.csv would overwrite .*plan\.csv, an input of this command"):
        run("simulate", M900IB, str(plan), "-o", str(other))
    assert plan.read_bytes() == other.read_bytes() == before


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["simulate", M900IB, "plan.csv", "-o", ""], "-o: the value is empty"),
        (["simulate", M900IB, "plan.csv", "--output="], "--output: the value is empty"),
        (["check", M900IB, "--json", ""], "--json: the value is empty"),
        (["check", ""], "the argument after check: the value is empty"),
    ],
)
def test_an_empty_value_is_named_by_its_option(
    words: list[str], said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["qsf", *words])
    with pytest.raises(SystemExit):
        main()
    assert said in capsys.readouterr().err


def test_an_unwritable_output_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        run("simulate", M900IB, str(example("m900ib") / "table5.csv"), "-o", str(tmp_path / "file" / "r.csv"))


@pytest.mark.parametrize("file", ["m900ib/experiment.yaml", "r2000ic/design.yaml", "ur10/design.yaml"])
def test_design_on_three_robots(file: str, tmp_path: Path) -> None:
    folder, name = file.split("/")
    output = run(
        "design",
        str(example(folder) / name),
        "-n",
        "14",
        "--candidates",
        "200",
        "-o",
        str(tmp_path / "plan.csv"),
        "--report",
        str(tmp_path / "plan.html"),
        "--json",
        str(tmp_path / "plan.json2"),
    )
    assert "is certified to an efficiency of" in output
    assert "predicted tip uncertainty after calibration: " in output
    assert "poses tried, 200 allowed" in output
    page = (tmp_path / "plan.html").read_text()
    assert "Predicted standard deviation of each plan" in page
    assert "certified to an efficiency" in page
    certificate = json.loads((tmp_path / "plan.json2").read_text())["certificate"]
    assert certificate["relaxed_efficiency"] >= 0.9999


def test_design_options(tmp_path: Path) -> None:
    plan = tmp_path / "plan.csv"
    run("design", M900IB, "-n", "6", "--candidates", "150", "--criterion", "D", "--no-polish", "-o", str(plan))
    more = ["-n", "4", "--candidates", str(plan), "--taken", str(plan), "-o", str(tmp_path / "more.csv")]
    output = run("design", M900IB, *more, "--test-poses", str(plan), "--criterion", "I")
    assert "with what was taken" in output
    run("simulate", M900IB, str(plan), "-o", str(tmp_path / "r.csv"))
    run("design", M900IB, *more[:4], "--taken", str(tmp_path / "r.csv"), "--repeats", "-o", str(tmp_path / "x.csv"))
    with pytest.raises(InputError, match="give a number, grid:LEVELS"):
        run("design", M900IB, "--candidates", "many")


def test_identify_in_one_step_with_all_its_files(tmp_path, capsys) -> None:  # type: ignore[no-untyped-def]
    from qsframework.cli.identify import FitFiles, run_identify
    from qsframework.estimation import FitOptions
    from qsframework.experiment import example
    from qsframework.fits import read_fit

    names = {"json": "fit.json", "report": "r.html", "nominal": "nominal.yaml"}
    out = {key: tmp_path / name for key, name in names.items()}
    files = FitFiles(experiment=example("r2000ic") / "experiment.yaml", **out)
    run_identify(files, None, FitOptions(loss="huber", fixed=("joint_compliance[joint_1]",), bounds=True), clean=False)
    said = capsys.readouterr().out
    assert "(fixed)" in said
    assert "Loss huber" in said
    assert "nominal values:" in said
    assert all(path.exists() for path in out.values())
    assert read_fit(out["json"]).method == "one-step"
    page = out["report"].read_text()
    assert "Method: one-step" in page
    assert "Fixed: joint_compliance[joint_1]." in page


def test_identify_options_reach_the_fit(tmp_path) -> None:  # type: ignore[no-untyped-def]
    from typer.testing import CliRunner

    from qsframework.cli.app import app
    from qsframework.experiment import example
    from qsframework.fits import read_fit

    options = ["--method", "one-step", "--tied", "joint_compliance[joint_4],joint_compliance[joint_5]"]
    file = tmp_path / "fit.json"
    result = CliRunner().invoke(
        app, ["identify", str(example("r2000ic") / "experiment.yaml"), *options, "--json", str(file)]
    )
    assert result.exit_code == 0, result.output
    stored = read_fit(file)
    values = dict(zip(stored.names, stored.values, strict=True))
    assert abs(values["joint_compliance[joint_4]"] / values["joint_compliance[joint_5]"] - 1.8 / 1.5) < 1e-9


def test_a_table_in_the_place_of_an_experiment_is_called_a_table(root: Path) -> None:
    with pytest.raises(
        InputError, match=r"series_b\.csv: is a table, where a YAML file is expected\. Tables of readings"
    ):
        run("identify", str(root / "examples" / "ur10" / "series_b.csv"))
