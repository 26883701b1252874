"""Which few causes together explain the residuals best: all subsets, from one Gram matrix, by the extended BIC.

EBIC (gamma = 1) of a subset: chi-square + k log m + 2 log(number of subsets of its size). All pairs are looked at; of
larger subsets those that grow from the best smaller ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, pairwise
from math import comb

import numpy as np

from qsframework.diagnose.linearization.columns import Subspace
from qsframework.estimation import left
from qsframework.plugin import Array, Indices

LARGEST = 3
_GROWN = 25
_FLOOR = 1e-6
"""Share of a direction that must remain beside the others in a subset."""
_RIDGE = 1e-9
_BEYOND = 3.0
"""Standard deviations by which a fitted parameter may end below its bound in a subset that is still looked at."""


@dataclass(frozen=True)
class Subset:
    """Positions of causes; rss: whitened squares left; dof: directions used; ebic less that of no cause at all."""

    members: tuple[int, ...]
    rss: float
    dof: int
    ebic: float


@dataclass(frozen=True, eq=False)
class Bounds:
    """Fitted parameters at the baseline (f,), their sds and lower bounds: no subset may push them far below."""

    value: Array
    sd: Array
    lower: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Gram:
    """Products G (K, K) of all directions beside the fitted columns, and c (K,) with the residuals.

    total: squares of the residuals, of `count` readings; at: positions of each cause's directions; sided: whether only
    a positive coefficient is physical; absorbed: shift of the fitted parameters per coefficient
    """

    G: Array
    c: Array
    total: float
    count: int
    stated: bool
    at: tuple[Indices, ...]
    sided: tuple[bool, ...]
    absorbed: tuple[Array, ...]
    bounds: Bounds | None

    @cached_property
    def visible(self) -> list[int]:
        """Positions of the causes that have directions."""
        return [i for i, at in enumerate(self.at) if len(at)]

    def ebic(self, rss: float, dof: int, size: int, classes: int) -> float:
        """EBIC less that of no cause."""
        fall = rss - self.total if self.stated else self.count * float(np.log(max(rss, 1e-300) / self.total))
        return fall + dof * float(np.log(self.count)) + 2.0 * float(np.log(comb(classes, size)))

    def solve(self, members: tuple[int, ...]) -> tuple[float, Array, bool]:
        """Squares left by a subset, its coefficients, and whether it is physical: signs and bounds kept."""
        index = np.concatenate([self.at[i] for i in members])
        z: Array = np.asarray(np.linalg.solve(self._own(index), self.c[index]), dtype=np.float64)
        return self.total - float(self.c[index] @ z), z, self._physical(members, z)

    def _own(self, index: Indices) -> Array:
        return self.G[np.ix_(index, index)] + _RIDGE * np.eye(len(index))

    def _physical(self, members: tuple[int, ...], z: Array) -> bool:
        first = 0
        shift = 0.0
        for i in members:
            part = z[first : first + len(self.at[i])]
            if self.sided[i] and part[0] < 0.0:
                return False
            shift = shift + self.absorbed[i] @ part
            first += len(part)
        if self.bounds is None:
            return True
        ends = self.bounds.value + shift
        started = self.bounds.value >= self.bounds.lower
        return bool(np.all((ends >= self.bounds.lower - _BEYOND * self.bounds.sd) | ~started))

    def beside(self, members: Sequence[int]) -> tuple[Array, Array]:
        """G and c of all directions after a subset has taken its part."""
        if not len(members):
            return self.G, self.c
        index = np.concatenate([self.at[i] for i in members])
        W = np.linalg.solve(self._own(index), np.column_stack([self.G[index], self.c[index]]))
        return self.G - self.G[:, index] @ W[:, :-1], self.c - self.G[:, index] @ W[:, -1]

    def falls(self, members: Sequence[int], others: Sequence[int]) -> Array:
        """By how much each other cause lowers the squares beside a subset (len(others),)."""
        G, c = self.beside(members)
        out = np.zeros(len(others))
        for n, i in enumerate(others):
            at = self.at[i]
            if len(at) == 1:
                d = G[at[0], at[0]]
                out[n] = c[at[0]] ** 2 / d if d > _FLOOR else 0.0
            else:
                part = G[at[0] : at[-1] + 1, at[0] : at[-1] + 1] + _FLOOR * np.eye(len(at))
                out[n] = float(c[at] @ np.linalg.solve(part, c[at]))
        return out


def make_gram(
    subspaces: Sequence[Subspace],
    residuals: Array,
    stated: bool,
    bounds: Bounds | None,
    A: Array | None = None,
    kept: Indices | None = None,
) -> Gram:
    """Products of the subspaces; of some scalar readings `kept` only, where A (m, f) must be taken out again."""
    ends = np.cumsum([0, *(s.Q.shape[1] for s in subspaces)])
    Q = np.concatenate([s.Q for s in subspaces], axis=1)
    if A is not None and kept is not None:
        basis, _ = np.linalg.qr(A[kept])
        Q, residuals = left(basis, Q[kept]), left(basis, residuals[kept])
    return Gram(
        G=Q.T @ Q,
        c=Q.T @ residuals,
        total=float(residuals @ residuals),
        count=len(residuals),
        stated=stated,
        at=tuple(np.arange(a, b) for a, b in pairwise(map(int, ends))),
        sided=tuple(s.one_sided for s in subspaces),
        absorbed=tuple(s.absorbed for s in subspaces),
        bounds=bounds,
    )


def search(gram: Gram, classes: Sequence[int], largest: int = LARGEST) -> list[Subset]:
    """Physical subsets up to a size, best first. classes: positions to choose from, one for each set of aliases."""
    choice = [i for i in classes if len(gram.at[i])]
    found: list[Subset] = []
    grown: list[Subset] = [Subset((), gram.total, 0, 0.0)]
    for size in range(1, min(largest, len(choice)) + 1):
        level: dict[tuple[int, ...], Subset] = {}
        for start in grown:
            others = [i for i in choice if i not in start.members]
            for i, fall in zip(others, gram.falls(start.members, others), strict=True):
                members = tuple(sorted((*start.members, i)))
                dof, rss = start.dof + len(gram.at[i]), start.rss - float(fall)
                level[members] = Subset(members, rss, dof, gram.ebic(rss, dof, size, len(choice)))
        best = sorted(level.values(), key=lambda s: s.ebic)
        wanted = len(best) if size == 1 else _GROWN
        kept: list[Subset] = []
        for subset in best:
            if len(kept) == wanted:
                break
            if gram.solve(subset.members)[2]:
                kept.append(subset)
        found += kept
        grown = kept
    return sorted(found, key=lambda s: s.ebic)


def parts_of(subset: Subset, gram: Gram) -> list[Subset]:
    """The subset and every smaller one of its members, for exact fits: squares and EBIC are not known (NaN)."""
    members = sorted(subset.members)
    nan = float("nan")
    some = (part for size in range(1, len(members) + 1) for part in combinations(members, size))
    return [Subset(part, nan, sum(len(gram.at[i]) for i in part), nan) for part in some]
