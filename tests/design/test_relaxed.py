"""Relaxed designs: every criterion against cvxpy, the certificate against what it bounds, deletion against support."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from qsframework.errors import NotCertified
from qsframework.information import (
    Allowed,
    MadeRows,
    as_rows,
    bound_of,
    everything,
    scores,
    weighted_information,
)
from qsframework.information.certificate import deletable
from qsframework.plans.column_generation import solve_columns
from qsframework.plans.criteria import Criterion, Determinant, Linear, Mean, Sum
from qsframework.plans.interior import Small, curvature
from qsframework.plans.relaxed import optimum
from qsframework.plans.task import make_task
from qsframework.plugin import Array

P = 4
RNG = np.random.default_rng(0)
ROWS = RNG.normal(size=(200, 3, P)) * np.array([1.0, 3.0, 0.1, 20.0])
SCENARIOS = np.stack([ROWS, ROWS * RNG.uniform(0.5, 1.5, (200, 1, 1)), ROWS * RNG.uniform(0.2, 1.5, (1, 1, P))], axis=1)
TWO = (np.arange(80), np.arange(80, 200))
PRIOR = np.diag([0.1, 1.0, 0.01, 3.0])[None]
EVERY: dict[str, Criterion] = {
    "D": Determinant(),
    "A": Linear(),
    "O3": Sum(((0.5, Linear()), (0.5, Determinant()))),
    "Ds": Determinant("Ds", directions=np.eye(P)[:, [0, 2]]),
    "L": Linear("L", weight=np.diag([1.0, 0.0, 1.0, 0.0])),
    "c": Linear("c", weight=np.outer([1.0, -2.0, 0.5, 3.0], [1.0, -2.0, 0.5, 3.0])),
}
CASES = {
    "all": (everything(200), None, ROWS[:, None]),
    "groups": (Allowed(TWO, (0.3, 0.7)), None, ROWS[:, None]),
    "prior": (Allowed(TWO, (0.3, 0.7)), PRIOR, ROWS[:, None]),
    "cap": (Allowed(TWO, (0.3, 0.7), 1 / 50), None, ROWS[:, None]),
    "mean": (everything(200), None, SCENARIOS),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("name", EVERY)
def test_column_generation_agrees_with_cvxpy(name: str, case: str) -> None:
    """Same optimum from two unrelated solvers, and the certificate holds what it says."""
    allowed, prior, rows = CASES[case]
    rule = Mean(EVERY[name])
    result = solve_columns(make_task(as_rows(rows), rule, allowed, prior), np.random.default_rng(0), 1 - 1e-5)
    before = np.zeros(result.information.shape) if prior is None else prior
    weights = optimum(rows[:, None] if rows.ndim == 3 else rows, rule, allowed, prior)[0]
    theirs = float(rule.value(before + weighted_information(rows, weights)))
    ours = float(rule.value(result.information))
    assert ours <= theirs * (1.0 + 1e-5)
    assert ours * result.efficiency <= theirs * (1.0 + 1e-9), "the bound is above what another design reaches"
    spread = result.spread(200)
    assert np.allclose(before + weighted_information(rows, spread), result.information)
    for members, share in zip(allowed.groups, allowed.shares, strict=True):
        assert np.isclose(spread[members].sum(), share)
    assert spread.min() >= 0.0
    assert spread.max() <= min(allowed.cap, 1.0) + 1e-9


def cone_form(rows: Array, weight: Array) -> Array:
    """Elfving's form, by cones: min sum |H_i|_F with sum A_i' H_i = K, W = K K'; weights proportional to |H_i|_F."""
    import cvxpy as cp

    count, k, p = rows.shape
    size = np.linalg.norm(rows, axis=(0, 1))
    values, vectors = np.linalg.eigh(weight / np.outer(size, size))
    kept = values > 1e-14 * values[-1]
    K = vectors[:, kept] * np.sqrt(values[kept])
    H = cp.Variable((count * k, K.shape[1]))
    norms = cp.hstack([cp.norm(H[i * k : (i + 1) * k], "fro") for i in range(count)])
    whole = [K / np.abs(K).max() == (rows / size).reshape(-1, p).T @ H]
    cp.Problem(cp.Minimize(cp.sum(norms)), whole).solve(solver="CLARABEL")
    weights = np.linalg.norm(np.asarray(H.value).reshape(count, -1), axis=1)
    return weights / weights.sum()


