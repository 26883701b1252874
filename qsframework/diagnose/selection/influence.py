"""Whether a name hangs on a few readings: it must survive deleting any two poses."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from qsframework.diagnose.linearization.columns import Case, Subspace
from qsframework.diagnose.selection.search import Subset
from qsframework.estimation import LinearFit
from qsframework.estimation.projection import solved
from qsframework.plugin import Array, Indices

_MOST_POSES = 120
"""Above this many poses only single poses are deleted: two of them weigh little."""
_RIDGE = 1e-9


def hangs_on(
    case: Case, subspaces: Sequence[Subspace], chosen: Subset, without: Subset, others: Sequence[Subset], needed: float
) -> list[tuple[int, ...]]:
    """Smallest sets of one or two poses without which a cause is not significant, or another takes its place.

    chosen: the subset with the cause; without: the same without it; others: those that count as another answer;
    needed: by how much the cause must lower the squares to be named
    """
    blocks, count = _pose_blocks(case.pose)
    pairs = [(i,) for i in range(count)]
    if count <= _MOST_POSES:
        pairs += list(combinations(range(count), 2))
    index = np.array([(*p, p[0]) if len(p) == 1 else p for p in pairs])
    same = index[:, 0] == index[:, 1]
    none = _squares_without(case, _columns(subspaces, without), blocks, index, same)
    best = _squares_without(case, _columns(subspaces, chosen), blocks, index, same)
    lost = none - best < needed
    penalty = float(np.log(len(case.pose)))
    for other in others:
        rival = _squares_without(case, _columns(subspaces, other), blocks, index, same)
        lost |= rival + penalty * (other.dof - chosen.dof) < best
    singles = {pairs[i] for i in np.flatnonzero(lost) if len(pairs[i]) == 1}
    alone = {p[0] for p in singles}
    doubles = [pairs[i] for i in np.flatnonzero(lost) if len(pairs[i]) == 2 and not alone & set(pairs[i])]
    return [*sorted(singles), *doubles]


def _columns(subspaces: Sequence[Subspace], subset: Subset) -> Array:
    none = np.zeros((len(subspaces[0].Q), 0))
    return np.concatenate([none, *(subspaces[i].Q for i in subset.members)], axis=1)


def _pose_blocks(pose: Indices) -> tuple[Indices, int]:
    """Positions (P, b) of each pose's scalars, filled up with len(pose)."""
    found = [np.flatnonzero(pose == p) for p in np.unique(pose)]
    out = np.full((len(found), max(map(len, found))), len(pose))
    for i, at in enumerate(found):
        out[i, : len(at)] = at
    return out, len(found)


def _squares_without(case: Case, columns: Array, blocks: Indices, index: Indices, same: Array) -> Array:
    """Squares left by a fit to all poses but two (D,): RSS - r' (I - H)^-1 r over the deleted rows."""
    fit = LinearFit.onto(np.linalg.qr(np.concatenate([case.A, columns], axis=1))[0], case.residuals)
    Q, r = np.pad(fit.Q, ((0, 1), (0, 0))), np.append(fit.white, 0.0)
    second = np.where(same[:, None], len(r) - 1, blocks[index[:, 1]])
    at = np.concatenate([blocks[index[:, 0]], second], axis=1)
    out = np.empty(len(at))
    for part, _, error in solved(Q * (1.0 - _RIDGE), at, r, None):
        out[part] = fit.chi2 - np.einsum("di,di->d", r[at[part]], error)
    return out
