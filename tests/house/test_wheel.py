"""The wheel, installed outside the repository beside what its metadata name and nothing else, runs the main job."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from email.parser import Parser
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name


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
        "qsf_trackers/json_points.py",
        "qsf_controllers/krl.py",
        "qsf_day/templates/day.html",
        "qsf_onboarding/proposal.py",
    ):
        assert name in names


def needed(wheel: Path) -> set[str]:
    """Names of all distributions that the wheel says it needs, directly or through others."""
    (found,) = (n for n in zipfile.ZipFile(wheel).namelist() if n.endswith(".dist-info/METADATA"))
    said = Parser().parsestr(zipfile.ZipFile(wheel).read(found).decode())
    wanted = [(text, {""}) for text in said.get_all("Requires-Dist") or []]
    names = set[str]()
    while wanted:
        text, extras = wanted.pop()
        requirement = Requirement(text)
        if requirement.marker and not any(requirement.marker.evaluate({"extra": e}) for e in extras):
            continue
        name = canonicalize_name(requirement.name)
        installed = metadata.distribution(name)
        assert requirement.specifier.contains(installed.version, prereleases=True), requirement
        if name not in names or requirement.extras:
            names.add(name)
            wanted += [(more, requirement.extras or {""}) for more in installed.requires or ()]
    return names


def link(names: set[str], site: Path) -> None:
    """Put installed distributions into another environment, without what else stands beside them."""
    for name in names:
        for top in {file.parts[0] for file in metadata.distribution(name).files or ()} - {"..", "__pycache__"}:
            here = Path(str(metadata.distribution(name).locate_file(top)))
            if not (site / top).exists():
                (site / top).symlink_to(here)


def test_the_wheel_runs_the_demo_in_an_environment_that_holds_what_it_needs(wheel: Path, tmp_path: Path) -> None:
    """Its own metadata say what that is: nothing else is there."""
    environment = tmp_path / "env"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(environment)], check=True)
    python = str(environment / "bin" / "python")
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-compile", "--no-deps"]
    subprocess.run([*pip, "--no-index", "--disable-pip-version-check", str(wheel)], check=True, cwd=tmp_path)
    (site,) = environment.glob("lib/python*/site-packages")
    names = needed(wheel)
    assert {"numpy", "pin", "plotly"} <= names
    assert not names & {"pytest", "ruff", "hypothesis"}
    link(names, site)
    own = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    run = subprocess.run(
        [str(environment / "bin" / "qsf"), "demo", "--output", "out"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env=own,
    )
    assert run.returncode == 0, run.stderr
    assert "0.406" in run.stdout
    assert (tmp_path / "out" / "report.html").is_file()
    assert run.stdout.splitlines()[-1] == "open: out/report.html (one file, no network needed)"
