"""docs/import.md: its commands run and print what it says, and its formats are those that the tests hold."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parents[1] / "importers"))

from samples import FORMATS

from qsframework.cli.app import app
from qsframework.cli.refusals import told
from qsframework.errors import InputError
from qsframework.experiment import load_experiment, read_readings


def blocks(root: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", (root / "docs" / "import.md").read_text(), re.M | re.S)


def plain(text: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"[\u2500-\u257f]", " ", text))


def test_the_commands_run_and_print_what_is_said(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tracker's own file gives the readings of the example, to the ten digits that these have."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(root / "examples")
    commands = [line for block in blocks(root, "sh") for line in block.splitlines()]
    printed = ""
    for command in commands:
        done = CliRunner().invoke(app, shlex.split(command)[1:], env={"COLUMNS": "400", "TERMINAL_WIDTH": "400"})
        assert done.exit_code == 0, f"{command}: {done.output}"
        printed += done.output
    said, proposed = blocks(root, "text")
    for line in said.splitlines():
        assert plain(line) in plain(printed), line
    experiment = load_experiment(root / "examples" / "ur10" / "experiment.yaml")
    ours = read_readings(root / "examples" / "ur10" / "series_d.csv", experiment)
    found = read_readings(tmp_path / "ur10.csv", experiment)
    assert np.array_equal(found.value, ours.value)
    assert found.pose == ours.pose
    assert np.abs(found.poses.pendant - ours.poses.pendant).max() < 1e-9
    bare = shlex.split(re.sub(r" --mapping \S+", "", commands[0]))[1:]
    done = CliRunner().invoke(app, [*bare[:-1], "other.csv", "--unit", "mm"])
    assert isinstance(done.exception, InputError)
    assert proposed.strip() in "\n".join(told(done.exception))


def test_the_table_names_the_formats_that_are_tested(root: Path) -> None:
    page = (root / "docs" / "import.md").read_text()
    rows = re.findall(r"^\| ([^|]+) \| ([^|]+) \| (.*?) ?\|$", page.split("| Program |")[1].split("\n\n")[0], re.M)
    told = {name: stated.strip("` ") for name, _, stated in rows}
    assert told == {name: " ".join(stated) for name, (_, stated, _) in FORMATS.items()}
