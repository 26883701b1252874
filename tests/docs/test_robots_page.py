"""docs/robots.md says what the robots are; its runs all held."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import make_robots

from qsframework.uses.conformance import STEPS, GravityCheck


def test_the_table_is_that_of_the_folders(root: Path) -> None:
    loaded, page = make_robots.robots(), (root / "docs" / "robots.md").read_text()
    assert make_robots.page(loaded) == page, "run: python docs/make_robots.py"
    rows = list(csv.DictReader(make_robots.RUNS.read_text().splitlines()))
    assert [row["robot"] for row in rows] == [r.name for r in loaded]
    assert all(row["held"] == f"{len(STEPS)} of {len(STEPS)}" for row in rows)
    (listed,) = re.findall(r"^- Robots: (.*?;.*?)$", (root / "README.md").read_text().replace("\n  ", " "), re.M)
    for r in loaded:
        number = re.search(r"\d{2,}", r.title)
        assert number is not None
        assert number[0] in listed


def test_a_run_that_failed_is_told() -> None:
    checks = tuple(GravityCheck(name, name != "model", f"{name} went wrong") for name in STEPS)
    row = make_robots.run_row("arm", checks, 3.2)
    assert f"{len(STEPS) - 1} of {len(STEPS)}" in row
    assert "model went wrong" in row
    assert row[-1] == "3 s"
