"""Coverage of the confidence intervals by simulated campaigns, for docs/results.md (some minutes on two cores).

python benchmarks/make_statistics.py [--campaigns 4000] [--jobs 2] [--write]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from common import PAGE, replace_between, shelved, table
from scipy.stats import t
from statistics_methods import table as methods_table

from qsframework.estimation import FitOptions, Independent, Observations, shared_error, solve
from qsframework.experiment import Experiment, Readings, example, load_experiment, make_rows, observation_model
from qsframework.experiment.simulate import displaced
from qsframework.plugin import Array, Indices, Poses
from qsframework.work import Work, run as run_tasks

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
    """16 poses over the whole range, or within 3 deg of one posture whose axes 4 and 6 are nearly one line; or 8 under
    three loads of one direction each.
    """
    controller = experiment.robot.controller
    rng = np.random.default_rng(SEED)
    span = 0.75 * (controller.upper - controller.lower) / 2.0
    centre = (controller.upper + controller.lower) / 2.0
    if plan == "ill":
        span, centre = np.deg2rad([3.0, 3.0, 3.0, 3.0, 0.5, 3.0]), np.deg2rad([20.0, 30.0, -20.0, 40.0, -1.0, 30.0])
    count = 16 if loads == 1 else 8
    pendant = np.repeat(centre + span * rng.uniform(-1.0, 1.0, (count, 6)), loads, axis=0)
    kinds = np.array([[0, 1500.0, -4000.0, 0, 0, 0]]) * np.array([[1.0], [0.8], [0.6]])
    return Poses(pendant, controller.to_joints(pendant), np.tile(kinds[:loads], (count, 1)))


def blank(experiment: Experiment, case: Case) -> Readings:
    """The campaign's readings without values."""
    p = poses(experiment, case.plan, case.loads)
    N, K = len(p), len(experiment.markers)
    made = displaced(p, np.zeros((N, K, 3)), SIGMA, [f"p{m}" for m in range(N)])
    return replace(made, minus=N + case.loads * (made.plus // case.loads))  # the loads of a pose share its first one


def setting(case: Case) -> tuple[Experiment, Readings, Observations, Array, Array]:
    """Experiment, readings, what is fitted (without bounds), truth, exact values."""
    experiment = load_experiment(example("m900ib") / "experiment.yaml")
    readings = blank(experiment, case)
    names = experiment.fit_names()
    model = experiment.model()
    truth = model.nominal[model.index(names)]
    seen = observation_model(experiment, readings, names, linear=True)
    observations = seen.observations()
    exact = observations.predict(truth)
    predict, jacobian = (_remembered(f) for f in (observations.predict, observations.jacobian))
    observations = replace(observations, predict=predict, jacobian=jacobian)
    if case.nominal == 1.0:  # the model bends by 1e-5 only: its slope at the truth stands for it, and is quick
        A = observations.jacobian(truth)
        observations = replace(observations, predict=lambda x: exact + A @ (x - truth), jacobian=lambda x: A)
    parameters = tuple(replace(p, nominal=case.nominal * p.nominal, lower=-np.inf) for p in observations.parameters)
    noise = seen.rows.noise if case.covariance else Independent(seen.rows.flat(seen.rows.sigma))
    return experiment, readings, replace(observations, parameters=parameters, noise=noise), truth, exact


def _remembered(function: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """The function with its last values: all campaigns start at the same point, and a fit comes back to its end."""

    @lru_cache(maxsize=64)
    def at(x: bytes) -> Array:
        value = function(np.frombuffer(x))
        value.flags.writeable = False
        return value

    return lambda x: at(np.ascontiguousarray(x, dtype=float).tobytes())


def condition(case: Case) -> float:
    """Condition number of the columns, whitened and scaled by the true values."""
    _, _, observations, truth, _ = setting(case)
    return float(np.linalg.cond(observations.noise.whiten(observations.jacobian(truth)) * truth))


def errors(case: Case, readings: Readings, rng: np.random.Generator) -> Array:
    """Errors (m,) of one campaign, m."""
    K = 1 + int(readings.marker.max())
    N = len(readings) // K
    if case.loads > 1:
        u = rng.standard_normal((N // case.loads, 1, K, 3))
        e = (rng.standard_normal((N // case.loads, case.loads, K, 3)) - u) / np.sqrt(2.0)
    else:
        e = rng.standard_normal((N, K, 3)) + case.within * rng.standard_normal((N, 1, 3))
    return SIGMA * e.ravel()


def campaigns(case: Case, count: int, start: int = 0, level: float = 0.95) -> tuple[Array, Array]:
    """Whether each interval covers the truth (count, p), and its sd relative to the truth (p,) in the last campaign."""
    _, readings, observations, truth, exact = setting(case)
    label = make_rows(readings).label
    inside = np.zeros((count, len(truth)), dtype=bool)
    sd = np.zeros(len(truth))
    drawn = [errors(case, readings, np.random.default_rng([SEED, CASES.index(case), start + c])) for c in range(count)]
    quick = _straight(case, observations, truth, np.stack(drawn, axis=1)) if _is_straight(case) else None
    for c in range(count):
        given = replace(observations, measured=exact + drawn[c])
        if quick is None or c == 0:
            x, sd, dof = fitted(given, case, label)
        if quick is not None:  # a linear fit of all campaigns in one product; the solver's own answer stands beside it
            assert c or (np.allclose(quick[0][0], x, rtol=1e-6) and np.allclose(quick[1][0], sd, rtol=1e-6))
            x, sd = quick[0][c], quick[1][c]
        inside[c] = np.abs(x - truth) <= t.ppf(0.5 + level / 2.0, dof) * sd
    return inside, sd / truth


def _is_straight(case: Case) -> bool:
    """Whether the fit is one of weighted linear least squares."""
    return case.nominal == 1.0 and not (case.within and case.modelled)


def _straight(case: Case, observations: Observations, truth: Array, drawn: Array) -> tuple[Array, Array]:
    """Estimates and sds (count, p) of all campaigns from errors (m, count)."""
    A = observations.noise.whiten(observations.jacobian(truth)) * truth
    Q, R = np.linalg.qr(A)
    white = observations.noise.whiten(drawn)
    inverse = np.linalg.inv(R)
    x = truth * (1.0 + (inverse @ (Q.T @ white)).T)
    m, p = A.shape
    left = np.square(white).sum(axis=0) - np.square(Q.T @ white).sum(axis=0)
    unit = np.sqrt(left / (m - p)) if case.estimated else np.ones(drawn.shape[1])
    return x, unit[:, None] * truth * np.sqrt(np.square(inverse).sum(axis=1))


def fitted(given: Observations, case: Case, label: Indices) -> tuple[Array, Array, float]:
    """Estimates, their sds, and the degrees of freedom behind these."""
    solution = solve(given, FitOptions(starts=0))
    m, p = solution.jacobian.shape
    if case.within and case.modelled:
        residuals = given.measured - given.predict(solution.x)
        shared = shared_error(residuals, given.jacobian(solution.x), np.full(m, SIGMA), label, stated=False)
        again = solve(replace(given, noise=shared.noise), start=solution.x)
        free = len(np.unique(label)) - p  # what the shared error is told from: one number for each pose and axis
        return again.x, shared.unit * np.sqrt(np.diag(again.covariance)), free
    unit = float(np.sqrt(2.0 * solution.cost / (m - p))) if case.estimated else 1.0
    return solution.x, unit * np.sqrt(np.diag(solution.covariance)), (m - p) if case.estimated else np.inf


def _part(level: float, part: tuple[int, int, int]) -> tuple[Array, Array]:
    case, start, count = part
    return campaigns(CASES[case], count, start, level)


def run(count: int, work: Work) -> list[tuple[Case, Array, Array]]:
    """All cases: coverage (p,) and relative sd (p,)."""
    jobs = [(i, s, min(500, count - s)) for i in range(len(CASES)) for s in range(0, count, 500)]
    results = list(run_tasks(_part, 0.95, jobs, work))
    out = []
    for i, case in enumerate(CASES):
        mine = [r for job, r in zip(jobs, results, strict=True) if job[0] == i]
        out.append((case, np.concatenate([inside for inside, _ in mine]).mean(axis=0), mine[0][1]))
    return out


def _short(value: float) -> str:
    """Two digits, without a power of ten."""
    return f"{float(f'{value:.2g}'):g}"


def record(count: int, results: list[tuple[Case, Array, Array]], methods: str) -> str:
    """Both tables as Markdown, and how they were made."""
    rows = []
    for case, inside, sd in results:
        c = 100 * inside
        shares = (f"{c.mean():.1f}", f"{c.min():.1f}", f"{c.max():.1f}")
        rows.append(
            (case.name, f"{condition(case):,.0f}", *shares, f"{_short(100 * sd.min())} to {_short(100 * sd.max())}")
        )
    head = ("campaign", "condition", "coverage, mean", "smallest", "largest", "sd of the parameters, %")
    made = f"`python benchmarks/make_statistics.py`, {DATE}, {count:,} campaigns, seed {SEED}."
    return "\n\n".join([made, "### Coverage", table(head, rows), "### Two steps", methods])


def main() -> None:
    """Simulate, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=4000)
    parser.add_argument("--jobs", type=int, default=2, help="processes; 0: one per core")
    parser.add_argument("--write", action="store_true", help="write docs/results.md and its tables")
    chosen = parser.parse_args()
    results = run(chosen.campaigns, Work(chosen.jobs))
    text = record(chosen.campaigns, results, methods_table(chosen.campaigns, SEED))
    print(text)
    if chosen.write:
        marks = "<!-- uncertainties -->", "<!-- end of uncertainties -->"
        replace_between(PAGE, *marks, shelved(text, "uncertainties"))


if __name__ == "__main__":
    main()
