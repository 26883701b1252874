"""Reads: a marker that was read several times while the arm stood still. They share the error of the visit: one row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.errors import MOST_PROBLEMS, Problem
from qsframework.estimation.tails import chi2_cdf
from qsframework.experiment.columns import Table, numbered
from qsframework.plugin import Array, Indices

_TOLD_APART = ("read", "sigma", "time", "temperature", "time_unloaded", "temperature_unloaded", "use")
"""Columns in which reads of one marker at one visit may differ, beside what was measured."""
_SURE = 1e-3
"""Chance below which reads of one visit differ by less than the stated noise has them: the rest is the visit's."""


@dataclass(frozen=True, eq=False)
class Reads:
    """count (R,): of how many reads each row is the mean; spread: sd (m) of reads about the means of their visits, over
    the whole table, with its degrees of freedom."""

    count: Indices
    spread: float = 0.0
    freedom: int = 0

    def sigma(self, one: Array) -> Array:
        """sd (R,) of the rows where that of one reading is stated, the error of its visit included.

        Where reads differ by less than that, the rest is what they share, and no mean takes it away.
        """
        share = np.minimum(np.square(self.spread / np.maximum(one, 1e-300)), 1.0)
        own = np.where(chi2_cdf(share * self.freedom, self.freedom) < _SURE, share, 1.0) if self.freedom else 1.0
        return np.asarray(one * np.sqrt(1.0 - own + own / self.count), dtype=np.float64)


def averaged(table: Table, measured: Sequence[str]) -> tuple[Table, Reads]:
    """One row for all reads of a marker at one visit, the mean of those in use, and what is known of these.

    The sd of a row that states its own is that of the mean. Rows of one visit that differ in angles or load are no
    reads of one another: a problem of the table.
    """
    if "read" not in table.numbers:
        return table, Reads(np.ones(len(table.rows), dtype=np.intp))
    same = {stem: values for stem, values in table.numbers.items() if stem not in (*_TOLD_APART, *measured)}
    placed = [stem for stem in same if stem in ("repeat", "cycle", "ux", "uy", "uz")]
    keys = list(zip(*table.texts.values(), *(same[stem].tolist() for stem in placed), strict=True))
    group, first = numbered([tuple("nan" if v != v else v for v in key) for key in keys])
    problems = [*table.problems, *_read_twice(table, group), *_elsewhere(table, same, group, first)]
    numbers = {stem: values[first] for stem, values in table.numbers.items() if stem != "read"}
    use = table.column("use", 1.0) != 0
    used = np.bincount(group, use, len(first)).astype(np.intp)
    reads = Reads(np.maximum(used, 1), *_spread([table.numbers[m] for m in measured if m in table.numbers], group, use))
    for stem in table.numbers:
        if stem in measured or (stem in _TOLD_APART and stem not in ("read", "use", "sigma")):
            numbers[stem] = _mean(table.numbers[stem], group, use | (used[group] == 0), len(first))
    if "sigma" in table.numbers:
        square = np.bincount(group, np.where(use, table.numbers["sigma"] ** 2, 0.0), len(first))
        numbers["sigma"] = np.where(used > 0, reads.sigma(np.sqrt(square / reads.count)), numbers["sigma"])
    if "use" in table.numbers:
        numbers["use"] = (used > 0).astype(float)
    at = [int(i) for i in first]
    texts = {stem: [values[i] for i in at] for stem, values in table.texts.items()}
    told = replace(table, rows=[table.rows[i] for i in at], numbers=numbers, texts=texts, problems=problems)
    return told, reads


def _spread(measured: Sequence[Array], group: Indices, use: Array) -> tuple[float, int]:
    """sd of numbers about the means of their groups, and its degrees of freedom."""
    square, freedom = 0.0, 0
    for values in measured:
        told = np.isfinite(values) & use
        mean = _mean(values, group, use, int(group.max(initial=-1)) + 1)
        square += float(np.square(values[told] - mean[group[told]]).sum())
        freedom += int(told.sum()) - len(np.unique(group[told]))
    return (float(np.sqrt(square / freedom)), freedom) if freedom else (0.0, 0)


def _mean(values: Array, group: Indices, use: Array, count: int) -> Array:
    """Mean of the numbers in use by group (count,), NaN where none is told."""
    told = np.isfinite(values) & use
    total = np.bincount(group, np.where(told, values, 0.0), count)
    many = np.bincount(group, told, count)
    return np.where(many > 0, total / np.maximum(many, 1), np.nan)


def _read_twice(table: Table, group: Indices) -> list[Problem]:
    reads = table.column("read").tolist()
    again, first = numbered(list(zip(group.tolist(), reads, strict=True)))
    message = "read {:.0f} of this marker at this visit stands here twice; first in line {}"
    hint = "Number reads without moving 1, 2, 3, ...; another visit has its own number in the column repeat."
    return [
        table.problem(i, "read", message.format(reads[i], table.rows[first[again[i]]]), hint=hint)
        for i in map(int, np.flatnonzero(first[again] != np.arange(len(again)))[:MOST_PROBLEMS])
    ]


def _elsewhere(table: Table, same: dict[str, Array], group: Indices, first: Indices) -> list[Problem]:
    """Reads at other angles or under another load than the first of their visit."""
    message = "a read without moving has the angles and the load of line {}"
    hint = "Give another visit a number of its own in the column repeat."
    return [
        table.problem(i, stem, message.format(table.rows[int(first[group[i]])]), hint=hint)
        for stem, values in same.items()
        for there in [values[first][group]]
        for i in map(int, np.flatnonzero((values != there) & ~(np.isnan(values) & np.isnan(there))))
    ][:MOST_PROBLEMS]
