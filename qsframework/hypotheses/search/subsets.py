"""Which few causes together explain the residuals best: all subsets, from one Gram matrix, by the extended BIC.

EBIC (gamma = 1) of a subset: chi-square + k log m + 2 log(number of subsets of its size). All pairs are looked at; of
larger subsets those that grow from the best smaller ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, pairwise
from math import comb

import numpy as np

from qsframework.estimation import left
from qsframework.estimation.projection import Flags
from qsframework.hypotheses.columns import Subspace
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
    at: tuple[Indices, ...]
    sided: tuple[bool, ...]
    absorbed: tuple[Array, ...]
    bounds: Bounds | None

    @cached_property
    def sizes(self) -> Indices:
        """How many directions each cause has."""
        return np.array([len(at) for at in self.at], dtype=np.intp)

    @cached_property
    def _first(self) -> Indices:
        """Of each cause's directions, which stand side by side."""
        return np.cumsum(self.sizes) - self.sizes

    @cached_property
    def visible(self) -> list[int]:
        """Positions of the causes that have directions."""
        return [i for i, at in enumerate(self.at) if len(at)]

    def ebic(
        self, rss: Array | float, dof: Indices | int, size: int, classes: int, total: float | None = None
    ) -> Array:
        """EBIC of subsets of one size that leave rss (n,), less that of no cause, which leaves `total`."""
        fall = self.count * np.log(np.maximum(rss, 1e-300) / (self.total if total is None else total))
        return fall + dof * np.log(self.count) + 2.0 * np.log(comb(classes, size))

    def solve(self, members: Sequence[int]) -> tuple[float, Array, bool]:
        """Squares left by a subset, its coefficients, and whether it is physical: signs and bounds kept."""
        index = self._places(members)
        z: Array = np.asarray(np.linalg.solve(self._own(index), self.c[index]), dtype=np.float64)
        return self.total - float(self.c[index] @ z), z, self._physical(members, z)

    def _places(self, members: Sequence[int]) -> Indices:
        """Those of all directions of a subset (k,)."""
        return np.concatenate([np.zeros(0, dtype=np.intp), *(self.at[i] for i in members)])

    def _own(self, index: Indices) -> Array:
        """Products (..., k, k) of directions (..., k) among themselves."""
        return self.G[index[..., :, None], index[..., None, :]] + _RIDGE * np.eye(index.shape[-1])

    def _physical(self, members: Sequence[int], z: Array) -> bool:
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

    def given(self, members: Sequence[int], without: Sequence[int] = ()) -> Gram:
        """The same after a subset has taken its part, without the directions of some causes."""
        (index,), (W,) = self._taken([members])
        return replace(
            self,
            G=self.G - self.G[:, index] @ W[:, :-1],
            c=self.c - self.G[:, index] @ W[:, -1],
            total=self.total - float(self.c[index] @ W[:, -1]),
            at=tuple(at[:0] if i in without else at for i, at in enumerate(self.at)),
        )

    @cached_property
    def whitening(self) -> tuple[Array, Indices]:
        """H (K, k), which turns coefficients into independent ones along what each cause can do, and whose each is."""
        half: list[Array] = []
        for at in self.at:
            values, vectors = np.linalg.eigh(self.G[np.ix_(at, at)])
            kept = values > _FLOOR
            half.append(vectors[:, kept] / np.sqrt(values[kept]))
        owner = np.repeat(np.arange(len(half)), [h.shape[1] for h in half])
        H = np.zeros((len(self.c), len(owner)))
        for i, at in enumerate(self.at):
            H[np.ix_(at, np.flatnonzero(owner == i))] = half[i]
        return H, owner

    def squares(self, parts: Array) -> Array:
        """By how much each cause alone lowers the squares (draws, G), from coefficients along H (draws, k)."""
        owner = self.whitening[1]
        sided = np.array(self.sided)[owner] & (self.sizes[owner] == 1)
        square = np.square(np.where(sided, np.maximum(parts, 0.0), parts))
        out = np.zeros((len(parts), len(self.at)))
        edges = np.flatnonzero(np.diff(owner, prepend=-1))
        if len(edges):
            out[:, owner[edges]] = np.add.reduceat(square, edges, axis=1)
        return out

    def _taken(self, subsets: Sequence[Sequence[int]]) -> tuple[Indices, Array]:
        """Directions (n, k) of subsets that have as many, and what of all directions and the residuals they hold
        (n, k, K + 1)."""
        index: Indices = np.array([self._places(s) for s in subsets], dtype=np.intp)
        W = np.linalg.solve(self._own(index), np.concatenate([self.G[index], self.c[index][..., None]], axis=2))
        return index, np.asarray(W, dtype=np.float64)

    def falls(self, members: Sequence[int], others: Sequence[int]) -> Array:
        """By how much each other cause lowers the squares beside a subset (len(others),)."""
        return self.falls_beside([members], others)[0]

    def falls_beside(self, subsets: Sequence[Sequence[int]], others: Sequence[int]) -> Array:
        """The same beside each of n subsets (n, len(others)); no cause does anything beside itself."""
        out = np.zeros((len(subsets), len(others)))
        if not out.size:
            return out
        chosen = np.asarray(others, dtype=np.intp)
        used = np.array([sum(len(self.at[i]) for i in s) for s in subsets])
        for k in map(int, np.unique(used)):
            rows = np.flatnonzero(used == k)
            index, W = self._taken([subsets[r] for r in rows.tolist()])
            for size in map(int, np.unique(self.sizes[chosen])):
                of = np.flatnonzero(self.sizes[chosen] == size)
                at: Indices = self._first[chosen[of]][:, None] + np.arange(size)
                taken = self.G[at[None, :, :, None], index[:, None, None, :]]
                c = self.c[at] - np.einsum("nosk,nk->nos", taken, W[:, :, -1])
                part = self.G[at[:, :, None], at[:, None, :]] - taken @ W[:, :, at].transpose(0, 2, 1, 3)
                out[np.ix_(rows, of)] = _fall(part, c)
        return out


