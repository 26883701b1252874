"""How alike two causes look: principal angles between what they can do to the readings.

Readings of visible size s mistake one of two one-parameter causes at angle phi for the other in about
Phi(-s sin(phi / 2)). Angles come from sines and cosines together, so that small ones keep their digits.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np

from qsframework.estimation.tails import normal_isf, normal_sf
from qsframework.hypotheses.columns import Subspace, by_size
from qsframework.plugin import Array, Indices

ALIKE = float(np.deg2rad(1.0))
"""Causes whose directions all lie within this angle do the same to the readings."""
_ROUNDING = 1e-9
"""Of a square of a cosine."""


class _Directions:
    """All directions in coordinates of their common span, so that a pair costs little however many readings."""

    def __init__(self, subspaces: Sequence[Subspace]):
        sizes = [s.Q.shape[1] for s in subspaces]
        ends = np.cumsum([0, *sizes])
        self.sizes = np.array(sizes)
        self.at = [slice(a, b) for a, b in pairwise(ends)]
        self.sided = np.array([s.one_sided for s in subspaces], dtype=bool)
        every = np.concatenate([s.Q for s in subspaces], axis=1) if subspaces else np.zeros((0, 0))
        tall = every.shape[0] > every.shape[1]
        self.Q = np.asarray(np.linalg.qr(every, mode="r") if tall else every, dtype=np.float64)
        self.groups = list(by_size(self.sizes))

    def angles(self, i: int, whole: bool = True) -> tuple[Array, Array]:
        """Smallest and largest principal angle (G,) of cause i with each cause; nan with itself and invisible ones.

        whole: also those of a cause with one direction with causes of several, which the row of the other one tells
        """
        count = len(self.sizes)
        smallest, largest = np.full(count, np.nan), np.full(count, np.nan)
        own = self.Q[:, self.at[i]]
        if not own.shape[1]:
            return smallest, largest
        cosines = own.T @ self.Q
        left = self.Q - own @ cosines
        left -= own @ (own.T @ left)
        for of, columns in self.groups:
            if columns.shape[1] == 1:
                column = columns[:, 0]
                cosine: Array = np.linalg.norm(cosines[:, column], axis=0)
                if self.sided[i]:  # two causes that can only grow may point away from each other
                    cosine = np.where(self.sided[of], cosines[0, column], cosine)
                smallest[of] = largest[of] = np.arctan2(np.linalg.norm(left[:, column], axis=0), cosine)
            elif whole or self.sizes[i] > 1:
                smallest[of], largest[of] = _extremes(cosines.T[columns], left.T[columns])
        smallest[i] = largest[i] = np.nan
        return smallest, largest

    @cached_property
    def _products(self) -> Array:
        return self.Q.T @ self.Q

    def near(self, i: int, angle: float) -> Indices:
        """The other causes of as many directions that may all lie within an angle of those of cause i: none of their
        directions has less in its span than the angle leaves."""
        of, columns = next(group for group in self.groups if i in group[0])
        held = np.square(self._products[self.at[i]])[:, columns].sum(axis=0).min(axis=1)
        return of[(held > np.cos(angle) ** 2 - _ROUNDING) & (of != i)]


def _extremes(cosines: Array, left: Array) -> tuple[Array, Array]:
    """Smallest and largest principal angles (n,) from the products (n, k2, k1) of one basis with n others of k2
    directions, and what it leaves (n, k2, m) of these."""
    (k2, k1), m = cosines.shape[1:], left.shape[2]
    cosine = np.linalg.svd(cosines, compute_uv=False)
    sine = np.linalg.svd(left, compute_uv=False)
    shared = min(k1, k2)
    most = sine[:, k2 - shared] if m >= k2 else sine[:, 0]
    return np.arctan2(sine[:, -1], cosine[:, 0]), np.arctan2(most, cosine[:, shared - 1])


def angle_matrix(subspaces: Sequence[Subspace], largest: bool = False) -> Array:
    """Smallest (or largest) principal angle (G, G), rad, of every pair; nan on the diagonal and for invisible causes.

    Between two causes that can only grow the angle is signed and reaches pi.
    """
    directions = _Directions(subspaces)
    rows = [directions.angles(i, False)[int(largest)] for i in range(len(subspaces))]
    out = np.stack(rows) if rows else np.zeros((0, 0))
    return np.fmin(out, out.T)


def smallest_angles(subspaces: Sequence[Subspace], i: int) -> Array:
    """Row i of `angle_matrix` (G,)."""
    return _Directions(subspaces).angles(i)[0]


def alias_classes(subspaces: Sequence[Subspace]) -> tuple[tuple[int, ...], ...]:
    """Positions of visible causes that do the same to the readings: as many directions, all within ALIKE.

    Most classes have one member. The first member of a class stands for it.
    """
    directions = _Directions(subspaces)
    classes: list[list[int]] = []
    home: dict[int, list[int]] = {}
    for i, subspace in enumerate(subspaces):
        if i in home or not subspace.visible:
            continue
        alike = directions.near(i, ALIKE)
        if len(alike):
            alike = alike[directions.angles(i, False)[1][alike] < ALIKE]
        members = [i, *(j for j in alike.tolist() if j not in home)]
        home.update({j: members for j in members})
        classes.append(members)
    return tuple(tuple(sorted(c)) for c in classes)


def mistaken(s: float, angle: float) -> float:
    """Probability that a cause of visible size s is mistaken for another one at this angle (rad)."""
    return float(normal_sf(s * float(np.sin(min(angle, np.pi) / 2.0))))


def named_from(angle: float, share: float = 0.95) -> float:
    """The visible size s from which a cause is named right in this share, against one rival at an angle (rad)."""
    sine = float(np.sin(min(angle, np.pi) / 2.0)) if np.isfinite(angle) else 1.0
    return float(-normal_isf(share)) / sine if sine > 0.0 else float("inf")
