"""The house: a module imports only from the layers above its own."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LAYERS = (
    ("errors",),
    ("units",),
    ("files",),
    ("plugin",),
    ("robot",),
    ("elastostatics",),
    ("experiment",),
    ("information",),
    ("design", "identify"),
    ("diagnose",),
    ("applications",),
    ("report", "viz"),
    ("cli",),
)
RANK = {name: rank for rank, names in enumerate(LAYERS) for name in names}
SIBLINGS = {("report", "viz")}
"""Pairs of one layer that may look at each other: a report embeds a scene."""
OWNERS = {"pinocchio": "robot", "coal": "robot", "cvxpy": "design/relaxed.py", "meshcat": "viz"}
HEAVY = {"pinocchio", "coal", "cvxpy", "meshcat", "plotly", "scipy", "pint", "xacro", "jinja2", "pandas", "matplotlib"}


def modules() -> list[Path]:
    return sorted((ROOT / "qsframework").rglob("*.py"))


def imported(tree: ast.AST, top_level: bool = False) -> Iterator[str]:
    nodes = tree.body if top_level and isinstance(tree, ast.Module) else ast.walk(tree)
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def layer(path: Path) -> str:
    parts = path.relative_to(ROOT / "qsframework").parts
    return parts[0].removesuffix(".py")


@pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_point_up(path: Path) -> None:
    here = layer(path)
    for name in imported(ast.parse(path.read_text())):
        if not name.startswith("qsframework.") or here in ("__init__", "__main__"):
            continue
        there = name.split(".")[1]
        if here == there or (here, there) in SIBLINGS:
            continue
        assert RANK[there] < RANK[here], f"{path}: {here} may not import {there}"


def test_every_module_has_a_layer() -> None:
    assert {layer(p) for p in modules()} - {"__init__", "__main__"} <= set(RANK)


@pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(ROOT)))
def test_dependencies_have_one_owner(path: Path) -> None:
    where = str(path.relative_to(ROOT / "qsframework"))
    for name in imported(ast.parse(path.read_text())):
        owner = OWNERS.get(name.split(".")[0])
        assert owner is None or where.startswith(owner), f"{path}: only {owner} may import {name}"


@pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(ROOT)))
def test_heavy_libraries_are_imported_where_they_are_used(path: Path) -> None:
    top = {name.split(".")[0] for name in imported(ast.parse(path.read_text()), top_level=True)}
    assert not top & HEAVY, f"{path} imports {top & HEAVY} when it is itself imported"


def test_plugins_use_the_public_api_only() -> None:
    for path in sorted((ROOT / "plugins").rglob("*.py")):
        for name in imported(ast.parse(path.read_text())):
            if name.startswith("qsframework"):
                assert name == "qsframework.plugin", f"{path} imports {name}"
