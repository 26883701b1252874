"""Plots as Plotly's JSON: against what the package plotly makes of the same calls."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np
import pytest
from plotly.graph_objects import Figure
from plotly.subplots import make_subplots

from qsframework.report.plots import TEMPLATE, Plot, blank, panels
from qsframework.report.power_section import angle_figure


def layout(figure: Any) -> dict[str, Any]:
    return {name: value for name, value in figure.to_plotly_json()["layout"].items() if name != "template"}


@pytest.mark.parametrize(("rows", "columns", "spacing", "shared"), [(2, 3, None, True), (1, 2, 0.14, False)])
def test_panels_stand_where_plotly_puts_them(rows: int, columns: int, spacing: float | None, shared: bool) -> None:
    titles = [f"plot {k}" for k in range(rows * columns)]
    theirs = make_subplots(
        rows=rows, cols=columns, shared_yaxes=shared, subplot_titles=titles, horizontal_spacing=spacing
    )
    ours = panels("", rows, columns, titles, 400, spacing, shared)
    wanted = layout(theirs)
    made = {name: ours.layout[name] for name in wanted}
    for name in [n for n in wanted if "axis" in n]:
        assert made[name].pop("domain") == pytest.approx(wanted[name].pop("domain")), name
    for mine, other in zip(made["annotations"], wanted["annotations"], strict=True):
        assert [mine.pop(k) for k in "xy"] == pytest.approx([other.pop(k) for k in "xy"])
    assert made == wanted
    for row in range(1, rows + 1):
        for col in range(1, columns + 1):
            theirs.add_scatter(y=[1.0], row=row, col=col)
            ours.add("scatter", row, col, y=[1.0])
    assert [(t["xaxis"], t["yaxis"]) for t in ours.data] == [(t.xaxis, t.yaxis) for t in theirs.data]


def test_lines_through_a_plot_are_those_of_plotly() -> None:
    theirs, ours = Figure(), blank("", "", "")
    theirs.add_hline(y=2.0, line={"width": 1}, annotation_text="noise").add_vline(x=3.0, line={"width": 2})
    ours.line("y", 2.0, {"width": 1}, "noise")
    ours.line("x", 3.0, {"width": 2})
    assert {n: ours.layout[n] for n in ("shapes", "annotations")} == layout(theirs)


def test_settings_go_beside_what_is_there() -> None:
    plot = blank("title", "x, m", "y, mm").update(xaxis={"type": "log"}, height=500)
    plot.axis("y", title={"text": "z, mm"})
    plot.axes("x", showgrid=False)
    assert plot.layout["xaxis"] == {"title": {"text": "x, m"}, "type": "log", "showgrid": False}
    assert plot.layout["yaxis"] == {"title": {"text": "z, mm"}}
    assert plot.layout["height"] == 500
    assert "xaxis" in TEMPLATE["layout"]
    assert "type" not in TEMPLATE["layout"]["xaxis"], "what all plots share is not touched"


def test_numbers_that_are_none_are_gaps_in_the_json_and_figures_keep_arrays() -> None:
    plot = Plot([], {"title": {"text": "set by the page"}})
    values = np.array([1.0, np.inf, np.nan, 4.0])
    plot.add("scatter", x=values, y=[1.0, float("nan"), float("inf"), np.float64(4.0)], customdata=np.arange(4))
    plot.add("heatmap", z=np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]))
    written = json.loads(plot.json())
    assert written["layout"] == {}
    first, second = written["data"]
    assert first["y"] == [1.0, None, None, 4.0]
    assert first["customdata"] == [0, 1, 2, 3]
    assert second["z"]["shape"] == "2, 3"
    read = Figure(written)
    assert len(read.data) == 2
    there = np.frombuffer(base64.b64decode(first["x"]["bdata"]), "<f8")
    np.testing.assert_array_equal(there, [1.0, np.nan, np.nan, 4.0])
    np.testing.assert_array_equal(plot.figure().data[0].x, values)


def test_causes_that_look_alike_stand_side_by_side() -> None:
    """Groups within 5 deg, 60 deg from each other, in a random order: each comes out in one piece."""
    rng = np.random.default_rng(0)
    group = rng.permutation(np.repeat(np.arange(6), [1, 2, 3, 4, 5, 6]))
    noise = np.deg2rad(rng.uniform(0.0, 4.0, (21, 21)))
    angles = np.where(group[:, None] == group, np.deg2rad(1.0), np.deg2rad(60.0)) + noise + noise.T
    np.fill_diagonal(angles, np.nan)
    a, b = np.flatnonzero(group == 0)[0], np.flatnonzero(group == 5)[0]
    angles[a, b] = angles[b, a] = np.deg2rad(179.0)  # two that can only grow may point away from each other
    shown = [int(name) for name in angle_figure([str(k) for k in range(21)], angles).data[0]["x"]]
    assert sorted(shown) == list(range(21))
    assert int(np.count_nonzero(np.diff(group[shown]))) == 5
