"""Write docs/robots.md and docs/records/robots-conformance.csv, what their conformance runs found: make_robots.py

About two minutes. The times are those of the machine that runs it; everything else is the same anywhere.
"""

from __future__ import annotations

import csv
import io
import re
import time
from pathlib import Path

from qsframework.robot import Robot, load_robot
from qsframework.uses.conformance import STEPS, GravityCheck, check_robot

DOCS = Path(__file__).parent
PAGE = DOCS / "robots.md"
RUNS = DOCS / "records" / "robots-conformance.csv"
FOLDER = DOCS.parent / "robots"
_PLAIN = ("joint_compliance",)
HEAD = """# The robots

Each is a folder under `robots/` with `robot.yaml`, a URDF written anew with simple solids, `nominal.yaml`, and a README
that states the source of every number. What no source states is assumed and marked so: most stiffnesses, all masses of
FANUC's and KUKA's links. The optimal poses hardly depend on assumed values; a prediction does. [Add
yours](add-a-robot.md). Each below holds a weight with a side pull; the deflection is exaggerated.

"""
MIDDLE = """
"Assumed" counts parameters whose `source` in `nominal.yaml` begins so; what is published was published for the robot or
for one of its family.

## Their conformance runs

`qsf check ROBOT --conformance` compares kinematics and holding torques with Pinocchio and all derivatives with finite
differences; then it designs, simulates, identifies and diagnoses a campaign of eight poses under two loads. [All
runs](records/robots-conformance.csv) held.
"""


def robots() -> list[Robot]:
    """All robots of the repository, by name."""
    return [load_robot(p.parent) for p in sorted(FOLDER.glob("*/robot.yaml"))]


def robots_table(loaded: list[Robot]) -> str:
    """What each robot is."""
    lines = [
        "| robot | loops and springs beside the joints' own | payload | assumed |",
        "|---|---|---|---|",
    ]
    for r in loaded:
        extras = dict.fromkeys(p.split("[")[0] for p in (e.name for e in r.effects) if not p.startswith(_PLAIN))
        assumed = sum(p.source.startswith("assumed") for p in r.parameters)
        payload = "not stated" if r.payload is None else f"{r.payload:g} kg"
        listed = ", ".join(f"`{x}`" for x in extras) or "none"
        lines.append(f"| `{r.name}` | {listed} | {payload} | {assumed} of {len(r.parameters)} |")
    return "\n".join(lines) + "\n"


def pictures_table(loaded: list[Robot]) -> str:
    """Each robot under a load, two in a row; `make pictures` draws them."""
    cells = [f"![{r.name}](images/{r.name}.png) {r.title}" for r in loaded]
    cells += [""] * (len(cells) % 2)
    rows = [f"| {one} | {other} |" for one, other in zip(cells[::2], cells[1::2], strict=True)]
    return "\n".join(["| | |", "|---|---|", *rows]) + "\n\n"


def run_row(name: str, checks: tuple[GravityCheck, ...], seconds: float) -> tuple[str, ...]:
    """One robot's run."""
    words = {c.name: c.words for c in checks}

    def found(step: str, pattern: str) -> str:
        match = re.search(pattern, words[step])
        return match[1] if match else words[step]

    return (
        name,
        f"{sum(c.good for c in checks)} of {len(STEPS)}",
        found("kinematics", r"(\S+ m) from Pinocchio"),
        found("gravity", r"within (\S+)"),
        found("model", r"gives by (.*? mm)"),
        found("identify", r"worst (.*? sd)"),
        found("diagnose", r"end: (\w+)"),
        f"{seconds:.0f} s",
    )


def runs_table(loaded: list[Robot]) -> str:
    """What each conformance run found, and how long it took."""
    rows = [("robot", "held", "kinematics", "torques", "deflection, median", "worst error", "diagnosis", "time")]
    for r in loaded:
        start = time.perf_counter()
        checks = check_robot(r)
        rows.append(run_row(r.name, checks, time.perf_counter() - start))
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(rows)
    return out.getvalue()


def page(loaded: list[Robot]) -> str:
    """The page."""
    return HEAD + pictures_table(loaded) + robots_table(loaded) + MIDDLE


if __name__ == "__main__":
    found = robots()
    PAGE.write_text(page(found))
    RUNS.write_text(runs_table(found))
