"""Figures of a fit: its parameters and which of them cannot be separated, its errors, and where they are."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from qsframework.estimation.tails import normal_isf
from qsframework.experiment import Experiment, Readings
from qsframework.fits import Estimate, Fit, FitRecord
from qsframework.fits.columns import sd_of
from qsframework.plugin import Array, Indices
from qsframework.report.blocks import Block, Figure, Lines, Plot, ReportTable, SceneView, Text
from qsframework.report.numbers import MATRIX, matrix_table, row_table
from qsframework.report.plots import (
    AFTER,
    AMBER,
    BEFORE,
    BLACK,
    BLUE,
    DASHES,
    GREEN,
    GREY,
    blank,
    panels,
    plotted,
)
from qsframework.report.words.sizes import grouped, mm, number, shown, unit_shown, value_words

AXES = ("x", "y", "z")
_QUANTILE = 95
_NUMBERS = 9
"""Parameters up to which every cell of the correlation matrix carries its number."""
_LABELS = 48
"""Parameters up to which its axes carry all names."""
CORRELATED = 0.7
_SENTENCES = 10
_ROW, _LABEL, _BETWEEN, _AROUND = 18, 14, 52, 150
"""Height of a parameter's row, of its name, of what stands between two panels, and around all, pixels."""
_TALL = 970
"""Most height of all rows: a window holds the figure."""


def fit_figures(fit: Fit, before: FitRecord | None = None) -> tuple[Figure, ...]:
    """What the fit says of the parameters, another campaign's beside them, and how well it describes the readings."""
    pair = (correlation_figure(fit),) if 1 < len(fit.estimates) <= MATRIX else ()
    scatter = () if fit.position.all() else (_measured_predicted(fit),)
    out = fit.left_out[np.isfinite(fit.left_out).all(axis=1)]
    sizes = {
        "nominal": np.linalg.norm(_whole(fit.measured - fit.nominal), axis=1),
        "identified": np.linalg.norm(_whole(fit.residuals), axis=1),
        "held-out poses": np.linalg.norm(out, axis=1),
    }
    spread = (distribution_figure(sizes),) if len(sizes["identified"]) else ()
    parameters = parameter_figure(fit, before)
    return (*pair, *scatter, *spread, parameters) if parameters.wide else (parameters, *pair, *scatter, *spread)


def residual_figures(fit: Fit) -> tuple[Figure, ...]:
    """The residuals one by one, and against the normal law."""
    return (*_by_row(fit), *_normal(fit))


def _whole(values: Array) -> Array:
    """Rows (k, 3) of which every axis was measured."""
    return values[np.isfinite(values).all(axis=1)]


def _measured_predicted(fit: Fit) -> Figure:
    figure = blank("Measured against predicted displacement", "predicted, mm", "measured, mm", 400)
    at = np.flatnonzero(~fit.position)
    for i, axis in enumerate(AXES):
        figure.add_scatter(
            x=plotted(fit.predicted[at, i] * 1e3),
            y=plotted(fit.measured[at, i] * 1e3),
            mode="markers",
            name=f"d{axis}",
            customdata=_poses(fit, at),
            text=_labels(fit, at),
        )
    both = np.concatenate([fit.measured[at], fit.predicted[at]]) * 1e3
    low, high = float(np.nanmin(both)), float(np.nanmax(both))
    figure.add_scatter(x=[low, high], y=[low, high], mode="lines", name="equal", line={"color": GREY, "width": 1})
    margin = 0.05 * (high - low)
    ends = [low - margin, high + margin]
    figure.update_layout(
        xaxis={"range": ends, "constrain": "domain"},
        yaxis={"range": ends, "scaleanchor": "x", "constrain": "domain"},
    )
    header = ("row", "pose", *(f"{what} d{a} mm" for what in ("predicted", "measured") for a in AXES))
    rows = tuple(
        (str(fit.lines[r]), fit.poses[r], *(mm(v, 4) for v in (*fit.predicted[r], *fit.measured[r]))) for r in at
    )
    return Figure(
        figure,
        "Both axes have one scale. Look for a slope: points should lie on the line; another slope says that the "
        "stiffness is off.",
        ReportTable(header, rows),
    )


