"""What `qsf check` found, what is known of the parameters before the readings, and the readings by row."""

from __future__ import annotations

import html
from collections import Counter
from collections.abc import Sequence

import numpy as np

from qsframework.experiment import Experiment, Readings
from qsframework.experiment.prior import families, priors_of
from qsframework.plugin import Array
from qsframework.report.blocks import Figure, Plot, ReportTable, Section
from qsframework.report.numbers import row_table
from qsframework.report.plots import blank
from qsframework.report.words.sizes import people_size

_STATE = {True: "as it should be", False: "look at it", None: "not measured"}
Found = tuple[str, str, Sequence[tuple[bool | None, str, str]]]
"""A file, what it is, and lines: whether good, kind, words."""


def found_section(files: Sequence[Found]) -> Section:
    """One row for each thing that was looked at."""
    rows: list[tuple[str, ...]] = []
    for name, words, lines in files:
        rows.append((name, "read", "without errors", words))
        rows += [(name, kind, _STATE[good], said) for good, kind, said in lines]
    return Section(
        "What was found",
        (
            ReportTable(
                ("file", "looked at", "result", "in words"),
                tuple(rows),
                "Rows that say 'look at it' deserve a look at the file or the machine before any fit.",
            ),
        ),
    )


def prior_table(experiment: Experiment, readings: Readings | None = None) -> ReportTable:
    """The families that are to be estimated with these readings: how many there are, the sd of each (1 sigma) and where
    it is from."""
    model, names = experiment.model(), experiment.fit_names()
    known, kinds = priors_of(model, readings), families(model, names)
    rows = Counter[tuple[str, str, str]]()
    for name, i in zip(names, model.index(names), strict=True):
        told = np.isfinite(known.sd[i])
        sd = people_size(model.parameters[i], float(known.sd[i]), stiffness=False) if told else "-"
        rows[kinds[name][0], sd, known.source[i]] += 1
    return ReportTable(
        ("known before", "parameters", "sd", "from"),
        tuple((effect, str(count), sd, source) for (effect, sd, source), count in rows.items()),
        "One standard deviation of the values in the files; a maker's +- limit is two of it.",
    )


def readings_section(experiment: Experiment, readings: Readings, name: str) -> Section:
    """The readings' sizes by row of the file."""
    displaced = not readings.is_position.any()
    size = np.where(readings.is_position, _apart(readings), np.linalg.norm(np.nan_to_num(readings.value), axis=1) * 1e3)
    markers = [m.name for m in experiment.markers]
    marker = [markers[int(k)] for k in readings.marker]
    pose = list(readings.pose)
    used = ["yes" if u else "no" for u in readings.use]
    what = "displacement, mm" if displaced else "from the mean of the same state, mm"
    said = (
        what
        if displaced
        else "the distance from the mean of the same marker, pose and load; 0 where it is the only one"
    )
    caption = (
        f"The size of each reading ({said}) by row of the file; crosses are masked rows. Look for single rows far from "
        f"those around them, {'for zeros, ' if displaced else ''}and for a trend over the day."
    )
    rows = readings.line.tolist()
    header = ("row", "pose", "marker", what, "used")
    table = row_table(header, [list(map(str, rows)), pose, marker, size.tolist(), used])
    return Section(f"Readings of {name}", (Figure(_sizes(rows, size.tolist(), marker, used, what), caption, table),))


def _apart(readings: Readings) -> Array:
    """Distances (R,) mm of positions from the mean of their marker's at the same pose under the same load."""
    out, states = np.zeros(len(readings)), readings.states
    of = [
        (states.series[s], states.pose[s], bool(states.loaded[s]), states.load_id[s] if states.loaded[s] else "")
        for s in map(int, readings.plus)
    ]
    groups = list(zip(of, map(int, readings.marker), map(bool, readings.is_position), strict=True))
    for group in dict.fromkeys(g for g in groups if g[2]):
        at = np.array([g == group for g in groups])
        out[at] = 1e3 * np.linalg.norm(
            np.nan_to_num(readings.value[at] - np.nanmean(readings.value[at], axis=0)), axis=1
        )
    return out


def _sizes(rows: list[int], size: list[float], marker: list[str], used: list[str], what: str) -> Plot:
    figure = blank("Readings by row", "row of the readings file", what)
    for name in dict.fromkeys(marker):
        at = [i for i, m in enumerate(marker) if m == name]
        symbols = ["circle" if used[i] == "yes" else "x" for i in at]
        figure.add_scatter(
            x=[rows[i] for i in at],
            y=[size[i] for i in at],
            mode="markers",
            name=html.escape(name),
            marker={"size": 6, "symbol": symbols},
        )
    return figure
