"""Coverage of the confidence intervals by simulated campaigns: writes docs/statistics.md (some minutes on two cores).

python docs/make_statistics.py [--campaigns 4000] [--output docs/statistics.md]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import t

from qsframework.experiment import Experiment, Readings, example, load_experiment
from qsframework.identify.identify import displacement_observations
from qsframework.identify.linear import fit_rows
from qsframework.identify.noise import pose_groups, readings_noise, shared_error
from qsframework.identify.observations import Independent, Observations
from qsframework.identify.solve import solve
from qsframework.information.two_step import step_two, stiffness_rows
from qsframework.plugin import Array, Indices, Poses

SEED = 20261121
DATE = "2026-11-21"
SIGMA = 0.03e-3


@dataclass(frozen=True)
class Case:
    """One line of the table; each flag is a way to spoil or to repair a campaign."""

    name: str
    plan: str = "well"
    estimated: bool = False
    nominal: float = 1.0
    loads: int = 1
    covariance: bool = True
    within: float = 0.0
    modelled: bool = True


CASES = (
    Case("well-conditioned plan, sigma stated"),
    Case("well-conditioned plan, sigma estimated", estimated=True),
    Case("ill-conditioned plan, sigma stated", plan="ill"),
    Case("ill-conditioned plan, sigma estimated", plan="ill", estimated=True),
    Case("nominal values 2 times too large, sigma estimated", nominal=2.0, estimated=True),
    Case("nominal values 2 times too small, ill-conditioned, sigma stated", plan="ill", nominal=0.5),
    Case("three loads on one unloaded reading, full covariance", loads=3),
    Case("three loads on one unloaded reading, covariance ignored", loads=3, covariance=False),
    Case("error within a pose as large as sigma, estimated by REML", within=1.0, estimated=True),
    Case("error within a pose as large as sigma, ignored", within=1.0, estimated=True, modelled=False),
)


def poses(experiment: Experiment, plan: str, loads: int) -> Poses:
    """16 poses over the whole range, or within 3 deg of one posture; or 8 under three loads of one direction each."""
    controller = experiment.robot.controller
    rng = np.random.default_rng(SEED)
    span = 0.75 * (controller.upper - controller.lower) / 2.0
    centre = (controller.upper + controller.lower) / 2.0
    if plan == "ill":
        span, centre = np.full(6, np.deg2rad(3.0)), np.deg2rad([20.0, 30.0, -20.0, 40.0, -50.0, 30.0])
    count = 16 if loads == 1 else 8
    pendant = np.repeat(centre + span * rng.uniform(-1.0, 1.0, (count, 6)), loads, axis=0)
    kinds = np.array([[0, 1500.0, -4000.0, 0, 0, 0]]) * np.array([[1.0], [0.8], [0.6]])
    return Poses(pendant, controller.to_joints(pendant), np.tile(kinds[:loads], (count, 1)))


def blank(experiment: Experiment, case: Case) -> Readings:
    """The campaign's readings without values."""
    p = poses(experiment, case.plan, case.loads)
    N, K = len(p), len(experiment.markers)
    reference = tuple(f"u{m // case.loads}" for m in range(N) for _ in range(K))
    return Readings(
        p, tuple(f"p{m}" for m in range(N)), np.ones(N, dtype=int), np.ones(N, dtype=int), np.repeat(np.arange(N), K),
        np.tile(np.arange(K), N), np.zeros((N * K, 3)), np.full(N * K, SIGMA), np.ones(N * K, dtype=bool),
        np.arange(2, 2 + N * K), None, None, reference if case.loads > 1 else None,
    )  # fmt: skip


def setting(case: Case) -> tuple[Experiment, Readings, Observations, Array, Array]:
    """Experiment, readings, what is fitted (without bounds), truth, exact values."""
    experiment = load_experiment(example("m900ib") / "experiment.yaml")
    readings = blank(experiment, case)
    names = experiment.fit_names()
    model = experiment.model()
    truth = model.nominal[model.index(names)]
    rows, _ = fit_rows(experiment, readings, len(names))
    observations = displacement_observations(model, readings, rows, names)
    exact = observations.predict(truth)
    if case.nominal == 1.0:  # the model bends by 1e-5 only: its slope at the truth stands for it, and is quick
        A = observations.jacobian(truth)
        observations = replace(observations, predict=lambda x: exact + A @ (x - truth), jacobian=lambda x: A)
    parameters = tuple(replace(p, nominal=case.nominal * p.nominal, lower=-np.inf) for p in observations.parameters)
    full = readings_noise(readings, rows.keep, rows.sigma)
    noise = full if case.covariance else Independent(np.repeat(rows.sigma, 3))
    return experiment, readings, replace(observations, parameters=parameters, noise=noise), truth, exact


