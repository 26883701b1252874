"""Readings in which nothing is hidden: how often the diagnosis names something all the same.

    python benchmarks/clean.py [--seeds 200] [--jobs 2] [--robots ur10,made] [--json FILE] [--quick] [--write]

Simulated and diagnosed by the defaults of both: 24 poses drawn from those that the robot and its constraints allow,
two loads, three markers, 0.03 mm. Only what the diagnosis fits is drawn from its priors, the rest is nominal: the
model is right and the noise is as stated, so that every name is a false one. `made` is an arm that `qsf new` has made
from a stranger's URDF. Intervals are those of Clopper and Pearson, 95 %.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from common import ran, show, table
from scipy.stats import f

from qsframework.diagnoses import diagnose
from qsframework.errors import QsfError
from qsframework.experiment import Experiment, Plan, Readings, load_experiment, make_plan, simulate
from qsframework.plans import generate_candidates
from qsframework.plugin import Array, Poses
from qsframework.report.result_json import diagnosis_json
from qsframework.work import Work, run

SEEDS = 200
POSES = 24
CANDIDATES = 600
GOAL, POOLED = 0.06, 0.05
MARKERS = ((150, 250, 250), (400, -150, 150), (150, -150, -250))
NEAR = ((50, 200, 250), (250, -150, 150), (0, -150, 50))
SMALL = ((0, 0, 90), (100, 0, 60), (-40, 80, 60))


# ---------------------------------------------------------------- where the library is called


def pool_of(experiment: Experiment) -> Array:
    """Pendant angles (N, joints) rad that the robot and the experiment's constraints allow."""
    return generate_candidates(experiment, CANDIDATES, seed=5).pendant


def readings_of(experiment: Experiment, plan: Plan, truth: Array, seed: int) -> Readings:
    """What the instrument reads of an arm with these parameters, by default."""
    return simulate(experiment, plan, x=truth, seed=seed).readings


def answer_of(experiment: Experiment, readings: Readings) -> dict[str, Any]:
    """What the diagnosis says by default: its verdict, the names, and what it holds against the data."""
    told = diagnosis_json(diagnose(experiment, readings))
    names = [*told["conventions"], *(cause["id"] for cause in told["causes"])]
    problems = [problem["id"] for problem in told["data_problems"]]
    return {"verdict": told["verdict"], "names": list(dict.fromkeys(names)), "problems": problems}


def plan_of(experiment: Experiment, pendant: Array) -> Plan:
    """Poses under the experiment's loads in turns."""
    loads = [experiment.loads[i % len(experiment.loads)] for i in range(len(pendant))]
    poses = Poses(pendant, experiment.robot.controller.to_joints(pendant), np.stack([c.wrench for c in loads]))
    return make_plan(poses, [c.name for c in loads])


def truth_of(experiment: Experiment, rng: np.random.Generator) -> Array:
    """All parameters: those that are fitted drawn from their priors, as `qsf simulate` draws, the others nominal."""
    model = experiment.model()
    x = model.nominal.copy()
    for i in model.index(list(experiment.fit_names())):
        p = model.parameters[i]
        lower = 0.1 * p.nominal if p.lower == 0.0 else p.lower
        x[i] = np.clip(p.nominal + (p.sd or 0.0) * rng.standard_normal(), lower, p.upper)
    return x


# ---------------------------------------------------------------- the robots


@dataclass(frozen=True)
class Campaign:
    """How a robot is measured: weight and pull N, point and markers mm, and where its poses may lie."""

    point: tuple[int, int, int]
    markers: tuple[tuple[int, int, int], ...]
    weight: int
    pull: int
    constraints: str

    def text(self, robot: str) -> str:
        """experiment.yaml."""
        lines = [f"robot: {robot}", f"load: {{point_mm: {list(self.point)}}}", "markers:"]
        lines += [f"  m{k + 1}: {{xyz_mm: {list(xyz)}}}" for k, xyz in enumerate(self.markers)]
        lines += [
            "noise: {sigma_mm: 0.03}",
            "loads:",
            f"  - {{name: weight, fz_N: -{self.weight}}}",
            f"  - {{name: side_pull, fz_N: -{self.weight}, fy_N: {self.pull}}}",
            f"constraints: {{{self.constraints}}}",
        ]
        return "\n".join(lines) + "\n"


