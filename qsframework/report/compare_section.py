"""Robots side by side in a report: heat maps on one scale, the path, and what as many poses would tell."""

from __future__ import annotations

import html
from typing import Any

import numpy as np

from qsframework.plugin import Array
from qsframework.report.blocks import Figure, Plot, ReportTable, SceneView, Section, Text
from qsframework.report.numbers import row_table
from qsframework.report.plan_section import sd_words
from qsframework.report.plots import COLOURS, ORANGE, SYMBOLS, blank, log_axis, panels, plotted, round_ticks
from qsframework.report.words.sizes import shown_number, unit_shown
from qsframework.robot.collision import Flags
from qsframework.uses.compare import Compared, Comparison
from qsframework.viz import task_scene


def summary_table(result: Comparison) -> ReportTable:
    """One row per robot: reach, stiffness, the task, and what compensation leaves."""
    shared = result.shared
    rows = tuple(_summary(r, shared) for r in result.robots)
    header = (
        "robot",
        "cells reached",
        "shared: mean mm",
        "shared: softest N/um",
        "path reached",
        "path: mean mm",
        "path: worst mm",
        "after compensation: mean mm",
        "worst mm",
    )
    return ReportTable(
        header,
        rows,
        f"'Shared' counts the {int(shared.sum())} cells of the map that every robot reaches. Mean and worst over the "
        "path count the points that the robot reaches: compare them only where all points are reached.",
    )


def _summary(r: Compared, shared: Flags) -> tuple[str, ...]:
    here, done = np.isfinite(r.task), np.isfinite(r.after)
    return (
        r.robot.name,
        str(int(r.reached.sum())),
        _number(r.deflection[shared], np.mean, 1e3),
        _number(r.softest[shared], np.min, 1e-6),
        f"{int(here.sum())} of {len(here)}",
        _number(r.task[here], np.mean, 1e3),
        _number(r.task[here], np.max, 1e3),
        _number(r.after[done], np.mean, 1e3),
        _number(r.after[done], np.max, 1e3),
    )


def _number(values: Array, how: Any, scale: float) -> str:
    return f"{float(how(values)) * scale:.4g}" if len(values) else "none"


def sd_tables(result: Comparison) -> tuple[ReportTable, ...]:
    """Promised sd of each robot's parameters from as many poses."""
    return tuple(
        ReportTable(
            (r.robot.name, "nominal", "predicted sd", "unit"),
            tuple(
                (
                    p.name,
                    shown_number(p.nominal, p.unit),
                    sd_words(sd, p),
                    unit_shown(p.unit),
                )
                for p, sd in zip(r.parameters, r.sds, strict=True)
            ),
            f"{r.robot.title}: {r.campaign}. Look for parameters whose sd is a large share of their value.",
        )
        for r in result.robots
    )


def compare_sections(result: Comparison) -> tuple[Section, ...]:
    """Summary, maps, path and campaign."""
    notes = tuple(Text(f"{r.robot.name}: {note}.") for r in result.robots for note in r.notes)
    maps = (
        _map(
            result,
            [r.deflection * 1e3 for r in result.robots],
            "mm",
            "Deflection under the map's force",
            "All maps share one colour scale, in powers of ten: darker is softer; grey cells are not reached "
            "with the tool pointing that way. Look for robots that are dark where the work (crosses) is, and for "
            "jumps, where the arm changes its posture.",
        ),
        _map(
            result,
            [r.softest * 1e-6 for r in result.robots],
            "N/um",
            "Stiffness in the softest direction",
            "The force per micrometre in the most compliant direction, in powers of ten. Darker is softer. Look at "
            "the smallest value in the part of the workspace that the task needs.",
        ),
    )
    intro = Text(
        "Each robot was given a plan of its own of as many poses under the same loads and noise, best for the tip "
        "along this path. What a fit of it would leave along the path is 'after compensation'."
    )
    return (
        Section("Along the path", (Figure(path_figure(result), _PATH), path_view(result))),
        Section("Summary", (summary_table(result), *notes)),
        Section("Workspace", maps),
        Section("Identifiability", (intro, *sd_tables(result)), folded=True),
    )


def _map(result: Comparison, values: list[Array], unit: str, title: str, caption: str) -> Figure:
    maps = heat_maps(result, values, unit, title, soft_is_high=unit == "mm")
    return Figure(maps, caption, map_table(result, values, unit), wide=True)


