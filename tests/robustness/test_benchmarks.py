"""The benchmarks' page: sections are replaced whole, and every script that `make bench` runs has one."""

import csv
import importlib
import re
import shutil
import sys
from dataclasses import asdict
from pathlib import Path
from types import ModuleType

import numpy as np
import pinocchio as pin
import pytest
from scipy.stats import binomtest

from qsframework.experiment import load_experiment, read_readings
from qsframework.fits import identify

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "results.md"
with (PAGE.parent / "records" / "made.csv").open() as lines:
    MADE = {row["section"]: row for row in csv.DictReader(lines)}
SECTIONS = ("start-up", "commands", "kinematics", "design", "identification", "scaling")
ASKED = ("against", "clean", "positions")
"""Sections that only their own scripts fill, which take too long for `make bench`."""


@pytest.fixture
def load(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    names = ("common", "kinematics", "startup", "against", "campaign", "clean", "make_mixed_example")

    def module(name: str) -> ModuleType:
        return importlib.import_module(name)

    yield module
    for name in names:
        sys.modules.pop(name, None)


def test_the_page_holds_each_section_once_and_filled() -> None:
    page = PAGE.read_text()
    for name in SECTIONS:
        assert page.count(f"<!-- {name} -->") == page.count(f"<!-- end of {name} -->") == 1
        body = page.partition(f"<!-- {name} -->")[2].partition(f"<!-- end of {name} -->")[0]
        tables = re.findall(r"\]\((records/.*?\.csv)\)", body)
        assert tables, f"{name} has no table: run make bench"
        assert all(len((PAGE.parent / table).read_text().splitlines()) > 1 for table in tables)
        assert int(MADE[name]["runs"]) >= 5
        assert "benchmarks/" in MADE[name]["command"]


def test_the_page_has_room_for_what_is_asked_for() -> None:
    page = PAGE.read_text()
    for name in ASKED:
        assert page.count(f"<!-- {name} -->") == page.count(f"<!-- end of {name} -->") == 1
        assert f'show("{name}"' in (ROOT / "benchmarks" / f"{name}.py").read_text()
        assert f"benchmarks/{name}.py" in MADE[name]["command"]


def test_make_bench_runs_scripts_that_exist() -> None:
    line = next(x for x in (ROOT / "Makefile").read_text().splitlines() if x.startswith("BENCHMARKS :="))
    scripts = line.partition(":=")[2].split()
    assert len(scripts) >= 5
    for name in scripts:
        assert "--write" in (ROOT / "benchmarks" / f"{name}.py").read_text()


def test_a_section_is_replaced_and_nothing_else(load, tmp_path, monkeypatch) -> None:
    common = load("common")
    page = tmp_path / "results.md"
    page.write_text("before\n<!-- a -->\nold\n<!-- end of a -->\nafter\n<!-- b -->\nkept\n<!-- end of b -->\n")
    monkeypatch.setattr(common, "PAGE", page)
    monkeypatch.setattr(common, "RECORDS", tmp_path / "records")
    monkeypatch.setattr(common, "vectors", lambda: "AVX-512")
    common.write_section("a", "new", "the command")
    text = page.read_text()
    assert text.startswith("before\n<!-- a -->\nnew\n")
    assert "old" not in text
    assert text.endswith("<!-- end of a -->\nafter\n<!-- b -->\nkept\n<!-- end of b -->\n")
    assert "a,the command," in (tmp_path / "records" / "made.csv").read_text()
    with pytest.raises(SystemExit, match="once each"):
        common.write_section("c", "new", "the command")
    assert page.read_text() == text


def test_a_quick_run_is_not_written(load, tmp_path, monkeypatch, capsys) -> None:
    common = load("common")
    page = tmp_path / "results.md"
    page.write_text("<!-- a -->\nold\n<!-- end of a -->\n")
    monkeypatch.setattr(common, "PAGE", page)
    common.show("a", "new", write=True, quick=True)
    assert "old" in page.read_text()
    assert "not written" in capsys.readouterr().err


def test_raw_tables_go_beside_the_page_and_what_has_a_goal_stays(load, tmp_path, monkeypatch) -> None:
    common = load("common")
    monkeypatch.setattr(common, "RECORDS", tmp_path / "records")
    text = "made\n\n" + common.table(["metric", "goal", "cases"], [["a", "1 %", "7"], ["b", "-", "9"]])
    text += "\n\n### By kind\n\n" + common.table(["kind", "hits"], [["x, y", 3]])
    page = common.shelved(text, "tried")
    assert page.startswith("made\n\n| metric | goal |\n|---|---|\n| a | 1 % |\n\nRaw tables: ")
    assert "[By kind](records/tried-by-kind-by-kind.csv)" in page
    assert (tmp_path / "records" / "tried-by-kind-by-kind.csv").read_text() == 'kind,hits\n"x, y",3\n'
    assert (tmp_path / "records" / "tried-by-metric.csv").read_text() == "metric,goal,cases\na,1 %,7\nb,-,9\n"
    met = common.table(["metric", "goal", "goal met"], [["a", "1 %", "yes"], ["b", "2 %", "no"]])
    assert "1 of 2 goals are met.\n\n| metric | goal | goal met |\n|---|---|---|\n| b |" in common.shelved(met, "goals")


def test_jobs_take_turns_and_each_has_its_median(load) -> None:
    order: list[str] = []
    found = load("common").turns({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, 3)
    assert order == ["a", "b"] * 3
    assert set(found) == {"a", "b"}


def test_a_command_that_fails_stops_the_benchmark_with_its_words(load) -> None:
    with pytest.raises(SystemExit, match="no such thing"):
        load("common").ran([sys.executable, "-c", "raise SystemExit('no such thing')"])


def test_kinematics_says_how_it_compares(load) -> None:
    text = load("kinematics").tables(2000, 1)
    assert text.count("times") >= 4
    assert "Pinocchio" in text


# ---------------------------------------------------------------- against an older revision


def test_a_tree_that_refuses_a_job_has_a_row_that_says_so(load, tmp_path, capsys) -> None:
    against = load("against")
    sides = [against.Side(name, ROOT, sys.executable, "") for name in ("old", "new")]
    shutil.copytree(ROOT / "robots" / "ur10", tmp_path / "old")
    job = against.Job("ur10", "a robot that one tree has", "check {made}/robot.yaml", 2.0)
    row = against.run_job(job, sides, tmp_path, tmp_path, 2)
    assert {name: len(each) for name, each in row.runs.items()} == {"old": 2, "new": 0}
    name, _, old, new, ratio, _, size, goal = row.cells(1)
    assert (name, ratio, size) == ("ur10", "-", "-")
    assert float(old) > 0.0
    assert new.startswith("failed: ")
    assert goal == "at most 2: not measured"
    assert "new tree" in capsys.readouterr().err
    both = against.run_job(against.Job("help", "the help", "--help", 0.1), sides, tmp_path, tmp_path, 1)
    assert not both.failed
    assert both.cells(1)[-1] == "at most 0.1: NOT met"
    assert both.as_json()["runs"]["new"][0] == asdict(both.runs["new"][0])


def test_trees_take_turns_in_being_first(load) -> None:
    against, order = load("against"), []
    commands = {name: lambda name=name: order.append(name) for name in ("old", "new")}
    against.measured("a job", commands, 3)
    assert order == ["old", "new", "new", "old", "old", "new"]


def test_the_ratio_is_that_of_runs_that_follow_each_other(load) -> None:
    """The third pair fell on a busy machine: of the medians it would be 2.7."""
    against = load("against")
    seconds = {"old": (1.0, 1.1, 9.0), "new": (2.0, 3.0, 18.0)}
    runs = {name: [against.Ran(s, s, 100.0) for s in each] for name, each in seconds.items()}
    row = against.Row(against.Job("a", "", "", 2.0), runs, {})
    assert row.ratio == 2.0
    assert row.goal().endswith(": met")
    assert against.Row(against.Job("a", "", "", 1.9), runs, {}).goal().endswith(": NOT met")


def test_jobs_are_picked_by_name(load) -> None:
    against = load("against")
    names = [job.name for job in against.picked("")]
    assert len(names) == len(set(names)) >= 10
    assert [job.name for job in against.picked("check,start-up")] == ["start-up", "check"]
    with pytest.raises(SystemExit, match="no job nonsense; there are start-up"):
        against.picked("check,nonsense")


def test_examples_that_jobs_name_exist(load, tmp_path) -> None:
    against = load("against")
    for job in against.picked(""):
        command = job.command(ROOT / "examples", tmp_path)
        assert all(Path(word).is_file() for word in command if word.startswith(str(ROOT)))


def test_an_environment_of_its_own_is_made_where_needs_differ(load, tmp_path) -> None:
    against = load("against")
    for name in ("pyproject.toml", "requirements.lock"):
        (tmp_path / name).write_text((ROOT / name).read_text())
    project = tmp_path / "pyproject.toml"
    project.write_text(project.read_text().replace("line-length = 120", "line-length = 100"))
    assert against.needs(tmp_path) == against.needs(ROOT)
    project.write_text(project.read_text().replace('"rich>=14"', '"rich>=15"'))
    assert against.needs(tmp_path) != against.needs(ROOT)


def test_the_campaign_stands_in_equilibrium(load, tmp_path) -> None:
    """Torques from differences of the energy, and Hooke's law with them."""
    campaign = load("campaign")
    model = campaign.arm(np.random.default_rng(0))
    data, commanded, force = (
        model.createData(),
        np.array([0.4, -1.1, 1.3, 0.2, -0.7, 2.0]),
        np.array([80.0, 5.0, -20.0]),
    )
    q = campaign.settled(model, data, commanded, campaign.COMPLIANCE, force)

    def energy(q: np.ndarray) -> float:
        pin.forwardKinematics(model, data, q)
        point = data.oMi[model.njoints - 1].act(np.array(campaign.POINT) / 1e3)
        return float(pin.computePotentialEnergy(model, data, q) - force @ point)

    steps = 1e-5 * np.eye(6)
    torque = -np.array([(energy(q + d) - energy(q - d)) / 2e-5 for d in steps])
    assert np.abs(torque).max() > 10.0
    np.testing.assert_allclose(q - commanded, campaign.COMPLIANCE * torque, atol=1e-9)


def test_the_campaign_is_read(load, tmp_path) -> None:
    campaign = load("campaign")
    experiment = load_experiment(campaign.write(tmp_path / "one", 9))
    readings = read_readings(tmp_path / "one" / "readings.csv", experiment)
    assert readings.value.shape == (27, 3)
    assert readings.is_position.all()
    assert readings.states.loaded.tolist() == [False, True, True] * 3
    again = campaign.write(tmp_path / "two", 9).with_name("readings.csv").read_text()
    assert again == (tmp_path / "one" / "readings.csv").read_text()
    assert again != campaign.write(tmp_path / "three", 9, seed=1).with_name("readings.csv").read_text()


# ---------------------------------------------------------------- three kinds of readings


def test_the_mixed_example_is_what_its_script_makes(load, tmp_path) -> None:
    load("make_mixed_example").write(tmp_path)
    for name in ("tracker", "weights", "gauge"):
        made, kept = ((f / f"{name}.csv").read_text() for f in (tmp_path, ROOT / "examples" / "mixed"))
        assert made == kept, name


def test_the_mixed_example_settles_on_its_pedestal(load) -> None:
    """Torques from differences of the energy, and Hooke's law with them, at all seven springs."""
    mixed = load("make_mixed_example")
    arm = mixed.built(np.random.default_rng(0))
    commanded, force = arm.joints([20.0, 30.0, -20.0, 15.0, -40.0, 10.0]), np.array([0.0, 600.0, -1500.0])
    hand = arm.place(commanded, force)
    q = arm.settled(commanded, force)

    def energy(q: np.ndarray) -> float:
        pin.forwardKinematics(arm.model, arm.data, q)
        point = pin.updateFramePlacement(arm.model, arm.data, arm.flange).act(np.array(mixed.POINT) / 1e3)
        return float(pin.computePotentialEnergy(arm.model, arm.data, q) - force @ point)

    steps = 1e-5 * np.eye(7)
    torque = -np.array([(energy(q + d) - energy(q - d)) / 2e-5 for d in steps])
    assert abs(torque[0]) > 1000.0
    np.testing.assert_allclose(q - commanded, arm.compliance * torque, atol=1e-9)
    pin.forwardKinematics(arm.model, arm.data, q)
    np.testing.assert_allclose(pin.updateFramePlacement(arm.model, arm.data, arm.flange).homogeneous, hand.homogeneous)


def test_one_fit_of_three_kinds_of_readings_finds_the_truth(load, tmp_path) -> None:
    """Readings by Pinocchio without noise, of an arm whose geometry, markers and springs are all off and whose
    pedestal gives: the springs come back to a fifth of the sd that the noise would leave."""
    mixed = load("make_mixed_example")
    mixed.SIGMA = dict.fromkeys(mixed.SIGMA, 1e-6)
    arm = mixed.write(tmp_path, seed=1)
    text = (ROOT / "examples" / "mixed" / "experiment.yaml").read_text()
    text = text.replace("effects:\n", "effects:\n  - {effect: base_compliance, direction: ry}\n")
    (tmp_path / "experiment.yaml").write_text(text.replace("joint_compliance]", "joint_compliance, base_compliance]"))
    experiment = load_experiment(tmp_path / "experiment.yaml")
    readings = read_readings(experiment.data, experiment)
    assert (readings.is_gauge.sum(), readings.is_position.sum(), len(readings)) == (12, 120, 192)
    fit = identify(experiment, readings)
    names = ["base_compliance[ry]", *(f"joint_compliance[joint_{k}]" for k in range(1, 7))]
    found = {e.name: e for e in fit.estimates}
    for name, true in zip(names, arm.compliance, strict=True):
        assert abs(found[name].value - true) < 0.2 * found[name].sd, name
    assert fit.masked == ()


# ---------------------------------------------------------------- clean readings


def test_the_intervals_are_those_of_clopper_and_pearson(load) -> None:
    clean = load("clean")
    for hits, count in ((0, 200), (1, 7), (10, 200), (7, 7)):
        interval = binomtest(hits, count).proportion_ci(method="exact")
        assert clean.clopper_pearson(hits, count) == pytest.approx((interval.low, interval.high))


def test_answers_are_counted(load) -> None:
    clean = load("clean")
    said = {"none": (), "explained": ("c",), "unexplained": (), "partly_explained": ("c", "d")}
    verdicts = ["none"] * 46 + ["explained", "unexplained", "partly_explained"]
    results = [clean.Result("a", k, "done", 0.5, v, said[v]) for k, v in enumerate(verdicts)]
    results.append(clean.Result("a", 49, "refused", 0.0, words="too few"))
    assert clean.row("a", results, 0.06) == [
        "a",
        "49",
        "3: 6.1 %",
        "1.3 - 16.9 %",
        "at most 6 %: within the interval",
        "1",
        "0",
        "0.50",
        "1 refused",
    ]
    text = clean.report(results)
    assert "No answer: too few (1)." in text
    assert "Named: c (2), d (1)." in text
    assert clean.row("a", results[-1:], 0.06)[1:3] == ["0", "-"]


@pytest.fixture(scope="module")
def stranger(tmp_path_factory: pytest.TempPathFactory):
    """The experiment on the robot that `qsf new` makes."""
    import clean

    return clean, load_experiment(clean.written(clean.MADE, tmp_path_factory.mktemp("clean")))


def test_only_what_is_fitted_is_drawn(stranger) -> None:
    clean, experiment = stranger
    model = experiment.model()
    one = experiment.with_(fit=("joint_compliance[to_upper]",))
    drawn = clean.truth_of(one, np.random.default_rng(0)) != model.nominal
    assert [name for name, d in zip(model.names, drawn, strict=True) if d] == ["joint_compliance[to_upper]"]
    assert (clean.truth_of(experiment, np.random.default_rng(0)) != model.nominal).sum() == 6


def test_a_stranger_is_answered_and_a_refusal_is_kept(stranger) -> None:
    clean, experiment = stranger
    pools = {clean.MADE: (experiment, clean.pool_of(experiment))}
    told = clean.Result(**clean.one(pools, (clean.MADE, 0)))
    assert told.outcome == "done"
    assert told.verdict in ("none", "explained", "partly_explained", "unexplained")
    silent = experiment.with_(noise=type(experiment.noise)(None))
    refused = clean.Result(**clean.one({clean.MADE: (silent, pools[clean.MADE][1])}, (clean.MADE, 0)))
    assert refused.outcome == "refused"
    assert "noise" in refused.words
