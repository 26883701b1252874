"""The scripts in examples/scripts run, are short, and find what they say; docs/python.md shows them as they are."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import make_python
import pytest


def printed(root: Path, name: str, folder: Path) -> str:
    script = root / "examples" / "scripts" / f"{name}.py"
    done = subprocess.run([sys.executable, script, folder], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_fit_of_a_simulated_plan_finds_the_truth(root: Path, tmp_path: Path) -> None:
    said = printed(root, "design_simulate_identify", tmp_path)
    off = [float(x) for x in re.findall(r"([+-]\d+\.\d) sd from", said)]
    assert len(off) == 6
    assert max(abs(x) for x in off) < 4.0
    assert (tmp_path / "plan.json").is_file()


def test_the_hidden_effect_is_named(root: Path, tmp_path: Path) -> None:
    said = printed(root, "find_a_hidden_effect", tmp_path)
    assert "cause: joint_hardening[joint_3]" in said
    without, with_it = (float(x) for x in re.findall(r"(\d\.\d+) mm with", said))
    assert with_it < 0.9 * without


def test_the_correction_leaves_less_than_it_takes_away(root: Path, tmp_path: Path) -> None:
    said = printed(root, "compensate_targets", tmp_path)
    pairs = re.findall(r"(\S+) mm off uncorrected, (\S+) mm expected", said)
    assert len(pairs) == 2
    assert all(0.0 < float(after) < 0.5 * float(before) for before, after in pairs)


@pytest.mark.parametrize("name", make_python.SCRIPTS)
def test_a_script_is_short(root: Path, name: str) -> None:
    assert len((root / "examples" / "scripts" / f"{name}.py").read_text().splitlines()) < 40


def test_the_page_shows_every_script(root: Path) -> None:
    assert sorted(make_python.SCRIPTS) == sorted(p.stem for p in (root / "examples" / "scripts").glob("*.py"))
    assert make_python.page() == (root / "docs" / "python.md").read_text(), "run: python docs/make_python.py"
