"""The fit in a report: the table in lmfit's spirit, measured against predicted, residuals."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from qsframework.errors import some_of
from qsframework.experiment import Experiment, Readings, make_rows
from qsframework.experiment.observations import values_before
from qsframework.fits import Estimate, Fit, FitRecord, Masked
from qsframework.fits.columns import COLUMNS, ERRORS, OWN, SUITED, FitColumn, sd_of
from qsframework.report.blocks import Block, ReportTable, SceneView, Section, Text
from qsframework.report.error_maps import error_maps
from qsframework.report.fit_plots import (
    correlation_blocks,
    correlation_figure,
    fit_figures,
    residual_figures,
    residual_view,
)
from qsframework.report.moved_section import moved_table, moved_words
from qsframework.report.numbers import MATRIX
from qsframework.report.words.fit import STATES, alignment_words, first_words, listed_names, verdict_words
from qsframework.report.words.noise import SOURCE
from qsframework.report.words.sizes import (
    shown_number,
    shown_with_sd,
    stiffness_words,
    unit_shown,
    unquoted,
)

_SAME = 1.05
"""A total sd that is larger than that of the noise by less than this is not worth a word."""
_MOST_PERCENT = 999.0


def fit_table(fit: Fit, truth: dict[str, float] | None = None, brief: bool = False) -> ReportTable:
    """The columns of each estimate, those of frames and touched points last; with the truth where a simulation knows
    it. Columns that say nothing are left out, and, of a brief table, those that evidence has room for."""
    every = COLUMNS if truth is None else [*(c for c in COLUMNS[:-1] if c.brief), *_compared(truth), COLUMNS[-1]]
    columns = [c for c in every if c.head and (c.brief or not brief)]
    estimates = sorted(fit.estimates, key=lambda e: e.name.startswith(("frame", "point[", "plane[")))
    cells = {c.head: [_cell(c, fit, e) for e in estimates] for c in columns}
    cells = {head: column for head, column in cells.items() if set(column) != {"-"}}
    states = {e.state: STATES[e.state] for e in fit.estimates if e.state in STATES}
    legend = "".join(f" {state.value.capitalize()}: {words}." for state, words in states.items())
    held = any(e.share is not None for e in fit.estimates)
    known = "stated" if fit.shared_p is None else "estimated"
    shared = f"; shared by all markers of a pose: {fit.shared_sd * 1e3:.4f} mm, {known}" if fit.shared_sd else ""
    return ReportTable(
        tuple(cells),
        tuple(zip(*cells.values(), strict=True)),
        f"Method: {fit.method}, {'linear model' if fit.linear else 'full equilibrium'}. {_total(fit)}"
        f"Noise of one coordinate: {fit.sigma * 1e3:.4f} mm, {SOURCE[fit.sigma_source]}{shared}.{legend}"
        + (" Identified: the share of the variance before the readings that they removed." if held else ""),
    )


def _compared(truth: dict[str, float]) -> tuple[FitColumn, ...]:
    """The columns of a simulation, whose true values are known."""
    return (
        FitColumn(head="truth", value=lambda _, e: truth[e.name], unit=OWN, brief=True),
        FitColumn(
            head="error / sd",
            value=lambda fit, e: (e.value - truth[e.name]) / sd_of(fit, e) if e.sd > 0.0 else np.nan,
            brief=True,
        ),
    )


def _cell(column: FitColumn, fit: Fit, e: Estimate) -> str:
    """A cell as people read it; "-" for nothing."""
    value = column.value(fit, e)
    if isinstance(value, str):
        return unit_shown(value) if column.unit == OWN else value
    if column.sd is not None:
        return _value(e, column.sd(fit, e))
    if value is None or np.isnan(value):
        return "-"
    if np.isinf(value):
        return "no limit"
    if column.unit == "%":
        return _percent(100 * value)
    if column.unit == "stiffness":
        return stiffness_words(e.unit, 1.0 / value)
    return shown_number(value, e.unit) if column.unit == OWN else f"{value:+.2f}"


def _percent(share: float) -> str:
    """A share in per cent; of values next to nothing the digits would say nothing."""
    return f"{share:.1f} %" if share < _MOST_PERCENT else f"> {_MOST_PERCENT:.0f} %"


def interval_tables(fit: Fit) -> tuple[ReportTable, ...]:
    """The profile intervals, where some were asked for."""
    if not fit.intervals:
        return ()
    rows: list[tuple[str, ...]] = []
    for e, i in ((e, i) for i in fit.intervals for e in fit.estimates if e.name == i.name):
        ends = (shown_number(v, e.unit) for v in (i.lower, i.upper, *i.linear))
        rows.append((i.name, f"{100 * i.level:.0f} %", *ends, unit_shown(e.unit)))
    header = ("parameter", "level", "from", "to", "value - t sd", "value + t sd", "unit")
    caption = (
        "Profile intervals: within them the best fit of the other parameters is not significantly worse. Where they "
        "differ from value ± t sd, the model is nonlinear: quote the intervals. An end at a bound is that bound."
    )
    return (ReportTable(header, tuple(rows), caption),)


def masked_blocks(fit: Fit) -> tuple[Block, ...]:
    """What was masked before the fit, where the readings were looked through, and what the fit found to be gross."""
    blocks: list[Block] = []
    header = ("masked", "kind", "rows", "what was found")
    if fit.cleaned is not None and not fit.cleaned:
        blocks.append(Text("The readings were checked for wrong rows: none is masked."))
    if fit.cleaned:
        caption = "These rows were masked before the fit and are not used. Look at each: it stays in the file."
        blocks.append(ReportTable(header, tuple(_masked(m) for m in fit.cleaned), caption))
    gross = [m for m in fit.gross if m.unused]
    if gross:
        caption = "Duplicate rows, and outliers under the fitted and a richer model: masked by the fit itself."
        blocks.append(ReportTable(header, tuple(_masked(m) for m in gross), caption))
    blocks += [Text(m.words + ".") for m in fit.gross if not m.unused]
    return tuple(blocks)


def _masked(m: Masked) -> tuple[str, ...]:
    return (m.readings, m.kind, ", ".join(map(str, m.rows)), m.words)


def _value(e: Estimate, sd: float) -> str:
    """The value with its sd, in its table's unit."""
    text = shown_with_sd(e.value, sd, e.unit)
    return text if sd > 0.0 else f"{text} {unquoted(sd)}"


