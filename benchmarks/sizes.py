"""What large files cost: 10,000 markers, 200,000 rows, lines of 10 MB. Prints the table of docs/results.md.

    python benchmarks/sizes.py             # try all, and write the record
    python benchmarks/sizes.py --look      # print it only

Each is a whole command in a process of its own; CPU from its start, and its largest memory.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from datetime import date
from multiprocessing import get_context
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "robustness"))
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"
import command_lines  # noqa: E402
import numpy as np  # noqa: E402
from common import replace_between, shelved  # noqa: E402
from fuzz import PAGE, head, processor  # noqa: E402

from qsframework.experiment import load_experiment, make_plan, simulate, write_readings  # noqa: E402
from qsframework.plugin import Poses  # noqa: E402

START, STOP = "<!-- record of benchmarks/sizes.py -->", "<!-- end of the record of sizes -->"
LONG = 10_000_000
VISITS, MARKERS, SEEN = 10_000, 60, 20
"""Of a long campaign: visits, markers, and those that are seen at a visit."""


def cases(place: Path) -> Iterator[tuple[str, str]]:
    """What is large, and the command that reads it; the file is written when its turn comes."""
    text = (place / "experiment.yaml").read_text()
    markers = "".join(f"  m{k}: {{xyz_mm: [{k % 100}, {k // 100}, 50]}}\n" for k in range(4, 10_004))
    (place / "many.yaml").write_text(
        text.replace("markers:\n", f"markers:\n{markers}").replace("readings.csv", "x.csv")
    )
    yield "10,000 markers", "design many.yaml -n 4 --candidates 20 --no-polish -o many.csv"
    yield "10,000 markers", "simulate many.yaml plan.csv -o many_readings.csv"
    yield "60,000 readings of them", "identify many.yaml many_readings.csv --json many.json"
    # in a process of its own: what this one once held is counted to those that it starts
    campaign = get_context("spawn").Process(target=_long_campaign, args=(place,))
    campaign.start()
    campaign.join()
    rows = f"{VISITS * SEEN:,} readings, {MARKERS} markers, {VISITS:,} visits"
    yield rows, "check long.yaml rows.csv"
    yield rows, "identify long.yaml rows.csv --json rows.json"
    yield rows, "identify long.yaml rows.csv --report rows.html"
    yield rows, "validate long.yaml rows.json rows.csv"
    lines = (place / "readings.csv").read_text().splitlines(keepends=True)
    start = next(i for i, line in enumerate(lines) if not line.startswith("#")) + 1
    copied = lines[start:]
    (place / "more.csv").write_text("".join(lines[:start]) + "".join(copied) * (250_001 // len(copied) + 1))
    yield "more than 250,000 rows", "identify experiment.yaml more.csv"
    long = {
        "readings.csv": "x",
        "experiment.yaml": "# ",
        "fit.json": " ",
        "targets.csv": "1,",
        "points.csv": "9",
        "dh.csv": "a,",
    }
    for name, what in long.items():
        spoiled = f"long_{name}"
        (place / spoiled).write_text((place / name).read_text().rstrip("\n") + what * (LONG // len(what)) + "\n")
    yield "10 MB in a line of readings", "identify experiment.yaml long_readings.csv"
    yield "10 MB in a line of an experiment", "check long_experiment.yaml"
    yield "10 MB in a line of a fit", "validate experiment.yaml long_fit.json readings.csv"
    yield "10 MB in a line of targets", "compensate experiment.yaml fit.json long_targets.csv"
    yield "10 MB in a line of points", "import experiment.yaml long_points.csv --plan plan.csv --unit mm -o i.csv"
    yield "10 MB in a line of a table", "new arm --dh long_dh.csv"


def _long_campaign(place: Path) -> None:
    """`long.yaml` and `rows.csv`: random poses of the robot, at each some of the markers, with noise of their own."""
    rng = np.random.default_rng(0)
    at = rng.uniform(-150.0, 150.0, (MARKERS, 3)).round()
    markers = "".join(f"  n{k}: {{xyz_mm: {own}}}\n" for k, own in enumerate(at.tolist()))
    campaign = (place / "experiment.yaml").read_text()
    head, _, rest = campaign.partition("markers:\n")
    rest = rest[next(m.start() for m in re.finditer(r"^\S", rest, re.MULTILINE)) :]
    (place / "long.yaml").write_text(f"{head}markers:\n{markers}{rest}".replace("data: readings.csv\n", ""))
    experiment = load_experiment(place / "long.yaml")
    controller = experiment.robot.controller
    pendant = rng.uniform(controller.lower, controller.upper, (VISITS, len(controller.lower)))
    load = rng.integers(len(experiment.loads), size=VISITS)
    wrench = np.array([one.wrench for one in experiment.loads])[load]
    names = [experiment.loads[k].name for k in load.tolist()]
    plan = make_plan(Poses(pendant, controller.to_joints(pendant), wrench), names)
    readings = simulate(experiment, plan, seed=0).readings
    seen = np.argsort(rng.random((VISITS, MARKERS)), axis=1)[:, :SEEN] + MARKERS * np.arange(VISITS)[:, None]
    write_readings(place / "rows.csv", readings.of_rows(np.sort(seen.ravel())), experiment)


def measured(place: Path, line: str) -> tuple[int, float, float, str]:
    """Exit code, s of CPU, MB, and the last line that was printed."""
    with (place / "said").open("w") as said:
        command = [sys.executable, "-m", "qsframework", *line.split()]
        process = subprocess.Popen(command, cwd=place, stdout=said, stderr=said)
        _, status, usage = os.wait4(process.pid, 0)
    words = (place / "said").read_text().strip().splitlines() or [""]
    refusal = next((w for w in words if w.startswith("error: ")), "")
    return os.waitstatus_to_exitcode(status), usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024, refusal


def main() -> int:
    """Try, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--look", action="store_true", help="print the record, and leave the page")
    options = parser.parse_args()
    lines = ["| file | command | s of CPU | MB | exit code | said |", "|---|---|---:|---:|---:|---|"]
    worst = 0
    with tempfile.TemporaryDirectory() as folder:
        place = command_lines.prepared(Path(folder))
        for what, line in cases(place):
            code, seconds, megabytes, said = measured(place, line)
            worst = max(worst, 0 if code in (0, 2) else 1)
            shown = said.removeprefix("error: ")[:90].replace("|", "/")
            lines.append(f"| {what} | `qsf {line}` | {seconds:.1f} | {megabytes:.0f} | {code} | {shown} |")
            print(lines[-1], flush=True)
    made = f"`python benchmarks/sizes.py`, {date.today()}, commit {head()}; {processor()}."
    if not options.look:
        text = shelved("\n".join([made, "", *lines]), "robustness sizes")
        replace_between(PAGE, START, STOP, f"\n{text}\n")
    return worst


if __name__ == "__main__":
    sys.exit(main())
