# ruff: noqa: E402 - threads are set before numpy is imported
"""How the costs grow with candidates, poses, parameters and markers: slopes on log axes, and a picture of them.

    python benchmarks/scaling.py [--quick] [--write]

CPU seconds, one thread, medians; the sizes of one curve take turns. A slope is fitted to the upper half of a curve:
1 means twice the cost for twice the size. --write puts the table into docs/results.md and draws
docs/images/scaling.svg.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np
from common import ROOT, RUNS, show, table, turns
from design import model_of, robot_rows, sample

from qsframework.diagnoses.diagnose import diagnose
from qsframework.experiment import Experiment, Readings, load_experiment, make_plan, simulate
from qsframework.fits import identify
from qsframework.information import as_rows, everything
from qsframework.plans import CRITERIA, generate_candidates
from qsframework.plans.column_generation import solve_columns
from qsframework.plans.criteria import Mean
from qsframework.plans.exact import Quotas, exchange
from qsframework.plans.options import STARTS
from qsframework.plans.task import make_task, white_basis
from qsframework.plugin import Poses

PICTURE = ROOT / "docs" / "images" / "scaling.svg"
BLOCK = 50_000
OFFAXIS = ("3/x", "3/z", "4/y", "4/z", "5/z", "2/x", "2/z", "6/y", "6/z", "1/x", "1/y")


@dataclass(frozen=True)
class Curve:
    """One cost against one size. job: makes what is timed, setup left out; bound: the slope it should not exceed"""

    panel: str
    name: str
    sizes: Sequence[int]
    job: Callable[[int], Callable[[], object]]
    bound: float
    seconds: list[float] = field(default_factory=list)

    def measure(self, runs: int) -> Curve:
        found = turns({str(n): self.job(n) for n in self.sizes}, runs)
        return Curve(self.panel, self.name, self.sizes, self.job, self.bound, list(found.values()))

    def slope(self) -> float:
        upper = slice(len(self.sizes) // 2 - (len(self.sizes) < 4), None)
        return float(np.polyfit(np.log(self.sizes[upper]), np.log(self.seconds[upper]), 1)[0])


# ---------------------------------------------------------------- predictions and designs


def predicted(count: int, parameters: int) -> Callable[[], None]:
    """Predictions and sensitivities of the linear model, in blocks so that memory stays bounded."""
    model, names = model_of(parameters)
    poses = sample(model, count, 0)

    def job() -> None:
        for start in range(0, count, BLOCK):
            part = poses.take(slice(start, start + BLOCK))
            model.predict(part, linear=True)
            model.sensitivity(part, names=names, linear=True)

    return job


@cache
def _rows(count: int, parameters: int) -> np.ndarray:
    return robot_rows(count, parameters)


def relaxed(count: int, parameters: int) -> Callable[[], object]:
    task = make_task(as_rows(_rows(count, parameters)), Mean(CRITERIA["D"]), everything(count))
    return lambda: solve_columns(task, np.random.default_rng(1))


def exact(poses: int) -> Callable[[], object]:
    """The exchange alone, from the relaxed design of 1e4 candidates, as `qsf design` does it."""
    rows = _rows(10_000, 9)
    rule = Mean(CRITERIA["D"])
    best = solve_columns(make_task(as_rows(rows), rule, everything(len(rows))), np.random.default_rng(1))
    short = np.union1d(np.argpartition(-best.scores, 2000)[:2000], best.index)
    T = white_basis(rows[short][:, None], np.zeros((1, 9, 9)))
    quotas = Quotas((np.arange(len(short)),), (poses,), np.arange(len(short)), True)
    weights, few = best.spread(len(rows))[short], rows[short] @ T
    return lambda: exchange(few, rule.in_basis(T), quotas, weights, STARTS, np.random.default_rng(0))


# ---------------------------------------------------------------- identification and diagnosis


@cache
def campaign(poses: int, markers: int, springs: int = 6) -> tuple[Experiment, Readings]:
    """Simulated readings of the M-900iB; beyond its six, springs off the joints' axes and of the tool are fitted."""
    rng = np.random.default_rng(3)
    lines = ["robot: fanuc_m900ib", "load: {point_mm: [150, 0, 200]}", "noise: {sigma_mm: 0.03}", "markers:"]
    lines += [f"  m{k}: {{xyz_mm: {[round(x) for x in rng.uniform(-400, 400, 3)]}}}" for k in range(markers)]
    lines += ["constraints: {z_min_m: 0.5, axis1_distance_min_m: 1.0, of: wrist_centre}"]
    more = [f"offaxis_compliance[joint_{place}]" for place in OFFAXIS[: springs - 6]]
    if more:
        lines += ["effects:", *(f"  - {{effect: offaxis_compliance, joint: {m[19:26]}, axis: {m[27]}}}" for m in more)]
        lines += ["fit:", *(f"  - {json.dumps(name)}" for name in ["joint_compliance", *more])]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "experiment.yaml"
        path.write_text("\n".join(lines) + "\n")
        experiment = load_experiment(path)
    pendant = generate_candidates(experiment, poses, seed=1).pendant
    pendant = pendant[rng.integers(0, len(pendant), poses)]
    wrench = np.zeros((poses, 6))
    wrench[:, 2] = -4000.0
    wrench[::2, 1] = 1500.0
    poses_of = Poses(pendant, experiment.robot.controller.to_joints(pendant), wrench)
    plan = make_plan(poses_of, ["weight"] * poses)
    return experiment, simulate(experiment, plan, truth="drawn", seed=2).readings


