"""`import qsframework` and `qsf --help` are quick and load nothing heavy."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

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


NEW = """
sys.argv = ["qsf", "new", "arm", "--urdf", {urdf!r}, "-o", {output!r}]
from qsframework.cli import main
try:
    main()
except SystemExit:
    pass
"""


def test_a_new_robot_is_tried_without_a_campaign(root: Path, tmp_path: Path) -> None:
    """The campaign, and what reads units that few robots have, took two thirds of the time of `qsf new`."""
    urdf = root / "robots" / "kuka_kr500_r2800_2" / "kuka_kr500_r2800_2.urdf.xacro"
    loaded, _ = run(NEW.format(urdf=str(urdf), output=str(tmp_path / "arm")))
    assert (tmp_path / "arm" / "robot.yaml").is_file()
    assert set(loaded.split(",")) == {"pinocchio", "xacro", "pydantic", "numpy"}


@pytest.mark.parametrize(("stated", "threads"), [(None, 1), ("2", 2)])
def test_commands_keep_linear_algebra_to_one_thread_unless_told(stated: str | None, threads: int) -> None:
    environment = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    if stated is not None:
        environment["OPENBLAS_NUM_THREADS"] = stated
    code = f"import sys{HELP}import numpy, threadpoolctl\nprint('THREADS', threadpoolctl.threadpool_info())"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    found = [pool["num_threads"] for pool in ast.literal_eval(out.stdout.split("THREADS ")[1])]
    assert found
    assert set(found) == {min(threads, os.cpu_count() or 1)}
