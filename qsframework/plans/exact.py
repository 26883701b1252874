"""Exact plans: n poses out of the candidates, by rounding the relaxed design and by exchange from many starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from qsframework.errors import NotIdentifiable
from qsframework.plans.criteria import Criterion, Mean
from qsframework.plans.interior import moments_of
from qsframework.plugin import Array, Indices
from qsframework.work import HERE, Work, run

_PASSES = 50
_TRIED = 48
_RIDGE = 1e-9
_APART = 3
"""One of so many starts has nothing of the others."""
_AT_ONCE = 4
"""Starts from one best plan: as many can be climbed side by side."""
_SHARE = 8
"""One of so many poses of the best plan is drawn anew; a plan of fewer starts anew each time."""
Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Quotas:
    """How many poses of each group a plan holds; `place` (N,) says which candidates exclude each other.

    Two candidates of one place (a pose under two loads) are not both planned unless repeats are allowed.
    """

    groups: tuple[Indices, ...]
    counts: tuple[int, ...]
    place: Indices
    repeats: bool = False

    @property
    def poses(self) -> int:
        return sum(self.counts)

    @property
    def slots(self) -> tuple[int, ...]:
        """The group of each pose of a plan (poses,)."""
        return tuple(g for g, count in enumerate(self.counts) for _ in range(count))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Board:
    """Everything an exchange looks at: rows (N, S, k, p), M_i (N, S, p, p), M0, the rule and the quotas.

    known: the best candidates that were found beside other poses of a plan, which many starts come to
    """

    rows: Array
    moments: Array
    prior: Array
    rule: Mean
    quotas: Quotas
    known: dict[tuple[bytes, int, bool], tuple[int, float]] = field(default_factory=dict[Any, Any])

    def information(self, chosen: Indices) -> Array:
        return self.prior + self.moments[chosen].sum(axis=0)

    def value(self, M: Array) -> float:
        return float(self.rule.value(M))

    def with_one(self, M: Array, index: Indices) -> Array:
        """The criterion (m,) of M and one of m candidates."""
        if self.rows.shape[2] >= self.rows.shape[3]:
            return self.rule.value(M + self.moments[index])
        return self.rule.with_one(M, self.rows[index])

    def scores(self, slope: Array) -> Array:
        """<G, M_i> (N,)."""
        return self.moments.reshape(len(self.moments), -1) @ slope.ravel()


def exchange(
    rows: Array,
    criterion: Criterion | Mean,
    quotas: Quotas,
    weights: Array | None,
    starts: int,
    rng: np.random.Generator,
    progress: Progress | None = None,
    prior: Array | None = None,
    work: Work = HERE,
) -> Indices:
    """Indices (n,) of the best plan found from `starts` starts; the first rounds `weights`.

    A third of them are random; each later one is the best plan so far with some of its poses drawn anew, which leads
    farther in less time.

    Raises NotIdentifiable if no start gives a plan of full rank.
    """
    four = rows[:, None] if rows.ndim == 3 else rows
    rule = criterion if isinstance(criterion, Mean) else Mean(criterion)
    moments = moments_of(four)
    before = np.zeros(moments.shape[1:]) if prior is None else prior
    board = _Board(rows=four, moments=moments, prior=before, rule=rule, quotas=quotas)
    apart = starts if quotas.poses < _SHARE else max(1, starts // _APART)
    firsts = [_random(quotas, weights, rng) for _ in range(apart)]
    if weights is not None:
        firsts[0] = _rounded(weights, quotas, rng)
    best, best_value, done = None, np.inf, 0
    while firsts:
        for chosen, value in run(_climb, board, firsts, work):
            done += 1
            if value < best_value:
                best, best_value = chosen, value
            if progress is not None:
                progress(done, starts)
        some = range(min(_AT_ONCE, starts - done))
        firsts = [_random(quotas, weights, rng, None if best is None else _kept(best, rng)) for _ in some]
    if best is None:
        raise NotIdentifiable(
            f"no plan of {quotas.poses} poses identifies all {four.shape[-1]} parameters; ask for more poses, "
            "another load, or fewer parameters"
        )
    return best


def _pick(members: Indices, order: Indices, taken: set[int], quotas: Quotas) -> int:
    for i in order:
        if quotas.repeats or int(quotas.place[members[i]]) not in taken:
            return int(members[i])
    raise NotIdentifiable(
        f"only {len(members)} candidates for a group of the plan: too few for its poses; allow repeats or take more "
        "candidates"
    )


def _rounded(weights: Array, quotas: Quotas, rng: np.random.Generator) -> Indices:
    """Largest weights first; with repeats, by the remainders of n w."""
    chosen: list[int] = []
    taken: set[int] = set()
    left = weights * quotas.poses + 1e-9 * rng.random(len(weights))
    for group in quotas.slots:
        members = quotas.groups[group]
        pick = _pick(members, np.argsort(-left[members]), taken, quotas)
        left[pick] -= 1.0
        taken.add(int(quotas.place[pick]))
        chosen.append(pick)
    return np.array(chosen)


def _kept(chosen: Indices, rng: np.random.Generator) -> dict[int, int]:
    """Most poses of a plan (n,), by their slots."""
    left_out = rng.choice(len(chosen), max(2, len(chosen) // _SHARE), replace=False)
    return {slot: int(chosen[slot]) for slot in range(len(chosen)) if slot not in left_out}


def _random(
    quotas: Quotas, weights: Array | None, rng: np.random.Generator, kept: Mapping[int, int] | None = None
) -> Indices:
    """Random candidates beside the poses that are kept, by their slots; half of the starts drawn by weight where there
    are weights."""
    stay = kept or {}
    chosen: list[int] = []
    taken = {int(quotas.place[i]) for i in stay.values()}
    weighted = weights is not None and rng.random() < 0.5
    for slot, group in enumerate(quotas.slots):
        if slot in stay:
            chosen.append(stay[slot])
            continue
        members = quotas.groups[group]
        keys = rng.exponential(size=len(members))
        if weighted and weights is not None:
            keys = keys / np.maximum(weights[members], 1e-6 / len(members))
        pick = _pick(members, np.argsort(keys), taken, quotas)
        taken.add(int(quotas.place[pick]))
        chosen.append(pick)
    return np.array(chosen)


def _climb(board: _Board, chosen: Indices) -> tuple[Indices, float]:
    """Replace one pose after the other by a better candidate of its group until nothing helps.

    Candidates are ranked by their scores and the best few are tried exactly; when that stops, all are tried. A slot
    that has been tried since anything changed is left alone.
    """
    chosen = chosen.copy()
    # a singular start is climbed with a ridge that is too small to matter later
    size = np.diagonal(board.moments.mean(axis=0), axis1=-2, axis2=-1)
    ridge = _RIDGE * np.einsum("sp,pq->spq", np.where(size > 0.0, size, 1.0), np.eye(size.shape[-1]))
    value = board.value(board.information(chosen) + ridge)
    small = len(board.rows) <= 4 * _TRIED
    thorough = small
    tried: dict[int, bool] = {}  # the slots that nothing has changed for, and whether all candidates were tried there
    for _ in range(_PASSES):
        improved = False
        for slot, group in enumerate(board.quotas.slots):
            if tried.get(slot, False) or (slot in tried and not thorough):
                continue
            others = np.sort(np.delete(chosen, slot))  # in one order, so that a plan has one value to the last bit
            asked = (others.tobytes(), group, thorough)
            if asked not in board.known:
                board.known[asked] = _best(board, others, group, ridge, thorough)
            pick, trial = board.known[asked]
            if trial < value * (1.0 - 1e-10):
                chosen[slot], value, improved = pick, trial, True
                tried.clear()
            tried[slot] = thorough
        if not improved and thorough:
            break
        thorough = small or not improved
    M = board.information(chosen)
    regular = max(np.linalg.cond(m / np.sqrt(np.outer(np.diag(m), np.diag(m)) + 1e-300)) for m in M) < 1e13
    return chosen, board.value(M) if regular else np.inf


def _best(board: _Board, others: Indices, group: int, ridge: Array, thorough: bool) -> tuple[int, float]:
    """The best candidate of a group beside all other poses of a plan, and the criterion with it."""
    quotas = board.quotas
    members = quotas.groups[group]
    base = board.information(others) + ridge
    if not quotas.repeats:
        open_ = np.ones(quotas.place.max() + 1, dtype=bool)
        open_[quotas.place[others]] = False
        members = members[open_[quotas.place[members]]]
    if len(members) > _TRIED:
        rank = board.scores(board.rule.expansion(base).slope)[members]
        few = members[np.argpartition(-rank, _TRIED)[:_TRIED]]
        # psi is convex: no candidate falls below the tangent, and few can be the best one
        members = members[_may_win(board, base, few, rank)] if thorough else few
    best, best_value = -1, np.inf
    for start in range(0, len(members), 4096):
        part = members[start : start + 4096]
        trial = board.with_one(base, part)
        i = int(np.argmin(trial))
        if trial[i] < best_value:
            best, best_value = int(part[i]), float(trial[i])
    return best, best_value


def _may_win(board: _Board, base: Array, few: Indices, rank: Array) -> npt.NDArray[np.bool_]:
    """Which candidates, of these scores, can be as good as the best of a few: their tangents lie as low."""
    reached = float(board.with_one(base, few).min())
    return board.value(base) * (1.0 - rank) <= reached + 1e-9 * abs(reached)
