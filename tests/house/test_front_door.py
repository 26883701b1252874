"""Packages that load their names when they are asked for have the names that their stubs tell pyright of."""

from __future__ import annotations

import ast
import pkgutil
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest
from sources import ROOT, tree

LAZY = sorted([*(ROOT / "qsframework").rglob("__init__.pyi"), *(ROOT / "plugins").rglob("__init__.pyi")])


def package_of(path: Path) -> str:
    return ".".join(p for p in path.parent.relative_to(ROOT).parts if p != "plugins")


def told(path: Path) -> dict[str, tuple[str, str]]:
    """The names that pyright knows of the package, and the module and the name that each is there."""
    found: dict[str, tuple[str, str]] = {}
    for node in tree(path).body:
        if isinstance(node, ast.ImportFrom):
            found |= {a.name: (f"{package_of(path)}.{node.module}", a.name) for a in node.names if node.module}
        elif isinstance(node, ast.Assign):
            (short,) = node.targets
            found[ast.unparse(short)] = found.pop(ast.unparse(node.value))
    return found


@pytest.mark.parametrize("path", LAZY, ids=package_of)
def test_the_names_are_those_of_the_modules(path: Path) -> None:
    package = import_module(package_of(path))
    names = told(path)
    assert {*names} == {*dir(package)} - {"__version__", "units"}
    for name, (module, own) in names.items():
        assert getattr(package, name) is getattr(import_module(module), own), name


@pytest.mark.parametrize("path", LAZY, ids=package_of)
def test_a_name_stays_the_name_when_every_module_is_loaded(path: Path) -> None:
    package = import_module(package_of(path))
    for module in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
        if not module.name.endswith(".__main__"):
            import_module(module.name)
    for name in told(path):
        assert not isinstance(getattr(package, name), ModuleType), name


def test_a_name_can_be_put_in_place_of_one_that_a_module_has_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """As tests do, and a notebook may; the import of the module puts nothing in its place."""
    import qsframework.experiment as package

    def own() -> None: ...

    monkeypatch.setattr(package, "simulate", own)
    import_module("qsframework.experiment.simulate")
    assert package.simulate is own
    monkeypatch.undo()
    assert package.simulate is sys.modules["qsframework.experiment.simulate"].simulate
