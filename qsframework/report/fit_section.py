"""The fit in a report: the table in lmfit's spirit, measured against predicted, residuals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from qsframework.estimation import rms
from qsframework.experiment import Experiment, Readings
from qsframework.experiment.observations import values_before
from qsframework.identify import Estimate, Fit, FitRecord, Masked
from qsframework.report.blocks import Block, ReportTable, SceneView, Section, Text
from qsframework.report.fit_plots import fit_figures, residual_figures, workspace_figure
from qsframework.report.moved_section import moved_table, moved_words
from qsframework.report.numbers import MATRIX
from qsframework.report.parameter_plots import correlation_blocks, correlation_figure
from qsframework.report.residual_view import residual_view
from qsframework.report.words.fit import alignment_words, first_words, verdict_words
from qsframework.report.words.sizes import shown, stiffness_words, with_sd

_SAME = 1.005
"""A total sd that is larger than that of the noise by less than this is not worth a word."""
_MOST_PERCENT = 999.0


def fit_table(fit: Fit, truth: dict[str, float] | None = None, stiffness: bool = False) -> ReportTable:
    """Value ± sd, initial, status of each estimate; with the truth where a simulation knows it, and with the stiffness
    beside a compliance where there is room for it."""
    rows: list[tuple[str, ...]] = []
    stiff = stiffness and any(stiffness_words(e.unit, e.value) for e in fit.estimates)
    held = any(e.held for e in fit.estimates)
    for e in fit.estimates:
        unit = shown(e.value, e.unit)[1]
        initial = shown(e.initial, e.unit)[0]
        percent = _percent(100 * e.sd / abs(e.initial)) if e.initial and _quoted(e) else "-"
        row = [
            e.name,
            _value(e),
            unit,
            *([stiffness_words(e.unit, e.value) or "-"] if stiff else []),
            percent,
            *([_alone(e)] if held else []),
            f"{initial:.4g}",
        ]
        if truth is not None:
            true = truth[e.name]
            error = f"{(e.value - true) / e.sd:+.2f}" if _quoted(e) else "-"
            row += [f"{shown(true, e.unit)[0]:.4g}", error]
        rows.append((*row, e.status or "ok"))
    extra = () if truth is None else ("truth", "error / sd")
    return ReportTable(
        (
            "parameter",
            "value ± sd",
            "unit",
            *(("stiffness",) if stiff else ()),
            "sd, % of initial",
            *(("sd of the readings alone",) if held else ()),
            "initial",
            *extra,
            "status",
        ),
        tuple(rows),
        f"Method: {fit.method}, {'linear model' if fit.linear else 'full equilibrium'}. {_total(fit)}"
        f"Noise of one coordinate: {fit.sigma * 1e3:.4f} mm, "
        f"{fit.sigma_source}{_shared(fit)}. A parameter whose sd is above 100 % of its initial value "
        "cannot be identified from these readings; one at a bound has no sd."
        + (" Geometry and markers are held weakly near their nominal values." if held else ""),
    )


def _alone(e: Estimate) -> str:
    """The sd that the readings alone give, where a weak hold makes the quoted one smaller."""
    if not e.held:
        return "-"
    return f"{shown(e.readings_sd, e.unit)[0]:.3g}" if np.isfinite(e.readings_sd) else "no limit"


def _percent(share: float) -> str:
    """A share in per cent; of initial values next to nothing the digits would say nothing."""
    return f"{share:.1f} %" if share < _MOST_PERCENT else f"> {_MOST_PERCENT:.0f} %"


def interval_tables(fit: Fit) -> tuple[ReportTable, ...]:
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
    return (ReportTable(header, tuple(rows), caption),)


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
        blocks.append(ReportTable(header, tuple(_masked(m) for m in fit.cleaned), caption))
    gross = [m for m in fit.gross if m.kind == "gross"]
    if gross:
        caption = "Gross under the fitted and under a richer model: masked by the fit itself. Look at each."
        blocks.append(ReportTable(header, tuple(_masked(m) for m in gross), caption))
    blocks += [Text(m.words + ".") for m in fit.gross if m.kind != "gross"]
    return tuple(blocks)


def _masked(m: Masked) -> tuple[str, ...]:
    return (m.readings, m.kind, ", ".join(map(str, m.rows)), m.words)


def _quoted(e: Estimate) -> bool:
    """Whether an sd is quoted: neither fixed nor at a bound."""
    return bool(e.sd > 0.0)


def _value(e: Estimate) -> str:
    """The value with its sd, in its table's unit."""
    if _quoted(e):
        return with_sd(*(shown(v, e.unit)[0] for v in (e.value, e.sd)))
    return f"{shown(e.value, e.unit)[0]:.4g} ({'at bound' if np.isnan(e.sd) else 'fixed'})"


def _shared(fit: Fit) -> str:
    """The error that all markers of a pose share, where one was estimated."""
    return f"; shared by all markers of a pose: {fit.shared_sd * 1e3:.4f} mm, estimated" if fit.shared_sd else ""


