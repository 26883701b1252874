"""The exchange of poses against counting all plans, and what it refuses."""

from __future__ import annotations

from itertools import combinations, combinations_with_replacement, product

import numpy as np
import pytest

from qsframework.errors import NotIdentifiable
from qsframework.plans.criteria import Criterion, Determinant, Linear, Mean
from qsframework.plans.exact import Quotas, exchange
from qsframework.plans.interior import moments_of
from qsframework.plugin import Array


def rows_of(seed: int, count: int = 11) -> Array:
    """Rows (count, 2, 3) of candidates of very unequal worth."""
    rng = np.random.default_rng(seed)
    return rng.standard_normal((count, 2, 3)) * 10.0 ** rng.uniform(-1, 1, (count, 1, 1))


def value(rows: Array, chosen: tuple[int, ...], rule: Criterion) -> float:
    block = rows[list(chosen)].reshape(-1, 3)
    return float(rule.value(block.T @ block))


@pytest.mark.parametrize("rule", [Determinant(), Linear()], ids=["D", "A"])
@pytest.mark.parametrize("repeats", [False, True])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_best_of_all_plans_is_found(rule: Criterion, repeats: bool, seed: int) -> None:
    rows = rows_of(seed)
    quotas = Quotas((np.arange(11),), (4,), np.arange(11), repeats)
    found = exchange(rows, rule, quotas, None, 20, np.random.default_rng(0))
    every = combinations_with_replacement(range(11), 4) if repeats else combinations(range(11), 4)
    best = min(value(rows, plan, rule) for plan in every)
    assert value(rows, tuple(found.tolist()), rule) == pytest.approx(best, rel=1e-9)
    assert repeats or len(set(found.tolist())) == 4


@pytest.mark.parametrize("rule", [Determinant(), Linear()], ids=["D", "A"])
def test_no_single_exchange_helps(rule: Criterion) -> None:
    """Among more candidates than are tried one by one, under two scenarios: every candidate in every slot is worse."""
    rows = np.stack([rows_of(8, 400), rows_of(9, 400)], axis=1)
    averaged = Mean(rule)
    found = exchange(rows, averaged, Quotas((np.arange(400),), (5,), np.arange(400)), None, 2, np.random.default_rng(0))
    moments = moments_of(rows)
    reached = averaged.value(moments[found].sum(axis=0))
    for slot in range(5):
        others = np.delete(found, slot)
        free = np.setdiff1d(np.arange(400), others)
        assert averaged.value(moments[others].sum(axis=0) + moments[free]).min() > reached * (1.0 - 1e-9)


def test_what_other_starts_found_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """The plan of many starts is the same, bit by bit, where nothing is remembered; and fewer steps are taken."""
    from qsframework.plans import exact

    rows, asked = rows_of(4, 60), list[int]()
    plain = exact._best  # pyright: ignore[reportPrivateUsage]

    def counted(board, others, group, ridge, thorough):  # type: ignore[no-untyped-def]
        asked.append(1)
        return plain(board, others, group, ridge, thorough)

    class Forgets(dict):  # type: ignore[type-arg]
        def __contains__(self, key: object) -> bool:
            return False

    def found(known: type[dict]) -> tuple[list[int], int]:  # type: ignore[type-arg]
        asked.clear()
        monkeypatch.setattr(exact, "_best", counted)
        made = exact._Board  # pyright: ignore[reportPrivateUsage]
        monkeypatch.setattr(exact, "_Board", lambda **fields: made(**fields, known=known()))
        quotas = Quotas((np.arange(60),), (5,), np.arange(60))
        plan = exchange(rows, Determinant(), quotas, None, 12, np.random.default_rng(0)).tolist()
        monkeypatch.undo()
        return plan, len(asked)

    remembered, forgotten = found(dict), found(Forgets)
    assert remembered[0] == forgotten[0]
    assert remembered[1] < 0.8 * forgotten[1]


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_groups_and_places_are_kept(seed: int) -> None:
    """Two loads over the same six poses: two poses of the first, one of the second, and no pose twice."""
    rows = rows_of(seed, 12)
    place = np.arange(12) % 6
    quotas = Quotas((np.arange(6), np.arange(6, 12)), (2, 1), place)
    found = exchange(rows, Determinant(), quotas, np.ones(12) / 12, 20, np.random.default_rng(0))
    assert (found < 6).tolist() == [True, True, False]
    assert len(set(place[found].tolist())) == 3
    plans = (
        (*first, second)
        for first, second in product(combinations(range(6), 2), range(6, 12))
        if second - 6 not in first
    )
    best = min(value(rows, plan, Determinant()) for plan in plans)
    assert value(rows, tuple(found.tolist()), Determinant()) == pytest.approx(best, rel=1e-9)


def test_weights_are_a_start_and_progress_is_told() -> None:
    rows = rows_of(4)
    told: list[tuple[int, int]] = []
    quotas = Quotas((np.arange(11),), (4,), np.arange(11), True)
    weights = np.zeros(11)
    weights[[2, 7]] = 0.5
    exchange(rows, Determinant(), quotas, weights, 3, np.random.default_rng(0), lambda i, n: told.append((i, n)))
    assert told == [(1, 3), (2, 3), (3, 3)]


def test_what_is_known_before_counts() -> None:
    """With a prior one pose is enough, and it is the one that adds most to it."""
    rows = rows_of(5)
    prior = np.diag([1e4, 1e4, 1e-4])[None]
    found = exchange(
        rows,
        Determinant(),
        Quotas((np.arange(11),), (1,), np.arange(11)),
        None,
        8,
        np.random.default_rng(0),
        prior=prior,
    )
    scores = [float(Determinant().value(prior[0] + r.T @ r)) for r in rows]
    assert int(found[0]) == int(np.argmin(scores))


def test_rows_that_tell_too_little() -> None:
    blind = rows_of(6)
    blind[..., 2] = 0.0
    with pytest.raises(NotIdentifiable, match="no plan of 4 poses identifies all 3 parameters"):
        exchange(blind, Determinant(), Quotas((np.arange(11),), (4,), np.arange(11)), None, 3, np.random.default_rng(0))


def test_a_group_with_fewer_candidates_than_poses() -> None:
    for weights in (None, np.ones(11) / 11):
        quotas = Quotas((np.arange(2),), (4,), np.arange(11))
        with pytest.raises(NotIdentifiable, match=r"only 2 candidates for a group of the plan.*allow repeats"):
            exchange(rows_of(7), Determinant(), quotas, weights, 3, np.random.default_rng(0))
