"""The visits of the arm in a table of readings, in the order of the file."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from qsframework.experiment import ReadingRows
from qsframework.plugin import Indices


@dataclass(frozen=True, eq=False)
class Visits:
    """The visits of the arm in the order of the file: the states of each, and the visit (R,) of each row of a fit."""

    states: tuple[tuple[int, ...], ...]
    of: Indices

    def __len__(self) -> int:
        return len(self.states)

    def reversed(self) -> Visits:
        """The same, the last one first."""
        return Visits(self.states[::-1], len(self) - 1 - self.of)


def visits_of(rows: ReadingRows) -> Visits:
    """Rows of one `plus` are one visit, with the unloaded states that no other visit shares."""
    order = list(dict.fromkeys(rows.plus.tolist()))
    before: dict[int, set[int]] = {s: set() for s in order}
    shared: dict[int, set[int]] = {}
    for s, m in zip(rows.plus.tolist(), rows.minus.tolist(), strict=True):
        if m >= 0:
            before[s].add(m)
            shared.setdefault(m, set()).add(s)
    states = tuple((s, *(m for m in sorted(before[s]) if len(shared[m]) == 1)) for s in order)
    number = {s: i for i, s in enumerate(order)}
    return Visits(states, np.array([number[s] for s in rows.plus.tolist()]))


def stops_of(rows: ReadingRows) -> Visits:
    """The same with all states of one pose after each other as one visit."""
    seen = visits_of(rows)
    names = [rows.readings.states.pose[s[0]] for s in seen.states]
    stop = np.cumsum([False, *(a != b for a, b in pairwise(names))])
    states = [tuple(s for v in np.flatnonzero(stop == k) for s in seen.states[v]) for k in range(int(stop[-1]) + 1)]
    return Visits(tuple(states), stop[seen.of])