def errors(case: Case, readings: Readings, rng: np.random.Generator) -> Array:
    """Errors (m,) of one campaign, m."""
    N, K = len(readings.poses), len(readings.use) // len(readings.poses)
    if case.loads > 1:
        u = rng.standard_normal((N // case.loads, 1, K, 3))
        e = (rng.standard_normal((N // case.loads, case.loads, K, 3)) - u) / np.sqrt(2.0)
    else:
        e = rng.standard_normal((N, K, 3)) + case.within * rng.standard_normal((N, 1, 3))
    return SIGMA * e.ravel()


def campaigns(case: Case, count: int, start: int = 0, level: float = 0.95) -> tuple[Array, Array]:
    """Whether each interval covers the truth (count, p), and its sd relative to the truth (p,) in the last campaign."""
    _, readings, observations, truth, exact = setting(case)
    label = pose_groups(readings, np.arange(len(readings.use)))
    inside = np.zeros((count, len(truth)), dtype=bool)
    sd = np.zeros(len(truth))
    for c in range(count):
        rng = np.random.default_rng([SEED, CASES.index(case), start + c])
        given = replace(observations, measured=exact + errors(case, readings, rng))
        x, sd, dof = fitted(given, case, label)
        inside[c] = np.abs(x - truth) <= t.ppf(0.5 + level / 2.0, dof) * sd
    return inside, sd / truth


def fitted(given: Observations, case: Case, label: Indices) -> tuple[Array, Array, float]:
    """Estimates, their sds, and the degrees of freedom behind these."""
    solution = solve(given, starts=0)
    m, p = solution.jacobian.shape
    if case.within and case.modelled:
        residuals = given.measured - given.predict(solution.x)
        shared = shared_error(residuals, given.jacobian(solution.x), np.full(m, SIGMA), label, stated=False)
        again = solve(replace(given, noise=shared.noise), start=solution.x, starts=0)
        free = len(np.unique(label)) - p  # what the shared error is told from: one number for each pose and axis
        return again.x, shared.unit * np.sqrt(np.diag(again.covariance)), free
    unit = float(np.sqrt(2.0 * solution.cost / (m - p))) if case.estimated else 1.0
    return solution.x, unit * np.sqrt(np.diag(solution.covariance)), (m - p) if case.estimated else np.inf


def mean_squares(count: int, angles: int) -> tuple[Array, Array]:
    """Two steps of joint 2's stiffness, weighted and not, over one step: mean squared errors (3,) of K2, Kc, s0 Kc.

    Aggregated stiffnesses at `angles` angles with the sds that horizontal and upright links give them (cos q2).
    """
    rng = np.random.default_rng([SEED, 99, angles])
    q = np.deg2rad(np.linspace(5.0, 125.0, angles))
    rows = stiffness_rows(q, 0.4722, 0.8609)
    truth = np.array([6.0e6, 3.0e6, 1.5e6])
    k = 1.0 / (rows @ truth)
    sd = 2e-3 * k.mean() / np.maximum(np.abs(np.cos(q)), 0.1)
    out = np.zeros((3, 3))
    for _ in range(count):
        seen = k + sd * rng.standard_normal(angles)
        one = _one_step(rows, truth, seen, sd)
        covariance = np.diag((sd / seen**2) ** 2)
        found = [one, step_two(rows, 1.0 / seen, covariance)[0], step_two(rows, 1.0 / seen, covariance, False)[0]]
        out += np.square(np.stack(found) - truth)
    out /= count
    return out[1] / out[0], out[2] / out[0]


def _one_step(rows: Array, start: Array, k: Array, sd: Array) -> Array:
    """Least squares of the compliances themselves, k = 1 / (rows x), by Gauss-Newton."""
    x = start.copy()
    for _ in range(20):
        K = rows @ x
        A = -(rows / K[:, None] ** 2) / sd[:, None] * start
        step = np.linalg.lstsq(A, (k - 1.0 / K) / sd, rcond=None)[0]
        x = x + step * start
        if np.abs(step).max() < 1e-12:
            break
    return x


def _part(arguments: tuple[int, int, int]) -> tuple[Array, Array]:
    case, start, count = arguments
    return campaigns(CASES[case], count, start)


def run(count: int, map_: Callable[..., object]) -> list[tuple[Case, Array, Array]]:
    """All cases: coverage (p,) and relative sd (p,)."""
    jobs = [(i, s, min(500, count - s)) for i in range(len(CASES)) for s in range(0, count, 500)]
    results = list(map_(_part, jobs))  # type: ignore[call-overload]
    out = []
    for i, case in enumerate(CASES):
        mine = [r for job, r in zip(jobs, results, strict=True) if job[0] == i]
        out.append((case, np.concatenate([inside for inside, _ in mine]).mean(axis=0), mine[0][1]))
    return out


def page(count: int, results: list[tuple[Case, Array, Array]], squares: dict[int, tuple[Array, Array]]) -> str:
    """The page's text."""
    text = (Path(__file__).parent / "statistics_text.txt").read_text()
    spread = 100 * np.sqrt(0.95 * 0.05 / count)
    table = ["| campaign | coverage, mean | smallest | largest | sd of the parameters, % |", "|---|---|---|---|---|"]
    for case, inside, sd in results:
        c = 100 * inside
        table.append(f"| {case.name} | {c.mean():.1f} | {c.min():.1f} | {c.max():.1f} | "
                     f"{100 * sd.min():.2g} to {100 * sd.max():.2g} |")  # fmt: skip
    mse = ["| distinct angles | weighted / one-step: K2, Kc, s0 Kc | unweighted / one-step |", "|---|---|---|"]
    for n, (weighted, plain) in squares.items():
        said = [", ".join(f"{v:.3f}" for v in values) for values in (weighted, plain)]
        mse.append(f"| {n} | {said[0]} | {said[1]} |")
    filled = {"COUNT": f"{count:,}", "SEED": str(SEED), "DATE": DATE, "SPREAD": f"{spread:.2f}",
              "TABLE": "\n".join(table), "SQUARES": "\n".join(mse)}  # fmt: skip
    for key, value in filled.items():
        text = text.replace(f"@{key}@", value)
    return text


def main() -> None:
    """Simulate, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=4000)
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "statistics.md")
    chosen = parser.parse_args()
    with ProcessPoolExecutor(2) as pool:
        results = run(chosen.campaigns, pool.map)
        squares: dict[int, tuple[Array, Array]] = dict(
            zip((3, 4, 6, 9), pool.map(mean_squares, [chosen.campaigns] * 4, (3, 4, 6, 9)), strict=True)
        )
    chosen.output.write_text(page(chosen.campaigns, results, squares))
    print(chosen.output.read_text())


if __name__ == "__main__":
    main()
