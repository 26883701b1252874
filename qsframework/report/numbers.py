"""The numbers of a figure as a table, read off the figure itself, so that both always say the same."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from qsframework.plugin import Array
from qsframework.report.blocks import Plot, ReportTable

_CURVE = 60
"""A line of more points than this is a smooth curve: about this many of them are told."""
MATRIX = 15
"""Rows of a matrix that are read as one."""
_STRONGEST = 5
_MARKUP = re.compile(r"<[^>]+>")


def figure_table(figure: Plot) -> ReportTable:
    """Every number of a plot's traces: series side by side where they share their x, else one after another.

    Heat maps become a matrix. Columns carry the titles of the axes.
    """
    traces = [t for t in figure.data if t.type != "heatmap"]
    maps = [t for t in figure.data if t.type == "heatmap"]
    if maps:
        return _matrix(maps[0])
    series = [_Series(t, i) for i, t in enumerate(traces)]
    x, y = _title(figure, "xaxis") or "x", _title(figure, "yaxis") or "y"
    note = "" if not any(s.thinned for s in series) else "Of smooth curves some points are listed."
    if all(a.x == b.x for a, b in pairwise(series)):
        rows = zip(series[0].x, *(s.y for s in series), strict=True)
        names = (
            (y,) if len(series) == 1 else tuple(f"{s.name}: {y}" if i == 0 else s.name for i, s in enumerate(series))
        )
        return ReportTable((x, *names), tuple(tuple(map(_cell, row)) for row in rows), note)
    rows = ((s.name, _cell(a), _cell(b)) for s in series for a, b in zip(s.x, s.y, strict=True))
    return ReportTable(("series", x, y), tuple(rows), note)


class _Series:
    """One trace: its name and its points as lists."""

    def __init__(self, trace: Any, number: int) -> None:
        self.name = _plain(trace.name or f"series {number + 1}")
        y = list(trace.y)
        x = list(range(1, len(y) + 1) if trace.x is None else trace.x)
        self.thinned = trace.type == "scatter" and trace.mode == "lines" and len(x) > _CURVE
        step = -(-len(x) // _CURVE) if self.thinned else 1
        self.x, self.y = [_plain(v) for v in x[::step]], y[::step]


def _matrix(trace: Any) -> ReportTable:
    """A heat map with its labels."""
    shown = trace.z if trace.customdata is None else trace.customdata
    header = ("", *(_plain(str(v)) for v in trace.x))
    return ReportTable(
        header, tuple((_plain(str(label)), *map(_cell, row)) for label, row in zip(trace.y, shown, strict=True))
    )


def matrix_table(names: Sequence[str], strength: Array, values: Array, written: str) -> ReportTable:
    """A square matrix (n, n) of values for people: whole where it is small, else the strongest entries of each row.

    strength (n, n): by which entries of a row are chosen, the largest first; written: the format of a value
    """
    if len(names) <= MATRIX:
        rows = [(name, *(_number(v, written) for v in line)) for name, line in zip(names, values.tolist(), strict=True)]
        return ReportTable(("", *names), tuple(rows))
    order = np.argsort(-np.where(np.eye(len(names), dtype=bool) | np.isnan(strength), -np.inf, strength), axis=1)
    said = [
        ", ".join(f"{names[j]} {_number(float(values[i, j]), written)}" for j in best)
        for i, best in enumerate(order[:, :_STRONGEST].tolist())
    ]
    return ReportTable(("", f"with: the {_STRONGEST} strongest"), tuple(zip(names, said, strict=True)))


def _number(value: float, written: str) -> str:
    return "-" if value != value else format(value, written)


def _title(figure: Plot, axis: str) -> str:
    return str(_plain(figure.layout[axis].title.text or ""))


def _plain(value: Any) -> Any:
    """Text without the markup that plotly would draw."""
    import html

    return html.unescape(_MARKUP.sub(" ", value)) if isinstance(value, str) else value


def _cell(value: Any) -> str:
    """A number with four digits; words as they are; nothing as a dash."""
    if value is None or (isinstance(value, float) and value != value):
        return "-"
    return value if isinstance(value, str) else f"{value:.4g}"


def row_table(header: Sequence[str], columns: Sequence[Sequence[Any]], caption: str = "") -> ReportTable:
    """A table from columns of numbers or words."""
    return ReportTable(tuple(header), tuple(tuple(map(_cell, row)) for row in zip(*columns, strict=True)), caption)
