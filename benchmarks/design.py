# ruff: noqa: E402 - threads are set before numpy is imported
"""Optimal designs: column generation against one pass over the data, cvxpy and FIGAROH; exact plans against the bound.

Run: python benchmarks/design.py [--quick] [--write]. Times are CPU seconds, medians of RUNS; a pass is the scoring of
all candidates once. Every job runs in a process of its own, so that its peak memory is its own. --write puts the
tables into docs/results.md. FIGAROH is asked where it is installed (QSF_FIGAROH_PYTHON names its interpreter).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np
import scipy.linalg
from common import RUNS, cpu, memory, show, table

from qsframework.elastostatics import Model, Site, make_model
from qsframework.estimation import rank_test, scales
from qsframework.information import as_rows, bound_of, everything, scores, weighted_information
from qsframework.information.rows import MadeRows
from qsframework.plans import CRITERIA
from qsframework.plans.catalogue import find_criterion
from qsframework.plans.column_generation import solve_columns
from qsframework.plans.criteria import Mean
from qsframework.plans.exact import Quotas, exchange
from qsframework.plans.options import STARTS
from qsframework.plans.relaxed import optimum
from qsframework.plans.task import make_task, white_basis
from qsframework.plugin import Poses, find
from qsframework.robot import load_robot

TIP = Site(6, np.array([0.15, 0.1, 0.25]))
HERE = Path(__file__).resolve().parent
SPRINGS = ("offaxis_compliance", "base_compliance", "flange_compliance", "link_compliance")
MORE = ("joint_hardening", "load_direction")
"""One marker tells about 25 springs apart; more parameters need other physics."""


def model_of(parameters: int) -> tuple[Model, list[str]]:
    """The M-900iB with its joint springs and those of more effects that one marker tells apart best."""
    robot = load_robot("fanuc_m900ib")
    extra = [e for name in (SPRINGS if parameters < 25 else SPRINGS + MORE) for e in find(name).places(robot.facts)]
    effects = [*robot.effects, *extra]
    values = [*robot.parameters, *(p for e in extra for p in e.parameters(robot.facts))]
    model = make_model(robot.facts, effects, values, TIP, [("tip", TIP)], robot.gravity)
    springs = [n for n in model.names if n.split("[")[0].split(".")[0] in ("joint_compliance", *SPRINGS, *MORE)]
    few = rows_of(model, springs, sample(model, 400, 0)).reshape(-1, len(springs))
    names: list[str] = []
    for i in scipy.linalg.qr(few / np.linalg.norm(few, axis=0).clip(1e-300), mode="r", pivoting=True)[1]:
        names.append(springs[int(i)])
        if len(names) == parameters:
            break
    assert rank_test(few[:, [springs.index(n) for n in names]], names).full
    return model, names


def sample(model: Model, count: int, seed: int) -> Poses:
    robot = load_robot("fanuc_m900ib")
    rng = np.random.default_rng(seed)
    pendant = rng.uniform(robot.controller.lower, robot.controller.upper, (count, 6))
    wrench = np.zeros((count, 6))
    wrench[:, 2] = -4000.0
    wrench[::2, 1] = 1500.0
    return Poses(pendant, robot.controller.to_joints(pendant), wrench)


def rows_of(model: Model, names: list[str], poses: Poses) -> np.ndarray:
    A = model.sensitivity(poses, names=names, linear=True).reshape(len(poses), 3, len(names))
    A *= scales([model.parameters[i] for i in model.index(names)]) / 3e-5
    return A


def robot_rows(count: int, parameters: int) -> np.ndarray:
    """Whitened rows (N, 3, p), columns brought to one size."""
    model, names = model_of(parameters)
    out = np.empty((count, 3, parameters))
    for start in range(0, count, 100_000):
        stop = min(start + 100_000, count)
        out[start:stop] = rows_of(model, names, sample(model, stop - start, start))
    out /= np.sqrt((out[:1000] ** 2).mean(axis=(0, 1)))
    return out


def relaxed(count: int, parameters: int, criterion: str, runs: int) -> dict[str, Any]:
    """One criterion at one size: CPU seconds, passes, memory beyond the data."""
    rows = as_rows(robot_rows(count, parameters))
    tip = robot_rows(400, parameters) if criterion == "I" else None
    rule = Mean(find_criterion(criterion, (), parameters, tip))
    G = np.eye(parameters)
    one = cpu(lambda: scores(rows, G), runs)
    before = memory()
    goal = 1 - 1e-6
    results = []
    task = make_task(rows, rule, everything(count))
    seconds = cpu(lambda: results.append(solve_columns(task, np.random.default_rng(1), goal)), runs)
    best = results[-1]
    return {
        "seconds": seconds,
        "pass": one,
        "passes": best.passes,
        "multiple": seconds / one,
        "gap": 1 - best.efficiency,
        "support": len(best.index),
        "memory_percent": 100 * (memory() - before) / (rows.values.nbytes / 2**20),  # type: ignore[attr-defined]
    }


def made(count: int, parameters: int) -> dict[str, Any]:
    """Candidates from a generator: each pass computes the poses' rows anew from their numbers, and none is kept."""
    model, names = model_of(parameters)
    robot = load_robot("fanuc_m900ib")
    low, high = robot.controller.lower, robot.controller.upper
    growth = np.roots([1, *[0] * 5, -1, -1])  # evenly spread sequence: powers of the root of x^7 = x + 1
    steps = float(growth[np.isreal(growth)].real.max()) ** -np.arange(1.0, 7.0)

    def rows(index: np.ndarray) -> np.ndarray:
        pendant = low + (high - low) * ((0.5 + index[:, None] * steps) % 1.0)
        wrench = np.zeros((len(index), 6))
        wrench[:, 2] = -4000.0
        wrench[index % 2 == 0, 1] = 1500.0
        return rows_of(model, names, Poses(pendant, robot.controller.to_joints(pendant), wrench))

    size = np.sqrt((rows(np.arange(1000)) ** 2).mean(axis=(0, 1)))
    source = MadeRows(lambda index: (rows(index) / size)[:, None], (count, 1, 3, parameters))
    task = make_task(source, Mean(CRITERIA["D"]), everything(count))
    start, wall = time.process_time(), time.perf_counter()
    best = solve_columns(task, np.random.default_rng(1))
    return {
        "seconds": time.process_time() - start,
        "wall": time.perf_counter() - wall,
        "passes": best.passes,
        "gap": 1 - best.efficiency,
        "memory": memory(),
    }


