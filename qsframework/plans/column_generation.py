"""Relaxed designs at any size, by column generation.

Few candidates carry weight. So a small problem over some of them is solved by an interior point method,
its slope scores the others in one pass, the worst violators join it, and candidates that carry next to
nothing leave. Random subsets come first, then the best of all; what the first pass told bounds the scores under
later slopes, so that few candidates are looked at again to certify.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from qsframework.errors import NotCertified, NotIdentifiable
from qsframework.information.certificate import Allowed, bound_of, deletable
from qsframework.information.rows import HeldRows
from qsframework.plans.criteria import Determinant, Expansion
from qsframework.plans.interior import Small, Solved, moments_of, solve_small
from qsframework.plans.scoreboard import Scoreboard
from qsframework.plans.task import RelaxedTask
from qsframework.plugin import Array, Indices
from qsframework.work.threads import single_thread

_FIRST = 4096
_SUBSET = 16
_LARGEST = 2048
"""The largest subset holds one candidate in so many, and at most so many for each parameter."""
_SHORTLIST = 128
_EACH = 256
"""One candidate in so many is among the best after the first pass, and so many for each parameter."""
_SINGULAR = 1e15
"""Condition of an information matrix, its parameters brought to one size, that float64 cannot tell from singular."""
_UNIDENTIFIABLE = "the candidates do not identify all parameters, or hardly"
_ROUNDS = 60
_ROOM = 2.0
"""How many times its share a group's candidates may hold where weights are capped, at least."""
_SUBSET_EFFICIENCY = 0.9
_GOAL = 1e-7
_FLOOR = 1e-16
"""Gap of a small problem that float64 cannot tell from none."""
Progress = Callable[[float], None]
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False, kw_only=True)
class Relaxed:
    """Weights of the candidates that carry any: indices and weights (m,), M (S, p, p), certified efficiency.

    passes counts those over all candidates, subsets as fractions
    """

    index: Indices
    weights: Array
    information: Array
    expansion: Expansion
    efficiency: float
    board: Scoreboard
    slope: Array
    passes: float

    @property
    def scores(self) -> Array:
        """<G, M_i> (N,) of all candidates: a further pass, unless all were needed for the certificate."""
        return self.board.exact(self.slope)

    def spread(self, count: int) -> Array:
        """The weights as (N,)."""
        out = np.zeros(count)
        out[self.index] = self.weights
        return out


@dataclass(frozen=True, eq=False)
class Columns:
    """The candidates of the small problem, their rows, and its solution."""

    index: Indices
    block: Array
    solved: Solved


def solve_columns(
    task: RelaxedTask, rng: np.random.Generator, efficiency: float = 1.0 - 1e-6, progress: Progress | None = None
) -> Relaxed:
    """The relaxed design, certified over all candidates; NotCertified where `efficiency` cannot be reached."""
    with single_thread():
        try:
            return _solve_columns(task, rng, efficiency, progress)
        except np.linalg.LinAlgError as error:
            raise NotIdentifiable(_UNIDENTIFIABLE) from error


def _solve_columns(
    task: RelaxedTask, rng: np.random.Generator, efficiency: float, progress: Progress | None
) -> Relaxed:
    tell: Progress = progress or (lambda _: None)
    goal = min(1.0 - efficiency, 0.1)
    state, passes = _from_subsets(task, rng, goal, tell)
    bound, best, before = 0.0, 0.0, -1.0
    board = Scoreboard(task.rows, task.basis)
    for _ in range(20):
        values = board.bounds(state.solved.expansion.slope, _levels(state, task.label))
        bound = _bound(task, state, values, task.allowed)
        tell(bound)
        best = max(best, bound)
        if bound >= efficiency or (best <= before and len(state.index) == len(task.rows)):
            break
        before = best
        pool = _shortlist(task, state, values)
        state, used = _improve(task, pool, state, 0.3 * goal)
        passes += used
    if bound < efficiency:
        raise NotCertified(
            f"the design is certified to within {1.0 - bound:.1e} of {task.criterion.name}-efficiency 1, asked for "
            f"{1.0 - efficiency:.1e}; ask for less, or omit parameters that the candidates hardly identify"
        )
    return _result(task, state, bound, board, passes + board.passes)


