"""Sizes, leftovers, and the lock."""

from __future__ import annotations

import ast
import importlib.metadata
import re
from collections.abc import Iterator
from pathlib import Path

from packaging.requirements import Requirement
from sources import MODULES, ROOT, complaints, text, tree


def long_functions(path: Path) -> Iterator[str]:
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.FunctionDef):
            first = node.body[1] if ast.get_docstring(node) and len(node.body) > 1 else node.body[0]
            if (node.end_lineno or 0) - first.lineno >= 60:
                yield f"{node.name} is longer than 60 lines"


def test_functions_are_short() -> None:
    assert complaints(MODULES, long_functions) == []


def left_over(path: Path) -> Iterator[str]:
    yield from re.findall(r"NotImplementedError|TODO|FIXME|XXX|pragma: no cover|pinv\(", text(path))
    yield from re.findall(r"except\s*:", text(path))
    if not ast.get_docstring(tree(path)):
        yield "a module says in its docstring what it is for"


def test_nothing_is_left_over() -> None:
    assert complaints(MODULES, left_over) == []


def test_public_functions_and_classes_have_docstrings() -> None:
    missing = []
    for path in MODULES:
        for node in tree(path).body:
            public = isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")
            if public and not ast.get_docstring(node):
                missing.append(f"{path.relative_to(ROOT)}: {node.name}")
    assert not missing


MANY, FIRST = 6, 4
"""Fields above which a record is made by keywords, and how many of them may then be given by position (KW_ONLY)."""


def fields(node: ast.ClassDef) -> tuple[list[str], int]:
    """The fields of a dataclass, and how many of them may be given by position; no fields for other classes."""
    marks = [ast.unparse(d) for d in node.decorator_list if "dataclass" in ast.unparse(d)]
    own = [b for b in node.body if isinstance(b, ast.AnnAssign) and "ClassVar" not in ast.unparse(b.annotation)]
    names = [ast.unparse(b.target) for b in own if ast.unparse(b.annotation) != "KW_ONLY"]
    if not marks:
        return [], 0
    first = next((i for i, b in enumerate(own) if ast.unparse(b.annotation) == "KW_ONLY"), len(names))
    return names, 0 if "kw_only=True" in marks[0] else first


def made_by_position(path: Path) -> Iterator[str]:
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.ClassDef):
            names, first = fields(node)
            if len(names) > MANY and first > FIRST:
                yield f"{node.name} has {len(names)} fields: kw_only=True, or KW_ONLY"


def test_large_records_are_made_by_keywords() -> None:
    assert complaints(MODULES, made_by_position) == []


COMMAND_FILES = {"command.py", "options.py", "run.py", "run_protocol.py"}
"""Of packages with commands: what these are asked, call and print."""
OPTION = re.compile(r"(?<![\w-])--[a-z]")


def options_named(path: Path) -> Iterator[str]:
    if not path.is_relative_to(ROOT / "qsframework" / "cli") and path.name not in COMMAND_FILES:
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and OPTION.search(node.value):
                yield f"line {node.lineno} names an option: {node.value!r}"


def test_options_are_named_by_commands_only() -> None:
    """The library says what would help; which option that is, says the command line (`Problem.argument`)."""
    assert complaints(MODULES, options_named) == []


SAYING = {
    "screening/closure.py: ClosureCheck",
    "robot/statics.py: GravityCheck",
    "plans/candidates.py: Candidates",
    "estimation/rank.py: RankTest",
    "fits/record.py: Masked",
    "experiment/finding.py: Finding",
    "information/identifiable.py: NotEstimated",
    "hypotheses/hypothesis.py: Hypothesis",
    "hypotheses/catalogue/rows.py: WrongRows",
}
"""Classes outside report/words that still hold or make sentences: of errors, or of files that keep them. No more."""


def test_results_hold_no_prose() -> None:
    found: set[str] = set()
    for path in (ROOT / "qsframework").rglob("*.py"):
        where = path.relative_to(ROOT / "qsframework")
        if where.parts[0] in ("cli", "report"):
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            parts = node.body if isinstance(node, ast.ClassDef) else []
            names = {ast.unparse(b.target) for b in parts if isinstance(b, ast.AnnAssign)}
            names |= {b.name for b in parts if isinstance(b, ast.FunctionDef)}
            if isinstance(node, ast.ClassDef) and names & {"words", "statements", "sentence"}:
                found.add(f"{where}: {node.name}")
    assert found == SAYING


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
        for line in importlib.metadata.requires(name) or ():
            requirement = Requirement(line)
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
