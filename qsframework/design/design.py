"""`design`: the poses that pin the parameters down best, with a proof of how close to the best they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.design.candidates import Candidates, generate_candidates
from qsframework.design.criteria import Criterion, find_criterion
from qsframework.design.exact import Quotas, exchange
from qsframework.design.relaxed import relax
from qsframework.errors import InputError, NotIdentifiable
from qsframework.experiment import Certificate, Experiment, LoadCase, Plan, make_plan
from qsframework.information import (
    Allowed,
    efficiency_bound,
    information_rows,
    rank_test,
    weighted_information,
)
from qsframework.plugin import Array, Indices, Poses

STARTS = 20
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class Problem:
    """N (pose, load) candidates of one design: whitened scaled rows (N, 3 K, p) and the groups by load."""

    poses: Poses
    rows: Array
    place: Indices
    load: Indices
    loads: tuple[LoadCase, ...]
    counts: tuple[int, ...]

    @property
    def groups(self) -> tuple[Indices, ...]:
        return tuple(np.flatnonzero(self.load == g) for g in range(len(self.loads)))

    def allowed(self) -> Allowed:
        total = sum(self.counts)
        return Allowed(self.groups, tuple(count / total for count in self.counts))


def design(
    experiment: Experiment,
    poses: int,
    criterion: str = "A",
    candidates: int = 1000,
    seed: int = 0,
    repeats: bool = False,
    progress: Progress | None = None,
) -> Plan:
    """A plan of `poses` poses, certified against the best relaxed design over the same candidates.

    InputError where the experiment cannot give a plan; NotIdentifiable, before any optimisation,
    where its loads cannot tell the parameters apart.
    """
    rule = find_criterion(criterion)
    tell = progress or (lambda *_: None)
    found = generate_candidates(experiment, candidates, seed, lambda i, n: tell("candidate poses", i, n))
    problem = make_problem(experiment, found, poses)
    _require_rank(problem, experiment.fit_names())
    tell("relaxed design (cvxpy)", 0, 1)
    weights, _ = relax(problem.rows, rule, problem.allowed())
    tell("relaxed design (cvxpy)", 1, 1)
    quotas = Quotas(problem.groups, problem.counts, problem.place, repeats)
    rng = np.random.default_rng(seed)
    chosen = exchange(
        problem.rows, rule, quotas, weights, STARTS, rng, lambda i, n: tell("exact plan (exchange)", i, n)
    )
    return _plan(experiment, problem, rule, weights, chosen, seed)


def make_problem(experiment: Experiment, candidates: Candidates, poses: int) -> Problem:
    """Every allowed pose under every load case is a candidate of its own."""
    if not experiment.loads:
        raise InputError(f"{experiment.path}: a design needs `loads`, for example - {{name: weight, fz_N: -4000}}")
    sigma = experiment.noise.sigma
    if sigma is None:
        raise InputError(f"{experiment.path}: a design needs the noise, for example noise: {{sigma_mm: 0.03}}")
    counts = _counts(experiment.loads, poses)
    count, cases = len(candidates), len(experiment.loads)
    pendant = np.tile(candidates.pendant, (cases, 1))
    wrench = np.repeat(np.stack([load.wrench for load in experiment.loads]), count, axis=0)
    batch = Poses(pendant, experiment.robot.controller.to_joints(pendant), wrench)
    model = experiment.model()
    rows = information_rows(model, batch, experiment.fit_names(), sigma)
    return Problem(
        batch, rows, np.tile(np.arange(count), cases), np.repeat(np.arange(cases), count), experiment.loads, counts
    )


def _counts(loads: Sequence[LoadCase], poses: int) -> tuple[int, ...]:
    stated = sum(load.poses or 0 for load in loads)
    open_cases = sum(load.poses is None for load in loads)
    if stated > poses or (open_cases == 0 and stated != poses):
        raise InputError(f"the loads ask for {stated} poses in all, the plan has {poses}")
    return tuple(poses - stated if load.poses is None else load.poses for load in loads)


def _require_rank(problem: Problem, names: Sequence[str]) -> None:
    used = np.isin(problem.load, [g for g, count in enumerate(problem.counts) if count])
    test = rank_test(problem.rows[used].reshape(-1, len(names)), names)
    if not test.full:
        raise NotIdentifiable(f"no plan with these loads can tell the parameters: {test.words()}")


def _plan(
    experiment: Experiment, problem: Problem, rule: Criterion, weights: Array, chosen: Indices, seed: int
) -> Plan:
    """Put the chosen candidates, merged into repeats, and the certificate into a Plan."""
    count = len(chosen)
    value = float(rule.value(weighted_information(problem.rows, np.bincount(chosen, minlength=len(problem.rows)))))
    M = weighted_information(problem.rows, weights)
    relaxed_value = float(rule.value(M)) / count
    bound = efficiency_bound(float(rule.value(M)), rule.gradient(M), problem.rows, problem.allowed())
    certificate = Certificate(
        criterion=rule.name,
        value=value,
        relaxed_value=relaxed_value,
        relaxed_efficiency=bound,
        efficiency=bound * relaxed_value / value,
        candidates=len(problem.rows),
        poses=count,
        parameters=experiment.fit_names(),
    )
    picks, repeats = np.unique(chosen, return_counts=True)
    order = np.lexsort((*problem.poses.pendant[picks].T[::-1], problem.load[picks]))
    picks, repeats = picks[order], repeats[order]
    names = tuple(problem.loads[g].name for g in problem.load[picks])
    return make_plan(problem.poses.take(picks), names, repeats.tolist(), rule.name, certificate, seed)
