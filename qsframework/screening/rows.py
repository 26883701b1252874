"""Readings that cannot be right: what a finding is, and rows that nobody read or that were copied."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.experiment import Readings
from qsframework.plugin import Array, Indices

LEVEL = 0.01
"""Of all tests together: clean readings give any false finding in at most so many cases."""
KINDS = ("zero", "duplicate", "late angles", "swapped markers", "gross", "tool", "small model", "block", "angles")
_COARSE = 5e-6
"""m: repeats written no finer than this may be equal by chance."""


@dataclass(frozen=True, eq=False)
class Finding:
    """What is wrong with some readings: rows are lines of the file, mask (R,) True where a row should not be used."""

    kind: str
    rows: tuple[int, ...]
    words: str
    mask: Array


def masked(readings: Readings, findings: Sequence[Finding]) -> Readings:
    """The same readings with `use` False where a finding says so."""
    wrong = np.zeros(len(readings), dtype=bool)
    for one in findings:
        wrong |= one.mask.astype(bool)
    return readings.masked(wrong)


def finding(kind: str, readings: Readings, index: Indices, words: str, mask: bool = True) -> Finding:
    """What is wrong with the rows at `index` (k,) of the readings; mask False: said only."""
    wrong = np.zeros(len(readings), dtype=bool)
    wrong[index] = mask
    return Finding(kind, tuple(int(r) for r in readings.line[index]), words, wrong)


def lines(readings: Readings, rows: Indices) -> str:
    """Rows with their poses, and their file where there are several: `row 7 (pose 3, gauge.csv)`."""
    file = [f", {source.name}" for source in readings.sources] if len(readings.sources) > 1 else [""]
    told = [
        f"{readings.line[i]} (pose {readings.states.pose[readings.plus[i]]}{file[readings.file[i]]})" for i in rows[:5]
    ]
    more = f" and {len(rows) - 5} more" if len(rows) > 5 else ""
    return f"row{'s' if len(rows) > 1 else ''} {', '.join(told)}{more}"


def unread(readings: Readings) -> list[Finding]:
    """Values that are zero to the last digit, where the instrument did not read; and copies of other rows, of which the
    first one stays."""
    values = np.nan_to_num(readings.value)
    whole = np.isfinite(readings.value).all(axis=1)
    found: list[Finding] = []
    rows = np.flatnonzero(readings.use & ~np.any(values, axis=1))
    for position in (False, True):
        part = rows[readings.is_position[rows] == position]
        if len(part):
            what = "position" if position else "displacement"
            words = f"{lines(readings, part)}: the {what} is exactly zero: nothing was read"
            found.append(finding("zero", readings, part, words))
    seen: dict[object, int] = {}
    coarse = bool(np.allclose(values / _COARSE, np.round(values / _COARSE), atol=1e-6))
    copies: dict[int, list[int]] = {}
    pose = readings.pose
    for i in np.flatnonzero(readings.use & whole & np.any(values, axis=1)).tolist():
        first = seen.setdefault(tuple(np.round(np.asarray(values[i]), 12).tolist()), i)
        if coarse and pose[i] == pose[first]:
            continue
        if first != i and np.count_nonzero(values[i]) == 3:
            copies.setdefault(first, []).append(i)
    for first, more in copies.items():
        what = "position" if readings.is_position[first] else "displacement"
        words = f"{lines(readings, np.array(more))}: the same {what} to the last digit as in row {readings.line[first]}"
        found.append(finding("duplicate", readings, np.array(more), f"{words}: a row was copied"))
    return found
