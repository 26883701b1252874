"""What `make coverage` says of a report."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))

from coverage_table import HELD, main, packages, shares, table


def report(branches: int = 20, packages: tuple[str, ...] = HELD) -> dict[str, object]:
    """A report of one file of 100 lines and 20 branches in each package."""
    summary = {"num_statements": 100, "covered_lines": 99, "num_branches": 20, "covered_branches": branches}
    return {"files": {f"/x/qsframework/{name}/a.py": {"summary": summary} for name in packages}}


def test_files_of_a_package_add_up() -> None:
    one = {"num_statements": 10, "num_branches": 4, "covered_branches": 1}
    two = {"files": {f"qsframework/robot/{n}.py": {"summary": {**one, "covered_lines": n}} for n in (4, 8)}}
    assert shares(packages(two)["robot"]) == (60.0, 25.0, 50.0)


def test_all_above() -> None:
    text, wrong = table(report())
    assert not wrong
    assert all(name in text for name in HELD)


def test_too_few_branches_are_named_though_lines_are_enough() -> None:
    _, wrong = table(report(branches=18))
    assert len(wrong) == len(HELD)
    assert any(line.startswith("robot: 90.0 % of branches, 97.5 %") for line in wrong)


def test_a_package_that_was_not_measured_is_no_success(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "coverage.json"
    path.write_text(json.dumps(report(packages=HELD[1:])))
    assert main(str(path)) == 1
    assert "robot: not measured" in capsys.readouterr().err
    path.write_text(json.dumps(report()))
    assert main(str(path)) == 0
