"""docs/paper.md: every equation has its row, every function named there exists, and every test."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "paper.md"


def paths(text: str) -> list[str]:
    return re.findall(r"`((?:qsf|paper_)\w+(?:\.\w+)+)`", text)


def held_by(text: str) -> list[str]:
    return re.findall(r"`(tests/[^`]+)`", text)


def section(title: str) -> list[list[str]]:
    """The table under a heading, without its head."""
    text = PAGE.read_text().split(f"## {title}\n")[1].split("\n## ")[0]
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line[1:-1].split("|")] for line in lines[2:]]


def resolve(dotted: str) -> object:
    """Import the longest module of a dotted path and follow the rest."""
    parts = dotted.split(".")
    for n in range(len(parts), 0, -1):
        try:
            found: object = importlib.import_module(".".join(parts[:n]))
        except ModuleNotFoundError:
            continue
        for name in parts[n:]:
            found = getattr(found, name)
        return found
    raise ModuleNotFoundError(dotted)


def test_every_equation_has_one_row() -> None:
    assert [row[0] for row in section("Equations")] == [f"({n})" for n in range(1, 23)]


@pytest.mark.parametrize("row", section("Equations"), ids=lambda row: row[0])
def test_a_row_names_code_and_test_or_says_not_yet(row: list[str]) -> None:
    _, words, where, held = row
    assert len(words) > 15
    if where.startswith("not yet: "):
        assert not paths(where)
    else:
        assert paths(where)
        assert held_by(held)


@pytest.mark.parametrize("dotted", sorted(set(paths(PAGE.read_text()))))
def test_every_function_can_be_imported(dotted: str) -> None:
    assert resolve(dotted) is not None


@pytest.mark.parametrize("test", sorted(set(held_by(PAGE.read_text())) - {"tests/docs/test_paper.py"}))
def test_every_test_exists(root: Path, test: str) -> None:
    file, name = test.split("::")
    assert name in [
        node.name for node in ast.parse((root / file).read_text()).body if isinstance(node, ast.FunctionDef)
    ]


@pytest.mark.parametrize("row", section("Errors in print"), ids=lambda row: row[0])
def test_every_erratum_is_shown(row: list[str]) -> None:
    assert len(row) == 4
    assert all(row)
    assert held_by(row[3])


def test_no_erratum_is_forgotten() -> None:
    listed = {row[0] for row in section("Errors in print")}
    assert listed >= {"(11)", "(12)", "(16)", "(22)", "q2", "O2", "O3", "Table 2, columns"}
    assert {
        f"Table 5, {rows}" for rows in ("row 2", "rows 5 and 6, 7 and 8", "rows 11 and 12", "rows 1 and 2")
    } <= listed