def _fall(G: Array, c: Array) -> Array:
    """c' G^-1 c (...,) of directions (..., s, s) that may be hardly anything beside others."""
    if G.shape[-1] == 1:
        d = G[..., 0, 0]
        return np.where(d > _FLOOR, np.square(c[..., 0]) / np.maximum(d, _FLOOR), 0.0)
    solved = np.linalg.solve(G + _FLOOR * np.eye(G.shape[-1]), c[..., None])
    return (c * solved[..., 0]).sum(axis=-1)


def make_gram(
    subspaces: Sequence[Subspace],
    residuals: Array,
    bounds: Bounds | None,
    fitted: Array | None = None,
    kept: Indices | None = None,
) -> Gram:
    """Products of the subspaces; of some scalar readings `kept` only, where fitted (m, f) must be taken out again."""
    ends = np.cumsum([0, *(s.Q.shape[1] for s in subspaces)])
    Q = np.concatenate([s.Q for s in subspaces], axis=1)
    if fitted is not None and kept is not None:
        basis, _ = np.linalg.qr(fitted[kept])
        Q, residuals = left(basis, Q[kept]), left(basis, residuals[kept])
    return Gram(
        G=Q.T @ Q,
        c=Q.T @ residuals,
        total=float(residuals @ residuals),
        count=len(residuals),
        at=tuple(np.arange(a, b) for a, b in pairwise(map(int, ends))),
        sided=tuple(s.one_sided for s in subspaces),
        absorbed=tuple(s.absorbed for s in subspaces),
        bounds=bounds,
    )


def search(gram: Gram, classes: Sequence[int], largest: int = LARGEST) -> list[Subset]:
    """Physical subsets up to a size, best first. classes: positions to choose from, one for each set of aliases."""
    choice: Indices = np.array([i for i in classes if gram.sizes[i]], dtype=np.intp)
    found: list[Subset] = []
    grown: list[Subset] = [Subset((), gram.total, 0, 0.0)]
    for size in range(1, min(largest, len(choice)) + 1):
        others: list[Flags] = [~np.isin(choice, start.members) for start in grown]
        falls = gram.falls_beside([s.members for s in grown], choice.tolist())
        rss = [s.rss - fall[o] for s, fall, o in zip(grown, falls, others, strict=True)]
        dof: list[Indices] = [s.dof + gram.sizes[choice[o]] for s, o in zip(grown, others, strict=True)]
        of = np.repeat(np.arange(len(grown), dtype=np.intp), [int(o.sum()) for o in others])
        more: Indices = np.concatenate([choice[o] for o in others])
        left_over, used = np.concatenate(rss), np.concatenate(dof)
        ebic = gram.ebic(left_over, used, size, len(choice))
        seen: set[tuple[int, ...]] = set()
        kept: list[Subset] = []
        for n in map(int, np.argsort(ebic, kind="stable")):
            members: tuple[int, ...] = tuple(sorted((*grown[int(of[n])].members, int(more[n]))))
            if members not in seen and gram.solve(members)[2]:
                kept.append(Subset(members, float(left_over[n]), int(used[n]), float(ebic[n])))
                if size > 1 and len(kept) == _GROWN:
                    break
            seen.add(members)
        grown = kept
        found += grown
    return sorted(found, key=lambda s: s.ebic)


def parts_of(subset: Subset, gram: Gram) -> list[Subset]:
    """The subset and every smaller one of its members, for exact fits: squares and EBIC are not known (NaN)."""
    members = sorted(subset.members)
    nan = float("nan")
    some = (part for size in range(1, len(members) + 1) for part in combinations(members, size))
    return [Subset(part, nan, sum(len(gram.at[i]) for i in part), nan) for part in some]
