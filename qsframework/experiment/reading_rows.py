"""What each row of a table of readings measured: a vector, what a gauge read along a direction, or a touched point.

A marker that was read several times while the arm stood still is one row: its reads share the error of the visit.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from qsframework.errors import MOST_PROBLEMS, Problem
from qsframework.estimation.tails import chi2_cdf
from qsframework.experiment.columns import WRENCH, XYZ, Table, joint_stems, numbered, strength_problems
from qsframework.experiment.frames import PLANE, POINT
from qsframework.experiment.readings import axes_along
from qsframework.experiment.readings_table import ALONG, MOVED
from qsframework.experiment.setup import Experiment
from qsframework.plugin import Array, Indices

Flags = npt.NDArray[np.bool_]
"""Of each row, (R,)."""
_TOLD_APART = ("read", "sigma", "time", "temperature", "time_unloaded", "temperature_unloaded", "use")
"""Columns in which reads of one marker at one visit may differ, beside what was measured."""
_SURE = 1e-3
"""Chance below which reads of one visit differ by less than the stated noise has them: the rest is the visit's."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredRows:
    """R rows of a table and what they measured.

    pendant (R, n) rad, wrench (R, 6) N and N m, 0 where nothing stands; use, gauge (R,); marker, to (R,): its place in
    the experiment, and that of the other end of a distance, -1 for none; sigma (R,) m, NaN where the row has none;
    value (R, 3) m and axes (R, 3, 3) as in `Readings`; points: the frame that stands for what was touched, "" for none;
    normals (3,) of the plates among them; problems: what is wrong so far
    """

    table: Table
    of_states: bool
    reads: Reads
    pendant: Array
    wrench: Array
    use: Flags
    marker: Indices
    sigma: Array
    value: Array
    axes: Array | None
    to: Indices
    gauge: Flags
    points: tuple[str, ...]
    normals: dict[str, Array]
    problems: list[Problem]

    @property
    def kind(self) -> npt.NDArray[np.str_]:
        """The kind (R,) of each row."""
        return np.where(self.gauge, "gauge", "position" if self.of_states else "displacement")

    @property
    def who(self) -> list[Hashable]:
        """Marker, and of gauges the other marker and the direction: what one state is read of once."""
        if self.axes is None:
            return self.marker.tolist()
        along = [tuple(u) if g else () for u, g in zip(self.axes[:, 0].round(9).tolist(), self.gauge, strict=True)]
        return list(zip(self.marker.tolist(), self.to.tolist(), along, strict=True))


def measured_rows(table: Table, experiment: Experiment, of_states: bool) -> MeasuredRows:
    """What the rows of a table of states, or of displacements, measured; reads of one visit are one row."""
    stems, robot = XYZ if of_states else MOVED, experiment.robot
    table, reads = averaged(table, (*stems, "gauge"))
    wrench, use = table.columns(WRENCH, 0.0), table.column("use", 1.0) != 0
    marker, to = _places(table, "marker", 0, experiment), _places(table, "to_marker", -1, experiment)
    touched = np.array(table.text("point")) != ""
    read, along = _gauge_cells(table, touched)
    gauge, size, vector = np.isfinite(read), np.linalg.norm(along, axis=1), table.columns(stems)
    problems = [*table.problems, *strength_problems(table, wrench, robot.payload, robot.gravity)]
    problems += _gauge_problems(table, gauge, np.any(np.isfinite(vector), axis=1), size, marker, to)
    plates = touched & gauge & (to < 0)
    points = tuple(
        f"{PLANE if on else POINT}{p}" if p else "" for p, on in zip(table.text("point"), plates, strict=True)
    )
    axes = _axes(along, gauge & (size > 0) & (to < 0)) if gauge.any() else None
    problems += _point_problems(table, points, gauge & ~plates, axes)
    normals = {} if axes is None else {points[i]: np.array(axes[i]) for i in map(int, np.flatnonzero(plates)[::-1])}
    if axes is not None:
        axes[plates] = np.eye(3)
    value = np.where(gauge[:, None], np.stack([read, *np.full((2, len(read)), np.nan)], axis=1), vector)
    value = np.where((touched & ~gauge)[:, None], np.nan_to_num(value), value)
    return MeasuredRows(
        table=table,
        of_states=of_states,
        reads=reads,
        pendant=table.columns(joint_stems(robot.controller.axes)),
        wrench=np.nan_to_num(wrench, nan=0.0),
        use=use,
        marker=marker,
        sigma=table.column("sigma"),
        value=value,
        axes=axes,
        to=to,
        gauge=gauge & ~plates,
        points=points,
        normals=normals,
        problems=[*problems, *_unfilled(table, use & ~np.isfinite(value).any(axis=1), (*stems, "gauge"))],
    )