def exact(parameters: int, sizes: list[int], count: int) -> dict[str, Any]:
    """Exact plans against the bound, STARTS starts each; repeats allowed."""
    rows = robot_rows(count, parameters)
    rule = Mean(CRITERIA["D"])
    best = solve_columns(make_task(as_rows(rows), rule, everything(count)), np.random.default_rng(1))
    short = np.union1d(np.argpartition(-best.scores, 2000)[:2000], best.index)
    T = white_basis(rows[short][:, None], np.zeros((1, parameters, parameters)))
    weights, few = best.spread(count)[short], rows[short] @ T
    out = {}
    for n in sizes:
        quotas = Quotas((np.arange(len(short)),), (n,), np.arange(len(short)), True)
        start = time.process_time()
        chosen = exchange(few, rule.in_basis(T), quotas, weights, STARTS, np.random.default_rng(0))
        seconds = time.process_time() - start
        M = weighted_information(rows[short], np.bincount(chosen, minlength=len(short)))
        value = float(rule.value(M[None]))
        bound = best.efficiency * float(rule.value(best.information)) / n
        out[str(n)] = {"efficiency": bound / value, "seconds": seconds}
    return out


def reference(count: int, parameters: int, solver: str) -> dict[str, Any]:
    """The same problem as cvxpy solves it, and as column generation does."""
    from qsframework.plans import relaxed as module

    rows = robot_rows(count, parameters)
    allowed = everything(count)
    task = make_task(as_rows(rows), Mean(CRITERIA["D"]), allowed)
    ours = cpu(lambda: solve_columns(task, np.random.default_rng(0)), 3)
    start = time.process_time()
    robust = Mean(CRITERIA["D"])
    weights = optimum(rows[:, None], robust, allowed)[0] if solver == "CLARABEL" else plain_scs(rows)
    theirs = time.process_time() - start
    M = weighted_information(rows, weights / weights.sum())
    slope = np.linalg.inv(M) / parameters
    assert module.SOLVER == "CLARABEL"
    return {"theirs": theirs, "ours": ours, "their_gap": 1 - bound_of(scores(rows, slope), allowed)}


