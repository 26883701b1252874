"""Causes that the readings cannot tell from a named one: test inversion at 95 %.

A cause stays in the set if, were it the true one with its own estimated size, the best other cause would win by as
much as it did in at least 5 % of repeated measurements. The angle between what two causes can do says why: of two
one-parameter causes at angle phi, readings of size s mistake one for the other in about Phi(-s sin(phi / 2)).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from qsframework.hypotheses.search.subsets import Gram
from qsframework.plugin import Array, Indices

CONFIDENCE = 0.95
_DRAWS = 400
_FAR = 60.0
"""Loss of chi-square beyond which a cause is no rival, without a simulation."""
_FLOOR = 1e-6


@dataclass(frozen=True, eq=False)
class Contest:
    """All causes beside those that are taken as given: one whitening per cause turns coefficients into squares.

    G (K, K), c (K,): products of the directions that remain; at: positions of each cause in them
    """

    G: Array
    c: Array
    at: tuple[Indices, ...]
    sided: tuple[bool, ...]
    half: tuple[Array, ...]

    @cached_property
    def _whole(self) -> tuple[Array, Array, Indices]:
        """All halves in one matrix (K, k), which of its columns count where positive alone, and whose each is (k,)."""
        owner = np.repeat(np.arange(len(self.half)), [h.shape[1] for h in self.half])
        H = np.zeros((len(self.c), len(owner)))
        first = 0
        for at, half in zip(self.at, self.half, strict=True):
            H[at, first : first + half.shape[1]] = half
            first += half.shape[1]
        return H, np.array(self.sided)[owner], owner

    def parts(self, c: Array) -> Array:
        """What coefficients (draws, K) come to along the directions of each cause (draws, k)."""
        return np.asarray(c @ self._whole[0], dtype=np.float64)

    def falls(self, parts: Array) -> Array:
        """By how much each cause lowers the squares (draws, G)."""
        _, sided, owner = self._whole
        square = np.square(np.where(sided, np.maximum(parts, 0.0), parts))
        out = np.zeros((len(parts), len(self.at)))
        edges = np.flatnonzero(np.diff(owner, prepend=-1))
        if len(edges):
            out[:, owner[edges]] = np.add.reduceat(square, edges, axis=1)
        return out


def contest(gram: Gram, given: Sequence[int], without: Sequence[int] = ()) -> Contest:
    """The contest of all causes but some, beside the given ones."""
    G, c = gram.beside(given)
    half: list[Array] = []
    for i, at in enumerate(gram.at):
        if i in without:
            half.append(np.zeros((len(at), 0)))
            continue
        values, vectors = np.linalg.eigh(G[np.ix_(at, at)])
        kept = values > _FLOOR
        half.append(vectors[:, kept] / np.sqrt(values[kept]))
    sided = tuple(s and h.shape[1] == 1 and h[0, 0] > 0 for s, h in zip(gram.sided, half, strict=True))
    return Contest(G, c, gram.at, sided, tuple(half))


def alternative_set(
    gram: Gram,
    named: int,
    given: Sequence[int],
    exact: Mapping[int, float],
    seed: int = 0,
    without: Sequence[int] = (),
) -> tuple[int, ...]:
    """Causes that may stand in the place of `named` beside the `given` ones, the likeliest first; never the named.

    exact: squares that the exact fit leaves with each cause in this place, where such a fit was made; without: causes
    that do not compete, such as all axes of a place of which one is named
    """
    race = contest(gram, given, without)
    falls = race.falls(race.parts(race.c[None]))[0]
    left = gram.solve(given)[0] - falls
    for i, rss in exact.items():
        left[i] = rss
    others = [i for i in gram.visible if i not in {*given, *without, named} and left[i] - left[named] < _FAR]
    rng = np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(race.G)
    noise = race.parts(rng.standard_normal((_DRAWS, len(values))) @ (vectors * np.sqrt(np.maximum(values, 0.0))).T)
    kept = [i for i in others if _possible(race, i, left[i] - left[named], noise, given)]
    return tuple(sorted(kept, key=lambda i: left[i]))


def _possible(race: Contest, i: int, behind: float, noise: Array, given: Sequence[int]) -> bool:
    """Whether cause i, were it true, would be as far behind the best in a fair share of repeated measurements."""
    half = race.half[i]
    if not half.size:
        return False
    at = race.at[i]
    part = race.c[at] @ half
    if race.sided[i]:
        part = np.maximum(part, 0.0)
    falls = race.falls(noise + race.parts(race.G[:, at] @ (half @ part)))
    falls[:, list(given)] = 0.0
    lost = falls.max(axis=1) - falls[:, i]
    return bool(behind <= np.quantile(lost, CONFIDENCE) + 1e-9)