def test_the_cone_form_agrees() -> None:
    for criterion in (EVERY["A"], EVERY["L"], EVERY["c"]):
        best = solve_columns(make_task(as_rows(ROWS), Mean(criterion), everything(200)), np.random.default_rng(0))
        weight = np.eye(P) if criterion.weight is None else criterion.weight  # type: ignore[attr-defined]
        M = weighted_information(ROWS, cone_form(ROWS, weight))
        reached = float((np.linalg.lstsq(M, weight, rcond=None)[0]).trace())
        assert np.isclose(reached, float(criterion.value(best.information[0])), rtol=1e-4)


@pytest.mark.parametrize("name", EVERY)
def test_slopes_and_curvatures_agree_with_differences(name: str) -> None:
    """The expansion of the criterion over samples, in a random direction of the weights."""
    rule = Mean(EVERY[name])
    moments = np.swapaxes(SCENARIOS, -1, -2) @ SCENARIOS
    M, h = moments[:30].mean(axis=0), 1e-4
    d = moments[31] / 3.0 - moments[40]
    at = rule.expansion(M)
    ends = [rule.expansion(M + step * d) for step in (h, -h)]
    slope = (ends[0].height - ends[1].height) / (2 * h)
    assert np.isclose(-(at.slope * d).sum(), slope, rtol=1e-5, atol=1e-9)
    bend = -((ends[0].slope - ends[1].slope) * d).sum() / (2 * h)
    model = sum(c * np.einsum("sij,sjk,skl,sli->", Q, d, P_, d) for c, P_, Q in at.pairs)
    model += sum(c * (V * d).sum() ** 2 for c, V in at.ranks)
    assert np.isclose(model, bend, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("name", EVERY)
def test_curvature_in_the_weights_is_what_the_expansion_says(name: str) -> None:
    block = SCENARIOS[:12]
    small = Small(block, np.zeros(12, dtype=np.intp), np.ones(1), np.inf, np.zeros((3, P, P)))
    at = Mean(EVERY[name]).expansion(small.information(np.full(12, 1 / 12)))
    M = np.einsum("nski,nskj->nsij", block, block)
    H = sum(c * np.einsum("sij,nsjk,skl,msli->nm", Q, M, P_, M) for c, P_, Q in at.pairs)
    for c, V in at.ranks:
        each = np.einsum("sij,nsij->n", V, M)
        H += c * np.outer(each, each)
    assert np.allclose(curvature(small, at), H, rtol=1e-9, atol=1e-12 * np.abs(H).max())


@pytest.mark.parametrize("name", EVERY)
def test_another_basis_is_the_same_criterion(name: str) -> None:
    rule = Mean(EVERY[name])
    T = np.random.default_rng(2).normal(size=(P, P))
    M = (np.swapaxes(SCENARIOS, -1, -2) @ SCENARIOS)[:30].mean(axis=0)
    one, two = rule.expansion(M), rule.in_basis(T).expansion(T.T @ M @ T)
    assert np.isclose(float(rule.value(M)), float(rule.in_basis(T).value(T.T @ M @ T)), rtol=1e-9)
    assert np.isclose(one.height, two.height, rtol=1e-9)
    assert np.allclose(one.slope, T @ two.slope @ T.T, rtol=1e-7)


def test_nearly_tied_parameters_are_designed_for() -> None:
    """Rows of condition 1e7: M has 1e14, which the equations in their own coordinates do not survive."""
    rng = np.random.default_rng(8)
    rows = rng.normal(size=(6000, 3, 8)) @ np.diag(np.logspace(0, -7, 8)) @ np.linalg.qr(rng.normal(size=(8, 8)))[0]
    best = solve_columns(make_task(as_rows(rows), Mean(Determinant()), everything(6000)), np.random.default_rng(0))
    assert best.efficiency >= 1 - 1e-6


@pytest.mark.parametrize("name", EVERY)
def test_the_certificate_is_a_true_bound_for_any_weights(name: str) -> None:
    rule = Mean(EVERY[name])
    best = solve_columns(make_task(as_rows(ROWS), rule, everything(200)), np.random.default_rng(0), 1 - 1e-5)
    top = float(rule.value(best.information))
    rng = np.random.default_rng(3)
    for _ in range(30):
        M = weighted_information(ROWS[:, None], rng.dirichlet(np.full(200, 0.05)))
        bound = bound_of(scores(as_rows(ROWS), rule.expansion(M).slope), everything(200))
        assert bound <= top / float(rule.value(M)) * (1 + 1e-9)
        assert bound < 0.95


def test_a_wrong_weight_vector_is_not_certified() -> None:
    best = solve_columns(make_task(as_rows(ROWS), Mean(Determinant()), everything(200)), np.random.default_rng(0))
    weights = best.spread(200)
    weights[best.index[np.argmax(best.weights)]] = 0.0
    M = weighted_information(ROWS, weights / weights.sum())
    found = scores(as_rows(ROWS), Determinant().expansion(M).slope)
    assert bound_of(found, everything(200)) < 0.99


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), p=st.integers(2, 5), k=st.integers(1, 4), spread=st.floats(0.02, 1.0))
def test_deletion_never_removes_a_support_point(seed: int, p: int, k: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(60, k, p))
    task = make_task(as_rows(rows), Mean(Determinant()), everything(60))
    best = solve_columns(task, np.random.default_rng(0), 1 - 1e-8)
    support = best.index[best.weights > 1e-3]
    weights = (1 - spread) * best.spread(60) + spread * rng.dirichlet(np.ones(60))
    M = weighted_information(rows, weights)
    gone = deletable(scores(rows, np.linalg.inv(M) / p), p)
    assert not gone[support].any()


