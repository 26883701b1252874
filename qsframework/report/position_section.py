"""A fit of absolute positions in a report: errors as distances, trackers' frames, what is left aside."""

from __future__ import annotations

import html
from typing import Any

import numpy as np

from qsframework.experiment import Experiment, StateReadings, make_plan
from qsframework.identify.absolute import PositionFit
from qsframework.report.blocks import Figure, Section, Table, Text, View
from qsframework.report.fit_section import fit_table, masked_blocks, residual_figure, residual_table

_MOST = 24
"""Poses in the scene."""


def position_error_table(fit: PositionFit) -> Table:
    """RMS of the distances between predicted and measured positions."""
    at = fit.absolute
    left = fit.left_out[at][~np.isnan(fit.left_out[at]).any(axis=1)]
    rows: tuple[tuple[str, float], ...] = (
        ("nominal arm, fitted tracker frame and markers", fit.error_of((fit.measured - fit.nominal)[at])),
        ("identified", fit.error_of(fit.residuals[at])),
        ("leave-one-pose-out", fit.error_of(left) if len(left) else float("nan")),
    )
    if fit.displaced:
        last = slice(at.stop, None)
        rows += (
            ("displacements, nominal arm", fit.error_of((fit.measured - fit.nominal)[last])),
            ("displacements, identified", fit.error_of(fit.residuals[last])),
        )
    return Table(
        ("RMS of the distance", "mm"),
        tuple((name, f"{value * 1e3:.4f}") for name, value in rows),
        "Leave-one-pose-out counts: it is the error at poses that the fit has not seen.",
    )


def frame_table(fit: PositionFit) -> Table:
    """Where each tracker sees the robot's base."""
    rows = tuple(
        (f.series or "-", ", ".join(f"{v * 1e3:.3f}" for v in f.origin), "; ".join(
            ", ".join(f"{v:.6f}" for v in row) for row in f.rotation))
        for f in fit.frames
    )  # fmt: skip
    return Table(("series", "origin of the base, mm", "rotation matrix, by rows"), rows, "The base in tracker frames.")


def left_aside_table(fit: PositionFit) -> Table:
    """Parameters that these readings cannot tell."""
    rows = tuple(
        (entry.name, "no effect" if not entry.absorbed_by else ", ".join(entry.absorbed_by),
         "-" if np.isinf(entry.sd) else f"{entry.sd:.2g}")
        for entry in fit.left_aside
    )  # fmt: skip
    note = (
        "The last column: its standard deviation if it were fitted too, in its typical sizes; - where these readings "
        "do not tell it at all."
    )
    return Table(("left aside", "absorbed by, or looks like", "sd"), rows, note)


def position_section(fit: PositionFit, title: str) -> Section:
    """Tables and figures of a fit of positions."""
    own = ", ".join(map(str, fit.masked)) or "none"
    return Section(
        title,
        (
            Text(fit.verdict()),
            position_error_table(fit),
            *masked_blocks(fit),
            Text(f"Gross errors that the fit itself found, masked and not used: rows {own}."),
            fit_table(fit),
            *(Text(note) for note in fit.notes),
            left_aside_table(fit),
            frame_table(fit),
            Figure(
                _distances(fit),
                "Distances between predicted and measured positions by row of the file. Look for rows that stay far "
                "off when all others fall: a gross error, or a pose that the model does not describe.",
            ),
            Figure(
                residual_figure(fit, ("x", "y", "z")),
                "Studentised residuals by row of the file. Look for a run of one sign: it says that the model misses "
                "something.",
                residual_table(fit.rows, fit.poses, fit.residuals, fit.studentised),
            ),
        ),
    )


def _distances(fit: PositionFit) -> Any:
    import plotly.graph_objects as go

    figure = go.Figure(layout={"title": {"text": "Error of the position"}, "template": "plotly_white", "height": 380,
                               "xaxis": {"title": {"text": "row of the readings file"}},
                               "yaxis": {"title": {"text": "distance, mm"}}})  # fmt: skip
    text = [f"pose {html.escape(p)}" for p in fit.poses[fit.absolute]]
    for name, errors in (("nominal", fit.measured - fit.nominal), ("identified", fit.residuals)):
        size = np.linalg.norm(errors, axis=1) * 1e3
        figure.add_scatter(
            x=fit.rows[fit.absolute], y=size[fit.absolute], mode="markers", name=name, text=text, marker={"size": 4}
        )
    return figure


def position_view(fit: PositionFit, experiment: Experiment, states: StateReadings) -> Section:
    """The poses whose positions are farthest off, with the error of each."""
    from qsframework.viz import show_scene

    size = 1e3 * np.linalg.norm(fit.residuals, axis=1)[fit.absolute]
    worst: dict[str, float] = {}
    for pose, error in zip(fit.poses[fit.absolute], size.tolist(), strict=True):
        worst[pose] = max(error, worst.get(pose, 0.0))
    order = sorted(worst, key=lambda p: -worst[p])
    first = {pose: i for i, pose in reversed(list(enumerate(states.pose)))}
    names = [f"{p}, up to {worst[p]:.3f} mm off" for p in order[:_MOST]]
    plan = make_plan(states.poses.take([first[p] for p in order[:_MOST]]), [""] * len(names), names=names)
    view = View(
        show_scene(experiment, plan).html(),
        f"The poses that are predicted worst by the identified arm, up to {_MOST} of them, worst first. Look for what "
        "they have in common: a stretched arm, one side of the workspace, one turned wrist.",
        Table(("pose", "largest error, mm"), tuple((p, f"{worst[p]:.4f}") for p in order), "All poses, worst first."),
    )
    return Section("Poses that are predicted worst", (view,))
