"""typings/ says of libraries only what they have: a stub that is wrong would hide errors from pyright."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
TYPINGS = ROOT / "typings"
MOST_IGNORED = 6
STUBS = sorted(TYPINGS.rglob("*.pyi"))
MADE_LATER = {
    "Motion",
    "SE3",
    "Inertia",  # properties of the bindings
    "Problem.status",
    "Variable.value",
    "Figure.data",
    "Figure.layout",
    "CollisionRequest.security_margin",
}
"""What only an instance has."""


def module_of(stub: Path) -> str:
    parts = stub.relative_to(TYPINGS).with_suffix("").parts
    return ".".join(p for p in parts if p != "__init__")


def missing(stub: Path, module: Any) -> Iterator[str]:
    """Names and parameters of the stub that the library does not have."""
    tree = ast.parse(stub.read_text())
    hidden = {c.name: c for c in tree.body if isinstance(c, ast.ClassDef) and c.name.startswith("_")}
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield from _function(node, getattr(module, node.name, None), node.name)
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from _class(node, getattr(module, node.name, None), node.name)
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.target.id[0] != "_":
            name = node.target.id
            kind = hidden.get(ast.unparse(node.annotation))
            if not hasattr(module, name):
                yield name
            elif kind is not None:
                yield from _class(kind, getattr(module, name), name)


def _class(node: ast.ClassDef, real: Any, name: str) -> Iterator[str]:
    if real is None:
        yield name
        return
    for part in node.body:
        if isinstance(part, ast.FunctionDef):
            where = getattr(real, part.name, None)
            if where is not None or part.name[:2] != "__":
                yield from _function(part, where, f"{name}.{part.name}")
        elif isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name):
            whole = f"{name}.{part.target.id}"
            stated = (*getattr(real, "__dataclass_fields__", ()), *_parameters(getattr(real, "__init__", None)))
            if not (hasattr(real, part.target.id) or part.target.id in stated or {name, whole} & MADE_LATER):
                yield whole


def _function(node: ast.FunctionDef, real: Any, name: str) -> Iterator[str]:
    if real is None:
        yield name
        return
    known = _parameters(real)
    if not known or any(p.kind is p.VAR_KEYWORD for p in known.values()):
        return
    given = [*node.args.args, *node.args.kwonlyargs]
    yield from (f"{name}({a.arg})" for a in given if a.arg not in known and a.arg not in ("self", "cls", "other"))


def _parameters(function: Any) -> Mapping[str, inspect.Parameter]:
    try:
        return inspect.signature(function).parameters
    except (TypeError, ValueError):  # made in C++
        return {}


@pytest.mark.parametrize("stub", STUBS, ids=module_of)
def test_the_library_has_what_its_stub_says(stub: Path) -> None:
    assert list(missing(stub, importlib.import_module(module_of(stub)))) == []


def test_pyright_is_strict_with_one_exception() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["pyright"]
    assert settings["typeCheckingMode"] == "strict"
    assert {"qsframework", "plugins"} <= set(settings["include"])
    off = {key for key, value in settings.items() if value is False or value in ("none", "information", "warning")}
    assert off == {"enableTypeIgnoreComments", "reportConstantRedefinition"}


def test_every_ignored_line_names_its_rule_and_there_are_few() -> None:
    files = [*(ROOT / "qsframework").rglob("*.py"), *(ROOT / "plugins").rglob("*.py")]
    ignored = [line for file in files for line in file.read_text().splitlines() if "pyright: ignore" in line]
    assert all(re.search(r"# pyright: ignore\[\w+\]", line) for line in ignored), ignored
    assert len(ignored) <= MOST_IGNORED
    assert not [f for f in files if "type: ignore" in f.read_text() or "# pyright: basic" in f.read_text()]


def test_what_a_library_does_not_have_is_noticed(tmp_path: Path) -> None:
    stub = tmp_path / "math.pyi"
    stub.write_text("def sin(x: float) -> float: ...\ndef sine(x: float) -> float: ...\nhalf: float\n")
    assert list(missing(stub, importlib.import_module("math"))) == ["sine", "half"]
    stub.write_text("class Path:\n    def exists(self, *, follow: bool) -> bool: ...\n    size: int\n")
    assert list(missing(stub, importlib.import_module("pathlib"))) == ["Path.exists(follow)", "Path.size"]
