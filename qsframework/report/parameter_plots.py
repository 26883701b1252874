"""Figures of a fit's parameters: their changes, grouped by kind, and which of them the readings cannot separate."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING, Any

import numpy as np

from qsframework.identify import Estimate, Fit, FitRecord
from qsframework.report.blocks import Block, Figure, Lines, ReportTable, Text
from qsframework.report.numbers import MATRIX, matrix_table
from qsframework.report.plots import AFTER, AMBER, BEFORE, BLACK, BLUE, GREEN, GREY, blank, panels
from qsframework.report.words.sizes import shown, unit_shown, value_words

if TYPE_CHECKING:
    from plotly.graph_objects import Figure as Plot

_NUMBERS = 9
"""Parameters up to which every cell of the correlation matrix carries its number."""
_LABELS = 60
"""Parameters up to which its axes carry all names."""
CORRELATED = 0.7
_SENTENCES = 10
_ROW, _BETWEEN, _AROUND = 18, 64, 150
"""Height of a parameter's row, of what stands between two panels, and around all, pixels."""


def parameter_figure(fit: Fit, other: FitRecord | None = None) -> Figure:
    """Each estimate with its sd as its change from nominal: a panel for each kind of parameter and unit, each with its
    own axis, so that frames do not set the scale of springs; other: a fit to be shown beside this one."""
    groups: dict[tuple[str, str], list[Estimate]] = {}
    for e in (e for e in fit.estimates if np.isfinite(e.value)):
        groups.setdefault((kind_of(e.name), _unit(e)), []).append(e)
    groups = dict(sorted(groups.items(), key=lambda group: group[0][0].startswith("frame")))
    tall = [_ROW * max(len(group), 3) for group in groups.values()]
    height = sum(tall) + _BETWEEN * (len(tall) - 1) + _AROUND
    figure = panels(
        "Parameters with their standard deviations",
        len(tall),
        1,
        [""] * len(tall),
        height,
        heights=[float(t) for t in tall],
        spacing=_BETWEEN / (height - _AROUND + 18) if len(tall) > 1 else None,
        shared=False,
    )
    for k, ((kind, unit), group) in enumerate(groups.items(), start=1):
        _draw_group(figure, group, k, other)
        figure.update_xaxes(row=k, col=1, title={"text": f"{html.escape(kind)}: change from nominal, {unit}"})
        figure.update_yaxes(row=k, col=1, autorange="reversed", type="category", dtick=1)
    figure.update_layout(barmode="overlay")
    every = [e for group in groups.values() for e in group]
    rows = tuple(
        (e.name, value_words(e.value, e.sd, e.unit), *(f"{v:.4g}" for v in _changes(e)), _unit(e)) for e in every
    )
    return Figure(
        figure,
        "Circles: identified, bars one standard deviation; diamonds: nominal; grey: the stated prior. Look for circles "
        "whose bar reaches the diamond: these readings hardly separate such a parameter from its nominal value.",
        ReportTable(("parameter", "value ± sd", "change", "sd", "unit of both"), rows),
        wide=len(groups) > 2,
    )


def kind_of(name: str) -> str:
    """The kind of a parameter: `gravity_sag` of `gravity_sag[joint_2].link_3_x`; of frames their series with it."""
    return name.rpartition(".")[0] if name.startswith("frame") else name.partition("[")[0]


def _short(name: str, kind: str) -> str:
    """What is left of a name under the title of its kind."""
    return html.escape(name.removeprefix(kind).replace("[", "").replace("]", "").lstrip(".") or name)


def _unit(e: Estimate) -> str:
    """Changes are per cent where there is a nominal value, else in the unit in which the value is shown."""
    return "%" if e.initial else unit_shown(e.unit)


def _change(e: Estimate, value: float) -> float:
    """A difference from the nominal value in the unit of its panel; 0 where there is none."""
    if not np.isfinite(value):
        return 0.0
    return 100.0 * value / abs(e.initial) if e.initial else shown(value, e.unit)[0]


def _changes(e: Estimate) -> tuple[float, float]:
    return _change(e, e.value - e.initial), _change(e, e.sd)


