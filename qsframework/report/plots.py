"""How every plot of a report looks: Okabe and Ito's colours, each with a symbol, and one template.

A plot is written as Plotly's JSON (plotly.com/javascript/reference), which the page's own Plotly.js draws: a command
need not load the package plotly for it, which takes longer than most fits.
"""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from qsframework.plugin import Array

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
    {"color": ORANGE, "pattern": {"shape": "/", "fgcolor": "white", "size": 6}},
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
}
TEMPLATE: dict[str, Any] = {
    "layout": {
        "font": {"family": "system-ui, sans-serif", "size": 13, "color": "#222"},
        "colorway": list(COLOURS),
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "margin": {"l": 64, "r": 16, "t": 40, "b": 56},
        "xaxis": _AXIS,
        "yaxis": _AXIS,
        "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
        "hovermode": "closest",
    },
    "data": {"scatter": [{"type": "scatter", "marker": {"symbol": s, "size": 6}} for s in SYMBOLS]},
}


@dataclass(frozen=True, eq=False)
class Plot:
    """Traces and a layout that grow while a plot is drawn; across: how many plots stand in a row."""

    data: list[dict[str, Any]]
    layout: dict[str, Any]
    across: int = 1

    def add(self, kind: str, row: int = 1, col: int = 1, **trace: Any) -> None:
        """A trace of a kind, in the plot of a row and column."""
        number = self._number(row, col)
        axes = {"xaxis": f"x{number}", "yaxis": f"y{number}"} if "xaxis2" in self.layout else {}
        self.data.append({"type": kind, **trace, **axes})

    def update(self, **layout: Any) -> Plot:
        """Settings of the layout, beside what is there."""
        _merge(self.layout, layout)
        return self

    def axis(self, letter: str, row: int = 1, col: int = 1, **settings: Any) -> None:
        """Settings of the x or y axis of one plot."""
        _merge(self.layout[f"{letter}axis{self._number(row, col)}"], settings)

    def axes(self, letter: str, **settings: Any) -> None:
        """Settings of all x or y axes."""
        for name in [n for n in self.layout if n.startswith(f"{letter}axis")]:
            _merge(self.layout[name], settings)

    def line(self, letter: str, value: float, line: dict[str, Any], said: str = "") -> None:
        """A straight line at one value of x or y, through the whole plot, with a word at its end."""
        other = "y" if letter == "x" else "x"
        ends = {f"{letter}0": value, f"{letter}1": value, f"{other}0": 0, f"{other}1": 1}
        refs = {f"{letter}ref": letter, f"{other}ref": f"{other} domain"}
        self.layout.setdefault("shapes", []).append({"type": "line", "line": line, **ends, **refs})
        if said:
            side = {"xanchor": "left", "yanchor": "top"} if letter == "x" else {"xanchor": "right", "yanchor": "bottom"}
            where = {letter: value, other: 1, **side, **refs}
            self.layout.setdefault("annotations", []).append({"text": said, "showarrow": False, **where})

    def json(self) -> str:
        """As JSON, without its title, which the page sets; whoever puts it inside a script escapes it."""
        layout = {name: value for name, value in self.layout.items() if name != "title"}
        return json.dumps(_plain({"data": self.data, "layout": layout}), allow_nan=False)

    def figure(self) -> Any:
        """A `plotly.graph_objects.Figure`, which checks every property."""
        from plotly.graph_objects import Figure

        return Figure(cast(Any, {"data": self.data, "layout": self.layout}))

    def _number(self, row: int, col: int) -> str:
        """What the names of a plot's axes end with."""
        return _ending((row - 1) * self.across + col)


def _ending(number: int) -> str:
    """What the names of the axes of a plot end with; the first plot's have none."""
    return "" if number == 1 else str(number)


def _merge(into: dict[str, Any], settings: dict[str, Any]) -> None:
    for name, value in settings.items():
        if isinstance(value, dict) and isinstance(into.get(name), dict):
            _merge(into[name], cast(dict[str, Any], value))
        else:
            into[name] = value


def _plain(value: Any) -> Any:
    """What JSON can hold: numbers of an array in Plotly's packed form, and nothing in place of what is no number."""
    if isinstance(value, dict):
        return {name: _plain(inner) for name, inner in cast(dict[str, Any], value).items()}
    if isinstance(value, np.ndarray):
        array = cast(npt.NDArray[Any], value)
        return _packed(array) if array.dtype == np.float64 else array.tolist()
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in cast(Sequence[Any], value)]
    if isinstance(value, float):
        return float(value) if np.isfinite(value) else None
    return value


def _packed(numbers: Array) -> dict[str, str]:
    """Numbers as Plotly packs them: the bytes of doubles."""
    data = base64.b64encode(np.where(np.isfinite(numbers), numbers, np.nan).astype("<f8").tobytes()).decode()
    shape = {} if numbers.ndim == 1 else {"shape": ", ".join(map(str, numbers.shape))}
    return {"dtype": "f8", "bdata": data, **shape}


def blank(title: str, x: str, y: str, height: int = 360) -> Plot:
    """An empty plot with its title and those of its axes."""
    axes: dict[str, Any] = {"xaxis": {"title": {"text": x}}, "yaxis": {"title": {"text": y}}}
    return Plot([], {"title": {"text": html.escape(title)}, **axes, "template": TEMPLATE, "height": height})


def panels(
    title: str,
    rows: int,
    columns: int,
    titles: list[str],
    height: int,
    spacing: float | None = None,
    shared: bool = True,
) -> Plot:
    """Empty plots in rows and columns under one title; shared: all of a row have one y axis."""
    between = 0.2 / columns if spacing is None else spacing
    above = 0.5 / rows
    wide, tall = (1.0 - between * (columns - 1)) / columns, (1.0 - above * (rows - 1)) / rows
    layout: dict[str, Any] = {}
    over: list[dict[str, Any]] = []
    for k, said in enumerate(titles[: rows * columns]):
        row, col = divmod(k, columns)
        left, top = col * (wide + between), 1.0 - row * (tall + above)
        number = _ending(k + 1)
        layout[f"xaxis{number}"] = {"anchor": f"y{number}", "domain": [left, left + wide]}
        y: dict[str, Any] = {"anchor": f"x{number}", "domain": [max(top - tall, 0.0), top]}
        if shared and col:
            y |= {"matches": f"y{_ending(k - col + 1)}", "showticklabels": False}
        layout[f"yaxis{number}"] = y
        place = {"x": left + 0.5 * wide, "xanchor": "center", "y": top, "yanchor": "bottom"}
        over.append({"text": said, "font": {"size": 16}, "showarrow": False, "xref": "paper", "yref": "paper", **place})
    layout |= {
        "annotations": over,
        "title": {"text": html.escape(title)},
        "template": TEMPLATE,
        "height": height,
        "margin": {"t": 76},
        "legend": {"orientation": "h", "x": 0, "y": 1.0 + 30.0 / height, "yanchor": "bottom"},
    }
    return Plot([], layout, columns)


def plotted(values: Array) -> list[float | None]:
    """Numbers for a figure; what was not measured is left out."""
    return [v if v == v and abs(v) != float("inf") else None for v in values.tolist()]