MADE = "made"
ROBOTS = {
    "fanuc_m900ib": Campaign(
        (150, 0, 200), MARKERS, 4000, 1500, "z_min_m: 0.5, axis1_distance_min_m: 1.0, of: wrist_centre"
    ),
    "fanuc_r2000ic": Campaign(
        (100, 0, 200), NEAR, 1500, 600, "z_min_m: 0.4, axis1_distance_min_m: 0.6, of: wrist_centre"
    ),
    "kuka_kr500_r2800_2": Campaign(
        (150, 0, 200), MARKERS, 3500, 1300, "z_min_m: 0.5, axis1_distance_min_m: 0.8, of: wrist_centre"
    ),
    "ur10": Campaign((80, 0, 60), SMALL, 90, 30, "z_min_m: 0.2, of: flange"),
    MADE: Campaign((80, 0, 100), NEAR, 360, 140, "z_min_m: 0.3, of: flange"),
}
LINKS = (("foot", 60), ("turret", 90), ("upper", 60), ("fore", 35), ("roll", 20), ("bend", 10), ("hand", 4))
JOINTS = (
    ("0 0 1", "0 0 0.4"),
    ("0 1 0", "0.2 0 0.2"),
    ("0 1 0", "0 0 0.8"),
    ("1 0 0", "0.3 0 0.1"),
    ("0 1 0", "0.5 0 0"),
    ("1 0 0", "0.15 0 0"),
)


def urdf() -> str:
    """An arm for 40 kg as a stranger may have drawn it."""
    parts = [
        f'<link name="{name}"><inertial><origin xyz="0 0 0.1"/><mass value="{mass}"/><inertia ixx="{mass / 50}" '
        f'iyy="{mass / 50}" izz="{mass / 50}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for name, mass in LINKS
    ]
    parts += [
        f'<joint name="to_{child}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="{axis}"/><limit lower="-2.5" upper="2.5" effort="0" velocity="1"/></joint>'
        for (parent, _), (child, _), (axis, xyz) in zip(LINKS[:-1], LINKS[1:], JOINTS, strict=True)
    ]
    return '<?xml version="1.0"?>\n<robot name="stranger">\n' + "\n".join(parts) + "\n</robot>\n"


def written(robot: str, folder: Path) -> Path:
    """experiment.yaml of a robot; the folder of the one that is made too."""
    own = folder / robot
    own.mkdir()
    if robot == MADE:
        (own / "arm.urdf").write_text(urdf())
        ran(
            [
                sys.executable,
                "-m",
                "qsframework",
                "new",
                "arm",
                "--urdf",
                "arm.urdf",
                "--payload",
                "40",
                "--output",
                "arm",
            ],
            own,
        )
    path = own / "experiment.yaml"
    path.write_text(ROBOTS[robot].text("arm" if robot == MADE else robot))
    return path


# ---------------------------------------------------------------- answers


@dataclass(frozen=True)
class Result:
    """One answer. outcome: done, refused in the library's words, or failed by a fault of it"""

    robot: str
    seed: int
    outcome: str
    seconds: float
    verdict: str = ""
    names: Sequence[str] = ()
    problems: Sequence[str] = ()
    words: str = ""

    @property
    def alarm(self) -> bool:
        """Whether anything but "nothing found" was said."""
        return self.outcome == "done" and self.verdict != "none"


def one(pools: dict[str, tuple[Experiment, Array]], task: tuple[str, int]) -> dict[str, Any]:
    """Simulate and diagnose one seed of a robot: a Result as a plain dictionary, which any process can carry."""
    robot, seed = task
    experiment, pool = pools[robot]
    rng = np.random.default_rng([zlib.crc32(robot.encode()), seed])
    start = time.process_time()
    try:
        plan = plan_of(experiment, pool[rng.choice(len(pool), POSES, replace=False)])
        readings = readings_of(experiment, plan, truth_of(experiment, rng), seed)
        start = time.process_time()
        told = {"outcome": "done"} | answer_of(experiment, readings)
    except QsfError as error:
        told = {"outcome": "refused", "words": str(error)}
    except Exception as error:  # one fault must not stop a thousand answers; the table counts it
        told = {"outcome": "failed", "words": f"{type(error).__name__}: {error}"}
    return told | {"robot": robot, "seed": seed, "seconds": time.process_time() - start}


