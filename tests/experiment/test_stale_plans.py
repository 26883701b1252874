"""A plan whose arm or campaign has changed since it was made is said to be so by every command that drives by it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.experiment import example, load_experiment
from qsframework.experiment.plan import changed_since

NOTE = "note: the markers changed since plan.csv was made"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The example of the measuring day with its plan; the current folder."""
    for name in ("experiment.yaml", "plan.csv", "plan.json"):
        shutil.copy(example("day") / name, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def change(folder: Path, before: str, after: str) -> None:
    file = folder / "experiment.yaml"
    text = file.read_text()
    assert before in text
    file.write_text(text.replace(before, after, 1))


def qsf(*words: str) -> str:
    done = CliRunner().invoke(app, list(words), catch_exceptions=False)
    assert done.exit_code == 0
    return " ".join(done.output.split())


@pytest.mark.parametrize(
    "words",
    [
        ["simulate", "experiment.yaml", "plan.csv"],
        ["protocol", "experiment.yaml", "plan.csv"],
        ["export", "experiment.yaml", "plan.csv", "--to", "csv", "-o", "points.csv"],
    ],
    ids=lambda words: words[0],
)
def test_commands_say_what_changed(folder: Path, words: list[str]) -> None:
    assert "changed since" not in qsf(*words)
    for file in folder.glob("*.csv"):
        if file.name != "plan.csv":
            file.unlink()
    change(folder, "m1: {xyz_mm: [", "m1: {xyz_mm: [1")
    assert NOTE in qsf(*words)


def test_readings_that_are_named_later_change_nothing(folder: Path) -> None:
    change(folder, "robot:", "constraints: {z_min_m: 0.3}\nrobot:")
    assert changed_since(folder / "plan.csv", load_experiment(folder / "experiment.yaml")) == ()
