"""The wheel, installed in an empty environment outside the repository, runs the main job."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def wheel(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(out), str(root)],
        check=True,
        capture_output=True,
    )
    return next(out.glob("*.whl"))


def test_the_wheel_holds_robots_examples_and_plugins(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    for name in (
        "qsframework/_robots/fanuc_m900ib/robot.yaml",
        "qsframework/_examples/r2000ic/readings.csv",
        "qsf_plugins/joint_compliance.py",
        "qsframework/report/templates/report.html.j2",
        "qsframework/py.typed",
        "qsf_plugins/py.typed",
    ):
        assert name in names


def test_the_wheel_runs_the_demo_in_an_empty_environment(wheel: Path, root: Path, tmp_path: Path) -> None:
    environment = tmp_path / "env"
    subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
    pip = [str(environment / "bin" / "python"), "-m", "pip", "install", "--quiet", "--no-compile"]
    pip.append("--disable-pip-version-check")
    subprocess.run([*pip, "-c", str(root / "requirements.lock"), str(wheel)], check=True, cwd=tmp_path)
    run = subprocess.run(
        [str(environment / "bin" / "qsf"), "demo", "--output", "out"], cwd=tmp_path, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    assert "0.234" in run.stdout
    assert (tmp_path / "out" / "report.html").is_file()
    assert run.stdout.splitlines()[-1] == "report: out/report.html"
