"""The table of what the product states of errors names tests that are there, and misses none of this folder."""

from __future__ import annotations

import re
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
ROW = re.compile(r"^\| (?P<words>[^|]+) \| `(?P<test>[^`]+)` \|$")


def functions(file: Path) -> set[str]:
    """Names of a file's tests."""
    return set(re.findall(r"^def (test_\w+)", file.read_text(), re.M))


def test_the_table_of_statements_is_that_of_the_tests() -> None:
    lines = (TESTS / "calibration" / "statements.md").read_text().splitlines()
    rows = [match for line in lines if (match := ROW.match(line))]
    assert len(rows) == sum(line.startswith("| ") for line in lines) - 1, "a row has another form"
    assert len({row["words"] for row in rows}) == len(rows)
    listed = {row["test"] for row in rows}
    for file, name in (test.split("::") for test in listed):
        assert name in functions(TESTS / file), f"{file}: {name}"
    for file in TESTS.glob("calibration/test_*_calibration.py"):
        missing = [name for name in functions(file) if f"calibration/{file.name}::{name}" not in listed]
        assert not missing, f"statements.md does not list {missing}"
