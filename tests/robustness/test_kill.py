"""Commands killed at random moments leave old or new files."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from command_lines import prepared

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
EXPERIMENT = str(ROOT / "examples" / "m900ib" / "experiment.yaml")
TASK = """title: a line
tool_mm: 250
approach: [0, 0, -1]
path:
  - {xyz_mm: [1700, -300, 800], fz_N: 600}
  - {xyz_mm: [1700, 300, 800], fz_N: 600}
map: {x_mm: [1500, 2000], z_mm: [600, 1200], steps: 3, fz_N: -1000}
campaign:
  poses: 8
  sigma_mm: 0.03
  lever_mm: 200
  candidates: 40
  loads:
    - {name: weight, fz_N: -1000}
    - {name: side_pull, fz_N: -500, fy_N: 800, poses_min: 3}
"""
BENCH = "../bench"
SMALL, PLAN = f"{BENCH}/experiment.yaml", f"{BENCH}/plan.csv"
FIT, READINGS = f"{BENCH}/fit.json", f"{BENCH}/readings.csv"
"""Of an arm of two joints: what is killed is the writing, and that of a large arm is no other."""
COMMANDS: list[dict[str, Any]] = [
    {
        "arguments": [
            *("design", SMALL, "-n", "4", "--candidates", "60", "--no-polish"),
            *("-o", "out/plan.csv", "--json", "out/d.json"),
        ],
        "kills": 4,
        "again": True,
    },
    {
        "arguments": ["simulate", SMALL, PLAN, "-o", "out/readings.csv", "--json", "out/t.json"],
        "kills": 4,
        "again": True,
    },
    {
        "arguments": ["identify", SMALL, READINGS, "--json", "out/fit.json", "--nominal", "out/n.yaml"],
        "kills": 4,
        "again": True,
    },
    {
        "arguments": [
            *("stiffness", f"{BENCH}/small", "--pose", "10,-20", "--load", "0,0,-100"),
            *("--json", "out/s.json", "--report", "out/s.html"),
        ],
        "kills": 4,
    },
    {
        "arguments": [
            *("compensate", SMALL, FIT, f"{BENCH}/targets.csv", "--anyway"),
            *("-o", "out/c.csv", "--json", "out/c.json"),
        ],
        "kills": 4,
    },
    {
        "arguments": [
            *("export", f"{BENCH}/ur10.yaml", f"{BENCH}/ur10_plan.csv", "--to", "urscript", "-o", "out/arm.script")
        ],
        "kills": 4,
    },
    {"arguments": ["protocol", SMALL, PLAN, "-o", "out/sheet.html", "--readings", "out/r.csv"], "kills": 4},
    {"arguments": ["show", SMALL, PLAN, "--html", "out/scene.html"], "kills": 4},
    {
        "arguments": ["diagnose", SMALL, READINGS, "--json", "out/d.json", "--extend", "out/new"],
        "folders": ["new"],
        "kills": 4,
        "again": True,
    },
    {
        "arguments": ["new", "arm", "--urdf", f"{BENCH}/small/small.urdf", "-o", "out/arm"],
        "folders": ["arm"],
        "fresh": True,
        "kills": 4,
    },
    {"arguments": ["demo", "-o", "out"], "kills": 1},
    {"arguments": ["robots", "--json", "out/robots.json"], "kills": 2},
    {"arguments": ["check", SMALL, "--json", "out/check.json"], "kills": 2},
]
IMPORTS = [
    "qsframework.cli.design",
    "qsframework.cli.identify",
    "qsframework.cli.diagnose_plan",
    "scipy.stats",
    "qsframework.report",
    "qsframework.robot.loader",
    "qsframework.cli.compare",
    "qsf_controllers.command",
    "qsframework.cli.show",
    "qsframework.report.extended",
    "meshcat",
    "rich.progress",
    "typer.rich_utils",
]


@pytest.fixture(scope="module")
def trials(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """All jobs, done in one process that forks, whose libraries are loaded once."""
    folder = tmp_path_factory.mktemp("kills")
    (folder / "task.yaml").write_text(TASK)
    prepared(folder)
    before = [["check", EXPERIMENT]]
    given = {"imports": IMPORTS, "before": before, "folder": str(folder), "seed": 8, "jobs": COMMANDS}
    (folder / "jobs.json").write_text(json.dumps(given))
    done = subprocess.run(
        [sys.executable, str(HERE / "killed.py"), str(folder / "jobs.json")],
        capture_output=True,
        text=True,
        timeout=600,
        env=os.environ | {"PYTHONPATH": str(HERE), "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "200"},
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout)


def named(job: dict[str, Any]) -> str:
    return " ".join([job["arguments"][0], *[a for a in job["arguments"] if a in (PLAN, "--extend")]])


@pytest.mark.parametrize("k", range(len(COMMANDS)), ids=[named(job) for job in COMMANDS])
def test_a_killed_command_leaves_old_or_new_files(trials: list[dict[str, Any]], k: int) -> None:
    result = trials[k]
    assert result["code"] == 0, result["said"]
    assert result["files"]
    assert len(result["trials"]) == COMMANDS[k]["kills"]
    for trial in result["trials"]:
        assert not trial["half"], trial
        assert "Traceback" not in trial["said"], trial["said"]
        if trial["signal"] == signal.SIGINT:
            assert not trial["stale"], trial
            assert trial["code"] in (0, 130), trial
            if trial["code"] == 130:
                assert trial["said"].splitlines()[-1] == "Interrupted. No partial files were left."
        else:
            assert trial["code"] in (0, -signal.SIGKILL)
            assert all(".qsf-part" in name for name in trial["stale"]), trial
    if COMMANDS[k].get("again"):
        assert result["again"] == 0
        assert result["same"], "a run after kills leaves the files of a first run, and nothing else"


def test_there_were_kills_enough(trials: list[dict[str, Any]]) -> None:
    killed = [t for r in trials for t in r["trials"] if t["code"] in (130, -signal.SIGKILL)]
    assert len(killed) >= 18
    assert {t["code"] for t in killed} == {130, -signal.SIGKILL}


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_the_command_line_itself(tmp_path: Path, number: signal.Signals, code: int) -> None:
    """A process of its own, stopped before anything is computed and while it is."""
    say = "from qsframework.cli import main; print('here', flush=True); main()"
    command = [sys.executable, "-c", say, "design", EXPERIMENT, "--candidates", "300000", "-o", str(tmp_path / "p.csv")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.readline()
        time.sleep(1.5)
        process.send_signal(number)
        said = process.stderr.read()
        assert process.wait(timeout=600) == code, said
    assert said.strip().splitlines()[-1] == "Interrupted. No partial files were left."
    assert "Traceback" not in said
    assert not list(tmp_path.iterdir())


SWALLOWED = """
import os, signal
from qsframework.cli.stop import listening
class Compiled:
    def __del__(self):  # what is raised here is lost, as in compiled code that cannot raise
        os.kill(os.getpid(), signal.SIGINT)
        for _ in range(10):
            pass
with listening():
    made = Compiled()
    del made
    print("went on")
"""


PRINTED = """
import os, signal
from numpy.lib.npyio import NpzFile
from scipy.stats import qmc
from qsframework.cli.stop import listening
read = NpzFile.__getitem__
def reads(self, key):
    os.kill(os.getpid(), signal.SIGINT)
    return read(self, key)
NpzFile.__getitem__ = reads
with listening():
    qmc.Sobol(3)  # loads its table where Cython prints a traceback and goes on
    print("went on")
"""


@pytest.mark.parametrize("program", [SWALLOWED, PRINTED])
def test_a_signal_that_compiled_code_swallows_ends_the_command(program: str, tmp_path: Path) -> None:
    """SciPy's Sobol numbers once went on with a table that a signal had left half filled."""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 130
    assert (done.stdout, done.stderr) == ("", "Interrupted. No partial files were left.\n")
