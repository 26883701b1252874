"""Runs of rows that hold other values: in another unit than the others, those of another row or pose, another marker's.

With orthonormal whitened columns Q of a linear fit and y its readings, other values y + d in some rows leave
|y + d|^2 - |Q'(y + d)|^2: of every run at once, by sums from the first row on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from qsframework.estimation import orthonormal
from qsframework.hypotheses.catalogue.edits import INCH, SAYS
from qsframework.hypotheses.catalogue.rows import among, lines
from qsframework.hypotheses.hypothesis import Hypothesis
from qsframework.hypotheses.linearized import Linearized
from qsframework.plugin import Array, Indices

_UNITS = (
    (1e3, "m where the others are in mm"),
    (1e-3, "um where the others are in mm"),
    (INCH, "inches where the others are in mm"),
    (1.0 / INCH, "mm where the others are in inches"),
)
_LEAST = 3
"""Poses' worth of rows of a run, and of those beside one in another unit: of fewer poses other changes say more."""
_MOST = 500
"""Rows up to which all runs are looked at; of more, those that end with the table or begin with it."""
MOST_OF_IT = 0.05
"""Share of what is left as given that a right answer leaves at most: one that merely fits better stands for another."""
NEAR_NOISE = 16.0
"""Times the stated variance that a right answer leaves at most."""
_MARKERS = 4
"""Markers of which all orders are tried."""


def run_of_rows(fit: Linearized) -> Hypothesis | None:
    """The run of rows with other values with which next to nothing is left; None without one.

    What makes readings smaller makes all misfits smaller: it is believed where nothing else comes near the noise.
    """
    sigma = fit.rows.flat(fit.rows.sigma)
    Q, y = orthonormal(fit.slopes / sigma[:, None]), fit.errors / sigma
    near = NEAR_NOISE * (len(y) - Q.shape[1]) if fit.stated else 0.0
    found: list[tuple[bool, bool, float, Hypothesis]] = []
    visit = np.unique(np.stack([fit.rows.plus, fit.rows.minus], axis=1), axis=0, return_inverse=True)[1].ravel()
    each = int(np.median(np.bincount(visit)))
    for other in _others(fit, visit, each):
        d = fit.rows.flat(other.value - fit.rows.measured) / sigma
        rest = 1 if other.step else _LEAST * each
        start, end = _best(_Sums(fit.row, len(fit.keep), Q, y, d), _LEAST * each, rest)
        # what is lost at its end misleads the search by so many rows
        late, early = max(other.step, 0), max(-other.step, 0)
        near_by = [(start + k, end) for k in range(late + 1)] + [(start, end - k) for k in range(1, early + 1)]
        square, run = min((_judged(fit, other, d, Q, y, *ends) for ends in near_by), key=lambda x: x[0])
        found.append((square > near, other.smaller, square, run))
    best = min(found, key=lambda x: x[:3], default=None)
    return best[3] if best is not None and best[2] < MOST_OF_IT * _square(Q, y) else None


def _judged(
    fit: Linearized, other: _Other, d: Array, Q: Array, y: Array, start: int, end: int
) -> tuple[float, Hypothesis]:
    """What a run leaves without the rows that are lost, infinite where it says no more than none; and the run."""
    count, rows = len(fit.keep), np.arange(start, end)
    lost = np.arange(start - other.step, start) if other.step > 0 else np.arange(end, end - other.step)
    lost = lost[(lost >= 0) & (lost < count)]
    here, kept = np.isin(fit.row, rows), ~np.isin(fit.row, lost)
    own = orthonormal(Q[kept])
    square = _square(own, (y + np.where(here, d, 0.0))[kept])
    nothing = _square(own, (y - np.where(here, fit.rows.scalars / fit.rows.flat(fit.rows.sigma), 0.0))[kept])
    value = np.array(fit.readings.value)
    value[fit.keep[rows]] = other.value[rows]
    changed = fit.readings.with_values(value).masked(among(fit.readings, fit.keep[lost]))
    words = f"{lines(fit.readings, fit.keep[rows])}: {other.what}"
    tried = len(fit.readings) ** 2
    run = Hypothesis(other.name, 1.0, words, fit.experiment, readings=changed, tried=tried).at(fit.keep[rows])
    return (square if len(rows) and nothing - square > SAYS else np.inf), run


