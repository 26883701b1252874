"""A stranger's effect, in a package of its own, in every verb: nothing in qsframework knows of it."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

NAME = "bolted_base[x]"


@pytest.fixture(scope="module")
def installed(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package, built and installed in a folder of its own: the repository's environment stays as it is."""
    source = tmp_path_factory.mktemp("source") / "qsf_bolted_base"
    shutil.copytree(root / "tests" / "third_party_package", source, ignore=shutil.ignore_patterns("__pycache__"))
    target = tmp_path_factory.mktemp("site")
    options = ["--quiet", "--disable-pip-version-check", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([sys.executable, "-m", "pip", "install", *options, "--target", str(target), str(source)], check=True)
    return target


def shell(command: str, folder: Path, site: Path | None) -> subprocess.CompletedProcess[str]:
    """Run a command as the page writes it, with the stranger's package on the path or without."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    places = [str(site)] if site else []
    places += [p for p in os.environ.get("PYTHONPATH", "").split(os.pathsep) if p]
    env = {**os.environ, "PATH": path, "PYTHONPATH": os.pathsep.join(places)}
    return subprocess.run(command, shell=True, cwd=folder, env=env, capture_output=True, text=True)


@pytest.fixture(scope="module")
def used(root: Path, installed: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What the page's commands print, and the files that they write."""
    folder = tmp_path_factory.mktemp("campaign")
    shutil.copy(root / "tests" / "third_party_package" / "experiment.yaml", folder)
    found = {}
    page = (root / "docs" / "new-effect.md").read_text()
    for command in "".join(re.findall(r"^```sh\n(.*?)^```", page, re.M | re.S)).splitlines():
        if command != "pip install .":
            run = shell(command, folder, installed)
            assert run.returncode == 0, f"{command}: {run.stderr}"
            found[command.split()[1]] = run.stdout
    return found | {path.name: path.read_text() for path in folder.glob("*.json")}


def test_the_protocol_holds(used: dict[str, str]) -> None:
    assert {"docstring", "frozen", "unit of bolted_base[x]", "validate"} <= set(used["-c"].splitlines())


def test_the_plan_counts_on_it(used: dict[str, str]) -> None:
    assert NAME in used["design"]
    assert NAME in json.loads(used["plan.json"])["certificate"]["parameters"]


def test_the_hidden_value_is_found(used: dict[str, str]) -> None:
    hidden = json.loads(used["truth.json"])["truth"][NAME]
    estimate = json.loads(used["fit.json"])["estimates"][NAME]
    assert hidden > 10 * estimate["sd"], "large enough to be seen"
    assert abs(estimate["value"] - hidden) < 4 * estimate["sd"]


def test_files_are_checked_with_it(used: dict[str, str], root: Path, installed: Path, tmp_path: Path) -> None:
    assert "ok" in used["check"]
    good = (root / "tests" / "third_party_package" / "experiment.yaml").read_text()
    (tmp_path / "experiment.yaml").write_text(good.replace("axis: x", "axis: w"))
    run = shell("qsf check experiment.yaml", tmp_path, installed)
    assert run.returncode == 2
    assert "unknown axis" in run.stderr


def test_without_the_package_the_effect_is_unknown(root: Path, tmp_path: Path) -> None:
    """It comes by its entry point alone, and the tests have not left it in the environment."""
    shutil.copy(root / "tests" / "third_party_package" / "experiment.yaml", tmp_path)
    run = shell("qsf check experiment.yaml", tmp_path, None)
    assert run.returncode == 2
    assert "unknown effect 'bolted_base'" in run.stderr
