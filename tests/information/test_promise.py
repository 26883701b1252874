"""What a plan tells before anything is measured: sizes, shares and advice, in Python and by the command."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.errors import NotIdentifiable
from qsframework.experiment import example, load_experiment

PAPER = example("m900ib")


def test_a_plan_that_cannot_tell_a_spring_says_what_would_help(tmp_path: Path) -> None:
    """The paper's plan has a vertical weight only; and its balancer's spring is told to seven times its value."""
    asked = ["diagnose", str(PAPER / "experiment.yaml"), str(PAPER / "table5.csv")]
    done = CliRunner().invoke(app, asked, env={"COLUMNS": "250"})
    assert isinstance(done.exception, NotIdentifiable)
    assert "add a side pull along the base's y with the arm stretched" in str(done.exception)
    assert "not identifiable" in done.output
    asked = ["diagnose", str(PAPER / "table5.yaml"), *asked[2:], "--json", str(tmp_path / "f.json")]
    done = CliRunner().invoke(app, asked, env={"COLUMNS": "250"})
    assert done.exit_code == 0, done.output
    fitted = {p["name"]: p for p in json.loads((tmp_path / "f.json").read_text())["fitted"]}
    balancer = fitted["gravity_compensator[joint_2].stiffness"]
    assert balancer["sd"] == pytest.approx(6.59 * balancer["nominal"], rel=0.05)
    assert "absolute positions" in balancer["help"]
    assert all(p["help"] == "" for name, p in fitted.items() if p is not balancer)


def test_a_design_that_no_plan_can_meet_says_what_would_help() -> None:
    from qsframework.plans import design

    experiment = load_experiment(PAPER / "experiment.yaml")
    weight = experiment.with_(loads=experiment.loads[:1])
    with pytest.raises(NotIdentifiable, match=r"no plan with these loads.*add a side pull along the base's"):
        design(weight, 8, candidates=50)
