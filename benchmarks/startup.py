"""Start-up, imports and whole commands, each as a process of its own.

    python benchmarks/startup.py [--quick] [--write]

Start-up and imports stand beside an empty Python and the libraries that they need in any case; the whole commands are
those of the README and the examples, reports included, in units: the CPU of a fresh Python that imports numpy and
scipy.optimize. Medians; all commands take turns.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median

from common import ROOT, RUNS, Ran, medians, ran, show, table

QSF = str(Path(sys.executable).with_name("qsf"))
EXAMPLES = ROOT / "examples"


def python(code: str) -> list[str]:
    return [sys.executable, "-c", code]


def starts(runs: int) -> str:
    """How long nothing takes: the interpreter, the imports, the commands that only answer."""
    found = medians(
        {
            "an empty Python": python("pass"),
            "import numpy": python("import numpy"),
            "import qsframework": python("import qsframework"),
            "`qsf --help`": [QSF, "--help"],
            "import pinocchio": python("import pinocchio"),
            "a robot in memory": python("from qsframework.robot import load_robot; load_robot('fanuc_m900ib')"),
            "`qsf check fanuc_m900ib`": [QSF, "check", "fanuc_m900ib"],
            "import cvxpy": python("import cvxpy"),
        },
        ROOT,
        runs,
    )
    empty = found["an empty Python"].cpu
    rows = [[name, f"{r.cpu:.2f}", f"{r.cpu / empty:.1f}", f"{r.memory:.0f}"] for name, r in found.items()]
    return table(["what", "CPU s", "times an empty Python", "peak memory, MB"], rows)


def commands(folder: Path) -> dict[str, tuple[Sequence[str], float]]:
    """The commands with their goals in units, NaN where none was set."""
    hidden, r2000ic = EXAMPLES / "hidden_effect" / "experiment.yaml", EXAMPLES / "r2000ic" / "experiment.yaml"
    m900ib, ur10 = EXAMPLES / "m900ib" / "experiment.yaml", EXAMPLES / "ur10" / "experiment.yaml"
    plan = str(folder / "made.csv")
    report = ["--report", str(folder / "report.html")]
    none = float("nan")
    return {
        "robots": ([QSF, "robots"], 1.0),
        "check, 60 poses x 3 markers": ([QSF, "check", str(hidden)], 1.5),
        "stiffness": ([QSF, "stiffness", "fanuc_m900ib", "--pose=0,20,-10,0,60,0", "--load=0,0,-1000"], 1.5),
        "identify the R-2000iC, 43 poses, report": ([QSF, "identify", str(r2000ic), *report], 2.4),
        "design: 12 poses of the M-900iB, report": (
            [QSF, "design", str(m900ib), "--output", str(folder / "d.csv"), *report],
            4.5,
        ),
        "diagnose 60 poses x 3 markers, report": ([QSF, "diagnose", str(hidden), *report], 9.0),
        "demo: fit 43 poses, design 12, report": ([QSF, "demo", "--output", str(folder / "demo")], none),
        "simulate that plan": ([QSF, "simulate", str(m900ib), plan, "--output", str(folder / "s.csv")], none),
        "identify the UR10's geometry, report": ([QSF, "identify", str(ur10), *report], none),
    }


UNIT = python("import numpy, scipy.optimize")
"""What a unit is the CPU of."""


def whole(runs: int) -> str:
    """Commands from their start to their end."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        ran([QSF, "design", str(EXAMPLES / "m900ib" / "experiment.yaml"), "--output", str(folder / "made.csv")])
        asked = commands(folder)
        found: Mapping[str, Ran] = medians({"": UNIT} | {n: command for n, (command, _) in asked.items()}, folder, runs)
    unit = found[""].cpu
    rows = [
        [
            n,
            f"{r.cpu:.2f}",
            f"{r.cpu / unit:.1f}",
            f"{goal:g}" if goal == goal else "",
            f"{r.wall:.1f}",
            f"{r.memory:.0f}",
        ]
        for n, (_, goal) in asked.items()
        if (r := found[n])
    ]
    return table(["command", "CPU s", "units", "goal, units", "clock s", "peak memory, MB"], rows)


STEPS = """
import json, time
from qsframework.diagnoses import diagnose
from qsframework.experiment import load_experiment, read_readings
experiment = load_experiment({path!r})
readings = read_readings(experiment.data, experiment)
marks = [("imports and files", 0.0)]
def tell(step, done, count):
    marks.append((step, time.process_time()))
diagnose(experiment, readings, progress=tell)
marks.append(("", time.process_time()))
spent = {{step: 0.0 for step, _ in marks[:-1]}}
for (step, start), (_, end) in zip(marks, marks[1:]):
    spent[step] += end - start
print(json.dumps(spent))
"""


def steps(runs: int) -> str:
    """What each step of a diagnosis costs; a unit is the CPU of a fresh Python with numpy and scipy.optimize."""
    unit = medians({"unit": UNIT}, ROOT, runs)["unit"].cpu
    program = python(STEPS.format(path=str(EXAMPLES / "hidden_effect" / "experiment.yaml")))
    env = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    seen = [json.loads(subprocess.run(program, check=True, capture_output=True, env=env).stdout) for _ in range(runs)]
    spent = {name: float(median(one[name] for one in seen)) for name in seen[0]}
    whole = float(median(sum(one.values()) for one in seen))
    rows = [[name, f"{s:.2f}", f"{s / unit:.1f}", ""] for name, s in spent.items()]
    rows.append(["all, 60 poses x 3 markers, without a report", f"{whole:.2f}", f"{whole / unit:.1f}", "9 units"])
    return table(["step", "CPU s", "units", "goal"], rows)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one run")
    parser.add_argument("--write", action="store_true", help="write the tables to docs/results.md")
    given = parser.parse_args()
    if shutil.which(QSF) is None:
        raise SystemExit(f"{QSF} is not there: install qsframework into this environment")
    runs = 1 if given.quick else RUNS
    show("start-up", starts(runs), given.write, given.quick)
    show("commands", whole(runs), given.write, given.quick)
    show("diagnosis", steps(runs), given.write, given.quick)


if __name__ == "__main__":
    main()
