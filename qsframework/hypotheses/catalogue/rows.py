"""Rows that cannot be right: what is said of them, and rows that nobody read or that were copied."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from qsframework.errors import some_of
from qsframework.estimation.projection import Flags
from qsframework.experiment import Readings
from qsframework.experiment.frames import PLANE, POINT
from qsframework.plugin import Array, Indices

LEVEL = 0.01
"""Of all tests together: clean readings give any false finding in at most so many cases."""
_COARSE = 5e-6
"""m: repeats written no finer than this may be equal by chance."""


@dataclass(frozen=True, eq=False)
class WrongRows:
    """What is wrong with some readings: rows are lines of the file, mask (R,) True where a row should not be used.

    marker (R,): where only names of markers are wrong, those that were meant; file: of the rows, if several
    """

    name: str
    rows: tuple[int, ...]
    words: str
    mask: Flags
    marker: Indices | None = None
    file: str = ""

    def applied(self, readings: Readings) -> Readings:
        """The readings without these rows, or with their markers as they were meant."""
        if self.marker is None:
            return readings.masked(self.mask)
        return replace(readings, marker=np.where(self.mask, self.marker, readings.marker))


def masked(readings: Readings, masks: Iterable[Flags | None]) -> Readings:
    """The same readings with `use` False where a mask (R,) says so."""
    wrong = np.zeros(len(readings), dtype=bool)
    for mask in masks:
        wrong |= False if mask is None else mask
    return readings.masked(wrong)


def among(readings: Readings, index: Indices) -> Flags:
    """(R,) whether each row is one of those at `index` (k,)."""
    return np.isin(np.arange(len(readings)), index)


def as_series(readings: Readings, rows: Flags, name: str) -> Readings:
    """Some rows (R,) as a series of their own, whose frame is found."""
    frame = np.where(rows, len(readings.frames), readings.frame)
    return replace(readings, frame=frame, frames=(*readings.frames, name), known=(*readings.known, None))


def wrong_rows(name: str, readings: Readings, index: Indices, words: str, mask: bool = True) -> WrongRows:
    """What is wrong with the rows at `index` (k,) of the readings; mask False: said only."""
    wrong = among(readings, index) & mask
    return WrongRows(name, tuple(int(r) for r in readings.line[index]), words, wrong, file=file_of(readings, index))


def file_of(readings: Readings, index: Indices) -> str:
    """Name of the file of some rows (k,), where there are several."""
    if len(readings.sources) < 2 or not len(index):
        return ""
    return readings.sources[int(readings.file[index[0]])].name


def lines(readings: Readings, rows: Indices) -> str:
    """Rows with their poses, and their file where there are several: `row 7 (pose 3, gauge.csv)`."""
    file = [f", {source.name}" for source in readings.sources] if len(readings.sources) > 1 else [""]
    told = [f"{readings.line[i]} (pose {readings.states.pose[readings.plus[i]]}{file[readings.file[i]]})" for i in rows]
    return f"row{'s' if len(rows) > 1 else ''} {some_of(told, 5)}"


def unread(readings: Readings) -> list[WrongRows]:
    """Values that are zero to the last digit, where the instrument did not read; at a touched point it is met."""
    found: list[WrongRows] = []
    touched = np.array([*(name.startswith((POINT, PLANE)) for name in readings.frames), False])[readings.frame]
    rows = np.flatnonzero(readings.use & ~touched & ~np.any(np.nan_to_num(readings.value), axis=1))
    for position in (False, True):
        part = rows[readings.is_position[rows] == position]
        if len(part):
            words = f"{lines(readings, part)}: the {_what(position)} is exactly zero: nothing was read"
            found.append(wrong_rows("unread", readings, part, words))
    return found


def doubled(readings: Readings) -> list[WrongRows]:
    """Duplicate rows: the same values of a marker at the same angles under the same load, to the last digit, in
    a copy of the file, under another name or as a repeat. The first ones stay."""
    coarse, firsts = _coarse(readings), dict[bytes, int]()
    states = np.column_stack([readings.poses.q, readings.poses.wrench])[readings.plus]
    own = [np.nan_to_num(readings.value), states, readings.marker, readings.kind == "position"]
    keys: Array = np.asarray(np.round(np.column_stack(own), 12) + 0.0, dtype=np.float64)
    twice: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for i in np.flatnonzero(readings.use & np.all(np.nan_to_num(readings.value) != 0.0, axis=1)).tolist():
        first = firsts.setdefault(keys[i].tobytes(), i)
        if first != i and not (coarse and readings.pose[i] == readings.pose[first]):
            files = int(readings.file[first]), int(readings.file[i])
            twice.setdefault(files, []).append((first, i))
    found: list[WrongRows] = []
    for pairs in twice.values():
        first, again = (np.array(own, dtype=np.intp) for own in zip(*pairs, strict=True))
        one = f"{lines(readings, again[:1])} is {lines(readings, first[:1])} to the last digit"
        words = f"{one}: it stands twice" if len(pairs) == 1 else f"{len(pairs)} rows stand twice: {one}, and so on"
        found.append(wrong_rows("doubled_rows", readings, again, words))
    return found


def _coarse(readings: Readings) -> bool:
    """Whether values are written so coarsely that repeats may be equal by chance."""
    values = np.nan_to_num(readings.value)
    return bool(np.allclose(values / _COARSE, np.round(values / _COARSE), atol=1e-6))


def copies(readings: Readings) -> list[WrongRows]:
    """Rows that are copies of others to the last digit, of which the first one stays."""
    values, whole = np.nan_to_num(readings.value), np.isfinite(readings.value).all(axis=1)
    firsts: dict[object, int] = {}
    same: dict[int, list[int]] = {}
    coarse, pose, keys = _coarse(readings), readings.pose, np.round(values, 12).tolist()
    for i in np.flatnonzero(readings.use & whole & np.any(values, axis=1)).tolist():
        first = firsts.setdefault(tuple(keys[i]), i)
        if first != i and not (coarse and pose[i] == pose[first]) and np.all(values[i]):
            same.setdefault(first, []).append(i)
    found: list[WrongRows] = []
    for first, more in same.items():
        where = f"the same {_what(bool(readings.is_position[first]))} to the last digit as in row"
        words = f"{lines(readings, np.array(more))}: {where} {readings.line[first]}: a row was copied"
        found.append(wrong_rows("repeated_readings", readings, np.array(more), words))
    return found


def _what(position: bool) -> str:
    return "position" if position else "displacement"