def _places(table: Table, stem: str, missing: int, experiment: Experiment) -> Indices:
    """Place (R,) of each row's marker in the experiment."""
    places = {name: k for k, name in enumerate(experiment.marker_names)}
    return np.array([places.get(name, missing) for name in table.text(stem)], dtype=np.intp)


def _gauge_cells(table: Table, touched: Flags) -> tuple[Array, Array]:
    """What gauges read (R,) m, and along which direction (R, 3), NaN where there is none; rows that touch a plate read
    zero where they read nothing."""
    along = table.columns(ALONG)
    along = np.where(np.isfinite(along).any(axis=1, keepdims=True), np.nan_to_num(along, nan=0.0), np.nan)
    read = table.column("gauge")
    return np.where(touched & np.isnan(read) & (np.linalg.norm(along, axis=1) > 0), 0.0, read), along


def _axes(along: Array, pointed: Flags) -> Array:
    """Axes (R, 3, 3) of rows that read along a direction (R, 3), those of the base of others."""
    return np.stack([axes_along(u) if own else np.eye(3) for u, own in zip(along, pointed, strict=True)])


def _gauge_problems(
    table: Table, gauge: Flags, vector: Flags, size: Array, marker: Indices, to: Indices
) -> list[Problem]:
    """Rows (R,) with a direction of this size or another marker that are of no gauge, and gauges of two or no ways."""
    distance, pointed, alone = to >= 0, size > 0, gauge & ~vector
    stray = ~gauge & vector & (distance | np.isfinite(size))
    message = "the row is of a vector: a direction or another marker belongs to a gauge"
    hint = "Fill in gauge_mm in a row of its own, or leave this empty."
    out = table.each(stray & distance, "to_marker", message, hint)
    out += table.each(stray & ~distance, "ux", message, hint)
    hint = "Give it a row of its own: each row is of one instrument."
    out += table.each(gauge & vector, "gauge", "a gauge and a vector stand in one row", hint)
    hint = "Give ux, uy, uz, the direction in the base frame of any length, or to_marker."
    message = "the gauge has a direction and a marker to which it measures"
    out += table.each(alone & pointed & distance, "gauge", message, hint)
    out += table.each(alone & ~pointed & ~distance, "gauge", "the gauge has no direction", hint)
    itself = alone & ~pointed & (to == marker)
    return out + table.each(itself, "to_marker", "a distance is to another marker", hint)


def _point_problems(table: Table, points: tuple[str, ...], gauge: Flags, axes: Array | None) -> list[Problem]:
    """Rows of touched points that are of a gauge or of a series too, points that were touched once, and plates of
    several normals."""
    series = table.text("series")
    count, first = Counter(points), {name: i for i, name in reversed(list(enumerate(points)))}
    out: list[Problem] = []
    for i, name in enumerate(points):
        kind, _, own = name.partition(":")
        if name and (gauge[i] or series[i]):
            stem = "gauge" if gauge[i] else "series"
            hint = "Give it a row of its own: the place of a point is in the axes of the base."
            out.append(table.problem(i, stem, f"the row touches the {kind} {own!r} and is of a {stem} too", hint=hint))
        elif name and count[name] == 1:
            hint = "Touch it at two poses or more, all with ux, uy, uz or none."
            out.append(table.problem(i, "point", f"the {kind} {own!r} is touched once, which says nothing", hint=hint))
        elif kind == "plane" and axes is not None and np.abs(axes[i, 0] - axes[first[name], 0]).max() > 1e-6:
            line = table.rows[first[name]]
            out.append(table.problem(i, "ux", f"the plane {own!r} has another normal than in line {line}"))
        elif series[i].startswith((POINT, PLANE)):
            message = f"a series does not begin with {POINT!r} or {PLANE!r}"
            out.append(table.problem(i, "series", message, repr(series[i])))
    return out[:MOST_PROBLEMS]