def _total(fit: Fit) -> str:
    """Which sds hold more than the noise of the readings, and by what; whether a stated load adds anything."""
    parts = {h.name: h.moment[i] * h.moved**2 for i, h in enumerate(fit.held) if h.sd >= 0.0}
    if fit.total_covariance is not None:
        parts |= {"the load": np.diag(fit.total_covariance - fit.covariance)}
    more = [e for e in fit.estimates if e.sd > 0.0 and sd_of(fit, e) > _SAME * e.sd]
    if not more:
        return "The load's stated uncertainty adds nothing that counts to these sds. " if "the load" in parts else ""
    said = [f"{e.name} ({sd_of(fit, e) / e.sd:.2g} times)" for e in more]
    most = dict.fromkeys(max(parts, key=lambda name: parts[name][fit.names.index(e.name)]) for e in more)
    settles = "" if [*most] == ["the load"] else " State more closely what is held at nominal, or name it in fit."
    return f"Larger than by the noise alone are the sds of {some_of(said)}, most by {some_of([*most])}.{settles} "


def error_tables(fit: Fit) -> tuple[ReportTable, ...]:
    """For each kind of reading the 3D RMS of its errors: before, after, and at held-out poses with masked rows."""
    heads = {row.key: row.head for row in ERRORS}
    note = "Quote the held-out error: it is the prediction error."
    note += " Masked rows count as held-out." if len(fit.missed) else ""
    note += f" The nominal model is {SUITED}." if (fit.kind == "position").any() else ""
    if fit.carriers:
        note += f" It leaves out {some_of(fit.carriers)}: each of these poses alone carries a parameter."
    return tuple(
        ReportTable(
            ("3D RMS" if len(fit.errors) == 1 else f"{kind}s, 3D RMS", "mm"),
            tuple((heads[key], f"{1e3 * value:.4f}") for key, value in errors.items()),
            note,
        )
        for kind, errors in fit.errors.items()
    )


