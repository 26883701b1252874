"""The report of a diagnosis: verdict, causes, errors, residuals, what cannot be told apart, noise and data."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from qsframework.diagnoses.result import Diagnosis
from qsframework.diagnoses.second_day import FollowUp
from qsframework.experiment import make_rows
from qsframework.report import diagnosis_plots as plots, diagnosis_tables as tables
from qsframework.report.blocks import Block, Section, Text
from qsframework.report.error_maps import error_maps
from qsframework.report.fit_plots import residual_view
from qsframework.report.provenance import EQUILIBRIUM, LEAST_SQUARES, LINEAR, provenance_section
from qsframework.report.words.diagnosis import method_words
from qsframework.report.words.follow_up import follow_up_words
from qsframework.report.words.law import place_words
from qsframework.report.words.noise import audit_words, misfit_words
from qsframework.report.words.sizes import kind_and_place

_HOW = (
    "Wrong conventions are applied and refitted first. The exact model (full equilibrium, every law) is fitted by "
    "least squares; the noise is audited on what all causes together leave. Every effect of the library at every place "
    "is scored from one Jacobian (Lagrange multiplier test), and the largest of all scores is compared with its own "
    "distribution by Monte Carlo (max-T). Small sets of causes are searched by the extended BIC (gamma = 1), the best "
    "are refitted with the exact model. A test for remaining signal looks for any further smooth motion at any "
    "joint or link. Held-out errors repeat the search in every fold."
)


_DIM = 0.25
"""Brightness of a place of a small share: still to be seen."""
_LAWS = (
    ("score of a cause", "s^2 = |P r|^2, P onto the cause's part of the Jacobian that the fit leaves", "Rao 1948"),
    ("chance over all causes", "adjusted p = share of simulated maxima above s (max-T)", "Westfall, Young 1993"),
    ("choice of a set", "extended BIC = BIC + 2 gamma log(number of sets of this size)", "Chen, Chen 2008"),
)


def diagnosis_sections(diagnosis: Diagnosis, files: Sequence[Path], day: FollowUp | None = None) -> tuple[Section, ...]:
    """All sections of the report; files: what the diagnosis read, for their hashes; day: the visits of a second day."""
    model, robots = diagnosis.extended.model, (diagnosis.experiment.robot,)
    laws = (LINEAR, EQUILIBRIUM, LEAST_SQUARES, *_LAWS)
    computed = provenance_section(model.effects, files, diagnosis.seed, laws, model.parameters, robots)
    r = diagnosis.readings
    rows = f"{len(diagnosis.kept)} of {len(r.use)} rows at {len(r.poses)} poses"
    settings = Text(f"Level {100 * diagnosis.level:g} %, {len(diagnosis.table)} causes tried, {rows}.")
    return (
        Section("Verdict", tuple(_verdict(diagnosis, day))),
        Section("Causes", tuple(_causes(diagnosis)), folded=True),
        *([] if day is None else [Section("A second day", tuple(_day(day)))]),
        Section("Residuals before and after", tuple(_residuals(diagnosis)), folded=True),
        Section("What these readings can identify", tuple(_tell(diagnosis)), folded=True),
        Section("Noise and data", tuple(_noise(diagnosis)), folded=True),
        Section(computed.title, (Text(_HOW), settings, *computed.blocks), folded=True),
    )


def _verdict(diagnosis: Diagnosis, day: FollowUp | None) -> Iterator[Block]:
    yield plots.budget_figure(diagnosis)
    yield residual_view(
        diagnosis.experiment,
        diagnosis.readings,
        diagnosis.kept,
        diagnosis.residuals(),
        ("before", "after the extension"),
        "Look for red arrows that turn together with a link.",
        _suspects(diagnosis),
    )
    for title, rows in tables.verdict_groups(diagnosis, day):
        yield Text(f"{title}:")
        yield rows
    yield tables.error_rows(diagnosis)


def _suspects(diagnosis: Diagnosis) -> dict[str, tuple[str, float]]:
    """What glows on the arm: the named causes; without any the places where one may be, by their shares."""
    named = {f.name: (kind_and_place(f.name)[1], 1.0) for f in diagnosis.findings}
    return named or {
        f"{place_words(x.law)} {100 * x.share:.0f} %": (x.law.place, max(x.share, _DIM)) for x in diagnosis.places
    }


def _causes(diagnosis: Diagnosis) -> Iterator[Block]:
    if (certain := tables.cause_table(diagnosis)).rows:
        yield certain
    if (doubtful := tables.doubtful_table(diagnosis)).rows:
        yield Text("Doubtful, and never to be read as certain:")
        yield doubtful
    for f in diagnosis.findings:
        if f.alternatives:
            said = ", ".join(f"{r.name} ({tables.degrees(r.angle)})" for r in f.alternatives)
            yield Text(f"{f.name} cannot be separated from {said}: any of them explains the readings as well.")
        if f.hangs_on:
            sets = ", ".join("+".join(s) for s in f.hangs_on)
            yield Text(f"{f.name} rests on poses {sets}: without them another answer, or none, fits as well.")
    if diagnosis.leftovers:
        yield tables.leftover_table(diagnosis)
    if diagnosis.places:
        yield tables.place_table(diagnosis)
    if diagnosis.learned is not None:
        yield from plots.learned_figure(diagnosis, diagnosis.learned)
    for rest in (tables.alone_table, tables.excluded_table, tables.unseen_table):
        if (table := rest(diagnosis)).rows:
            yield table


def _day(day: FollowUp) -> Iterator[Block]:
    yield from (Text(said) for said in follow_up_words(day))
    yield tables.suspect_table(day)


def _residuals(diagnosis: Diagnosis) -> Iterator[Block]:
    rows, (before, after) = make_rows(diagnosis.readings), diagnosis.residuals()
    kept = rows.take(np.isin(rows.keep, diagnosis.kept))
    yield from error_maps(diagnosis.experiment, kept, {"identified": before, "after the extension": after})
    yield plots.cause_figure(diagnosis)
    yield plots.marker_figure(diagnosis)
    if diagnosis.before.trends:
        yield tables.trend_table(diagnosis)


def _tell(diagnosis: Diagnosis) -> Iterator[Block]:
    yield plots.power_figure(diagnosis)
    angles = plots.angle_figure(diagnosis)
    if angles is not None:
        yield angles
    yield tables.all_causes_table(diagnosis)


def _noise(diagnosis: Diagnosis) -> Iterator[Block]:
    for said in audit_words(diagnosis.audit):
        yield Text(said)
    for label, fit in (("Before", diagnosis.before), ("After", diagnosis.after)):
        for said in misfit_words(fit):
            yield Text(f"{label} the extension: {said}")
    if len(diagnosis.outliers):
        yield tables.outlier_table(diagnosis)
    if diagnosis.conventions:
        yield tables.convention_table(diagnosis)
        for c in diagnosis.conventions:
            yield Text(f"{c.name}: {c.words}.")
    else:
        yield Text(
            "No other convention (controller angles, joint signs, axes, signs, exchanged markers, late angles, units) "
            "explains the readings better than the files as given."
        )
    for said in method_words(diagnosis):
        yield Text(said)
