"""Sizes, leftovers, and the lock."""

from __future__ import annotations

import ast
import importlib.metadata
import re
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[2]
MODULES = sorted([*(ROOT / "qsframework").rglob("*.py"), *(ROOT / "plugins").rglob("*.py")])


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_modules_and_functions_are_short(path: Path) -> None:
    text = path.read_text()
    assert len(text.splitlines()) <= 310, "one idea each, under about 300 lines"
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            first = node.body[1] if ast.get_docstring(node) and len(node.body) > 1 else node.body[0]
            assert (node.end_lineno or 0) - first.lineno < 40, f"{node.name} is longer than 40 lines"


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_nothing_is_left_over(path: Path) -> None:
    text = path.read_text()
    assert not re.search(r"NotImplementedError|TODO|FIXME|XXX|pragma: no cover|pinv\(", text)
    assert not re.search(r"except\s*:", text)
    assert ast.get_docstring(ast.parse(text)), "a module says in its docstring what it is for"


def test_public_functions_and_classes_have_docstrings() -> None:
    missing = []
    for path in MODULES:
        for node in ast.parse(path.read_text()).body:
            public = isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")
            if public and not ast.get_docstring(node):
                missing.append(f"{path.relative_to(ROOT)}: {node.name}")
    assert not missing


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_the_lock_pins_everything_that_is_needed() -> None:
    lock = dict(line.split("==") for line in (ROOT / "requirements.lock").read_text().splitlines() if "==" in line)
    lock = {normal(name): version for name, version in lock.items()}
    seen: set[tuple[str, str]] = set()
    queue = [("qsframework", "test"), ("qsframework", "")]
    while queue:
        name, extra = queue.pop()
        if (name, extra) in seen:
            continue
        seen.add((name, extra))
        for text in importlib.metadata.requires(name) or ():
            requirement = Requirement(text)
            if requirement.marker is None or requirement.marker.evaluate({"extra": extra}):
                dependency = normal(requirement.name)
                assert dependency in lock, f"{dependency}, needed by {name}, is not in requirements.lock"
                assert importlib.metadata.version(dependency) == lock[dependency]
                queue += [(dependency, e) for e in ("", *requirement.extras)]
    assert any(name.startswith("cmeel") for name in lock)


def test_no_file_names_a_machine() -> None:
    pattern = re.compile(r"(?<![\w./~-])/(home|root|work|tmp|farm)/\w")
    for path in ROOT.rglob("*"):
        if path.suffix in (".py", ".md", ".yaml", ".toml", ".xacro", ".lock", ".csv") and not any(
            part.startswith(".") or part in ("build", "qsf-demo") for part in path.relative_to(ROOT).parts
        ):
            for line in path.read_text().splitlines():
                assert not pattern.search(line), f"{path}: {line}"