def _result(task: RelaxedTask, state: Columns, bound: float, board: Scoreboard, passes: float) -> Relaxed:
    w = state.solved.weights
    M = task.prior + np.tensordot(w, moments_of(state.block), 1)
    size = np.sqrt(np.diagonal(M, axis1=-2, axis2=-1))
    if not np.all(np.linalg.cond(M / np.maximum(size[:, :, None] * size[:, None, :], 1e-300)) < _SINGULAR):
        raise NotIdentifiable(_UNIDENTIFIABLE)
    back = np.linalg.inv(task.basis)
    expansion = state.solved.expansion
    own = replace(expansion, slope=task.basis @ expansion.slope @ task.basis.T, pairs=(), ranks=())
    return Relaxed(
        index=state.index,
        weights=w,
        information=back.T @ M @ back,
        expansion=own,
        efficiency=bound,
        board=board,
        slope=expansion.slope,
        passes=passes,
    )


def _bound(task: RelaxedTask, state: Columns, values: Array, allowed: Allowed) -> float:
    expansion = state.solved.expansion
    return bound_of(values, allowed, float((task.prior * expansion.slope).sum()))


def _from_subsets(task: RelaxedTask, rng: np.random.Generator, goal: float, tell: Progress) -> tuple[Columns, float]:
    """Nested random subsets, each solved to a moderate efficiency: a start that costs a tenth of a pass."""
    count = len(task.rows)
    order = _sample(task, rng, count)
    size = min(_FIRST, count)
    passes = 0.0
    state: Columns | None = None
    while True:
        pool = np.sort(order[:size])
        last = size == len(order)
        target = 0.3 * goal if size == count else 1.0 - _SUBSET_EFFICIENCY
        state, used = _improve(task, pool, state or _first(task, pool, rng), target)
        passes += used
        tell(0.0)
        if last:
            return state, passes
        size = min(size * _SUBSET, len(order))


