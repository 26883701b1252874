"""The fit in a report: the table in lmfit's spirit, measured against predicted, residuals."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

import numpy as np

from qsframework.experiment import Experiment, Readings
from qsframework.identify import Estimate, Fit
from qsframework.plugin import Array, Indices
from qsframework.report.blocks import Block, Figure, Section, Table, Text, View

_AXES = ("x", "y", "z")
_SAME = 1.005
"""A total sd that is larger than that of the noise by less than this is not worth a word."""
_SHOWN = {"rad/(N m)": (1e6, "urad/(N m)"), "m": (1e3, "mm"), "rad": (1e3, "mrad")}


def shown(value: float, unit: str) -> tuple[float, str]:
    """A value in the unit that people read: compliances in urad/(N m)."""
    factor, name = _SHOWN.get(unit, (1.0, unit))
    return value * factor, name


def fit_table(fit: Fit, truth: dict[str, float] | None = None) -> Table:
    """Value +- sd, initial, status of each estimate; with the truth where a simulation knows it."""
    rows: list[tuple[str, ...]] = []
    for e in fit.estimates:
        value, unit = shown(e.value, e.unit)
        initial = shown(e.initial, e.unit)[0]
        percent = f"{100 * e.sd / abs(e.initial):.1f} %" if e.initial and _quoted(e) else "-"
        row = [e.name, f"{value:.4g}{_spread(e)}", unit, percent, f"{initial:.4g}"]
        if truth is not None:
            true = truth[e.name]
            error = f"{(e.value - true) / e.sd:+.2f}" if _quoted(e) else "-"
            row += [f"{shown(true, e.unit)[0]:.4g}", error]
        rows.append((*row, e.status or "ok"))
    extra = () if truth is None else ("truth", "error / sd")
    return Table(
        ("parameter", "value ± sd", "unit", "sd, % of initial", "initial", *extra, "status"),
        tuple(rows),
        f"Method: {fit.method}. {_total(fit)}Noise of one coordinate: {fit.sigma * 1e3:.4f} mm, "
        f"{fit.sigma_source}{_shared(fit)}. A parameter whose sd is above 100 % of its initial value "
        "is not told by these readings; one at a bound has no sd.",
    )


def interval_tables(fit: Fit) -> tuple[Table, ...]:
    """The profile intervals, where some were asked for."""
    if not fit.intervals:
        return ()
    rows: list[tuple[str, ...]] = []
    for e, i in ((e, i) for i in fit.intervals for e in fit.estimates if e.name == i.name):
        ends = (shown(v, e.unit)[0] for v in (i.lower, i.upper, *i.linear))
        rows.append((i.name, f"{100 * i.level:.0f} %", *(f"{v:.4g}" for v in ends), shown(e.value, e.unit)[1]))
    header = ("parameter", "level", "from", "to", "value - t sd", "value + t sd", "unit")
    caption = (
        "Profile intervals: within them the best fit of the other parameters is not significantly worse. Where they "
        "differ from value ± t sd, the model bends, and they are the ones to quote; an end at a bound is that bound."
    )
    return (Table(header, tuple(rows), caption),)


def masked_blocks(fit: Fit) -> tuple[Block, ...]:
    """What was masked before the fit, where the readings were looked through."""
    if fit.cleaned is None:
        return ()
    if not fit.cleaned:
        return (Text("The readings were looked through for rows that cannot be right: none is masked."),)
    rows = tuple((m.readings, m.kind, ", ".join(map(str, m.rows)), m.words) for m in fit.cleaned)
    caption = "These rows were masked before the fit (--clean) and are not used. Look at each: it stays in the file."
    return (Table(("masked", "kind", "rows", "what was found"), rows, caption),)


def _quoted(e: Estimate) -> bool:
    """Whether an sd is quoted: neither fixed nor at a bound."""
    return bool(e.sd > 0.0)


def _spread(e: Estimate) -> str:
    if _quoted(e):
        return f" ± {shown(e.sd, e.unit)[0]:.2g}"
    return " (at bound)" if np.isnan(e.sd) else " (fixed)"


def _shared(fit: Fit) -> str:
    """The error that all markers of a pose share, where one was estimated."""
    return f"; shared by all markers of a pose: {fit.shared_sd * 1e3:.4f} mm, estimated" if fit.shared_sd else ""


def _total(fit: Fit) -> str:
    """The sds with the load's uncertainty, where one is stated."""
    if fit.total_covariance is None:
        return ""
    said = [
        f"{e.name} {100 * total / abs(e.initial):.1f} %"
        if e.initial
        else f"{e.name} {shown(total, e.unit)[0]:.2g} {shown(total, e.unit)[1]}"
        for e, total in zip(fit.estimates, fit.sd_total, strict=True)
        if _quoted(e) and total > _SAME * e.sd
    ]
    if not said:
        return "The load's stated uncertainty adds nothing that counts to these sds. "
    return (
        f"The sd above is that of the noise alone; with the load's stated uncertainty, of initial: {', '.join(said)}. "
    )


def error_table(fit: Fit) -> Table:
    """RMS per axis of the readings, the nominal model, the fit, and the poses left out."""
    names = ("readings", "nominal model", "identified", "leave-one-pose-out")
    values = (fit.rms_readings, fit.rms_nominal, fit.rms, fit.rms_left_out)
    note = ""
    if fit.carriers:
        note = f" It leaves out {', '.join(fit.carriers)}: each of these poses alone carries a parameter."
    return Table(
        ("RMS per axis", "mm"),
        tuple((name, f"{value * 1e3:.4f}") for name, value in zip(names, values, strict=True)),
        "The last row counts: it is the error at poses that the fit has not seen." + note,
    )