def _draw_group(figure: Plot, group: list[Estimate], row: int, other: FitRecord | None) -> None:
    """Priors, nominal values, estimates and those of another fit in one panel."""
    place: dict[str, Any] = {"row": row, "col": 1}
    names = {e.name: _short(e.name, kind_of(e.name)) for e in group}
    first: dict[str, Any] = {"showlegend": row == 1}
    prior = [e for e in group if e.prior_sd is not None]
    if prior:
        figure.add_bar(
            orientation="h",
            y=[names[e.name] for e in prior],
            x=[_change(e, 2.0 * (e.prior_sd or 0.0)) for e in prior],
            base=[-_change(e, e.prior_sd or 0.0) for e in prior],
            name="prior, 1 sd to each side",
            marker={"color": "rgba(128, 128, 128, 0.25)", "line": {"color": GREY, "width": 1}},
            **first,
            **place,
        )
    nominal = {**BEFORE, "size": 9}
    labels = list(names.values())
    figure.add_scatter(x=[0.0] * len(group), y=labels, mode="markers", name="nominal", marker=nominal, **first, **place)
    figure.add_scatter(
        x=[_changes(e)[0] for e in group],
        y=labels,
        mode="markers",
        name="identified",
        error_x={"type": "data", "array": [_changes(e)[1] for e in group], "thickness": 2, "color": BLUE},
        marker={**AFTER, "size": 8},
        text=[html.escape(f"{e.name}: {value_words(e.value, e.sd, e.unit)}") for e in group],
        hovertemplate="%{text}<extra></extra>",
        **first,
        **place,
    )
    known = {} if other is None else dict(zip(other.names, zip(other.values, other.sd, strict=True), strict=True))
    both = [e for e in group if e.name in known]
    if both:
        sds = [_change(e, float(known[e.name][1])) for e in both]
        figure.add_scatter(
            x=[_change(e, float(known[e.name][0]) - e.initial) for e in both],
            y=[names[e.name] for e in both],
            mode="markers",
            name="the other fit",
            error_x={"type": "data", "array": sds, "thickness": 2, "color": GREEN},
            marker={"color": GREEN, "symbol": "triangle-up", "size": 9},
            **first,
            **place,
        )


def correlation_blocks(fit: Fit) -> tuple[Block, ...]:
    """Pairs of parameters that the readings hardly separate, in words."""
    pairs = sorted(fit.high_correlations(CORRELATED), key=lambda pair: -abs(pair[2]))
    if not pairs:
        return (Text(f"No two parameters are correlated above {CORRELATED:g}."),)
    first, second, most = pairs[0]
    said = (
        f"Correlations above {CORRELATED:g}: {len(pairs)}, the strongest {most:+.2f}, of {first} with {second}. "
        "Vary poses or loads to separate them."
    )
    rows = [(f"{c:+.2f}", f"{a} is correlated with {b}.") for a, b, c in pairs[1:_SENTENCES]]
    if len(pairs) > _SENTENCES:
        rows.append(("", f"{len(pairs) - _SENTENCES} more pairs are in the correlation matrix."))
    return (Text(said), *((Lines(tuple(rows)),) if rows else ()))


def correlation_figure(fit: Fit) -> Figure:
    """Correlation of every pair of estimates."""
    kinds, c = {kind_of(n) for n in fit.names}, fit.correlation
    names = [_short(n, next(iter(kinds))) if len(kinds) == 1 else html.escape(n) for n in fit.names]
    figure = blank("Correlation of the parameters", "", "")
    few = len(names) <= _NUMBERS
    figure.add_heatmap(
        x=names,
        y=names,
        z=c,
        zmin=-1.0,
        zmax=1.0,
        colorscale=[[0.0, BLUE], [0.5, "#ffffff"], [1.0, AMBER]],
        texttemplate="%{z:.2f}" if few else "",
        textfont={"color": BLACK},
        colorbar={"title": {"text": "r"}, "thickness": 12},
        hovertemplate="%{x}<br>%{y}<br>%{z:.3f}<extra></extra>",
    )
    labels = {"showticklabels": len(names) <= _LABELS, "dtick": 1, "tickfont": {"size": 11 if few else 9}}
    figure.update_layout(
        height=max(360, 200 + (22 if len(names) <= MATRIX else 14) * min(len(names), _LABELS)),
        xaxis=labels if few and len(kinds) == 1 else {**labels, "tickangle": 90},
        yaxis={**labels, "autorange": "reversed"},
    )
    return Figure(
        figure,
        "Look for strong colour off the diagonal: the readings cannot separate the two. Vary poses or loads.",
        matrix_table(fit.names, np.abs(c), c, "+.3f"),
        wide=len(names) > MATRIX,
    )
