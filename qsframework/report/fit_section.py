"""The fit in a report: the table in lmfit's spirit, measured against predicted, residuals."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

import numpy as np

from qsframework.estimation import rms
from qsframework.experiment import Experiment, Readings
from qsframework.identify import Estimate, Fit, Masked
from qsframework.plugin import Array, Indices
from qsframework.report.blocks import Block, Figure, Section, Table, Text, View
from qsframework.report.words.fit import alignment_words, first_words, verdict_words

_AXES = ("x", "y", "z")
_SAME = 1.005
"""A total sd that is larger than that of the noise by less than this is not worth a word."""
_SHOWN = {"rad/(N m)": (1e6, "urad/(N m)"), "m/N": (1e6, "um/N"), "m": (1e3, "mm"), "rad": (1e3, "mrad")}


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
        f"Method: {fit.method}, {'linear model' if fit.linear else 'full equilibrium'}. {_total(fit)}"
        f"Noise of one coordinate: {fit.sigma * 1e3:.4f} mm, "
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


_SIZES = {"displacement": "RMS per axis", "gauge": "RMS", "position": "RMS of the distance"}
"""How large errors of each kind of reading are said to be."""


def masked_blocks(fit: Fit) -> tuple[Block, ...]:
    """What was masked before the fit, where the readings were looked through, and what the fit found to be gross."""
    blocks: list[Block] = []
    header = ("masked", "kind", "rows", "what was found")
    if fit.cleaned is not None and not fit.cleaned:
        blocks.append(Text("The readings were looked through for rows that cannot be right: none is masked."))
    if fit.cleaned:
        caption = "These rows were masked before the fit and are not used. Look at each: it stays in the file."
        blocks.append(Table(header, tuple(_masked(m) for m in fit.cleaned), caption))
    gross = [m for m in fit.gross if m.kind == "gross"]
    if gross:
        caption = "Gross under the fitted and under a richer model: masked by the fit itself. Look at each."
        blocks.append(Table(header, tuple(_masked(m) for m in gross), caption))
    blocks += [Text(m.words + ".") for m in fit.gross if m.kind != "gross"]
    return tuple(blocks)


def _masked(m: Masked) -> tuple[str, ...]:
    return (m.readings, m.kind, ", ".join(map(str, m.rows)), m.words)


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


def error_tables(fit: Fit) -> tuple[Table, ...]:
    """For each kind of reading: before, after, and at poses left out, those that the fit masked as gross among them.

    RMS per axis of displacements and gauges; of positions that of the distance.
    """
    out: list[Table] = []
    for kind, title in _SIZES.items():
        at, unseen = fit.kind == kind, fit.missed[fit.missed_kind == kind]
        if not at.any():
            continue
        size = fit.error_of if kind == "position" else rms
        rows = [
            ("nominal arm, best tracker frame", size((fit.measured - fit.nominal)[at])),
            ("identified", size(fit.residuals[at])),
            ("leave-one-pose-out", size(np.concatenate([fit.left_out[at], unseen]))),
        ]
        if kind != "position":
            rows[:1] = [("readings", rms(fit.measured[at])), ("nominal model", rows[0][1])]
        if len(unseen):
            rows.append(("the same without masked rows", size(fit.left_out[at])))
        note = " Masked rows count as unseen." if len(unseen) else ""
        if fit.carriers:
            note += f" It leaves out {', '.join(fit.carriers)}: each of these poses alone carries a parameter."
        out.append(_errors(title if at.all() else f"{kind}s, {title}", rows, note))
    return tuple(out)


def _errors(title: str, rows: Sequence[tuple[str, float]], note: str) -> Table:
    return Table(
        (title, "mm"),
        tuple((name, f"{value * 1e3:.4f}") for name, value in rows),
        "Leave-one-pose-out counts: it is the error at poses that the fit has not seen." + note,
    )


def frame_table(fit: Fit) -> Table:
    """Where each tracker sees the robot's base."""
    rows = tuple(
        (
            f.series or "-",
            ", ".join(f"{v * 1e3:.3f}" for v in f.origin),
            "; ".join(", ".join(f"{v:.6f}" for v in row) for row in f.rotation),
        )
        for f in fit.frames
    )
    return Table(("series", "origin of the base, mm", "rotation matrix, by rows"), rows, "The base in tracker frames.")


