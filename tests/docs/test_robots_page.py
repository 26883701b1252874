"""docs/robots.md says what the robots are; its runs all held."""

from __future__ import annotations

import re
from pathlib import Path

import make_robots

from qsframework.applications.conformance import STEPS, GravityCheck


def test_the_table_is_that_of_the_folders(root: Path) -> None:
    loaded, page = make_robots.robots(), (root / "docs" / "robots.md").read_text()
    assert make_robots.robots_table(loaded) in page
    rows = [line for line in page.split("conformance runs")[1].splitlines() if line.startswith("| `")]
    assert [row.split("`")[1] for row in rows] == [r.name for r in loaded]
    assert all(f"| {len(STEPS)} of {len(STEPS)} |" in row for row in rows)
    (listed,) = re.findall(r"^- Robots: (.*?;.*?)$", (root / "README.md").read_text().replace("\n  ", " "), re.M)
    for r in loaded:
        number = re.search(r"\d{2,}", r.title)
        assert number is not None
        assert number[0] in listed


def test_a_run_that_failed_is_told() -> None:
    checks = tuple(GravityCheck(name, name != "model", f"{name} went wrong") for name in STEPS)
    row = make_robots.run_row("arm", checks, 3.2)
    assert f"| {len(STEPS) - 1} of {len(STEPS)} |" in row
    assert "model went wrong" in row
    assert row.endswith("| 3 s |")