def distribution_figure(sizes: dict[str, Array]) -> Figure:
    """Shares of readings whose 3D error is below a value; sizes (k,) m by name, the first of them before the fit."""
    figure = blank("Distribution of the 3D error", "3D error, mm", "share of readings, %")
    colours = (BEFORE["color"], BLUE, BLACK)
    rows: list[tuple[str, ...]] = []
    for i, (name, values) in enumerate((n, v) for n, v in sizes.items() if len(v)):
        size: Array = np.sort(values) * 1e3
        share = 100.0 * np.arange(1, len(size) + 1) / len(size)
        most = float(np.quantile(size, _QUANTILE / 100))
        line = {"color": colours[i % 3], "dash": DASHES[(1, 0, 2)[i % 3]], "shape": "hv"}
        said = f"{name}: 95 % {most:.3f}, max {size[-1]:.3f} mm"
        figure.add_scatter(x=size, y=share, mode="lines", name=said, line=line)
        figure.add_scatter(
            x=[most, float(size[-1])],
            y=[_QUANTILE, 100.0],
            mode="markers",
            marker={"color": colours[i % 3], "symbol": ["square", "star"], "size": 9},
            showlegend=False,
            cliponaxis=False,
        )
        numbers = (size.mean(), np.sqrt(np.mean(size**2)), most, size[-1])
        rows.append((name, str(len(size)), *(f"{v:.4f}" for v in numbers)))
    return Figure(
        figure,
        "How many readings have an error below a value. Look at where a curve ends (star) and at 95 % (square): the "
        "tail decides about scrap.",
        ReportTable(("3D error, mm", "readings", "mean", "RMS", "95 %", "max"), tuple(rows)),
    )


def _by_row(fit: Fit) -> tuple[Figure, ...]:
    """Studentised residuals by row of the file; of positions their length too."""
    every = np.arange(len(fit.lines))
    figure = blank("Studentised residuals", "row of the readings file", "residual / its sd")
    for i, axis in enumerate(AXES):
        figure.add_scatter(
            x=fit.lines,
            y=plotted(fit.studentised[:, i]),
            mode="markers",
            name=axis if fit.position.all() else f"d{axis}",
            customdata=_poses(fit, every),
            text=[f"{v * 1e3:.3f} mm" for v in fit.residuals[:, i]],
        )
    for level in (-3.0, 3.0):
        figure.add_hline(level, line={"color": GREY, "width": 1, "dash": "dot"})
    student = Figure(
        figure,
        "Look beyond the dotted lines at ±3: such a reading deserves a look; a run of one sign says that the model "
        "misses something.",
        residual_table(fit.lines, fit.poses, fit.residuals, fit.studentised),
    )
    if not fit.position.any():
        return (student,)
    at = np.flatnonzero(fit.position)
    figure = blank("Error of the position", "row of the readings file", "distance, mm")
    for name, errors, look in (("nominal", fit.measured - fit.nominal, BEFORE), ("identified", fit.residuals, AFTER)):
        figure.add_scatter(
            x=fit.lines[at],
            y=plotted(np.linalg.norm(errors[at], axis=1) * 1e3),
            mode="markers",
            name=name,
            customdata=_poses(fit, at),
            text=_labels(fit, at),
            marker={**look, "size": 5},
        )
    far = Figure(
        figure,
        "Distances between predicted and measured positions by row of the file. Look for rows that stay far off when "
        "all others come near: an outlier, or a pose that the model does not describe.",
    )
    return student, far


def _normal(fit: Fit) -> tuple[Figure, ...]:
    """Quantiles of the studentised residuals against the normal law."""
    z: Array = np.sort(fit.studentised[np.isfinite(fit.studentised)])
    if len(z) < 3:
        return ()
    wanted = -normal_isf((np.arange(1, len(z) + 1) - 0.5) / len(z))
    figure = blank("Residuals against the normal law", "quantile of the normal law", "residual / its sd")
    figure.add_scatter(x=wanted, y=z, mode="markers", name="residuals", marker={**AFTER, "size": 5})
    ends = [float(wanted[0]), float(wanted[-1])]
    figure.add_scatter(x=ends, y=ends, mode="lines", name="normal law", line={"color": BLACK, "dash": "dash"})
    caption = (
        "Look at the ends: points that leave the dashed line there are outliers, or tails heavier than those of normal "
        "noise; points on a steeper or flatter line: the noise is not what was stated."
    )
    return (Figure(figure, caption, row_table(("normal law", "residual / its sd"), [wanted.tolist(), z.tolist()])),)


def residual_table(rows: Any, poses: Any, left: Array, student: Array) -> ReportTable:
    """Residuals (R, 3) m and in units of their sd, by row of the file."""
    header = ("row", "pose", *(f"{a}, mm" for a in AXES), *(f"{a} / its sd" for a in AXES))
    lines = zip(rows, poses, left, student, strict=True)
    return ReportTable(
        header,
        tuple((str(r), str(p), *(mm(v, 4) for v in a), *(number(v, ".2f") for v in b)) for r, p, a, b in lines),
        "Measured minus predicted.",
    )


def _poses(fit: Fit, at: Indices) -> list[str]:
    return [html.escape(fit.poses[int(r)]) for r in at]


def _labels(fit: Fit, at: Indices) -> list[str]:
    return [f"row {fit.lines[r]}, pose {html.escape(fit.poses[int(r)])}" for r in at]


