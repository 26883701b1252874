"""What `qsf check` found, and the readings by row."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

import numpy as np

from qsframework.experiment import Experiment, Readings, StateReadings
from qsframework.report.blocks import Figure, Section, Table
from qsframework.report.numbers import row_table

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
            Table(
                ("file", "looked at", "result", "in words"), tuple(rows),
                "Rows that say 'look at it' deserve a look at the file or the machine before any fit.",
            ),
        ),
    )  # fmt: skip


def readings_section(experiment: Experiment, readings: Readings | StateReadings, name: str) -> Section:
    """The readings' sizes by row of the file."""
    displaced = isinstance(readings, Readings)
    size = np.linalg.norm(readings.displacement, axis=1) * 1e3 if isinstance(readings, Readings) else _apart(readings)
    markers = [m.name for m in experiment.markers]
    marker = [markers[int(k)] for k in readings.marker]
    pose = [readings.pose[int(m)] for m in readings.measurement]
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
    rows = readings.rows.tolist()
    header = ("row", "pose", "marker", what, "used")
    table = row_table(header, [list(map(str, rows)), pose, marker, size.tolist(), used])
    return Section(f"Readings of {name}", (Figure(_sizes(rows, size.tolist(), marker, used, what), caption, table),))


def _apart(states: StateReadings) -> Any:
    """Distances (R,) mm of positions from the mean of their marker's at the same pose under the same load."""
    out = np.zeros(len(states.marker))
    of = [(states.series[m], states.pose[m], bool(states.loaded[m]), states.load_id[m] if states.loaded[m] else "")
          for m in map(int, states.measurement)]  # fmt: skip
    groups = list(zip(of, map(int, states.marker), strict=True))
    for group in dict.fromkeys(groups):
        at = np.array([g == group for g in groups])
        out[at] = 1e3 * np.linalg.norm(states.position[at] - states.position[at].mean(axis=0), axis=1)
    return out


def _sizes(rows: list[int], size: list[float], marker: list[str], used: list[str], what: str) -> Any:
    import plotly.graph_objects as go

    figure = go.Figure(layout={"title": {"text": "Readings by row"}, "template": "plotly_white", "height": 380,
                               "xaxis": {"title": {"text": "row of the readings file"}},
                               "yaxis": {"title": {"text": what}}})  # fmt: skip
    for name in dict.fromkeys(marker):
        at = [i for i, m in enumerate(marker) if m == name]
        symbols = ["circle" if used[i] == "yes" else "x" for i in at]
        figure.add_scatter(x=[rows[i] for i in at], y=[size[i] for i in at], mode="markers", name=html.escape(name),
                           marker={"size": 6, "symbol": symbols})  # fmt: skip
    return figure
