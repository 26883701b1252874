"""A robot's folder beside an experiment goes before a shipped robot of its name, and every command says so."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.experiment import example, load_experiment
from qsframework.robot.search import find_robot

NOTE = "the folder {} is read, not the robot ur10 of"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The UR10's example beside a robot of another title in a folder of its name; the current one."""
    shutil.copytree(example("ur10"), tmp_path, dirs_exist_ok=True)
    shutil.copytree(find_robot("ur10").parent, tmp_path / "ur10")
    robot = tmp_path / "ur10" / "robot.yaml"
    robot.write_text(re.sub("^title:.*", "title: the cell's own arm", robot.read_text(), flags=re.M))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def qsf(*words: str) -> str:
    """What a command prints, on one line."""
    done = CliRunner().invoke(app, list(words), catch_exceptions=False)
    assert done.exit_code == 0
    return " ".join(done.output.split())


def test_the_folder_beside_the_experiment_is_read(folder: Path) -> None:
    assert load_experiment(folder / "experiment.yaml").robot.title == "the cell's own arm"
    assert load_experiment(example("ur10") / "experiment.yaml").robot.title != "the cell's own arm"


@pytest.mark.parametrize(
    "words",
    [
        ["check", "ur10"],
        ["check", "experiment.yaml"],
        ["identify", "experiment.yaml"],
        ["show", "experiment.yaml", "--html", "scene.html"],
    ],
    ids=" ".join,
)
def test_commands_say_which_they_read(folder: Path, words: list[str]) -> None:
    assert NOTE.format("ur10") in qsf(*words).replace(f"{folder}/", "")


def test_the_shipped_robot_needs_no_words() -> None:
    assert "is read, not" not in qsf("check", "ur10", str(example("ur10") / "experiment.yaml"))


def test_a_new_robot_of_a_shipped_name_is_noted(folder: Path) -> None:
    made = qsf("new", "ur10", "--urdf", str(next((folder / "ur10").glob("*.xacro"))), "-o", "cell/ur10")
    assert NOTE.format("cell/ur10") in made
