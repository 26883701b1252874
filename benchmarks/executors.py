# ruff: noqa: E402 - threads are set before numpy is imported
"""One process against two: wall time of long work, medians of alternating runs, and whether the bits agree.

Run: python benchmarks/executors.py [--runs 3] [--jobs 2]. The processes are started before the clock is.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import statistics
import time
from collections.abc import Callable
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np

from qsframework.diagnoses import forecast
from qsframework.experiment import example, load_experiment
from qsframework.plans import DesignOptions, design
from qsframework.robot import load_robot
from qsframework.uses.compare import compare
from qsframework.uses.task import load_task
from qsframework.work import HERE, Work, run

Array = np.ndarray


def spectra(size: int, seed: np.random.SeedSequence) -> Array:
    """Monte Carlo: singular values of random matrices."""
    rng = np.random.default_rng(seed)
    return np.stack([np.linalg.svd(rng.standard_normal((size, size)), compute_uv=False) for _ in range(40)])


def jobs() -> dict[str, Callable[[Work], bytes]]:
    """Long work, each returning its result's bytes."""
    experiment = load_experiment(example("m900ib") / "experiment.yaml")
    few = design(experiment, 16, candidates=300, options=DesignOptions(polish=False))
    task = load_task(Path(__file__).resolve().parents[1] / "examples" / "compare" / "task.yaml")
    robots = [load_robot(name) for name in ("fanuc_m900ib", "fanuc_r2000ic")]
    options = DesignOptions(polish=False)
    seeds = np.random.SeedSequence(0).spawn(60)
    return {
        "Monte Carlo, 60 tasks of 40 spectra": lambda work: b"".join(
            a.tobytes() for a in run(spectra, 150, seeds, work)
        ),
        "design, 20 poses of 20,000 candidates": lambda work: design(
            experiment, 20, candidates=20_000, options=options, work=work
        ).pendant.tobytes(),
        "forecast of 16 poses, 112 causes": lambda work: forecast(experiment, few, work=work).angles.tobytes(),
        "two robots compared": lambda work: repr(compare(robots, task, work=work).as_json()).encode(),
    }


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    spread = Work(given.jobs)
    list(run(spectra, 10, np.random.SeedSequence(0).spawn(8), spread))
    print(f"| work | 1 process, s | {given.jobs} processes, s | ratio | same bits |\n|---|--:|--:|--:|---|")
    for name, job in jobs().items():
        times: dict[Work, list[float]] = {HERE: [], spread: []}
        found = set()
        for work in [HERE, spread] * (given.runs + 1):  # the first round loads libraries and is left out
            start = time.perf_counter()
            found.add(hashlib.sha256(job(work)).hexdigest())
            times[work].append(time.perf_counter() - start)
        one, two = (statistics.median(times[work][1:]) for work in (HERE, spread))
        print(
            f"| {name} | {one:.2f} | {two:.2f} | {one / two:.2f} | {'yes' if len(found) == 1 else 'NO'} |", flush=True
        )


if __name__ == "__main__":
    main()