def parameter_figure(fit: Fit, other: FitRecord | None = None) -> Figure:
    """Each estimate with its sd as its change from nominal: a panel for each kind of parameter and unit, each with its
    own axis, so that frames do not set the scale of springs; other: a fit to be shown beside this one."""
    shown_with = (replace(e, sd=sd_of(fit, e)) for e in fit.estimates if np.isfinite(e.value))
    groups = grouped(((kind_of(e.name), _unit(e)), e) for e in shown_with)
    groups = dict(sorted(groups.items(), key=lambda group: group[0][0].startswith("frame")))
    each = max(1, min(_ROW, _TALL // sum(max(len(group), 3) for group in groups.values())))
    tall = [each * max(len(group), 3) for group in groups.values()]
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
        named = {"dtick": -(-_LABEL // each), "tickfont": {"size": 11}}
        figure.update_yaxes(row=k, col=1, autorange="reversed", type="category", **named)
    figure.update_layout(barmode="overlay")
    every = [e for group in groups.values() for e in group]
    rows = tuple(
        (
            e.name,
            value_words(e.value, e.sd, e.unit),
            *(f"{v:.4g}" for v in _changes(e)),
            _unit(e),
        )
        for e in every
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
    names = {e.name: _short(e.name, kind_of(e.name)) for e in group}
    panel: dict[str, Any] = {"row": row, "col": 1, "showlegend": row == 1}
    prior = [e for e in group if e.prior_sd is not None]
    if prior:
        figure.add_bar(
            orientation="h",
            y=[names[e.name] for e in prior],
            x=[_change(e, 2.0 * (e.prior_sd or 0.0)) for e in prior],
            base=[-_change(e, e.prior_sd or 0.0) for e in prior],
            name="prior, 1 sd to each side",
            marker={"color": "rgba(128, 128, 128, 0.25)", "line": {"color": GREY, "width": 1}},
            **panel,
        )
    nominal = {**BEFORE, "size": 9}
    labels = list(names.values())
    figure.add_scatter(
        x=[0.0] * len(group),
        y=labels,
        mode="markers",
        name="nominal",
        marker=nominal,
        **panel,
    )
    figure.add_scatter(
        x=[_changes(e)[0] for e in group],
        y=labels,
        mode="markers",
        name="identified",
        error_x={"type": "data", "array": [_changes(e)[1] for e in group], "thickness": 2, "color": BLUE},
        marker={**AFTER, "size": 8},
        text=[html.escape(f"{e.name}: {value_words(e.value, e.sd, e.unit)}") for e in group],
        hovertemplate="%{text}<extra></extra>",
        **panel,
    )
    known = {} if other is None else dict(zip(other.names, zip(other.values, other.sd_total, strict=True), strict=True))
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
            **panel,
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
    labels = {"showticklabels": len(names) <= _LABELS, "dtick": 1, "tickfont": {"size": 11 if few else 10}}
    figure.update_layout(
        height=max(360, 200 + (22 if len(names) <= MATRIX else 16) * min(len(names), _LABELS)),
        xaxis=labels if few and len(kinds) == 1 else {**labels, "tickangle": 90},
        yaxis={**labels, "autorange": "reversed"},
    )
    return Figure(
        figure,
        "Look for strong colour off the diagonal: the readings cannot separate the two. Vary poses or loads.",
        matrix_table(fit.names, np.abs(c), c, "+.3f"),
        wide=len(names) > MATRIX,
    )


def residual_view(
    experiment: Experiment,
    readings: Readings,
    kept: Indices,
    residuals: tuple[Array, Array],
    names: tuple[str, str],
    look: str,
    suspects: Mapping[str, tuple[str, float]] | None = None,
) -> SceneView:
    """The poses with the largest residuals, with arrows at their markers, and all poses in numbers, in the same order.

    kept (R,): rows of the readings; residuals: before and after (R, 3) m, with their names; look: what to look for;
    suspects: of a diagnosis: what is written at a place of the arm, and how brightly it glows
    """
    from qsframework.viz import residual_scene
    from qsframework.viz.scenes import MOST

    scene, factor = residual_scene(experiment, readings, kept, *residuals, suspects)
    at = readings.plus[kept]
    sizes = [1e3 * np.linalg.norm(v, axis=1) for v in residuals]
    worst = {m: [float(s[at == m].max()) for s in sizes] for m in map(int, np.unique(at))}
    own = readings.states
    rows = tuple(
        (own.pose[m], str(int(own.repeat[m])), *(f"{v:.4f}" for v in worst[m]))
        for m in sorted(worst, key=lambda m: -worst[m][0])
    )
    shown = "all poses" if len(worst) <= MOST else f"the {MOST} poses with the largest residuals"
    return SceneView(
        scene.html(),
        f"Measured minus predicted at the markers, {factor:.0f} times enlarged: red {names[0]}, green {names[1]}; "
        f"{shown}, the slider shows one at a time. {look}",
        ReportTable(
            ("pose", "repeat", f"largest {names[0]}, mm", f"{names[1]}, mm"),
            rows,
            "Lengths of the vectors, worst first.",
        ),
        scene.poses,
    )
