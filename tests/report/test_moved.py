"""Two fits of one robot side by side: in the terminal, in the table, in the plot."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.experiment import Experiment, example, read_plan, simulate
from qsframework.fits import Fit, identify
from qsframework.report.fit_plots import fit_figures
from qsframework.report.moved_section import moved_table, moved_words


@pytest.fixture(scope="module")
def fits(m900ib: Experiment) -> list[Fit]:
    """The same arm measured twice, and with a softer joint 2."""
    plan = read_plan(example("day") / "plan.csv", m900ib)
    soft = m900ib.model().nominal
    soft[m900ib.model().index(["joint_compliance[joint_2]"])] *= 1.25
    truths = (m900ib.model().nominal, m900ib.model().nominal, soft)
    return [identify(m900ib, simulate(m900ib, plan, x, seed=s).readings) for s, x in enumerate(truths)]


def apart(one: Fit, other: Fit) -> dict[str, float]:
    return {row[0]: float(row[4]) for row in moved_table(one, other).rows}


def test_one_arm_measured_twice_and_one_that_changed(fits: list[Fit]) -> None:
    again, changed = apart(fits[0], fits[1]), apart(fits[2], fits[0])
    assert len(again) == 6
    assert max(abs(v) for v in again.values()) < 4.0
    assert changed["joint_compliance[joint_2]"] > 5.0
    assert max(abs(v) for n, v in changed.items() if "joint_2" not in n) < 4.0
    assert moved_words(fits[0], fits[1]).startswith("No parameter moved beyond its uncertainty: all 6 agree")
    assert re.match(
        r"Moved beyond its uncertainty: joint_compliance\[joint_2\] \(\+\d+\.\d sd\); the other 5 agree",
        moved_words(fits[2], fits[0]),
    )


def test_the_plot_has_both(fits: list[Fit]) -> None:
    names = [t["name"] for t in fit_figures(fits[0], fits[1])[0].figure.data]
    assert "the other fit" in names
    assert "the other fit" not in [t["name"] for t in fit_figures(fits[0])[0].figure.data]


def test_the_command_shows_them(tmp_path: Path) -> None:
    real = str(example("r2000ic") / "experiment.yaml")
    run = CliRunner().invoke
    assert run(app, ["identify", real, "--json", str(tmp_path / "a.json")]).exit_code == 0
    some = ["--fit", "joint_compliance[joint_2]", "--fit", "joint_compliance[joint_3]"]
    report = tmp_path / "b.html"
    done = run(app, ["identify", real, *some, "--compare", str(tmp_path / "a.json"), "--report", str(report)])
    assert done.exit_code == 0, done.output
    assert "change / its sd" in done.output
    assert "Both fits rest on the same readings" in done.output
    assert "In one of them only: joint_compliance[joint_1]" in " ".join(done.output.split())
    assert "the other fit" in report.read_text()
    assert "a.json" in report.read_text()


def test_another_robots_fit_is_refused(tmp_path: Path) -> None:
    real, other = (str(example(name) / "experiment.yaml") for name in ("r2000ic", "ur10"))
    run = CliRunner().invoke
    assert run(app, ["identify", real, "--json", str(tmp_path / "a.json")]).exit_code == 0
    done = run(app, ["identify", other, "--compare", str(tmp_path / "a.json")])
    assert done.exit_code == 1
    assert "the fit is of another robot" in str(done.exception)
