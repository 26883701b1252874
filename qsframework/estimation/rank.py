"""What readings can tell apart: rank decisions on scaled, whitened columns, said in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array

TOLERANCE = 1e-9
"""Relative size below which a column or a singular value counts as zero."""
_SHARE = 0.1


@dataclass(frozen=True)
class RankTest:
    """Rank of the observation matrix, and what is lost.

    unseen: parameters that no reading depends on; tied: groups of parameters of which only a
    combination is seen; condition: of the normalised columns that are seen
    """

    rank: int
    parameters: int
    unseen: tuple[str, ...]
    tied: tuple[tuple[str, ...], ...]
    condition: float

    @property
    def full(self) -> bool:
        return self.rank == self.parameters

    def words(self) -> str:
        """One sentence for each loss."""
        said = [f"{name}: no reading depends on it" for name in self.unseen]
        said += [f"{', '.join(group)}: only a combination of these is identifiable" for group in self.tied]
        return "; ".join(said) or "all parameters are identifiable"


def rank_test(rows: Array, names: Sequence[str]) -> RankTest:
    """Rank of rows (m, p), whitened and scaled by the parameters' typical sizes."""
    norms = np.linalg.norm(rows, axis=0)
    seen = norms > TOLERANCE * norms.max(initial=0.0)
    kept = np.flatnonzero(seen)
    unseen = tuple(name for name, s in zip(names, seen, strict=True) if not s)
    if not len(kept):
        return RankTest(0, len(names), unseen, (), np.inf)
    small = np.linalg.qr(rows[:, kept] / norms[kept], mode="r")
    _, values, basis = np.linalg.svd(small, full_matrices=True)
    values = np.concatenate([values, np.zeros(len(kept) - len(values))])
    rank = int((values > TOLERANCE * values[0]).sum())
    tied = _groups(basis[rank:], [names[int(i)] for i in kept])
    condition = float(values[0] / values[rank - 1])
    return RankTest(rank, len(names), unseen, tied, condition)


def _groups(null: Array, names: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Parameters that take part in the null space together, as connected groups."""
    projector = null.T @ null
    left = [i for i in range(len(names)) if projector[i, i] > _SHARE**2]
    groups: list[tuple[str, ...]] = []
    while left:
        group: set[int] = set()
        frontier = {left[0]}
        while frontier:
            i = frontier.pop()
            group.add(i)
            frontier |= {j for j in left if j not in group and abs(projector[i, j]) > _SHARE**2}
        groups.append(tuple(names[i] for i in sorted(group)))
        left = [i for i in left if i not in group]
    return tuple(groups)
