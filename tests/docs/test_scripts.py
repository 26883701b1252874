"""The scripts in examples/scripts run, are short, and find what they say; docs/python.md names all."""

from __future__ import annotations

import html
import inspect
import re
import runpy
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import make_python
import pytest

import qsframework as qsf

pytestmark = pytest.mark.usefixtures("diagnosed_once")

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


def test_one_fit_is_the_same_in_all_six_printers(tmp_path: Path) -> None:
    """Verdict, first value and held-out error, wherever they stand; the PDF where a browser is installed."""
    out = make_python.printed(tmp_path, pdf=shutil.which("chromium") is not None)
    assert list(make_python.PRINTERS) == ["Terminal", "Notebook", "Data frame", "JSON", "HTML", "PDF"]
    page = html.unescape((tmp_path / "fit.html").read_text())
    verdict = "1.176 → 0.406 mm (3D RMS at held-out poses); 5 of 6 parameters identified"
    for text in (out[""], " ".join(out["Terminal"].split()), out["Notebook"], page):
        assert verdict in text
    for text in (out["Terminal"], out["Notebook"], page):
        assert "1.161 ± 0.041" in text
    assert "1.161e-06 4.108e-08" in " ".join(out["Data frame"].split())
    assert "1.161e-06 ± 4.108e-08" in out["JSON"]
    assert "held-out: 0.406 mm" in out["Data frame"]
    assert "held-out: 4.056e-04 m" in out["JSON"]
    assert out["HTML"] == "report: fit.html\n"
    assert out["PDF"] == "report: fit.pdf\n"
    if (tmp_path / "fit.pdf").exists():
        assert (tmp_path / "fit.pdf").read_bytes().startswith(b"%PDF-")


@pytest.fixture(scope="module")
def api_page(root: Path) -> list[str]:
    """The examples of docs/api.md in their order, each with the name above it."""
    return re.findall(r"^```python\n(.*?)^```", (root / "docs" / "api.md").read_text(), re.M | re.S)


def test_the_examples_of_the_api_page_run(api_page: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "api_page"}
    for block in api_page:
        exec(compile(block, "api.md", "exec"), names)
    made = {"plan.csv", "readings.csv", "fit.json", "fit.html", "scene.html", "plan.ls", "my_arm", "extended"}
    assert {path.name for path in tmp_path.iterdir()} >= made


def test_every_function_of_the_front_door_has_its_example(root: Path, api_page: list[str]) -> None:
    """Directly under its name, where its module's page has one; a class and a module are used somewhere."""
    page = (root / "docs" / "api.md").read_text()
    for name in (n for n in dir(qsf) if inspect.isfunction(getattr(qsf, n))):
        found = getattr(qsf, name)
        assert any(f"qsf.{name}(" in block for block in api_page), name
        shown = re.search(rf"^::: \S+\.{found.__name__}\n\n```python\n(.*?)^```", page, re.M | re.S)
        assert name == "check_effect" or (shown and f"qsf.{name}(" in shown[1]), name
    assert max(len(block.splitlines()) for block in api_page) <= 10