def _sample(task: RelaxedTask, rng: np.random.Generator, count: int) -> Indices:
    """A random order of some candidates (all, where there are few), every group taking part."""
    if count <= _FIRST:
        return np.arange(count)
    wanted = min(max(_FIRST, count // _SUBSET), _LARGEST * task.rows.parameters)
    parts: list[Indices] = []
    for members in task.allowed.groups:
        size = len(range(*members.indices(count))) if isinstance(members, slice) else len(members)
        take = min(size, max(64, wanted * size // count))
        picks = rng.choice(size, take, replace=False)
        parts.append(picks + members.start if isinstance(members, slice) else members[picks])
    return rng.permutation(np.concatenate(parts))


def _first(task: RelaxedTask, pool: Indices, rng: np.random.Generator) -> Columns:
    """Some candidates of every group with which M is regular: random ones, then the pool's most independent."""
    p = task.rows.parameters
    picks: list[Indices] = []
    for g, share in enumerate(task.allowed.shares):
        members = np.flatnonzero(task.label[pool] == g)
        need = 4 * p if not np.isfinite(task.allowed.cap) else max(4 * p, int(2 * share / task.allowed.cap) + 4)
        picks.append(rng.choice(members, min(len(members), need), replace=False) if share > 0 else members[:0])
    chosen = np.unique(np.concatenate(picks))
    block = task.take(pool)
    chosen = np.union1d(chosen, _independent(block, np.isin(task.label[pool], np.flatnonzero(task.shares))))
    index = pool[chosen]
    return _solve(task, index, block[chosen], None, 1.0 - _SUBSET_EFFICIENCY)


def _independent(block: Array, useful: npt.NDArray[np.bool_]) -> Indices:
    """Candidates whose rows a pivoted QR picks first in every scenario."""
    import scipy.linalg

    found: set[int] = set()
    k = block.shape[2]
    members = np.flatnonzero(useful)
    for s in range(block.shape[1]):
        flat = block[members, s].reshape(-1, block.shape[-1])
        norms = np.linalg.norm(flat, axis=0)
        scaled = (flat / np.where(norms > 0, norms, 1.0)).T
        pivots = scipy.linalg.qr(scaled, mode="economic", pivoting=True)[-1]
        found |= {int(members[i // k]) for i in pivots[: 2 * block.shape[-1]]}
    return np.array(sorted(found))


def _solve(task: RelaxedTask, index: Indices, block: Array, start: Array | None, gap: float) -> Columns:
    small = Small(block, task.label[index].astype(np.intp), task.shares, task.allowed.cap, task.prior)
    return Columns(index, block, solve_small(small, task.criterion, gap, start))


def _improve(task: RelaxedTask, pool: Indices, state: Columns, gap: float) -> tuple[Columns, float]:
    """Solve over a pool of candidates until its own bound leaves `gap`; passes over all that this cost.

    A candidate that leaves and comes back stays, so that rounds do not turn in a circle.
    """
    block = task.rows.take(pool)
    allowed, label = task.within(pool), task.label[pool]
    board = Scoreboard(HeldRows(block), task.basis)
    inner, left, back = 0.3, np.zeros(len(pool), dtype=bool), np.zeros(len(pool), dtype=bool)
    for _ in range(_ROUNDS):
        values = board.bounds(state.solved.expansion.slope, _levels(state, label))
        open_gap = 1.0 - _bound(task, state, values, allowed)
        if open_gap <= gap:
            break
        joining = _violators(task, pool, state, values)
        if not len(joining) and inner < max(1e-3 * gap, _FLOOR):
            break
        inner = min(inner, 0.1 * open_gap) if len(joining) else 0.1 * min(inner, open_gap)
        back[joining] |= left[joining]
        own, inner_gap = np.searchsorted(pool, state.index), max(inner, 0.1 * gap if gap > 0 else _GOAL * 0.01)
        state = _renewed(task, pool, block, state, joining, inner_gap, back[own])
        left[own[~np.isin(pool[own], state.index)]] = True
    return state, (1.0 + board.passes) * len(pool) / len(task.rows)


def _levels(state: Columns, label: npt.NDArray[np.int16]) -> Array | float:
    """The scores above which candidates of these groups join, or count in the bound, now."""
    levels = np.minimum(state.solved.multipliers, state.solved.scores.max())
    return float(levels[0]) if len(levels) == 1 else levels[label]


def _merits(state: Columns, label: npt.NDArray[np.int16], values: Array) -> Array:
    """Scores of candidates of these groups, per multiplier of the group."""
    each = np.maximum(state.solved.multipliers, 1e-300)
    return values / (each[0] if len(each) == 1 else each[label])


def _violators(task: RelaxedTask, pool: Indices, state: Columns, values: Array) -> Indices:
    """Positions in the pool of up to 4 p candidates, of all groups, that improve the design most."""
    excess = _merits(state, task.label[pool], values) - 1.0
    excess[np.searchsorted(pool, state.index)] = -1.0
    wanted = min(4 * task.rows.parameters, len(pool))
    top = np.argpartition(excess, len(pool) - wanted)[-wanted:]
    return top[excess[top] > 1e-12]


def _renewed(
    task: RelaxedTask, pool: Indices, block: Array, state: Columns, joining: Indices, gap: float, stays: Flags
) -> Columns:
    """The small problem without candidates that carry next to nothing, but with those that stay and that join."""
    solved = state.solved
    ratio = solved.scores / np.maximum(solved.multipliers, 1e-300)[task.label[state.index]]
    stays = stays | (solved.weights * task.rows.parameters >= 1.0 - ratio)
    for g, share in enumerate(task.allowed.shares):  # a group keeps what its share needs
        mine = np.flatnonzero(task.label[state.index] == g)
        if share > 0 and not stays[mine].any():
            stays[mine[np.argmax(solved.weights[mine])]] = True
    joined = task.label[pool[joining]]
    for g, share in enumerate(task.allowed.shares if np.isfinite(task.allowed.cap) else ()):  # and may hold it
        mine = task.label[state.index] == g
        if (stays[mine].sum() + (joined == g).sum()) * task.allowed.cap < _ROOM * share:
            stays |= mine
    added = block[joining] @ task.basis
    kept = np.concatenate([state.block[stays], added])
    if not _tells(kept, task.prior):  # early weights are rough: what is left must still tell every parameter
        stays[:] = True
    index = np.concatenate([state.index[stays], pool[joining]])
    rows = np.concatenate([state.block[stays], added])
    start = np.concatenate([solved.weights[stays], np.zeros(len(joining))])
    for g, share in enumerate(task.allowed.shares):
        mine = task.label[index] == g
        total = start[mine].sum()
        start[mine] = start[mine] * share / total if total > 0 else share / max(mine.sum(), 1)
    return _solve(task, index, rows, start, gap)


def _tells(block: Array, prior: Array) -> bool:
    """Whether rows in the basis tell every parameter well enough for a start."""
    M = prior + moments_of(block).mean(axis=0)
    return bool((np.linalg.eigvalsh(M)[:, 0] > 1e-12 * np.linalg.eigvalsh(M)[:, -1]).all())


def _shortlist(task: RelaxedTask, state: Columns, values: Array) -> Indices:
    """The best of all candidates, less those that no optimal design uses, with the present ones."""
    count = len(values)
    size = min(count, max(_FIRST, _EACH * task.rows.parameters, count // _SHORTLIST))
    top = (
        np.argpartition(_merits(state, task.label, values), count - size)[-size:] if size < count else np.arange(count)
    )
    plain = len(task.shares) == 1 and not np.isfinite(task.allowed.cap) and task.rows.scenarios == 1
    inner = task.criterion.inner
    if plain and isinstance(inner, Determinant) and inner.directions is None and not task.prior.any():
        top = top[~deletable(values[top], task.rows.parameters)]
    return np.union1d(top, state.index)
