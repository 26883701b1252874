"""The house: a module imports only from the layers above its own."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

from sources import EFFECTS as EFFECT_FILES, FIELD, LIBRARY, PACKAGES, ROOT, complaints, tree

LAYERS = (
    ("errors",),
    ("arguments", "installed"),
    ("units", "option"),
    ("plausible", "terminal", "viewed"),
    ("files",),
    ("work",),
    ("plugin",),
    ("robot",),
    ("elastostatics",),
    ("estimation",),
    ("experiment",),
    ("information",),
    ("hypotheses",),
    ("screening",),
    ("plans", "fits"),
    ("diagnoses",),
    ("uses",),
    ("report", "viz"),
    ("cli",),
)
RANK = {name: rank for rank, names in enumerate(LAYERS) for name in names}
SIBLINGS = {("report", "viz")}
"""Pairs of one layer that may look at each other: a report embeds a scene."""
OWNERS = {
    "pinocchio": "robot",
    "coal": "robot",
    "cvxpy": "plans/relaxed.py",
    "meshcat": "viz",
    "starlette": "qsf_day/server.py",
    "joblib": "work",
    "distributed": "work",
    "multiprocessing": "work",
    "subprocess": "report/printed.py",  # who starts a process keeps the current folder off its path
}
HEAVY = {
    "pinocchio",
    "coal",
    "cvxpy",
    "meshcat",
    "plotly",
    "scipy",
    "pint",
    "xacro",
    "jinja2",
    "pandas",
    "matplotlib",
    "joblib",
    "distributed",
    "dask",
}


def imported(parsed: ast.AST) -> Iterator[str]:
    """Every module that parsed code imports, `from qsframework import units` as qsframework.units."""
    for node in ast.walk(parsed):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, "imports say the whole name"
            if node.module == "qsframework":
                yield from (f"qsframework.{alias.name}" for alias in node.names)
            else:
                yield node.module or ""


def imported_at_once(node: ast.AST) -> Iterator[str]:
    """What is loaded when the module itself is: all but the bodies of functions and of `if TYPE_CHECKING`."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import | ast.ImportFrom):
            yield from imported(child)
        elif isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
            continue
        elif not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            yield from imported_at_once(child)


def layer(path: Path) -> str:
    parts = path.relative_to(ROOT / "qsframework").parts
    return parts[0].removesuffix(".py")


MODULE = re.compile(r"\bqsframework[.:]([a-z_]+)")
DYNAMIC = {"import_module", "__import__", "files"}
"""Functions of importlib that take a module by its name."""


def called(node: ast.Call) -> str:
    """The name of the function that is called, without its module."""
    return node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")


def named_by_strings(parsed: ast.AST) -> Iterator[str]:
    """Every module that a text of parsed code names, docstrings aside, as an import by a name or an entry point does.

    A name that is put together, after `qsframework.` or relative to the package, can be any: `qsframework.*`.
    """
    told = {node.value for node in ast.walk(parsed) if isinstance(node, ast.Expr)}
    for node in ast.walk(parsed):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in told:
            yield from (f"qsframework.{name}" for name in MODULE.findall(node.value) if name in RANK)
            if node.value.endswith("qsframework."):
                yield "qsframework.*"
        elif isinstance(node, ast.Call) and called(node) in DYNAMIC:
            given = [*node.args, *(keyword.value for keyword in node.keywords)]
            if any(isinstance(value, ast.Constant) and value.value == "qsframework" for value in given):
                yield "qsframework.*"


def upside_down(path: Path) -> Iterator[str]:
    yield from upward(layer(path), tree(path))


def upward(here: str, parsed: ast.AST) -> Iterator[str]:
    """What a module of the layer `here` imports that is not above it."""
    for name in (*imported(parsed), *named_by_strings(parsed)):
        if not name.startswith("qsframework.") or here in ("__init__", "__main__"):
            continue
        there = name.split(".")[1]
        if there == "*":
            yield f"{here} imports what no name says"
        elif here != there and (here, there) not in SIBLINGS and RANK[there] >= RANK[here]:
            yield f"{here} may not import {there}"


def test_imports_point_up() -> None:
    assert complaints(LIBRARY, upside_down) == []


