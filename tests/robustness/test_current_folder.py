"""No code of the current folder runs without --trust, in the command's process or in any that it starts.

The folder holds a module of every name that Python, a library or a browser's wrapper could import or start from it;
each leaves a mark.
"""

from __future__ import annotations

import importlib.metadata
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from qsframework.report.printed import BROWSERS

EXAMPLE = Path(__file__).parents[2] / "examples" / "m900ib"
MARK = "RAN"
PRINTS = any(map(shutil.which, BROWSERS))
COMMANDS = {
    "design, workers": ["design", "experiment.yaml", "-n", "6", "--candidates", "60", "--jobs", "2", "-o", "new.csv"],
    "diagnose a plan, workers": ["diagnose", "experiment.yaml", "plan.csv", "--jobs", "2"],
    "simulate": ["simulate", "experiment.yaml", "plan.csv", "-o", "readings.csv"],
    "export": ["export", "experiment.yaml", "plan.csv", "--to", "csv", "-o", "points.csv"],
    "show": ["show", "experiment.yaml", "plan.csv", "--html", "show.html"],
    "check": ["check", "experiment.yaml"],
}
PRINTED = {"protocol, browser": ["protocol", "experiment.yaml", "plan.csv", "-o", "sheet.pdf"]}


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("plan") / "plan.csv"
    make = ["design", EXAMPLE / "experiment.yaml", "-n", "6", "--candidates", "60", "--no-polish", "-o", path]
    subprocess.run([sys.executable, "-c", "from qsframework.cli import main; main()", *make], check=True)
    return path


@pytest.fixture
def hostile(plan: Path, tmp_path: Path) -> Path:
    """A campaign's folder with a module of every name, each of which leaves a mark when it is imported or started."""
    shutil.copytree(EXAMPLE, tmp_path, dirs_exist_ok=True)
    shutil.copy(plan, tmp_path / "plan.csv")
    names = {*sys.stdlib_module_names, *importlib.metadata.packages_distributions(), "sitecustomize", "usercustomize"}
    leaves = f"open({str(tmp_path / MARK)!r}, 'a').write(__name__ + ' ')\n"
    for name in sorted(names):
        if name.isidentifier():
            (tmp_path / f"{name}.py").write_text(leaves)
    for name in BROWSERS:
        (tmp_path / name).write_text(f"#!/bin/sh\necho {name} >> {tmp_path / MARK}\n")
        (tmp_path / name).chmod(0o755)
    return tmp_path


@pytest.mark.parametrize("name", [*COMMANDS, *(PRINTED if PRINTS else ())])
def test_no_module_of_the_current_folder_is_imported(name: str, hostile: Path) -> None:
    script = Path(sys.executable).with_name("qsf")
    path = os.pathsep.join(["", ".", os.environ["PATH"]])
    done = subprocess.run(
        [script, *{**COMMANDS, **PRINTED}[name]],
        cwd=hostile,
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    mark = hostile / MARK
    assert not mark.exists(), mark.read_text()


def test_the_folder_is_hostile(hostile: Path) -> None:
    """A Python that looks into its current folder runs what lies there."""
    subprocess.run([sys.executable, "-c", "import plistlib"], cwd=hostile, capture_output=True)
    assert "plistlib" in (hostile / MARK).read_text()