_PATH = (
    "Solid: how far the tool moves under the task's force, without any correction. Dashed: what is to be expected "
    "after compensation with a fit of the campaign. Look for where the lines cross, and for gaps: points not reached."
)


def path_view(result: Comparison) -> SceneView:
    """Each robot where it deflects most along the path."""
    moved = [r.task for r in result.robots]
    scene = task_scene([r.robot for r in result.robots], [r.pendant for r in result.robots], moved, result.task.points)
    header = ("point", "x, m", "y, m", "z, m", *(f"{r.robot.name}, mm" for r in result.robots))
    points = result.task.points
    columns = [list(range(1, len(points) + 1)), *points.T.tolist(), *((1e3 * m).tolist() for m in moved)]
    return SceneView(
        scene.html(),
        "The slider goes through the robots, each at its point of largest deflection (red) on the path (blue). Look "
        "how far the arm is stretched there: a workpiece nearer to the base would move less.",
        row_table(header, columns, "How far the tool moves under the task's force, uncorrected; -: not reached."),
    )


def heat_maps(result: Comparison, values: list[Array], unit: str, title: str, soft_is_high: bool) -> Plot:
    """One heat map for each robot over x and z, all on one logarithmic scale, dark where the arm is soft; grey where it
    does not reach."""
    task, count = result.task, len(result.robots)
    names = [html.escape(r.robot.title.split(",")[0]) for r in result.robots]
    figure = panels(f"{title}, {unit}, at y = {task.map_y:g} m", 1, count, names, 420)
    for k, cells in enumerate(values, start=1):
        grid = cells.reshape(len(task.map_z), len(task.map_x))
        z, said = [plotted(np.log10(row)) for row in grid], [plotted(row) for row in grid]
        figure.add_heatmap(
            x=task.map_x.tolist(),
            y=task.map_z.tolist(),
            z=z,
            coloraxis="coloraxis",
            row=1,
            col=k,
            customdata=said,
            hovertemplate="x %{x:.2f} m, z %{y:.2f} m: %{customdata:.3g} " + unit + "<extra></extra>",
        )
        figure.add_scatter(
            x=task.points[:, 0].tolist(),
            y=task.points[:, 2].tolist(),
            mode="markers",
            showlegend=False,
            row=1,
            col=k,
            marker={"color": ORANGE, "size": 7, "symbol": "x", "line": {"color": "white", "width": 1}},
            hovertemplate="the path<extra></extra>",
        )
        figure.update_xaxes(row=1, col=k, title={"text": "x, m"})
    figure.update_yaxes(row=1, col=1, title={"text": "z, m"})
    ticks = round_ticks(np.concatenate(values))
    bar = {"title": {"text": unit}, "tickvals": np.log10(ticks).tolist(), "ticktext": [f"{v:g}" for v in ticks]}
    figure.update_layout(
        plot_bgcolor="#ddd",
        margin={"t": 40},
        coloraxis={"colorscale": "Cividis", "reversescale": soft_is_high, "colorbar": bar},
    )
    return figure.update_xaxes(showgrid=False, zeroline=False).update_yaxes(showgrid=False, zeroline=False)


def map_table(result: Comparison, values: list[Array], unit: str) -> ReportTable:
    """All cells of the maps: one row each, one column for each robot."""
    task = result.task
    z, x = (v.ravel() for v in np.meshgrid(task.map_z, task.map_x, indexing="ij"))
    header = ("x, m", "z, m", *(f"{r.robot.name}, {unit}" for r in result.robots))
    return row_table(header, [x.tolist(), z.tolist(), *(v.ravel().tolist() for v in values)], "-: not reached.")


def path_figure(result: Comparison) -> Plot:
    """Deflection along the path, uncorrected and after compensation."""
    figure = blank("Along the path", "point of the path", "position error, mm", 420)
    points = list(range(1, len(result.task.points) + 1))
    for k, r in enumerate(result.robots):
        for values, dash, name in ((r.task, "solid", r.robot.name), (r.after, "dash", f"{r.robot.name}, compensated")):
            mark = {"symbol": SYMBOLS[k % len(SYMBOLS)]}
            line = {"dash": dash, "color": COLOURS[k % len(COLOURS)]}
            figure.add_scatter(
                x=points, y=plotted(1e3 * values), mode="lines+markers", line=line, marker=mark, name=name
            )
    every = np.concatenate([v for r in result.robots for v in (r.task, r.after)])
    return figure.update_layout(yaxis=log_axis(1e3 * every))
