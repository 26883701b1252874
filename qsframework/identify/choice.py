"""Which of many parameters readings can tell, and what absorbs the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array

REDUNDANT = 1e-5
"""Share of a column that must be new, seen from the columns chosen before it."""
_NOTHING = 1e-6
"""Scaled size of a column below which readings tell nothing of its parameter, not even a million typical sizes."""
_SHARE = 0.2
_NAMED = 3


@dataclass(frozen=True)
class LeftAside:
    """A parameter that is not estimated; `sd` in its typical sizes if it were, inf where it makes no difference."""

    name: str
    absorbed_by: tuple[str, ...]
    sd: float

    def words(self) -> str:
        """Why, in one sentence."""
        if not self.absorbed_by and np.isinf(self.sd):
            return f"{self.name}: no reading depends on it"
        others = ", ".join(self.absorbed_by)
        if np.isinf(self.sd):
            return f"{self.name}: absorbed by {others}"
        told = f"{self.name}: hardly told, to {self.sd:.2g} times its typical size"
        return f"{told}; it looks like {others}" if others else told


def choose(rows: Array, names: Sequence[str], limits: Array) -> tuple[list[int], tuple[LeftAside, ...]]:
    """Take columns of rows (m, p), whitened and scaled by typical sizes, in their order.

    A column is left aside where those taken before leave less than REDUNDANT of it, or where its
    parameter would be told only to more than `limits` (p,) of its typical sizes; beyond a million of them it counts as
    not told at all.
    """
    R: Array = np.asarray(np.linalg.qr(rows, mode="r")) if len(rows) > rows.shape[1] else rows
    basis = np.zeros((len(R), 0))
    taken: list[int] = []
    left: list[LeftAside] = []
    for c in range(R.shape[1]):
        column, size = R[:, c], float(np.linalg.norm(R[:, c]))
        fresh = column - basis @ (basis.T @ column)
        fresh -= basis @ (basis.T @ fresh)
        new = float(np.linalg.norm(fresh))
        redundant = new <= REDUNDANT * size
        if not redundant and new * limits[c] >= 1.0:
            taken.append(c)
            basis = np.column_stack([basis, fresh / new])
            continue
        sd = np.inf if redundant or new < _NOTHING else 1.0 / new
        left.append(LeftAside(names[c], _absorbers(R, taken, column, names) if size > _NOTHING else (), sd))
    return taken, tuple(left)


def _absorbers(R: Array, taken: Sequence[int], column: Array, names: Sequence[str]) -> tuple[str, ...]:
    """The taken columns that make up most of a column, largest share first."""
    if not taken:
        return ()
    chosen = R[:, list(taken)]
    share = np.abs(np.linalg.lstsq(chosen, column, rcond=None)[0]) * np.linalg.norm(chosen, axis=0)
    order = [i for i in np.argsort(-share, kind="stable")[:_NAMED] if share[i] >= _SHARE * np.linalg.norm(column)]
    return tuple(names[taken[int(i)]] for i in order)
