"""Plots: what all of them share, panels beside one another, and numbers that are none."""

from __future__ import annotations

import base64
import json

import numpy as np
import pytest

from qsframework.report.plots import TEMPLATE, blank, panels
from qsframework.report.power_section import angle_figure


@pytest.mark.parametrize("count", [6, 7])
def test_panels_are_as_many_as_their_titles(count: int) -> None:
    figure = panels("a <b>", 3, 3, [f"plot {k}" for k in range(count)], 400)
    axes = [name for name in figure.to_plotly_json()["layout"] if name.startswith("xaxis")]
    assert len(axes) == count
    assert [a.text for a in figure.layout.annotations] == [f"plot {k}" for k in range(count)]
    assert figure.layout.title.text == "a &lt;b&gt;"
    assert figure.layout.yaxis2.matches == "y"


def test_settings_go_beside_what_is_there() -> None:
    plot = blank("title", "x, m", "y, mm").update_layout(xaxis={"type": "log"}, height=500)
    assert plot.layout.xaxis.to_plotly_json() == {"title": {"text": "x, m"}, "type": "log"}
    assert plot.layout.height == 500
    assert "type" not in TEMPLATE["layout"]["xaxis"], "what all plots share is not touched"


def test_numbers_that_are_none_are_gaps_in_the_json_and_figures_keep_arrays() -> None:
    plot = blank("set by the page", "", "")
    values = np.array([1.0, np.nan, 4.0])
    plot.add_scatter(x=values, y=[1.0, float("nan"), np.float64(4.0)])
    (trace,) = json.loads(plot.to_json(validate=False))["data"]
    assert trace["y"] == [1.0, None, 4.0]
    np.testing.assert_array_equal(np.frombuffer(base64.b64decode(trace["x"]["bdata"]), "<f8"), values)
    np.testing.assert_array_equal(plot.data[0].x, values)


def test_causes_that_look_alike_stand_side_by_side() -> None:
    """Groups within 5 deg, 60 deg from each other, in a random order: each comes out in one piece."""
    rng = np.random.default_rng(0)
    group = rng.permutation(np.repeat(np.arange(6), [1, 2, 3, 4, 5, 6]))
    noise = np.deg2rad(rng.uniform(0.0, 4.0, (21, 21)))
    angles = np.where(group[:, None] == group, np.deg2rad(1.0), np.deg2rad(60.0)) + noise + noise.T
    np.fill_diagonal(angles, np.nan)
    a, b = np.flatnonzero(group == 0)[0], np.flatnonzero(group == 5)[0]
    angles[a, b] = angles[b, a] = np.deg2rad(179.0)  # two that can only grow may point away from each other
    shown = [int(name) for name in angle_figure([str(k) for k in range(21)], angles, "").figure.data[0]["x"]]
    assert sorted(shown) == list(range(21))
    assert int(np.count_nonzero(np.diff(group[shown]))) == 5
