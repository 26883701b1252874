"""The relaxed design of a problem, certified over all its candidates: by column generation, or by cvxpy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from qsframework.errors import InputError, NotCertified
from qsframework.information import Allowed, bound_of
from qsframework.information.rows import CandidateRows, ScaledRows, gathered_information
from qsframework.plans.column_generation import Relaxed, solve_columns
from qsframework.plans.criteria import Mean
from qsframework.plans.options import DesignOptions
from qsframework.plans.problem import DesignProblem, allowed_designs
from qsframework.plans.relaxed import optimum
from qsframework.plans.scoreboard import Scoreboard
from qsframework.plans.task import make_task
from qsframework.plugin import Array

MOST_FOR_CVXPY = 5000
_AIM = 1.0 - 1e-6


def relaxed_design(
    problem: DesignProblem, rule: Mean, options: DesignOptions, seed: int, tell: Callable[[float], None]
) -> tuple[Relaxed, tuple[int | None, ...]]:
    """The relaxed design, and how many poses each load gets where that is fixed.

    A load whose share falls below what it needs at least is fixed there and the rest is solved again;
    the bound then allows every design that keeps the minimum.
    """
    fixed = problem.counts
    while True:
        allowed = allowed_designs(problem, fixed, _cap(problem, options))
        relaxed = _solve(problem, rule, options, allowed, seed, tell)
        share = shares(problem, relaxed) * problem.total / problem.prices
        short = [g for g, m in enumerate(problem.least) if fixed[g] is None and m and share[g] < m - 1e-6]
        if not short:
            break
        fixed = tuple(problem.least[g] if g in short else c for g, c in enumerate(fixed))
    bound = min(relaxed.efficiency, _free_bound(problem, relaxed, fixed, options))
    if bound < options.efficiency:
        raise NotCertified(
            f"the relaxed design is certified for an efficiency of {bound:.6f}, asked for {options.efficiency:g}"
        )
    return replace(relaxed, efficiency=bound), fixed


def shares(problem: DesignProblem, relaxed: Relaxed) -> Array:
    """Weight (loads,) that a relaxed design gives to each load."""
    total = np.bincount(problem.load(relaxed.index), relaxed.weights, len(problem.loads))
    return np.asarray(total, dtype=np.float64)


def _cap(problem: DesignProblem, options: DesignOptions) -> float:
    """The largest weight of a candidate: 1 / n where it may be measured once only."""
    return np.inf if options.repeats or options.budget is not None else 1.0 / problem.total


def _priced(problem: DesignProblem) -> CandidateRows:
    """Rows per unit of cost where there is a budget, else as they are."""
    if not problem.priced:
        return problem.rows
    return ScaledRows(problem.rows, 1.0 / np.sqrt(problem.prices[problem.load(np.arange(len(problem.rows)))]))


def _free_bound(
    problem: DesignProblem, relaxed: Relaxed, fixed: tuple[int | None, ...], options: DesignOptions
) -> float:
    """The bound over designs that give each load at least its minimum, where a minimum was made a number."""
    if fixed == problem.counts:
        return 1.0
    total = problem.total
    slope, values = relaxed.expansion.slope, relaxed.scores
    best = float((problem.prior / total * slope).sum())
    cap = min(_cap(problem, options), 1.0)
    room, rest = np.full(len(values), cap), 1.0
    for g, count in enumerate(problem.counts):
        mine = problem.members(g)
        need = (count if count is not None else problem.least[g]) * float(problem.prices[g]) / total
        left = room[mine]
        best += _fill(values[mine], left, need)
        room[mine] = 0.0 if count is not None else left
        rest -= need
    best += _fill(values, room, rest)
    return min(1.0 / best, 1.0)


def _fill(values: Array, room: Array, need: float) -> float:
    """Largest sum of w_i values_i with sum of w = need and w <= room; the room that it takes is gone afterwards."""
    total = 0.0
    for i in np.argsort(-values):
        if need <= 1e-12:
            break
        taken = min(need, float(room[i]))
        total, need = total + taken * float(values[i]), need - taken
        room[i] -= taken
    return total


def _solve(
    problem: DesignProblem,
    rule: Mean,
    options: DesignOptions,
    allowed: Allowed,
    seed: int,
    tell: Callable[[float], None],
) -> Relaxed:
    trouble = allowed.problems(len(problem.rows))
    if trouble:
        raise InputError(f"too few candidates: {trouble}; allow repeats or take more candidates")
    prior = problem.prior / problem.total
    if options.solver == "cvxpy":
        if problem.priced:
            raise InputError("a budget with costs needs the solver columns")
        return _by_cvxpy(problem, rule, allowed, prior)
    task = make_task(_priced(problem), rule, allowed, prior if prior.any() else None)
    rng = np.random.default_rng(seed)
    try:
        return solve_columns(task, rng, max(_AIM, options.efficiency), tell)
    except NotCertified:
        return solve_columns(task, rng, options.efficiency, tell)


def _by_cvxpy(problem: DesignProblem, rule: Mean, allowed: Allowed, prior: Array) -> Relaxed:
    """The reference: the convex programme as it is written, and its certificate over all candidates."""
    if len(problem.rows) > MOST_FOR_CVXPY:
        raise InputError(f"cvxpy takes up to {MOST_FOR_CVXPY} candidates, here are {len(problem.rows)}")
    rows = problem.rows.take(np.arange(len(problem.rows)))
    weights, expansion = optimum(rows, rule, allowed, prior if prior.any() else None)
    index = np.flatnonzero(weights)
    board = Scoreboard(problem.rows)
    slope = expansion.slope
    return Relaxed(
        index=index,
        weights=weights[index],
        information=prior + gathered_information(problem.rows, index, weights[index]),
        expansion=expansion,
        efficiency=bound_of(board.exact(slope), allowed, prior=float((prior * slope).sum())),
        board=board,
        slope=slope,
        passes=1.0,
    )