def left_aside_table(fit: Fit) -> Table:
    """Parameters that these readings cannot tell."""
    rows = tuple(
        (
            entry.name,
            "no effect" if not entry.absorbed_by else ", ".join(entry.absorbed_by),
            "-" if np.isinf(entry.sd) else f"{entry.sd:.2g}",
        )
        for entry in fit.left_aside
    )
    note = (
        "Asked for and not estimated: they stay at their nominal values. The last column: the sd if one were fitted "
        "too, in its natural sizes; - where these readings do not tell it at all."
    )
    return Table(("left aside", "absorbed by, or looks like", "sd"), rows, note)


def fit_section(fit: Fit, title: str, truth: dict[str, float] | None = None) -> Section:
    """Tables and figures of one fit."""
    pairs = fit.high_correlations()
    pairs.sort(key=lambda pair: -abs(pair[2]))
    said = "; ".join(f"{a} and {b}: {c:+.3f}" for a, b, c in pairs) or "none"
    return Section(
        title,
        (
            *(Text(line) for line in first_words(fit)),
            Text(verdict_words(fit)),
            *((left_aside_table(fit),) if fit.left_aside else ()),
            *error_tables(fit),
            *masked_blocks(fit),
            fit_table(fit, truth),
            *interval_tables(fit),
            *(Text(note) for note in (*alignment_words(fit.alignments), *fit.notes)),
            Text(f"Correlations above 0.9: {said}."),
            *((frame_table(fit),) if fit.frames else ()),
            *_figures(fit),
            Figure(
                residual_figure(fit),
                "Studentised residuals by row of the file. Beyond ±3 a reading deserves a look; a run of one sign "
                "says that the model misses something.",
                residual_table(fit.rows, fit.poses, fit.residuals, fit.studentised),
            ),
        ),
    )


def _figures(fit: Fit) -> tuple[Figure, ...]:
    out: list[Figure] = []
    if not fit.position.all():
        out.append(
            Figure(
                _measured_predicted(fit),
                "Look for a slope: points should lie on the line; one says that the stiffness is off.",
                _reading_table(fit),
            )
        )
    if fit.position.any():
        out.append(
            Figure(
                _distances(fit),
                "Distances between predicted and measured positions by row of the file. Look for rows that stay far "
                "off when all others fall: a gross error, or a pose that the model does not describe.",
            )
        )
    return tuple(out)


def _reading_table(fit: Fit) -> Table:
    """Predicted and measured displacement by row of the file."""
    header = ("row", "pose", *(f"{what} d{a} mm" for what in ("predicted", "measured") for a in _AXES))
    values = np.column_stack([fit.predicted, fit.measured]) * 1e3
    return Table(
        header,
        tuple(
            (str(r), p, *(_number(v, 4) for v in row))
            for r, p, row, at in zip(fit.rows, fit.poses, values, fit.position, strict=True)
            if not at
        ),
    )


def _number(value: float, digits: int) -> str:
    """A number, a dash where nothing was measured."""
    return f"{value:.{digits}f}" if np.isfinite(value) else "-"


def residual_table(rows: Sequence[int] | Indices, poses: Sequence[str], left: Array, student: Array) -> Table:
    """Residuals (R, 3) m and in units of their sd, by row of the file."""
    header = ("row", "pose", *(f"{a}, mm" for a in _AXES), *(f"{a} / its sd" for a in _AXES))
    lines = zip(rows, poses, left * 1e3, student, strict=True)
    return Table(
        header,
        tuple((str(r), str(p), *(_number(v, 4) for v in a), *(_number(v, 2) for v in b)) for r, p, a, b in lines),
        "Measured minus predicted.",
    )