def test_every_module_has_a_layer() -> None:
    assert {layer(p) for p in LIBRARY} - {"__init__", "__main__"} <= set(RANK)


def owned_by_others(path: Path) -> Iterator[str]:
    where = str(path.relative_to(ROOT / ("qsframework" if path in LIBRARY else "plugins")))
    for name in imported(tree(path)):
        owner = OWNERS.get(name.split(".")[0])
        if owner is not None and not where.startswith(owner):
            yield f"only {owner} may import {name}"


def test_dependencies_have_one_owner() -> None:
    assert complaints([*LIBRARY, *FIELD], owned_by_others) == []


def heavy_at_once(path: Path) -> Iterator[str]:
    for name in sorted({name.split(".")[0] for name in imported_at_once(tree(path))} & HEAVY):
        yield f"imports {name} when it is itself imported"


def test_heavy_libraries_are_imported_where_they_are_used() -> None:
    assert complaints([*LIBRARY, *FIELD], heavy_at_once) == []


def test_effects_use_the_public_api_only() -> None:
    allowed = {*sys.stdlib_module_names, "numpy", "qsf_plugins"}
    for path in EFFECT_FILES:
        for name in imported(tree(path)):
            assert name == "qsframework.plugin" or name.split(".")[0] in allowed, f"{path} imports {name}"


PACKAGE_NAMES = {path.name for path in PACKAGES}
NAMED = re.compile(r"\b(" + "|".join(sorted(PACKAGE_NAMES)) + r")\b")


def packages_named(path: Path) -> Iterator[str]:
    """What a module of the core imports of a package beside it, or names in a text, docstrings aside."""
    parsed = tree(path)
    said = {node.value for node in ast.walk(parsed) if isinstance(node, ast.Expr)}
    texts = [n.value for n in ast.walk(parsed) if isinstance(n, ast.Constant) and n not in said]
    for text in (*imported(parsed), *(text for text in texts if isinstance(text, str))):
        yield from (f"names {name}" for name in NAMED.findall(text))


def test_the_core_knows_no_package_beside_it() -> None:
    assert complaints(LIBRARY, packages_named) == []


def insides_of_others(path: Path) -> Iterator[str]:
    """What a package imports of another's modules: only its front door is for others."""
    own = path.relative_to(ROOT / "plugins").parts[0]
    for name in imported(tree(path)):
        package, _, module = name.partition(".")
        if package in PACKAGE_NAMES - {own} and module:
            yield f"imports {name}, which is inside {package}"


def test_packages_know_only_the_doors_of_each_other() -> None:
    assert complaints([*EFFECT_FILES, *FIELD], insides_of_others) == []


def behind(entry: Path) -> set[Path]:
    """A module and all of its package that it imports."""
    found, waiting = set[Path](), [entry]
    while waiting:
        path = waiting.pop()
        if path not in found:
            found.add(path)
            modules = (ROOT / "plugins" / f"{name.replace('.', '/')}.py" for name in imported(tree(path)))
            waiting += [module for module in modules if module.is_file()]
    return found


def test_readers_and_languages_stand_on_the_public_api_alone() -> None:
    """With whatever of their packages they use: somebody else's reader has no more."""
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]
    entries = {**groups["qsframework.readers"], **groups["qsframework.languages"]}
    files = {ROOT / "plugins" / f"{place.partition(':')[0].replace('.', '/')}.py" for place in entries.values()}
    assert len(files) == len(entries)
    allowed = {*sys.stdlib_module_names, "numpy", *PACKAGE_NAMES}
    for path in {module for file in files for module in behind(file)}:
        for name in imported(tree(path)):
            assert name == "qsframework.plugin" or name.split(".")[0] in allowed, f"{path} imports {name}"


EFFECTS = {p.stem for p in EFFECT_FILES if re.search(r"\w_\w", p.stem.strip("_"))}


def effects_named(path: Path) -> Iterator[str]:
    whole = [node.value for node in ast.walk(tree(path)) if isinstance(node, ast.Expr)]  # docstrings, and what is told
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in whole:
            yield from sorted(EFFECTS & set(re.findall(r"\w+", node.value)))


def test_the_library_refers_to_effects_by_role() -> None:
    """Another package's gear or load error is as good as the built-in one."""
    assert complaints(LIBRARY, effects_named) == []