def clopper_pearson(hits: int, count: int) -> tuple[float, float]:
    """95 % interval of a rate, which covers it at least so often."""

    def above(k: int) -> float:
        odds = (k + 1) * float(f.ppf(0.975, 2 * (k + 1), 2 * (count - k)))
        return odds / (count - k + odds)

    return 1.0 - above(count - hits) if hits else 0.0, above(hits) if hits < count else 1.0


def row(label: str, results: Sequence[Result], goal: float) -> list[str]:
    """A line of the table."""
    done = [r for r in results if r.outcome == "done"]
    lost = Counter(r.outcome for r in results if r.outcome != "done")
    said = ", ".join(f"{count} {outcome}" for outcome, count in sorted(lost.items()))
    if not done:
        return [label, "0", *["-"] * 6, said]
    alarms = sum(r.alarm for r in done)
    low, high = clopper_pearson(alarms, len(done))
    met = "yes" if alarms <= goal * len(done) else "within the interval" if low <= goal else "NO"
    unexplained = sum(r.verdict == "unexplained" for r in done)
    audited = sum(bool(r.problems) for r in done)
    return [
        label,
        str(len(done)),
        f"{alarms}: {100 * alarms / len(done):.1f} %",
        f"{100 * low:.1f} - {100 * high:.1f} %",
        f"at most {100 * goal:g} %: {met}",
        str(unexplained),
        str(audited),
        f"{np.median([r.seconds for r in done]):.2f}",
        said,
    ]


def report(results: Sequence[Result]) -> str:
    """The table, what was named, and why answers are missing."""
    robots = list(dict.fromkeys(r.robot for r in results))
    rows = [row(name, [r for r in results if r.robot == name], GOAL) for name in robots]
    rows.append(row("all", results, POOLED))
    head = (
        "robot",
        "answers",
        "something is found",
        "95 %",
        "goal",
        "of these unexplained",
        "noise or rows blamed",
        "CPU s each",
        "no answer",
    )
    text = table(head, rows)
    for title, count in (
        ("Named", Counter(name for r in results for name in r.names)),
        ("No answer", Counter(r.words.splitlines()[0] for r in results if r.words)),
    ):
        if count:
            text += f"\n\n{title}: " + ", ".join(f"{name} ({n})" for name, n in count.most_common(20)) + "."
    return text


def main() -> None:
    """Simulate, diagnose, count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=SEEDS, help="per robot")
    parser.add_argument("--robots", default=",".join(ROBOTS), help="some of them, by comma")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--json", type=Path, help="write all answers to this file")
    parser.add_argument("--quick", action="store_true", help="five seeds")
    parser.add_argument("--write", action="store_true", help="write the table to docs/results.md")
    given = parser.parse_args()
    robots, seeds = given.robots.split(","), 5 if given.quick else given.seeds
    unknown = [name for name in robots if name not in ROBOTS]
    if unknown:
        raise SystemExit(f"no robot {', '.join(unknown)} here; there are {', '.join(ROBOTS)}")
    with tempfile.TemporaryDirectory() as folder:
        experiments = {name: load_experiment(written(name, Path(folder))) for name in robots}
        pools = {name: (experiment, pool_of(experiment)) for name, experiment in experiments.items()}
        tasks = [(name, seed) for name in robots for seed in range(seeds)]
        results: list[Result] = []
        for told in run(one, pools, tasks, Work(given.jobs)):
            results.append(result := Result(**told))
            if result.seed == seeds - 1:
                print(
                    " | ".join(row(result.robot, [r for r in results if r.robot == result.robot], GOAL)),
                    file=sys.stderr,
                    flush=True,
                )
    if given.json:
        given.json.write_text(json.dumps([asdict(r) for r in results], indent=1) + "\n")
    some = given.quick or seeds < SEEDS or len(robots) < len(ROBOTS)
    show("clean", report(results), given.write, some, runs=None)


if __name__ == "__main__":
    main()
