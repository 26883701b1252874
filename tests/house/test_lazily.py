"""Packages that load their names when they are asked for have the names that they tell pyright of."""

from __future__ import annotations

import ast
import pkgutil
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest
from sources import LIBRARY, ROOT, tree

LAZY = [p for p in LIBRARY if p.name == "__init__.py" and "= lazily(" in p.read_text()]


def package_of(path: Path) -> str:
    return ".".join(path.parent.relative_to(ROOT).parts)


def told(path: Path) -> set[tuple[str, str]]:
    """Module and name of every import under `if TYPE_CHECKING`."""
    (block,) = (node for node in tree(path).body if isinstance(node, ast.If))
    return {(i.module or "", a.name) for i in block.body if isinstance(i, ast.ImportFrom) for a in i.names}


@pytest.mark.parametrize("path", LAZY, ids=package_of)
def test_the_names_are_those_of_the_modules(path: Path) -> None:
    (call,) = (n for n in ast.walk(tree(path)) if isinstance(n, ast.Call) and ast.unparse(n.func) == "lazily")
    homes = ast.literal_eval(call.args[1])
    package = package_of(path)
    assert {(f"{package}.{m}", n) for m, names in homes.items() for n in names.split()} == told(path)


@pytest.mark.parametrize("path", LAZY, ids=package_of)
def test_a_name_stays_the_name_when_every_module_is_loaded(path: Path) -> None:
    package = import_module(package_of(path))
    for module in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
        import_module(module.name)
    for name in package.__all__:
        assert not isinstance(getattr(package, name), ModuleType), name
