"""Figures of a fit: its parameters, its errors, and where in the workspace they are."""

from __future__ import annotations

import html
from typing import Any

import numpy as np

from qsframework.estimation.tails import normal_isf
from qsframework.experiment import Readings
from qsframework.identify import Fit, FitRecord
from qsframework.plugin import Array, Indices
from qsframework.report.blocks import Figure, ReportTable
from qsframework.report.numbers import MATRIX, row_table
from qsframework.report.parameter_plots import correlation_figure, parameter_figure
from qsframework.report.plots import AFTER, BEFORE, BLACK, BLUE, DASHES, GREY, ORANGE, SKY, blank, panels, plotted
from qsframework.report.words.sizes import mm, number

AXES = ("x", "y", "z")
_QUANTILE = 95


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
        "largest errors are what a part is scrapped for.",
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


def workspace_figure(fit: Fit, readings: Readings, pose: Indices, marker: Indices, errors: Array) -> Figure:
    """Errors (R, 3) m over the places in the workspace where they were read.

    pose, marker (R,): state and marker of each row of the readings
    """
    used, place = np.unique(pose, return_inverse=True)
    points = fit.model.positions(readings.poses.take(used), linear=True)[place, marker]
    size = 1e3 * np.linalg.norm(errors, axis=1)
    names = [readings.states.pose[m] for m in map(int, pose)]
    around = np.hypot(points[:, 0], points[:, 1])
    figure = panels("Errors over the workspace", 1, 2, ["from above", "from the side"], 420, 0.14, shared=False)
    views = ((points[:, 0], points[:, 1], "x, m", "y, m"), (around, points[:, 2], "from the base's axis, m", "z, m"))
    largest = max(float(size.max()), 1e-9)
    for col, (x, y, along, up) in enumerate(views, start=1):
        figure.add_scatter(
            x=x,
            y=y,
            mode="markers",
            showlegend=False,
            customdata=[html.escape(n) for n in names],
            text=[f"pose {html.escape(n)}: {s:.3f} mm" for n, s in zip(names, size, strict=True)],
            hovertemplate="%{text}<extra></extra>",
            marker={
                "size": 6.0 + 14.0 * size / largest,
                "symbol": "circle",
                "color": size,
                "coloraxis": "coloraxis",
                "line": {"width": 1, "color": GREY},
                "opacity": 0.85,
            },
            row=1,
            col=col,
        )
        anchor = "x" if col == 1 else "x2"
        figure.update_xaxes(row=1, col=col, title={"text": along})
        figure.update_yaxes(row=1, col=col, title={"text": up}, scaleanchor=anchor)
    scale = {"colorscale": [[0.0, SKY], [1.0, ORANGE]], "colorbar": {"title": {"text": "mm"}, "thickness": 12}}
    figure.update_layout(coloraxis=scale, margin={"t": 40})
    columns = [names, *points.T.tolist(), around.tolist(), size.tolist()]
    return Figure(
        figure,
        "Large and orange: far off after the fit. Look for a corner of the workspace in which all are: there the model "
        "misses something, or the poses were too few.",
        row_table(("pose", "x, m", "y, m", "z, m", "from the axis, m", "error, mm"), columns),
        wide=True,
    )


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
