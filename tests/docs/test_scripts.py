"""The scripts in examples/scripts run, are short, and find what they say; docs/python.md shows them as they are."""

from __future__ import annotations

import re
import runpy
import sys
from collections.abc import Callable
from pathlib import Path

import make_python
import pytest

Run = Callable[[str], str]


@pytest.fixture
def printed(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """What a script prints, run in this process as `python script folder` would."""

    def run(name: str) -> str:
        script = str(root / "examples" / "scripts" / f"{name}.py")
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", [script, str(tmp_path)])
        runpy.run_path(script, run_name="__main__")
        return capsys.readouterr().out

    return run


def test_the_fit_of_a_simulated_plan_finds_the_truth(printed: Run, tmp_path: Path) -> None:
    said = printed("design_simulate_identify")
    off = [float(x) for x in re.findall(r"([+-]\d+\.\d) sd from", said)]
    assert len(off) == 6
    assert max(abs(x) for x in off) < 4.0
    assert (tmp_path / "plan.json").is_file()


def test_the_hidden_effect_is_named(printed: Run) -> None:
    said = printed("find_a_hidden_effect")
    assert "cause: joint_hardening[joint_3]" in said
    without, with_it = (float(x) for x in re.findall(r"(\d\.\d+) mm with", said))
    assert with_it < 0.9 * without


def test_the_correction_leaves_less_than_it_takes_away(printed: Run) -> None:
    said = printed("compensate_targets")
    pairs = re.findall(r"(\S+) mm off uncorrected, (\S+) mm expected", said)
    assert len(pairs) == 2
    assert all(0.0 < float(after) < 0.5 * float(before) for before, after in pairs)


@pytest.mark.parametrize("name", make_python.SCRIPTS)
def test_a_script_is_short(root: Path, name: str) -> None:
    assert len((root / "examples" / "scripts" / f"{name}.py").read_text().splitlines()) < 40


def test_the_page_shows_every_script(root: Path) -> None:
    assert sorted(make_python.SCRIPTS) == sorted(p.stem for p in (root / "examples" / "scripts").glob("*.py"))
    assert make_python.page() == (root / "docs" / "python.md").read_text(), "run: python docs/make_python.py"


def test_each_verb_of_the_api_page_runs(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (block,) = re.findall(r"^```python\n(.*?)^```", (root / "docs" / "api.md").read_text(), re.M | re.S)
    monkeypatch.chdir(tmp_path)
    exec(compile(block, "api.md", "exec"), {"__name__": "api_page"})
    assert {path.name for path in tmp_path.iterdir()} >= {"plan.csv", "readings.csv", "fit.json", "scene.html"}
