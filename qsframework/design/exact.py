"""Exact plans: n poses out of the candidates, by rounding the relaxed design and by exchange."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from qsframework.design.criteria import Criterion
from qsframework.errors import NotIdentifiable
from qsframework.information import information
from qsframework.plugin import Array, Indices

_PASSES = 50
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


def exchange(
    rows: Array,
    criterion: Criterion,
    quotas: Quotas,
    weights: Array | None,
    starts: int,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Indices:
    """Indices (n,) of the best plan found from `starts` starts; the first rounds `weights`.

    Raises NotIdentifiable if no start gives a plan of full rank.
    """
    M = information(rows)
    best, best_value = None, np.inf
    for start in range(starts):
        first = _rounded(weights, quotas, rng) if start == 0 and weights is not None else _random(quotas, weights, rng)
        chosen, value = _climb(M, criterion, quotas, first)
        if value < best_value:
            best, best_value = chosen, value
        if progress is not None:
            progress(start + 1, starts)
    if best is None:
        raise NotIdentifiable(
            f"no plan of {quotas.poses} poses tells all {rows.shape[-1]} parameters apart; ask for more poses, "
            "another load, or fewer parameters"
        )
    return best


def _slots(quotas: Quotas) -> list[int]:
    return [g for g, count in enumerate(quotas.counts) for _ in range(count)]


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
    for group in _slots(quotas):
        members = quotas.groups[group]
        pick = _pick(members, np.argsort(-left[members]), taken, quotas)
        left[pick] -= 1.0
        taken.add(int(quotas.place[pick]))
        chosen.append(pick)
    return np.array(chosen)


def _random(quotas: Quotas, weights: Array | None, rng: np.random.Generator) -> Indices:
    """Random candidates, half of them drawn by weight where there are weights."""
    chosen: list[int] = []
    taken: set[int] = set()
    for group in _slots(quotas):
        members = quotas.groups[group]
        keys = rng.exponential(size=len(members))
        if weights is not None and rng.random() < 0.5:
            keys = keys / np.maximum(weights[members], 1e-12)
        pick = _pick(members, np.argsort(keys), taken, quotas)
        taken.add(int(quotas.place[pick]))
        chosen.append(pick)
    return np.array(chosen)


def _climb(M: Array, criterion: Criterion, quotas: Quotas, chosen: Indices) -> tuple[Indices, float]:
    """Replace one pose after the other by the best candidate of its group until nothing helps."""
    chosen = chosen.copy()
    slots = _slots(quotas)
    # a singular start is climbed with a ridge that is too small to matter later
    ridge = 1e-9 * np.trace(M.mean(axis=0)) / M.shape[-1] * np.eye(M.shape[-1])
    value = float(criterion.value(M[chosen].sum(axis=0) + ridge))
    for _ in range(_PASSES):
        improved = False
        for slot, group in enumerate(slots):
            members = quotas.groups[group]
            others = np.delete(chosen, slot)
            trial = criterion.value(M[others].sum(axis=0) + M[members] + ridge)
            if not quotas.repeats:
                trial = np.where(np.isin(quotas.place[members], quotas.place[others]), np.inf, trial)
            pick = int(np.argmin(trial))
            if trial[pick] < value * (1.0 - 1e-10):
                chosen[slot], value, improved = members[pick], float(trial[pick]), True
        if not improved:
            break
    exact = float(criterion.value(M[chosen].sum(axis=0)))
    condition = np.linalg.cond(M[chosen].sum(axis=0))
    return chosen, exact if condition < 1e14 else np.inf
