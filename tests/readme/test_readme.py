"""The README's commands run as written."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import yaml

from qsframework.experiment import load_experiment


def blocks(root: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", (root / "README.md").read_text(), re.M | re.S)


def test_every_command_runs(root: Path, tmp_path: Path) -> None:
    (tmp_path / "examples").symlink_to(root / "examples")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    commands = [line for block in blocks(root, "sh") for line in block.splitlines()]
    assert sum(c.startswith("qsf ") for c in commands) >= 6
    for command in commands:
        if command.startswith("make "):
            where = ["make", "--dry-run", command.split()[1]]
            subprocess.run(where, cwd=root, check=True, capture_output=True)
            continue
        run = subprocess.run(
            command, shell=True, cwd=tmp_path, env={**os.environ, "PATH": path}, capture_output=True, text=True
        )
        assert run.returncode == 0, f"{command}: {run.stderr}"
        assert run.stdout.strip(), command
    for name in ("plan.csv", "plan.json", "plan.html", "readings.csv", "fit.json", "fit.html"):
        assert (tmp_path / name).stat().st_size > 0


def test_the_experiment_shown_is_a_valid_one(root: Path, tmp_path: Path) -> None:
    (block,) = blocks(root, "yaml")
    (tmp_path / "experiment.yaml").write_text(block)
    assert yaml.safe_load(block)["robot"] == load_experiment(tmp_path / "experiment.yaml").robot.name


def test_the_picture_is_there(root: Path) -> None:
    for name in re.findall(r"!\[.*?\]\((.*?)\)", (root / "README.md").read_text()):
        assert (root / name).read_bytes().startswith(b"\x89PNG")


def test_the_ratio_to_cvxpy_is_that_of_the_benchmark(root: Path) -> None:
    """To one digit: it differs a little from run to run."""
    page = (root / "docs" / "performance.md").read_text()
    measured = [float(ratio) for ratio in re.findall(r"^\| cvxpy, .*\| (\d+) \|$", page, re.M)]
    (told,) = re.findall(r"Column generation is (\d+) to (\d+) times as\s+fast", (root / "README.md").read_text())
    assert [float(t) for t in told] == [float(f"{r:.1g}") for r in (min(measured), max(measured))]
