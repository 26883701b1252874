"""Which of many parameters columns of readings can tell, in which order they are taken, and what absorbs the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics import Model
from qsframework.files import FileRecord
from qsframework.plugin import Array, Geometry, Sensor, Spring

REDUNDANT = 1e-5
"""Share of a column that must be new, seen from the columns chosen before it."""
_NOTHING = 1e-6
"""Scaled size of a column below which readings tell nothing of its parameter, not even a million natural sizes."""
_SHARE = 0.2
_NAMED = 5


@dataclass(frozen=True)
class NotEstimated(FileRecord):
    """A parameter that is not estimated, and those that make up what readings show of it."""

    name: str
    correlated_with: tuple[str, ...]

    def words(self) -> str:
        """Why, in one sentence."""
        if not self.correlated_with:
            return f"{self.name}: no reading depends on it"
        return f"{self.name}: confounded with {', '.join(self.correlated_with)}"


def choose(rows: Array, names: Sequence[str]) -> tuple[list[int], tuple[NotEstimated, ...]]:
    """Take columns of rows (m, p), whitened and scaled by natural sizes, in their order.

    A column is not taken where those taken before leave less than REDUNDANT of it, or where its sd would be above a
    million natural sizes.
    """
    R: Array = np.asarray(np.linalg.qr(rows, mode="r")) if len(rows) > rows.shape[1] else rows
    basis = np.zeros((len(R), 0))
    taken: list[int] = []
    left: list[NotEstimated] = []
    largest = float(np.linalg.norm(R, axis=0).max(initial=0.0))
    for c in range(R.shape[1]):
        column, size = R[:, c], float(np.linalg.norm(R[:, c]))
        fresh = column - basis @ (basis.T @ column)
        fresh -= basis @ (basis.T @ fresh)
        new = float(np.linalg.norm(fresh))
        if new > REDUNDANT * size and size > 1e-12 * largest and new >= _NOTHING:
            taken.append(c)
            basis = np.column_stack([basis, fresh / new])
            continue
        seen = size > max(_NOTHING, 1e-12 * largest)
        left.append(NotEstimated(names[c], _absorbers(R, basis, taken, column, names) if seen else ()))
    return taken, tuple(left)


def _absorbers(R: Array, basis: Array, taken: Sequence[int], column: Array, names: Sequence[str]) -> tuple[str, ...]:
    """The taken columns, of an orthonormal basis, that make up most of a column, largest share first."""
    chosen = R[:, list(taken)]
    share = np.abs(np.linalg.solve(basis.T @ chosen, basis.T @ column)) * np.linalg.norm(chosen, axis=0)
    order = [i for i in np.argsort(-share, kind="stable")[:_NAMED] if share[i] >= _SHARE * np.linalg.norm(column)]
    return tuple(names[taken[int(i)]] for i in order)


def in_order(model: Model, names: Sequence[str]) -> list[str]:
    """The names to fit, physically simple ones first: markers, zeros and sag, springs, placements, others."""
    rank: dict[str, int] = {}
    for effect, part in zip(model.effects, model.slices, strict=True):
        place = 4
        if isinstance(effect, Sensor):
            place = 0
        elif isinstance(effect, Geometry):
            place = 3 if effect.moves_placements else 1
        elif isinstance(effect, Spring):
            place = 2
        rank |= dict.fromkeys(model.names[part], place)
    wanted = set(names)
    return sorted((n for n in model.names if n in wanted), key=lambda n: rank[n])
