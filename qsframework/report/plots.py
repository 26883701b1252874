"""How every plot of a report looks: Okabe and Ito's colours, each with a symbol, and one template."""

from __future__ import annotations

import html
from typing import Any

import numpy as np

from qsframework.plugin import Array
from qsframework.report.blocks import Plot

BLUE, ORANGE, GREEN, PURPLE, SKY, AMBER, BLACK = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#56B4E9",
    "#E69F00",
    "#000000",
)
"""Okabe, Ito 2008: told apart by everybody."""
COLOURS = (BLUE, ORANGE, GREEN, PURPLE, AMBER, SKY, BLACK)
SYMBOLS = ("circle", "diamond", "square", "triangle-up", "x", "cross", "star")
DASHES = ("solid", "dash", "dot", "dashdot")
BEFORE: dict[str, Any] = {"color": ORANGE, "symbol": "diamond-open"}
AFTER: dict[str, Any] = {"color": BLUE, "symbol": "circle"}
"""Markers of what was before, and after."""
BARS: tuple[dict[str, Any], ...] = (
    {"color": ORANGE, "pattern": {"shape": "/", "fgcolor": "white", "fillmode": "overlay", "size": 6}},
    {"color": BLUE},
)
"""The same of bars: hatched before, full after."""
GREY = "#707070"
_AXIS = {
    "gridcolor": "#e4e4e4",
    "zerolinecolor": "#c8c8c8",
    "linecolor": "#888",
    "ticks": "outside",
    "tickcolor": "#888",
    "automargin": True,
    "title": {"font": {"size": 13}},
}
TEMPLATE: dict[str, Any] = {
    "layout": {
        "font": {"family": "system-ui, sans-serif", "size": 13, "color": "#222"},
        "colorway": list(COLOURS),
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "margin": {"l": 64, "r": 16, "t": 40, "b": 56},
        "xaxis": _AXIS,
        "yaxis": _AXIS,
        "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
        "hovermode": "closest",
    },
    "data": {"scatter": [{"type": "scatter", "marker": {"symbol": s, "size": 6}} for s in SYMBOLS]},
}


def blank(title: str, x: str, y: str, height: int = 360) -> Plot:
    """An empty plot with its title and those of its axes."""
    from plotly.graph_objects import Figure

    axes: dict[str, Any] = {"xaxis": {"title": {"text": x}}, "yaxis": {"title": {"text": y}}}
    return Figure(layout={"title": {"text": html.escape(title)}, **axes, "template": TEMPLATE, "height": height})


def panels(
    title: str,
    rows: int,
    columns: int,
    titles: list[str],
    height: int,
    spacing: float | None = None,
    shared: bool = True,
    heights: list[float] | None = None,
) -> Plot:
    """Empty plots, as many as there are titles, in rows and columns under one title.

    shared: all of a row have one y axis; heights: of the rows, in proportion
    """
    empty = rows * columns - len(titles)
    drawn: list[dict[str, object] | None] = [*({} for _ in titles), *([None] * empty)]
    figure = blank(title, "", "", height).set_subplots(
        rows,
        columns,
        shared_yaxes=shared,
        subplot_titles=[*titles, *([""] * empty)],
        horizontal_spacing=spacing if heights is None else None,
        vertical_spacing=None if heights is None else spacing,
        row_heights=heights,
        specs=[drawn[k : k + columns] for k in range(0, len(drawn), columns)],
    )
    legend = {"orientation": "h", "x": 0, "y": 1.0 + 24.0 / (height - 132.0), "yanchor": "bottom"}
    return figure.update_annotations(font={"size": 13}).update_layout(margin={"t": 76}, legend=legend)


def _positive(values: Array) -> Array:
    return values[np.isfinite(values) & (values > 0.0)]


def log_axis(values: Array) -> dict[str, Any]:
    """A logarithmic axis over values that are above zero, with round numbers that are written out."""
    known = _positive(values)
    if not len(known):
        return {"type": "log"}
    low, high = float(np.log10(known.min())), float(np.log10(known.max()))
    room = max(0.05 * (high - low), 0.15)
    ticks = round_ticks(10.0 ** np.array([low - room, high + room]))
    return {
        "type": "log",
        "range": [low - room, high + room],
        "tickvals": ticks,
        "ticktext": [f"{v:g}" for v in ticks],
    }


def round_ticks(values: Array) -> list[float]:
    """Round numbers 1, 2, 5, 10, ... over the range of the values that are above zero."""
    known = _positive(values)
    if not len(known):
        return [1.0]
    low, high = int(np.floor(np.log10(known.min()))), int(np.ceil(np.log10(known.max())))
    steps = (1, 2, 5) if high - low < 3 else (1,)
    return [m * 10.0**k for k in range(low, high + 1) for m in steps if known.min() <= m * 10.0**k <= known.max()]


def plotted(values: Array) -> list[float | None]:
    """Numbers for a figure; what was not measured is left out."""
    return [v if v == v and abs(v) != float("inf") else None for v in values.tolist()]