def plain_scs(rows: np.ndarray) -> np.ndarray:
    """log det by cvxpy and SCS, columns scaled."""
    import cvxpy as cp

    count, _, p = rows.shape
    moments = np.einsum("nki,nkj->nij", rows, rows).reshape(count, -1)
    w = cp.Variable(count, nonneg=True)
    M = cp.reshape(moments.T @ w, (p, p), order="C")
    cp.Problem(cp.Maximize(cp.log_det(0.5 * (M + M.T))), [cp.sum(w) == 1]).solve(solver="SCS")
    return np.maximum(w.value, 0.0)


def against_figaroh(count: int) -> dict[str, Any]:
    """FIGAROH's choice among the UR10 configurations that it draws, and ours among the same rows."""
    sys.path.insert(0, str(HERE))
    import importlib

    helper = importlib.import_module("figaroh")  # benchmarks/figaroh.py, which stands first on the path
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rows.npz"
        theirs = helper.run("design", count, "--save", str(path))
        if "skipped" in theirs:
            return theirs
        with np.load(path) as saved:
            rows, weights = saved["rows"], saved["weights"]
        rows = rows / np.sqrt((rows**2).mean(axis=(0, 1)))
        before = memory()
        task = make_task(as_rows(rows), Mean(CRITERIA["D"]), everything(len(rows)))
        results = []
        seconds = cpu(lambda: results.append(solve_columns(task, np.random.default_rng(0))))
        M = weighted_information(rows, weights / weights.sum())
        value = float(CRITERIA["D"].value(M))
        ours = float(Mean(CRITERIA["D"]).value(results[-1].information))
        return {
            **theirs,
            "ours": seconds,
            "our_memory": memory(),
            "added": memory() - before,
            "support": int((results[-1].weights > 1e-5).sum()),
            "their_efficiency": results[-1].efficiency * ours / value,
        }


def kernel(count: int) -> dict[str, Any]:
    """Geometry and sensitivities of candidates with 20 parameters."""
    robot = load_robot("fanuc_m900ib")
    extra = find("offaxis_compliance").places(robot.facts)[:12]
    values = [*robot.parameters, *(p for e in extra for p in e.parameters(robot.facts))]
    model = make_model(robot.facts, [*robot.effects, *extra], values, TIP, [("tip", TIP)], robot.gravity)
    names = [n for n in model.names if "compliance[" in n or n.startswith("compensator_stiffness")][:20]
    assert len(names) == 20
    poses = sample(model, count, 0)
    out = np.empty((count, 3, 20))
    start = time.process_time()
    for first in range(0, count, 65536):  # as a design makes them
        part = slice(first, min(first + 65536, count))
        out[part] = rows_of(model, names, poses.take(part))
    return {"seconds": time.process_time() - start}


JOBS: dict[str, Callable[..., dict[str, Any]]] = {
    job.__name__: job for job in (relaxed, made, exact, reference, against_figaroh, kernel)
}