def _total(fit: Fit) -> str:
    """The sds with the load's uncertainty, where one is stated."""
    if fit.total_covariance is None:
        return ""
    said = [
        f"{e.name} {_percent(100 * total / abs(e.initial))}"
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


def error_tables(fit: Fit) -> tuple[ReportTable, ...]:
    """For each kind of reading: before, after, and at held-out poses, those that the fit masked as gross among them.

    RMS per axis of displacements and gauges; of positions that of the distance.
    """
    out: list[ReportTable] = []
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
        note = " Masked rows count as held-out." if len(unseen) else ""
        if fit.carriers:
            note += f" It leaves out {', '.join(fit.carriers)}: each of these poses alone carries a parameter."
        out.append(_errors(title if at.all() else f"{kind}s, {title}", rows, note))
    return tuple(out)


def _errors(title: str, rows: Sequence[tuple[str, float]], note: str) -> ReportTable:
    return ReportTable(
        (title, "mm"),
        tuple((name, f"{value * 1e3:.4f}") for name, value in rows),
        "Leave-one-pose-out counts: it is the error at poses that the fit has not seen." + note,
    )


def frame_table(fit: Fit) -> ReportTable:
    """Where each tracker sees the robot's base."""
    rows = tuple(
        (
            f.series or "-",
            ", ".join(f"{v * 1e3:.3f}" for v in f.origin),
            "; ".join(", ".join(f"{v:.6f}" for v in row) for row in f.rotation),
        )
        for f in fit.frames
        if not f.touched
    )
    return ReportTable(
        ("series", "origin of the base, mm", "rotation matrix, by rows"), rows, "The base in tracker frames."
    )


def point_table(fit: Fit) -> ReportTable:
    """Where the touched points are."""
    rows = tuple(
        (f.series.partition(":")[2], *(f"{v * 1e3:.3f}" for v in f.pose), *["-"] * (3 - f.freedom))
        for f in fit.frames
        if f.touched
    )
    words = "Their places in the base frame; of a plate the distance of its plane from the base's origin."
    return ReportTable(("touched", "x or distance, mm", "y, mm", "z, mm"), rows, words)


def left_aside_table(fit: Fit) -> ReportTable:
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
    return ReportTable(("left aside", "absorbed by, or looks like", "sd"), rows, note)


def fit_section(fit: Fit, title: str, truth: dict[str, float] | None = None) -> Section:
    """Tables and figures of one fit in one section."""
    return Section(title, (*_answer(fit, fit_table(fit, truth)), *_evidence(fit)))


def fit_sections(
    fit: Fit, experiment: Experiment, readings: Readings, before: FitRecord | None = None
) -> tuple[Section, ...]:
    """A report's sections: the pictures, the residuals on the robot, and the evidence, folded; before: the fit of
    another campaign."""
    from qsframework.viz import residuals

    rows, missed = residuals(experiment, readings, fit.x, fit.frames, fit.linear)
    seen = np.isfinite(fit.residuals).all(axis=1).any()
    where = (workspace_figure(fit, readings, rows.plus, rows.marker, missed),) if seen else ()
    return (
        Section(
            "Parameters and errors",
            (
                *(() if before is None else (Text(moved_words(fit, before)), moved_table(fit, before))),
                *_answer(fit, fit_table(fit, stiffness=True), before),
            ),
        ),
        Section("Residuals on the robot", (_on_the_robot(fit, experiment, readings), *where)),
        Section("Evidence", tuple(_evidence(fit)), folded=True),
        Section("Residuals", residual_figures(fit), folded=True),
    )


def _answer(fit: Fit, table: ReportTable, before: FitRecord | None = None) -> tuple[Block, ...]:
    """How the readings were taken, whether what is left fits the noise, the parameters, and what cannot be separated; a
    long table comes after the figures."""
    said = (*(Text(line) for line in first_words(fit)), Text(verdict_words(fit)))
    figures = fit_figures(fit, before)
    body = (table, *figures) if len(table.rows) <= MATRIX else (*figures, table)
    return (*said, *body, *correlation_blocks(fit))


def _evidence(fit: Fit) -> Iterator[Block]:
    """Tables and notes behind the pictures."""
    if fit.left_aside:
        yield left_aside_table(fit)
    yield from error_tables(fit)
    yield from masked_blocks(fit)
    yield from interval_tables(fit)
    yield from (Text(note) for note in (*alignment_words(fit.alignments), *fit.notes))
    if len(fit.estimates) > MATRIX:
        yield correlation_figure(fit)
    if any(not f.touched for f in fit.frames):
        yield frame_table(fit)
    if any(f.touched for f in fit.frames):
        yield point_table(fit)


def _on_the_robot(fit: Fit, experiment: Experiment, readings: Readings) -> SceneView:
    """The residuals of the nominal and of the identified model in 3D."""
    from qsframework.viz import residuals

    rows, before = residuals(experiment, readings, values_before(fit.model, readings), linear=fit.linear)
    _, after = residuals(experiment, readings, fit.x, fit.frames, fit.linear)
    look = (
        "Look for green arrows that turn together with a link, or that all point one way: the model misses something, "
        "and qsf diagnose can name it."
    )
    return residual_view(experiment, readings, rows.keep, (before, after), ("nominal", "identified"), look)