def identified(poses: int, markers: int, springs: int = 6) -> Callable[[], object]:
    experiment, readings = campaign(poses, markers, springs)
    return lambda: identify(experiment, readings)


def diagnosed(poses: int, markers: int) -> Callable[[], object]:
    experiment, readings = campaign(poses, markers)
    return lambda: diagnose(experiment, readings)


def curves(quick: bool) -> list[Curve]:
    """All curves; a quick run stops at smaller sizes."""
    top = 1 if quick else 10
    large = [n * top for n in (100, 1000, 10_000, 100_000)]
    few = [20, 40, 80] if quick else [20, 40, 80, 160]
    return [
        Curve("candidates", "predictions, 9 sensitivities, all springs", large, lambda n: predicted(n, 9), 1.0),
        Curve("candidates", "relaxed design, 9 parameters", large, lambda n: relaxed(n, 9), 1.0),
        Curve(
            "parameters",
            "predictions, sensitivities, 2e4 poses, all springs",
            [4, 8, 16, 32],
            lambda p: predicted(20_000, p),
            1.0,
        ),
        Curve("parameters", "relaxed design, 1e5 candidates", [4, 8, 16, 32], lambda p: relaxed(10_000 * top, p), 2.0),
        Curve("poses", "exact plan from 1e4 candidates", [12, 24, 48, 96], exact, 1.0),
        Curve(
            "poses", "identification, 3 markers", [n * top for n in (10, 40, 160, 640)], lambda n: identified(n, 3), 1.0
        ),
        Curve("poses", "diagnosis, 3 markers", few, lambda n: diagnosed(n, 3), 2.0),
        Curve("markers", "identification, 100 poses", [1, 2, 4, 8, 16], lambda k: identified(100, k), 1.0),
        Curve("markers", "diagnosis, 40 poses", [1, 2, 4], lambda k: diagnosed(40, k), 2.0),
        Curve(
            "fitted parameters",
            "identification, 100 poses, 3 markers",
            [6, 8, 12, 17],
            lambda p: identified(100, 3, p),
            2.0,
        ),
    ]


def draw(measured: Sequence[Curve], path: Path) -> None:
    """All curves on log axes, one panel for each kind of size."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams["svg.hashsalt"] = "scaling"  # the same file from the same numbers
    from matplotlib import pyplot

    panels = list(dict.fromkeys(c.panel for c in measured))
    figure, axes = pyplot.subplots(1, len(panels), figsize=(3.1 * len(panels), 3.6), sharey=True, layout="constrained")
    for panel, axis in zip(panels, axes, strict=True):
        for c in (c for c in measured if c.panel == panel):
            axis.loglog(c.sizes, c.seconds, "o-", label=f"{c.name}: {c.slope():.2f}")
        shown = sorted({n for c in measured if c.panel == panel for n in c.sizes})
        if shown[-1] < 100 * shown[0]:  # less than two decades: the sizes themselves
            axis.set_xticks(shown, [str(n) for n in shown])
            axis.set_xticks([], minor=True)
        axis.set_xlabel(panel)
        axis.grid(True, which="major", alpha=0.3)
        axis.legend(fontsize=6, loc="upper left")
    axes[0].set_ylabel("CPU seconds, one thread")
    low, high = axes[0].get_ylim()
    axes[0].set_ylim(low, high * 8)  # room for the legends
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    """Measure all curves, print their slopes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a tenth of the size, one run")
    parser.add_argument("--write", action="store_true", help="write docs/results.md and the picture")
    given = parser.parse_args()
    measured = [c.measure(1 if given.quick else RUNS) for c in curves(given.quick)]
    rows = [
        [
            c.panel,
            c.name,
            ", ".join(f"{n:,}" for n in c.sizes),
            ", ".join(f"{s:.3g}" for s in c.seconds),
            f"{c.slope():.2f}",
            f"{c.bound:g}",
        ]
        for c in measured
    ]
    text = table(["size", "what", "sizes", "CPU s", "slope", "expected at most"], rows)
    if given.write and not given.quick:
        draw(measured, PICTURE)
    show("scaling", "![Costs on log axes](images/scaling.svg)\n\n" + text, given.write, given.quick)


if __name__ == "__main__":
    main()
