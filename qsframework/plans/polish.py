"""Continuous polish: the angles of a plan's poses move inside the constraints until the criterion stops falling."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from qsframework.experiment import Experiment
from qsframework.information.rows import block_scores, root
from qsframework.plans.candidates import check_poses, joint_range, snapped
from qsframework.plans.criteria import Mean
from qsframework.plans.interior import moments_of
from qsframework.plans.problem import DesignProblem
from qsframework.plugin import Array, Indices

_STEP = 1e-5
_SIZES = np.array([0.3, 0.1, 0.03, 0.01, 0.003, 0.001])
_ROUNDS = 40
_DIGITS = (2, 3, 4, 6)
Progress = Callable[[int, int], None]


def polish(
    problem: DesignProblem, rule: Mean, chosen: Indices, counts: Indices, progress: Progress | None = None
) -> Array:
    """What the pendant shows (m, n) at m poses, measured `counts` times, rounded to 0.01 deg or mm, not worse.

    Every pose climbs along its own slope of the criterion; the longest step that helps and keeps the
    constraints is taken.
    """
    pendant = problem.pendant[problem.place(chosen)]
    moments = _moments(problem, pendant, chosen)
    value = start = _value(problem, rule, moments, counts)
    for turn in range(_ROUNDS):
        moved = _moved(problem, rule, pendant, chosen, counts, moments, value)
        if progress is not None:
            progress(turn + 1, _ROUNDS)
        if moved is None:
            break
        new = _value(problem, rule, moved[1], counts)
        if new > value * (1.0 - 1e-5):
            break
        (pendant, moments), value = moved, new
    round_ = rounded(problem.experiment, pendant)
    better = _value(problem, rule, _moments(problem, round_, chosen), counts) <= start
    return round_ if better else pendant


def rounded(experiment: Experiment, pendant: Array) -> Array:
    """Poses (m, n) in hundredths of a degree or a millimetre, in finer steps where one would leave the constraints."""
    lower, upper = joint_range(experiment)
    units = experiment.robot.controller.units
    out = pendant.copy()
    open_ = np.ones(len(out), dtype=bool)
    for digits in _DIGITS:
        trial = np.clip(units.si(np.round(units.shown(pendant), digits)), lower, upper)
        good = open_ & _kept(experiment, trial)
        out[good] = trial[good]
        open_ &= ~good
    return out


def _scales(problem: DesignProblem) -> Array:
    """What (n,) counts as one step of a joint: 1 rad, and of a travel its range in place of half a turn."""
    lower, upper = joint_range(problem.experiment)
    return np.where(problem.experiment.robot.controller.units.sliding, (upper - lower) / np.pi, 1.0)


def _moments(problem: DesignProblem, pendant: Array, chosen: Indices) -> Array:
    """Information M_i (m, S, P, P) of each pose, read as the candidates are."""
    return moments_of(problem.rows_at(pendant, chosen))


def _value(problem: DesignProblem, rule: Mean, moments: Array, counts: Indices) -> float:
    return float(rule.value(problem.prior + np.tensordot(counts, moments, 1)))


def _kept(experiment: Experiment, pendant: Array) -> Array:
    checks = check_poses(experiment, experiment.model(), pendant)
    same = np.abs(snapped(experiment, pendant) - pendant).max(axis=1) < 1e-9
    return np.logical_and.reduce([*checks.values(), same])


def _moved(
    problem: DesignProblem,
    rule: Mean,
    pendant: Array,
    chosen: Indices,
    counts: Indices,
    M_each: Array,
    value: float,
) -> tuple[Array, Array] | None:
    """One pose after the other a step along its slope, each step tried against the present plan.

    The new angles with the information M_i (m, S, p, p) of each pose; M_each: that of the poses as they are.
    """
    lower, upper = joint_range(problem.experiment)
    count, n = pendant.shape
    M = problem.prior + np.tensordot(counts, M_each, 1)
    roots = [root(G) for G in rule.expansion(M).slope]
    scales, units = _scales(problem), problem.experiment.robot.controller.units
    shifted = pendant[:, None, None] + _STEP * scales * np.stack([np.eye(n), -np.eye(n)], axis=1)[None]
    rows = problem.rows_at(shifted.reshape(-1, n), np.repeat(chosen, 2 * n))
    ends = block_scores(rows, roots).reshape(count, n, 2)
    slope = (ends[..., 0] - ends[..., 1]) / (2.0 * _STEP)
    fixed = [problem.experiment.robot.facts.joint_index(j) for j in problem.experiment.constraints.joint_values]
    slope[:, fixed] = 0.0
    slope /= np.maximum(np.abs(slope).max(axis=1, keepdims=True), 1e-300)
    moved = pendant[:, None] + _SIZES[:, None] * scales * slope[:, None]
    trials = np.clip(units.si(np.round(units.shown(moved), _DIGITS[0])), lower, upper)
    flat = trials.reshape(-1, n)
    kept = _kept(problem.experiment, flat).reshape(count, -1)
    moments = _moments(problem, flat, np.repeat(chosen, len(_SIZES))).reshape(count, len(_SIZES), *M.shape)
    out, M_out, changed = pendant.copy(), M_each.copy(), False
    for i in range(count):
        values = np.atleast_1d(rule.value(M + counts[i] * (moments[i] - M_each[i])))
        values = np.where(kept[i], values, np.inf)
        best = int(np.argmin(values))
        if values[best] < value * (1.0 - 1e-7):
            M = M + counts[i] * (moments[i, best] - M_each[i])
            out[i], M_out[i], value, changed = trials[i, best], moments[i, best], float(values[best]), True
    return (out, M_out) if changed else None