def run(name: str, *arguments: Any) -> dict[str, Any]:
    """A job in a process of its own."""
    command = [sys.executable, __file__, "--job", json.dumps([name, *arguments])]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{name}{arguments} failed:\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def relaxed_table(quick: bool) -> str:
    large = 100_000 if quick else 1_000_000
    jobs = [
        ("D", large, 9, "3", "2.5"),
        ("D", large, 32, "3", "3"),
        ("A", large, 9, "5", ""),
        ("A", large, 32, "5", ""),
        ("I", large, 9, "5", ""),
        ("D", large // 10, 9, "", ""),
        ("D", large // 10, 32, "", ""),
    ]
    rows = []
    for criterion, count, p, goal, cpu_goal in jobs:
        r = run("relaxed", count, p, criterion, 1 if quick else RUNS)
        rows.append(
            [
                criterion,
                f"{count:.0e}",
                str(p),
                f"{r['seconds']:.2f}",
                f"{r['pass']:.3f}",
                f"{r['passes']:.2f}",
                goal,
                f"{r['multiple']:.1f}",
                cpu_goal,
                f"{r['gap']:.0e}",
                f"{r['memory_percent']:.0f} %",
            ]
        )
        print(rows[-1], file=sys.stderr)
    head = [
        "criterion",
        "candidates",
        "parameters",
        "CPU s",
        "one pass, CPU s",
        "full passes",
        "goal, passes",
        "CPU in passes",
        "goal, CPU in passes",
        "1 - certified",
        "memory beyond the rows",
    ]
    return table(head, rows)


def large_text(quick: bool) -> str:
    """1e7 candidates from a generator, made anew in each pass."""
    count = 1_000_000 if quick else 10_000_000
    r = run("made", count, 9)
    measured = (
        f"{r['seconds']:.1f}",
        f"{r['wall']:.1f}",
        f"{r['passes']:.2f}",
        f"{r['gap']:.0e}",
        f"{r['memory']:.0f}",
    )
    head = ("criterion", "candidates", "parameters", "CPU s", "clock s", "passes", "1 - certified", "peak memory, MB")
    return table(head, [("D", f"{count:.0e}", "9", *measured)])


def exact_table(quick: bool) -> str:
    goals = {9: {6: 0.957, 12: 0.988, 24: 0.997, 48: 0.999}, 32: {12: 0.75, 24: 0.94, 48: 0.98, 100: 0.996}}
    rows = []
    for p, wanted in goals.items():
        result = run("exact", p, list(wanted), 10_000 if quick else 100_000)
        rows += [
            [str(p), str(n), f"{result[str(n)]['efficiency']:.4f}", f"{goal}", f"{result[str(n)]['seconds']:.2f}"]
            for n, goal in wanted.items()
        ]
    return table(["parameters", "poses", "efficiency of the bound", "goal", "CPU s, 30 starts"], rows)


def reference_table(quick: bool) -> str:
    rows = []
    for solver, count, p in [("CLARABEL", 1000, 9), ("CLARABEL", 1000, 32), ("SCS", 1000, 9), ("SCS", 10_000, 9)]:
        if quick and count > 1000:
            continue
        r = run("reference", count, p, solver)
        rows.append(
            [
                f"cvxpy, {solver}",
                f"{count:.0e}",
                str(p),
                f"{r['theirs']:.2f}",
                f"{r['their_gap']:.0e}",
                f"{r['ours']:.3f}",
                f"{r['theirs'] / r['ours']:.0f}",
            ]
        )
    return table(["solver", "candidates", "parameters", "CPU s", "1 - certified", "ours, CPU s", "ratio"], rows)


def figaroh_table(quick: bool) -> str:
    rows = []
    for count in (100, 250) if quick else (100, 250, 500, 1000):
        r = run("against_figaroh", count)
        if "skipped" in r:
            return f"FIGAROH is not compared here: {r['skipped']}."
        theirs = r["optimum"]["cpu_s"]
        rows.append(
            [
                str(count),
                f"{r['regressor']['cpu_s']:.2f}",
                f"{theirs:.2f}",
                f"{r['memory_MB']:.0f}",
                f"{r['their_efficiency']:.6f}",
                str(r["chosen"]),
                f"{r['ours']:.4f}",
                f"{r['our_memory']:.0f}",
                str(r["support"]),
                f"{theirs / r['ours']:.0f}",
            ]
        )
    head = [
        "candidates",
        "FIGAROH: rows, CPU s",
        "optimum, CPU s",
        "memory, MB",
        "D-efficiency",
        "kept",
        "ours: optimum, CPU s",
        "memory, MB",
        "kept",
        "ratio",
    ]
    return table(head, rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a tenth of the size, one run")
    parser.add_argument("--write", action="store_true", help="write docs/results.md")
    parser.add_argument("--job", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.job:
        name, *arguments = json.loads(given.job)
        print(json.dumps(JOBS[name](*arguments)))
        return
    seconds = run("kernel", 100_000 if given.quick else 1_000_000)["seconds"]
    size = "1e5" if given.quick else "1e6"
    parts = [
        "### Relaxed designs",
        relaxed_table(given.quick),
        "### Ten million candidates",
        large_text(given.quick),
        f"Rows of {size} candidates with 20 parameters, geometry included: {seconds:.2f} s CPU (goal for 1e6: 4 s).",
        "### Exact plans",
        exact_table(given.quick),
        "### Against cvxpy",
        reference_table(given.quick),
        "### Against FIGAROH 1.0.2",
        figaroh_table(given.quick),
    ]
    show("design", "\n\n".join(parts), given.write, given.quick)


if __name__ == "__main__":
    main()
