"""One term for one thing: no name and no sentence that a user can see says it in a word that was retired."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

ROWS: list[dict[str, Any]] = yaml.safe_load((Path(__file__).parent / "retired.yaml").read_text())
EXCEPTIONS: dict[str, str] = {}
"""A file, or a file and the words in it, with the reason: `path` or `path: words`."""
PAGES = (
    "README.md",
    "docs/*.md",
    "examples/*/*.md",
    "robots/*/*.md",
    "qsframework/report/templates/*",
    "plugins/qsf_day/templates/*",
)


def _documented(tree: ast.AST) -> set[int]:
    """The docstrings of a module."""
    bodies = [n.body for n in ast.walk(tree) if isinstance(n, ast.Module | ast.ClassDef | ast.FunctionDef)]
    said = [s.value for body in bodies for s in body if isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant)]
    return {id(s) for s in said}


def _sentences(tree: ast.AST) -> Iterator[tuple[str, bool]]:
    """Texts of the code: what is printed, written or drawn, the names of its files' keys, and whether it is a
    docstring."""
    docs = _documented(tree)
    for n in ast.walk(tree):
        if isinstance(n, ast.Constant) and isinstance(n.value, str):
            yield re.sub(r"\s+", " ", n.value), id(n) in docs


def _names(tree: ast.AST) -> Iterator[str]:
    """Names that others use: functions, classes, their parameters and fields."""
    for n in ast.walk(tree):
        if isinstance(n, ast.FunctionDef | ast.ClassDef):
            yield n.name
        if isinstance(n, ast.ClassDef):
            yield from (s.target.id for s in n.body if isinstance(s, ast.AnnAssign) and isinstance(s.target, ast.Name))
        if isinstance(n, ast.arg):
            yield n.arg


def _parts(name: str) -> str:
    """`LeftAside` and `left_aside` alike, between underlines."""
    return f"_{re.sub(r'(?<=[a-z])(?=[A-Z])', '_', name).lower().strip('_')}_"


def _found(root: Path) -> Iterator[tuple[str, str, str]]:
    """Where a retired word stands: file, the words, the term in its place."""
    phrases = [(re.compile(p), row["term"]) for row in ROWS for p in row["phrases"]]
    anywhere = [(re.compile(p), row["term"]) for row in ROWS for p in row["phrases"] if row.get("docstrings")]
    names = [(n, row["term"]) for row in ROWS for n in row["names"]]
    for path in sorted([*(root / "qsframework").rglob("*.py"), *(root / "plugins").rglob("*.py")]):
        tree, file = ast.parse(path.read_text()), path.relative_to(root).as_posix()
        for said, documented in _sentences(tree):
            asked = anywhere if documented else phrases
            yield from ((file, m[0], term) for pattern, term in asked for m in pattern.finditer(said))
        for name in _names(tree):
            yield from ((file, name, term) for old, term in names if f"_{old}_" in _parts(name))
    for path in sorted(p for pattern in PAGES for p in root.glob(pattern)):
        text = re.sub(r"\s+", " ", path.read_text())
        file = path.relative_to(root).as_posix()
        yield from ((file, m[0], term) for pattern, term in phrases for m in pattern.finditer(text))


@pytest.fixture(scope="module")
def found(root: Path) -> list[tuple[str, str, str]]:
    return list(_found(root))


def test_no_retired_word_is_left(found: list[tuple[str, str, str]]) -> None:
    left = [f"{file}: {words!r}, now {term!r}" for file, words, term in found if not _excepted(file, words)]
    assert left == []


def _excepted(file: str, words: str) -> bool:
    return file in EXCEPTIONS or f"{file}: {words}" in EXCEPTIONS


def test_exceptions_are_few_and_needed(found: list[tuple[str, str, str]]) -> None:
    assert len(EXCEPTIONS) <= 40
    assert all(EXCEPTIONS.values()), "each has its reason"
    needed = {file for file, _, _ in found} | {f"{file}: {words}" for file, words, _ in found}
    assert set(EXCEPTIONS) <= needed


@pytest.mark.parametrize(("name", "parts"), [("LeftAside", "_left_aside_"), ("_told_names", "_told_names_")])
def test_names_are_read_by_their_parts(name: str, parts: str) -> None:
    assert _parts(name) == parts
