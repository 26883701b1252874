"""docs/tutorial.md: its commands run as written, one after the other, and its experiment is the example's."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.experiment import load_experiment, read_readings

pytestmark = pytest.mark.usefixtures("diagnosed_once")


def blocks(root: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", (root / "docs" / "tutorial.md").read_text(), re.M | re.S)


def test_every_command_runs(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In this process. What is diagnosed is diagnosed by the README's command; the chain prints what the page says."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(root / "examples")
    (table,) = blocks(root, "csv")
    (tmp_path / "targets.csv").write_text(table)
    commands = [line for block in blocks(root, "sh") for line in block.splitlines()]
    assert [c.split()[1] for c in commands] == [
        "check",
        "design",
        "simulate",
        "identify",
        "diagnose",
        "identify",
        "validate",
        "compensate",
        "certificate",
        "stiffness",
        "compensate",
        "import",
        "diagnose",
        "diagnose",
        "identify",
        "certificate",
    ]
    printed = ""
    for command in commands:
        program, *arguments = shlex.split(command)
        assert program == "qsf"
        if arguments[0] == "diagnose" and "ur10.csv" in arguments:
            the_same(tmp_path / "ur10.csv", root / "examples" / "ur10" / "experiment.yaml")
            arguments.remove("ur10.csv")
        run = CliRunner().invoke(app, arguments, env={"COLUMNS": "1000"})
        assert run.exit_code == 0, f"{command}: {run.output}"
        assert run.stdout.strip(), command
        printed += run.stdout
    for said in (line for block in blocks(root, "text") for line in block.splitlines()):
        assert said in printed
    assert len(json.loads((tmp_path / "fit.json").read_text())["parameters"]) == 6
    assert (tmp_path / "corrected.csv").read_text().count("hole_") == 2


def the_same(imported: Path, path: Path) -> None:
    """What was imported are the example's own readings, which the README diagnoses; angles are rounded."""
    experiment = load_experiment(path)
    one, two = (read_readings(files, experiment) for files in (experiment.data, imported))
    np.testing.assert_array_equal(one.value, two.value)
    np.testing.assert_allclose(one.poses.pendant, two.poses.pendant, rtol=0, atol=1e-8)
    assert (one.pose, one.states.series) == (two.pose, two.states.series)


def test_the_experiment_shown_is_the_example(root: Path) -> None:
    shown = yaml.safe_load(blocks(root, "yaml")[0])
    example = yaml.safe_load((root / "examples" / "m900ib" / "experiment.yaml").read_text())
    assert {k: v for k, v in shown.items() if k not in ("markers", "constraints")}.items() <= example.items()