def _figure(title: str, x: str, y: str) -> Any:
    import plotly.graph_objects as go

    return go.Figure(
        layout={
            "title": {"text": html.escape(title)},
            "xaxis": {"title": {"text": x}},
            "yaxis": {"title": {"text": y}},
            "template": "plotly_white",
            "height": 380,
        }
    )


def _measured_predicted(fit: Fit) -> Any:
    figure = _figure("Measured against predicted displacement", "predicted, mm", "measured, mm")
    at = np.flatnonzero(~fit.position)
    for i, axis in enumerate(_AXES):
        figure.add_scatter(
            x=_plotted(fit.predicted[at, i] * 1e3),
            y=_plotted(fit.measured[at, i] * 1e3),
            mode="markers",
            name=f"d{axis}",
            text=[f"row {fit.rows[r]}, pose {html.escape(fit.poses[r])}" for r in at],
        )
    ends = np.array([np.nanmin(fit.measured[at]), np.nanmax(fit.measured[at])]) * 1e3
    figure.add_scatter(x=ends, y=ends, mode="lines", name="equal", line={"color": "#999", "width": 1})
    return figure


def _plotted(values: Array) -> list[float | None]:
    """Numbers for a figure; what was not measured is left out."""
    return [v if np.isfinite(v) else None for v in values.tolist()]


def _distances(fit: Fit) -> Any:
    figure = _figure("Error of the position", "row of the readings file", "distance, mm")
    at = np.flatnonzero(fit.position)
    text = [f"pose {html.escape(fit.poses[i])}" for i in at]
    for name, errors in (("nominal", fit.measured - fit.nominal), ("identified", fit.residuals)):
        size = np.linalg.norm(errors[at], axis=1) * 1e3
        figure.add_scatter(x=fit.rows[at], y=_plotted(size), mode="markers", name=name, text=text, marker={"size": 4})
    return figure


def residual_figure(fit: Fit) -> Any:
    """Studentised residuals by row of the file."""
    names = _AXES if fit.position.all() else ("dx", "dy", "dz")
    figure = _figure("Studentised residuals", "row of the readings file", "residual / its sd")
    for i, axis in enumerate(names):
        figure.add_scatter(
            x=fit.rows,
            y=_plotted(fit.studentised[:, i]),
            mode="markers",
            name=axis,
            text=[f"{v * 1e3:.3f} mm" for v in fit.residuals[:, i]],
        )
    for level in (-3.0, 3.0):
        figure.add_hline(y=level, line={"color": "#c33", "width": 1, "dash": "dot"})
    return figure


def residual_view(fit: Fit, experiment: Experiment, readings: Readings) -> Section:
    """The poses with the largest residuals, with arrows at their markers."""
    from qsframework.viz import residual_scene, residuals
    from qsframework.viz.residual_scene import MOST

    rows, before = residuals(experiment, readings, experiment.model().nominal, linear=fit.linear)
    _, after = residuals(experiment, readings, fit.x, fit.frames, fit.linear)
    scene, factor = residual_scene(experiment, readings, rows.keep, before, after)
    sizes = [1e3 * np.linalg.norm(v, axis=1) for v in (before, after)]
    worst = {m: [float(s[rows.plus == m].max()) for s in sizes] for m in map(int, np.unique(rows.plus))}
    order = sorted(worst, key=lambda m: -worst[m][1])
    own = readings.states
    rows_shown = tuple((own.pose[m], str(int(own.repeat[m])), *(f"{v:.4f}" for v in worst[m])) for m in order)
    shown_poses = "all poses" if len(worst) <= MOST else f"the {MOST} poses with the largest residuals"
    view = View(
        scene.html(),
        f"Measured minus predicted at the markers, {factor:.0f} times enlarged: red by the nominal model, green by the "
        f"identified one; {shown_poses}, the slider shows one at a time. Look for green arrows that turn together with "
        "a link, or that all point one way: the model misses something, and qsf diagnose can name it.",
        Table(
            ("pose", "repeat", "largest nominal, mm", "identified, mm"),
            rows_shown,
            "Lengths of the vectors, worst first.",
        ),
    )
    return Section("Residuals on the robot", (view,))