def fit_section(fit: Fit, title: str, truth: dict[str, float] | None = None) -> Section:
    """Tables and figures of one fit."""
    pairs = fit.high_correlations()
    pairs.sort(key=lambda pair: -abs(pair[2]))
    said = "; ".join(f"{a} and {b}: {c:+.3f}" for a, b, c in pairs) or "none"
    return Section(
        title,
        (
            Text(fit.verdict()),
            *masked_blocks(fit),
            fit_table(fit, truth),
            *interval_tables(fit),
            *(Text(note) for note in fit.notes),
            Text(f"Correlations above 0.9: {said}."),
            error_table(fit),
            Figure(
                _measured_predicted(fit),
                "Look for a slope: points should lie on the line; one says that the stiffness is off.",
                _reading_table(fit),
            ),
            Figure(
                residual_figure(fit),
                "Studentised residuals by row of the file. Beyond ±3 a reading deserves a look; a run of one sign "
                "says that the model misses something.",
                residual_table(fit.rows, fit.poses, fit.residuals, fit.studentised),
            ),
        ),
    )


def _reading_table(fit: Fit) -> Table:
    """Predicted and measured displacement by row of the file."""
    header = ("row", "pose", *(f"{what} d{a} mm" for what in ("predicted", "measured") for a in _AXES))
    values = np.column_stack([fit.predicted, fit.measured]) * 1e3
    return Table(header, tuple((str(r), p, *(f"{v:.4f}" for v in row)) for r, p, row in
                               zip(fit.rows, fit.poses, values, strict=True)))  # fmt: skip


def residual_table(rows: Sequence[int] | Indices, poses: Sequence[str], left: Array, student: Array) -> Table:
    """Residuals (R, 3) m and in units of their sd, by row of the file."""
    header = ("row", "pose", *(f"{a}, mm" for a in _AXES), *(f"{a} / its sd" for a in _AXES))
    lines = zip(rows, poses, left * 1e3, student, strict=True)
    return Table(header, tuple((str(r), str(p), *(f"{v:.4f}" for v in a), *(f"{v:.2f}" for v in b)) for r, p, a, b in
                               lines), "Measured minus predicted.")  # fmt: skip


def _figure(title: str, x: str, y: str) -> Any:
    import plotly.graph_objects as go

    return go.Figure(layout={"title": {"text": html.escape(title)}, "xaxis": {"title": {"text": x}},
                             "yaxis": {"title": {"text": y}}, "template": "plotly_white", "height": 380})  # fmt: skip


def _measured_predicted(fit: Fit) -> Any:
    figure = _figure("Measured against predicted displacement", "predicted, mm", "measured, mm")
    for i, axis in enumerate(_AXES):
        figure.add_scatter(
            x=fit.predicted[:, i] * 1e3, y=fit.measured[:, i] * 1e3, mode="markers", name=f"d{axis}",
            text=[f"row {r}, pose {html.escape(p)}" for r, p in zip(fit.rows, fit.poses, strict=True)],
        )  # fmt: skip
    ends = np.array([fit.measured.min(), fit.measured.max()]) * 1e3
    figure.add_scatter(x=ends, y=ends, mode="lines", name="equal", line={"color": "#999", "width": 1})
    return figure


def residual_figure(fit: Fit, names: tuple[str, ...] = ("dx", "dy", "dz")) -> Any:
    """Studentised residuals by row of the file."""
    figure = _figure("Studentised residuals", "row of the readings file", "residual / its sd")
    for i, axis in enumerate(names):
        figure.add_scatter(
            x=fit.rows, y=fit.studentised[:, i], mode="markers", name=axis,
            text=[f"{v * 1e3:.3f} mm" for v in fit.residuals[:, i]],
        )  # fmt: skip
    for level in (-3.0, 3.0):
        figure.add_hline(y=level, line={"color": "#c33", "width": 1, "dash": "dot"})
    return figure


def residual_view(fit: Fit, experiment: Experiment, readings: Readings) -> Section:
    """The poses with the largest residuals, with arrows at their markers."""
    from qsframework.viz import residual_scene, residuals
    from qsframework.viz.residual_scene import MOST

    kept, before = residuals(experiment, readings, experiment.model().nominal)
    _, after = residuals(experiment, readings, fit.x)
    scene, factor = residual_scene(experiment, readings, kept, before, after)
    at = readings.measurement[kept]
    sizes = [1e3 * np.linalg.norm(v, axis=1) for v in (before, after)]
    worst = {m: [float(s[at == m].max()) for s in sizes] for m in map(int, np.unique(at))}
    order = sorted(worst, key=lambda m: -worst[m][1])
    rows = tuple((readings.pose[m], str(int(readings.repeat[m])), *(f"{v:.4f}" for v in worst[m])) for m in order)
    shown_poses = "all poses" if len(worst) <= MOST else f"the {MOST} poses with the largest residuals"
    view = View(
        scene.html(),
        f"Measured minus predicted at the markers, {factor:.0f} times enlarged: red by the nominal model, green by the "
        f"identified one; {shown_poses}, the slider shows one at a time. Look for green arrows that turn together with "
        "a link, or that all point one way: the model misses something, and qsf diagnose can name it.",
        Table(
            ("pose", "repeat", "largest nominal, mm", "identified, mm"), rows, "Lengths of the vectors, worst first."
        ),
    )
    return Section("Residuals on the robot", (view,))
