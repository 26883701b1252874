"""Packages that load their names when they are asked for have the names that they tell pyright of."""

from __future__ import annotations

import ast
import pkgutil
import sys
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


def homes(path: Path) -> dict[str, list[str]]:
    """The modules that the package names, and the names of each, as it writes them."""
    (call,) = (n for n in ast.walk(tree(path)) if isinstance(n, ast.Call) and ast.unparse(n.func) == "lazily")
    return {module: names.split() for module, names in ast.literal_eval(call.args[1]).items()}


@pytest.mark.parametrize("path", LAZY, ids=package_of)
def test_the_names_are_those_of_the_modules(path: Path) -> None:
    package = package_of(path)
    own = {(f"{package}.{m}", n.rpartition("=")[2]) for m, names in homes(path).items() for n in names}
    assert own == {(module, name) for module, name in told(path) if module != package}


@pytest.mark.parametrize("path", LAZY, ids=package_of)
def test_a_name_stays_the_name_when_every_module_is_loaded(path: Path) -> None:
    package = import_module(package_of(path))
    for module in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
        if not module.name.endswith(".__main__"):
            import_module(module.name)
    for name in (n.partition("=")[0] for names in homes(path).values() for n in names):
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
