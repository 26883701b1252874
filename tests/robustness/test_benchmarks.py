"""The benchmarks' page: sections are replaced whole, and every script that `make bench` runs has one."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "performance.md"
SECTIONS = ("start-up", "commands", "kinematics", "design", "identification", "scaling")


@pytest.fixture
def load(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    names = ("common", "kinematics", "startup")

    def module(name: str) -> ModuleType:
        return importlib.import_module(name)

    yield module
    for name in names:
        sys.modules.pop(name, None)


def test_the_page_holds_each_section_once_and_filled() -> None:
    page = PAGE.read_text()
    for name in SECTIONS:
        assert page.count(f"<!-- {name} -->") == page.count(f"<!-- end of {name} -->") == 1
        body = page.partition(f"<!-- {name} -->")[2].partition(f"<!-- end of {name} -->")[0]
        assert "|---|" in body, f"{name} has no table: run make bench"
        assert "medians of" in body
        assert "benchmarks/" in body


def test_make_bench_runs_scripts_that_exist() -> None:
    line = next(x for x in (ROOT / "Makefile").read_text().splitlines() if x.startswith("BENCHMARKS :="))
    scripts = line.partition(":=")[2].split()
    assert len(scripts) >= 5
    for name in scripts:
        assert "--write" in (ROOT / "benchmarks" / f"{name}.py").read_text()


def test_a_section_is_replaced_and_nothing_else(load, tmp_path, monkeypatch) -> None:
    common = load("common")
    page = tmp_path / "performance.md"
    page.write_text("before\n<!-- a -->\nold\n<!-- end of a -->\nafter\n<!-- b -->\nkept\n<!-- end of b -->\n")
    monkeypatch.setattr(common, "PAGE", page)
    common.write_section("a", "new", "the command")
    text = page.read_text()
    assert text.startswith("before\n<!-- a -->\nnew\n")
    assert "old" not in text
    assert text.endswith("<!-- end of a -->\nafter\n<!-- b -->\nkept\n<!-- end of b -->\n")
    assert "`the command`" in text
    with pytest.raises(SystemExit, match="once each"):
        common.write_section("c", "new", "the command")
    assert page.read_text() == text


def test_a_quick_run_is_not_written(load, tmp_path, monkeypatch, capsys) -> None:
    common = load("common")
    page = tmp_path / "performance.md"
    page.write_text("<!-- a -->\nold\n<!-- end of a -->\n")
    monkeypatch.setattr(common, "PAGE", page)
    common.show("a", "new", write=True, quick=True)
    assert "old" in page.read_text()
    assert "not written" in capsys.readouterr().err


def test_jobs_take_turns_and_each_has_its_median(load) -> None:
    order: list[str] = []
    found = load("common").turns({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, 3)
    assert order == ["a", "b"] * 3
    assert set(found) == {"a", "b"}


def test_a_command_that_fails_stops_the_benchmark_with_its_words(load) -> None:
    with pytest.raises(SystemExit, match="no such thing"):
        load("common").ran([sys.executable, "-c", "raise SystemExit('no such thing')"])


def test_kinematics_says_how_it_compares(load) -> None:
    text = load("kinematics").tables(2000, 1)
    assert text.count("times") >= 4
    assert "Pinocchio" in text
