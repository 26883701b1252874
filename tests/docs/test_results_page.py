"""docs/results.md: what its own tables and sentences say is what the records beside it hold."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest

RECORDS = Path(__file__).resolve().parents[2] / "docs" / "records"


@pytest.fixture(scope="module")
def page(root: Path) -> str:
    return " ".join((root / "docs" / "results.md").read_text().split())


def column(table: str, name: str, start: str = "") -> list[str]:
    """A column of a record, of the rows whose first cell begins so."""
    with (RECORDS / f"{table}.csv").open() as lines:
        return [row[name] for row in csv.DictReader(lines) if next(iter(row.values())).startswith(start)]


def test_every_record_is_linked_and_every_link_a_record(root: Path) -> None:
    linked = re.findall(r"\]\(records/(.*?\.csv)\)", "".join(p.read_text() for p in (root / "docs").glob("*.md")))
    assert sorted(set(linked)) == sorted(path.name for path in RECORDS.glob("*.csv"))


def test_the_times_of_commands_are_those_of_the_record(page: str) -> None:
    made = ("identify the R-2000iC", "design: 12 poses", "diagnose 60 poses", "check")
    units = [column("performance-commands-by-command", "units", start)[0] for start in made]
    seconds = [float(column("performance-commands-by-command", "CPU s", start)[0]) for start in made]
    assert f"| {seconds[1]:.1f}, {seconds[0]:.1f} and {seconds[2]:.1f} s of CPU |" in page
    assert f"| {', '.join(units[:3])} units | 2.4, 4.5, 9: missed |" in page
    assert f"| {units[3]} units | 1.5: missed |" in page


def test_coverages_are_those_of_the_record(page: str) -> None:
    cover = column("uncertainties-coverage-by-campaign", "coverage, mean")
    said = page.split("## Uncertainties")[1].split("**The load's own error**")[0]
    assert re.findall(r"(\d\d\.\d)(?= %|,? and| %)", said) == cover
    holding = [float(c) for c in cover if float(c) > 90.0]
    assert f"{min(holding)} to {max(holding)} % on average" in page


@pytest.mark.parametrize(
    ("table", "name", "start", "said"),
    [
        ("diagnosis-results-by-metric", "measured", "named right, s = 8", "| {0} identified |"),
        ("diagnosis-results-by-metric", "measured", "false alarms, nominal", "| {0} of campaigns |"),
        ("diagnosis-unknown-kinds-untouched-kinds-by-metric", "measured", "untouched kinds: place r", "| {0}; of a"),
        ("diagnosis-results-by-metric", "measured", "detected, s = 4.5", "detected? | {0} | 85 %: missed |"),
        ("diagnosis-second-generator-by-metric", "measured", "library effects, s = 10: named", "| {0} named, or in"),
        ("diagnosis-mistakes-by-metric", "measured", "mistakes", "table named? | {0} | 95 % |"),
        ("stated-noise-predicted-by-robot", "predicted over fit", "", "are {0} to {1} of those of the fit"),
        ("stated-noise-coverage-by-noise", "measured", "", " to {1} (goal: 94 to"),
        ("heavy-arm-by-geometry-off-by-stage", "base, mm (worse)", "1, unc", "| uncorrected | {0} |"),
        ("performance-design-against-cvxpy-by-solver", "ratio", "", "{0} to {1} times faster"),
        ("performance-design-against-figaroh-1-0-2-by-candidates", "ratio", "", "{0} to {1} times faster"),
        ("performance-identification-by-series-model", "ratio", "", "{0} to {1} times faster"),
        ("performance-design-exact-plans-by-parameters", "efficiency of the bound", "9", "share of the bound | {0},"),
        ("performance-design-exact-plans-by-parameters", "efficiency of the bound", "32", ", {0} | 0.957, 0.75 |"),
        ("performance-clean-by-robot", "something is found", "all", "something is found | {2} of 600 |"),
        ("performance-scaling-by-size", "slope", "poses", "by a power of at most {1},"),
        ("performance-scaling-by-size", "slope", "parameters", "with the parameters of a design by {1}."),
        ("performance-against-by-job", "ratio", "ur10-b", "design | {0} to "),
        ("performance-against-by-job", "ratio", "r2000ic", " to {0}, 1.39,"),
        ("performance-against-by-job", "ratio", "design", "1.39, {0} times its time | 1.1: missed |"),
        ("performance-kinematics-by-what", "ratio", "positions", "| {0} |"),
    ],
)
def test_numbers_are_those_of_the_records(page: str, table: str, name: str, start: str, said: str) -> None:
    values = column(table, name, start)
    ordered = sorted(values, key=lambda text: float(re.match(r"[\d.]+", text)[0]))  # type: ignore[index]
    assert said.format(ordered[0], ordered[-1], ordered[0].split(":")[0]) in page
