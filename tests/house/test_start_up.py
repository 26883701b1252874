"""`import qsframework` and `qsf --help` are quick and load nothing heavy."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ("pinocchio", "cvxpy", "meshcat", "plotly", "scipy", "pint", "xacro", "jinja2", "pydantic", "numpy")
REPORT = """
import os, sys
{statement}
loaded = [name for name in {heavy!r} if name in sys.modules]
times = os.times()
print("LOADED", ",".join(loaded), times.user + times.system)
"""


def run(statement: str) -> tuple[str, float]:
    code = REPORT.format(statement=statement, heavy=HEAVY)
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    line = next(line for line in out.splitlines() if line.startswith("LOADED")).split(" ")
    return line[1], float(line[2])


HELP = """
sys.argv = ["qsf", "--help"]
from qsframework.cli import main
try:
    main()
except SystemExit:
    pass
"""


@pytest.mark.parametrize("statement", ["import qsframework", HELP], ids=["import", "help"])
def test_nothing_heavy_is_loaded(statement: str) -> None:
    loaded, _ = run(statement)
    assert loaded == ""


def test_help_takes_less_than_half_a_second_of_cpu() -> None:
    assert min(run(HELP)[1] for _ in range(3)) < 0.5