def _square(Q: Array, y: Array) -> float:
    return float(y @ y - np.square(Q.T @ y).sum())


@dataclass(frozen=True, eq=False)
class _Other:
    """What the values (R, 3) may have been; step: by how many rows they slipped; smaller: whether they get smaller."""

    name: str
    what: str
    value: Array
    step: int = 0
    smaller: bool = False


def _others(fit: Linearized, visit: Indices, each: int) -> Iterator[_Other]:
    """visit (R,): of each row; each: rows of one."""
    measured, rows = fit.rows.measured, fit.rows
    if not fit.readings.is_position[fit.keep].any():
        for factor, words in _UNITS:
            said = f"the displacements are in {words}"
            yield _Other("rows_unit", said, measured * factor, smaller=factor < 1.0)
    if not rows.mask.all():
        return
    file = fit.readings.file[fit.keep]
    for size, what in {1: "row", each: "pose"}.items():
        for step, words in ((size, "after"), (-size, "before")):
            other = np.roll(measured, step, axis=0)
            edge = np.roll(file, step) != file
            edge[slice(step) if step > 0 else slice(step, None)] = True
            other[edge] = measured[edge]
            yield _Other("rows_slipped", f"each holds what belongs to the {what} {words} it", other, step)
    yield from _exchanged(fit, visit)


def _exchanged(fit: Linearized, visit: Indices) -> Iterator[_Other]:
    """The markers of every visit in other orders, where all visits have all of a few."""
    rows, names = fit.rows, [m.name for m in fit.experiment.markers]
    used = [int(m) for m in np.unique(rows.marker)]
    order = np.lexsort((rows.marker, visit))
    whole = len(order) == len(used) * (int(visit.max()) + 1)
    if not 2 <= len(used) <= _MARKERS or not whole or (rows.marker[order].reshape(-1, len(used)) != used).any():
        return
    for places in list(permutations(range(len(used))))[1:]:
        value = np.empty_like(rows.measured)
        value[order] = rows.measured[order].reshape(-1, len(used), 3)[:, places].reshape(-1, 3)
        pairs = [f"{names[used[p]]} is {names[used[i]]}" for i, p in enumerate(places) if i != p]
        yield _Other("swapped_markers", f"the names of the markers are exchanged: {', '.join(pairs)}", value)


class _Sums:
    """Of R rows, from the first one on: d'd, 2 d'y and Q'd (R + 1, ...) of other values d (m,)."""

    def __init__(self, row: Indices, count: int, Q: Array, y: Array, d: Array) -> None:
        parts = (np.square(d) + 2.0 * d * y)[:, None], Q * d[:, None]
        total, along = (np.zeros((count + 1, p.shape[1])) for p in parts)
        for out, part in zip((total, along), parts, strict=True):
            np.add.at(out[1:], row, part)
        self.total, self.along = np.cumsum(total[:, 0]), np.cumsum(along, axis=0)
        self.start, self.plain = Q.T @ y, float(y @ y)

    def left(self, first: Indices, last: Indices) -> Array:
        """The sum of squares (n,) that runs leave."""
        along = self.start + self.along[last] - self.along[first]
        return self.plain + self.total[last] - self.total[first] - np.square(along).sum(axis=1)


def _best(sums: _Sums, least: int, rest: int) -> tuple[int, int]:
    """The run of so many rows and more, with at least `rest` beside it, that leaves least: from a row to before
    another."""
    count, best = len(sums.total) - 1, (np.inf, 0, 0)
    for start in range(count) if count <= _MOST else (0,):
        last = np.arange(start + least, min(count, count - rest + start) + 1)
        if len(last):
            left = sums.left(np.full(len(last), start), last)
            best = min(best, (float(left.min()), start, int(last[left.argmin()])))
    first = np.arange(rest, max(count - least + 1, rest))
    if len(first):
        left = sums.left(first, np.full(len(first), count))
        best = min(best, (float(left.min()), int(first[left.argmin()]), count))
    return best[1:]