def _unfilled(table: Table, empty: Flags, stems: Sequence[str]) -> list[Problem]:
    """One problem for all rows in which nothing was measured."""
    told = {p.line for p in table.problems if p.column in {table.names.get(s) for s in stems}}
    rows = [i for i in np.flatnonzero(empty).tolist() if table.rows[i] not in told]
    if not rows:
        return []
    many = f"{len(rows)} rows are not filled in, of which this is the first"
    message = many if len(rows) > 1 else "this row is not filled in"
    hint = "Fill in what was measured; put 0 in the column use of a row that was not."
    stem = next((s for s in stems if s in table.names), stems[0])
    return [table.problem(rows[0], stem, message, "''", "a number", hint)]


@dataclass(frozen=True, eq=False)
class Reads:
    """count (R,): of how many reads each row is the mean; spread: sd (m) of reads about the means of their visits, over
    the whole table, with its degrees of freedom; unnumbered: how many rows were taken as further reads of a visit,
    which no column says."""

    count: Indices
    spread: float = 0.0
    freedom: int = 0
    unnumbered: int = 0

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
    table, unnumbered = _numbered_reads(table, measured)
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
    spread = _spread([table.numbers[m] for m in measured if m in table.numbers], group, use)
    reads = Reads(np.maximum(used, 1), *spread, unnumbered)
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


def _numbered_reads(table: Table, measured: Sequence[str]) -> tuple[Table, int]:
    """The table with a column `read` where none numbers them, and how many rows are further reads: rows of one marker
    one after the other, at the same angles and in the same state, are of one visit, under whatever pose names.

    Not where a column says another repeat, cycle or visit, where the arm had the time to go away and come back between
    them, or where they are copies of one another.
    """
    numbers, texts = dict(table.numbers), dict(table.texts)
    visit = numbers.pop("visit", None)
    if visit is not None:
        numbers = {"repeat": visit} | numbers
    table = replace(table, numbers=numbers)
    constant = [v for stem, v in numbers.items() if stem not in (*_TOLD_APART, *measured, "ux", "uy", "uz")]
    named = [v for stem, v in texts.items() if stem not in ("pose", "marker", "to_marker", "point")]
    if "read" in numbers or not constant:
        return table, 0
    stands = np.nan_to_num(np.stack(constant, axis=1), nan=np.inf)
    alike = (stands[1:] == stands[:-1]).all(axis=1)
    for words in named:
        alike &= np.array(words[1:]) == np.array(words[:-1])
    time = table.column("time")
    gap = np.abs(np.diff(time))
    away = gap[~alike & np.isfinite(gap)]
    run = np.cumsum(np.r_[0, ~(alike & ~(gap >= away.min(initial=np.inf)))])
    who = [texts[stem] for stem in ("marker", "to_marker", "point") if stem in texts]
    who += [numbers[stem].tolist() for stem in ("ux", "uy", "uz") if stem in numbers]
    group, first = numbered(
        [tuple("nan" if v != v else v for v in key) for key in zip(run.tolist(), *who, strict=True)]
    )
    read = np.ones(len(run))
    order = np.argsort(group, kind="stable")
    start = np.r_[True, group[order][1:] != group[order][:-1]]
    read[order] = np.arange(len(run)) - np.maximum.accumulate(np.where(start, np.arange(len(run)), 0)) + 1
    values = np.nan_to_num(table.columns(measured), nan=np.inf)
    copies = {int(run[i]) for i in np.flatnonzero((read > 1) & (values == values[first[group]]).all(axis=1))}
    several = np.isin(run, run[read > 1]) & ~np.isin(run, list(copies))
    if not several.any():
        return table, 0
    opens = np.unique(run, return_index=True)[1]
    pose = [texts["pose"][opens[r]] if own else name for r, own, name in zip(run, several, texts["pose"], strict=True)]
    read = np.where(several, read, 1.0)
    told = replace(table, numbers=numbers | {"read": read}, texts=texts | {"pose": pose})
    return told, int((read > 1).sum())


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