def frame_table(fit: Fit) -> ReportTable:
    """Where each tracker sees the robot's base."""
    rows = tuple(
        (
            f.series or "-",
            ", ".join(f"{v * 1e3:z.3f}" for v in f.origin),
            "; ".join(", ".join(f"{v:z.6f}" for v in row) for row in f.rotation),
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
        (f.series.partition(":")[2], *(f"{v * 1e3:z.3f}" for v in f.pose), *["-"] * (3 - f.freedom))
        for f in fit.frames
        if f.touched
    )
    words = "Their places in the base frame; of a plate the distance of its plane from the base's origin."
    return ReportTable(("touched", "x or distance, mm", "y, mm", "z, mm"), rows, words)


def not_estimated_table(fit: Fit) -> ReportTable:
    """Parameters that were requested and that these readings cannot identify."""
    rows = tuple((e.name, listed_names(e.correlated_with) or "no effect") for e in fit.not_estimated)
    return ReportTable(("not estimated", "confounded with"), rows, "Requested but not identifiable; kept at nominal.")


def fit_section(fit: Fit, title: str, truth: dict[str, float] | None = None) -> Section:
    """Tables and figures of one fit in one section."""
    return Section(title, (*_answer(fit, fit_table(fit, truth)), *_evidence(fit)))


def fit_sections(
    fit: Fit, experiment: Experiment, readings: Readings, before: FitRecord | None = None
) -> tuple[Section, ...]:
    """A report's sections: the pictures, the residuals on the robot, and the evidence, folded; before: the fit of
    another campaign."""
    return (
        Section(
            "Parameters and errors",
            (
                *(() if before is None else (Text(moved_words(fit, before)), moved_table(fit, before))),
                *_answer(fit, fit_table(fit), before),
            ),
        ),
        where_section(fit, experiment, readings),
        Section("Evidence", tuple(_evidence(fit)), folded=True),
        Section("Residuals", residual_figures(fit), folded=True),
    )


def where_section(
    fit: Fit, experiment: Experiment, readings: Readings, title: str = "Residuals on the robot"
) -> Section:
    """Where the errors are: on the arm, and over its workspace before the fit and at held-out poses."""
    errors = {"nominal model": fit.measured - fit.nominal, "identified, held-out": fit.left_out}
    maps = error_maps(experiment, make_rows(fit.used(readings)), errors)
    return Section(title, (_on_the_robot(fit, experiment, readings), *maps))


def _answer(fit: Fit, table: ReportTable, before: FitRecord | None = None) -> tuple[Block, ...]:
    """How the readings were taken, whether what is left fits the noise, the parameters, and what cannot be separated; a
    long table comes after the figures."""
    said = (*(Text(line) for line in first_words(fit)), Text(verdict_words(fit)))
    figures = fit_figures(fit, before)
    body = (table, *figures) if len(table.rows) <= MATRIX else (*figures, table)
    return (*said, *body, *correlation_blocks(fit))


def _evidence(fit: Fit) -> Iterator[Block]:
    """Tables and notes behind the pictures."""
    if fit.not_estimated:
        yield not_estimated_table(fit)
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

    rows, before = residuals(experiment, readings, values_before(fit.model, readings.hashes), linear=fit.linear)
    _, after = residuals(experiment, readings, fit.x, fit.frames, fit.linear)
    look = (
        "Look for green arrows that turn together with a link, or that all point one way: the model misses something, "
        "and qsf diagnose can name it."
    )
    return residual_view(experiment, readings, rows.keep, (before, after), ("nominal", "identified"), look)
