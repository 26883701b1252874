"""The table of what the product states of errors names tests that are there, and misses none of this folder."""

from __future__ import annotations

import ast
import re
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
ROW = re.compile(r"^\| (?P<words>[^|]+) \| `(?P<test>[^`]+)` \| (?P<awaits>[^|]*)\|$")


def functions(file: Path) -> dict[str, str]:
    """Tests of a file, each with the title of the issue that it awaits, "" for none."""
    tree = ast.parse(file.read_text())
    titles = {n.targets[0].id: n.value.value for n in tree.body if isinstance(n, ast.Assign) and _title(n)}
    out = dict[str, str]()
    for test in tree.body:
        if isinstance(test, ast.FunctionDef) and test.name.startswith("test_"):
            marks = [ast.unparse(mark) for mark in test.decorator_list]
            awaited = [title for name, title in titles.items() if f"awaits({name})" in marks]
            out[test.name] = "".join(awaited)
    return out


def _title(node: ast.Assign) -> bool:
    return isinstance(node.targets[0], ast.Name) and isinstance(getattr(node.value, "value", None), str)


def test_the_table_of_statements_is_that_of_the_tests() -> None:
    lines = (TESTS / "calibration" / "statements.md").read_text().splitlines()
    rows = [match for line in lines if (match := ROW.match(line))]
    assert len(rows) == sum(line.startswith("| ") for line in lines) - 1, "a row has another form"
    assert len({row["words"] for row in rows}) == len(rows)
    listed = dict[str, str]()
    for row in rows:
        file, _, name = row["test"].partition("::")
        known = functions(TESTS / file)
        assert name in known, row["test"]
        assert row["awaits"].strip() == known[name], row["test"]
        listed[row["test"]] = row["awaits"]
    for file in TESTS.glob("calibration/test_*_calibration.py"):
        missing = [name for name in functions(file) if f"calibration/{file.name}::{name}" not in listed]
        assert not missing, f"statements.md does not list {missing}"
