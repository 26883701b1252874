"""Scores that are bounded instead of computed: never too low, exact where they count, and few."""

from __future__ import annotations

import numpy as np
import pytest

from qsframework.information import Allowed, as_rows, everything, scores
from qsframework.plans.column_generation import solve_columns
from qsframework.plans.criteria import Determinant, Mean
from qsframework.plans.scoreboard import Scoreboard
from qsframework.plans.task import make_task
from qsframework.plugin import Array


def near(slope: Array, far: float, seed: int) -> Array:
    """Another positive definite slope (S, p, p), not more than a few times `far` away."""
    rng = np.random.default_rng(seed)
    move = np.eye(slope.shape[-1]) + far * rng.normal(size=slope.shape)
    return np.swapaxes(move, -1, -2) @ slope @ move


@pytest.mark.parametrize("scenarios", [1, 2])
def test_bounds_are_never_too_low_and_exact_where_they_count(scenarios: int) -> None:
    rng = np.random.default_rng(scenarios)
    rows = as_rows(rng.normal(size=(3000, scenarios, 2, 4)) * rng.uniform(0.1, 1.0, (3000, 1, 1, 1)))
    T = np.asarray(np.linalg.inv(np.triu(rng.uniform(0.5, 1.5, (4, 4)))), dtype=np.float64)
    board = Scoreboard(rows, T)
    slope = near(np.stack([np.eye(4)] * scenarios), 0.1, 0)
    assert np.array_equal(board.exact(slope), scores(rows, slope, basis=T))
    for turn in range(1, 5):
        other = near(slope, 0.05, turn)
        true = scores(rows, other, basis=T)
        level = float(np.quantile(true, 0.95)) * np.where(np.arange(3000) % 2, 1.0, 1.1)
        bounds = board.bounds(other, level)
        counts = bounds >= level
        assert np.allclose(bounds[counts], true[counts], rtol=1e-12)
        assert (bounds >= true * (1.0 - 1e-12)).all()
        assert np.array_equal(counts, true >= level)
    assert 1.0 < board.passes < 2.0


def test_a_slope_that_the_last_one_does_not_bound_is_a_full_pass() -> None:
    rows = as_rows(np.random.default_rng(3).normal(size=(500, 1, 2, 3)))
    board = Scoreboard(rows)
    board.exact(np.diag([1.0, 1.0, 0.0])[None])
    slope = np.eye(3)[None]
    assert np.array_equal(board.bounds(slope, 1e9), scores(rows, slope))
    assert board.passes == 2.0


@pytest.mark.parametrize("groups", [1, 2])
def test_one_pass_and_a_part_certify_what_a_second_pass_does(groups: int) -> None:
    rows = as_rows(np.random.default_rng(4).normal(size=(50_000, 1, 3, 5)))
    halves = Allowed((slice(0, 25_000), slice(25_000, 50_000)), (0.3, 0.7))
    allowed = everything(50_000) if groups == 1 else halves
    task = make_task(rows, Mean(Determinant()), allowed)
    best = solve_columns(task, np.random.default_rng(1))
    assert best.passes < 1.6
    true = scores(rows, np.asarray(np.linalg.inv(best.information) / 5.0, dtype=np.float64))
    assert np.allclose(best.scores, true, rtol=1e-9)
    assert best.efficiency == pytest.approx(1.0 / allowed.best(true), abs=1e-9)