def test_units_do_not_matter_to_d() -> None:
    scale = np.array([1e-6, 1.0, 1e5, 7.0])
    one, two = (
        solve_columns(make_task(as_rows(r), Mean(Determinant()), everything(200)), np.random.default_rng(0), 1 - 1e-8)
        for r in (ROWS, ROWS * scale)
    )
    assert np.allclose(one.information[0], two.information[0] / np.outer(scale, scale), rtol=1e-4, atol=1e-6)


def test_a_generator_of_rows_gives_the_same_design() -> None:
    rng = np.random.default_rng(5)
    rows = rng.normal(size=(30_000, 1, 3, 5))
    made = MadeRows(lambda index: rows[index], rows.shape)
    held, streamed = (
        solve_columns(make_task(r, Mean(Determinant()), everything(30_000)), np.random.default_rng(1))
        for r in (as_rows(rows), made)
    )
    assert np.array_equal(held.index, streamed.index)
    assert np.array_equal(held.weights, streamed.weights)
    assert held.efficiency >= 1 - 1e-6
    assert held.passes < 4


def test_the_certificate_is_of_the_rows_in_double_precision() -> None:
    """Recomputed in long double."""
    rows = np.random.default_rng(9).normal(size=(30_000, 3, 6)) * np.logspace(0, -5, 6)
    best = solve_columns(make_task(as_rows(rows), Mean(Determinant()), everything(30_000)), np.random.default_rng(0))
    cov = np.asarray(np.linalg.inv(best.information[0]), dtype=np.longdouble)
    wide = rows.astype(np.longdouble)
    true = np.einsum("nki,nki->n", wide @ cov, wide) / 6
    assert best.efficiency == pytest.approx(float(1 / true.max()), abs=1e-9)
    assert best.efficiency >= 1 - 1e-6


def test_threads_do_not_change_scores() -> None:
    rows = as_rows(np.random.default_rng(7).normal(size=(40_000, 2, 6)))
    G = np.diag(np.arange(6.0))
    assert np.array_equal(scores(rows, G, threads=1), scores(rows, G, threads=3))


def test_duplicated_candidates_share_a_weight_but_not_the_information() -> None:
    once = solve_columns(make_task(as_rows(ROWS), Mean(Determinant()), everything(200)), np.random.default_rng(0))
    twice = np.concatenate([ROWS, ROWS])
    both = solve_columns(make_task(as_rows(twice), Mean(Determinant()), everything(400)), np.random.default_rng(0))
    assert np.allclose(once.information, both.information, rtol=1e-3, atol=1e-3)


def test_a_bound_that_misses_is_an_error() -> None:
    task = make_task(as_rows(ROWS), Mean(Determinant()), everything(200))
    with pytest.raises(NotCertified, match=r"is certified to within .* of D-efficiency 1, asked for"):
        solve_columns(task, np.random.default_rng(0), 1.0 + 1e-6)
