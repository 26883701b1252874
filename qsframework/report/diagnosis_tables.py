"""Tables of a diagnosis: its causes with their evidence, what is excluded, data problems, errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsframework.diagnoses.result import Diagnosis, Line, NamedCause, Status, Value
from qsframework.diagnoses.second_day import FollowUp
from qsframework.plugin import Parameter
from qsframework.report.blocks import Lines, ReportTable
from qsframework.report.words.diagnosis import (
    CauseGroup,
    excluded_words,
    limit_words,
    named_groups,
    statements,
    status_words,
)
from qsframework.report.words.follow_up import suspect_words
from qsframework.report.words.headline import check_words
from qsframework.report.words.law import place_words, variable_words
from qsframework.report.words.next_steps import next_steps
from qsframework.report.words.sizes import grouped, kind_and_place, mm, number, people_estimate, people_size, three

_STRONGEST = 12
FOLDED = 10
"""Causes beyond which a list of what is excluded or unseen is folded."""
_EVIDENCE = (
    "cause",
    "estimate ± sd",
    "s",
    "adjusted p",
    "delta EBIC",
    "held-out gain",
    "nearest alternative, angle",
    "status",
)
_BESIDE = ("nearest, angle", "upper limit given the named causes (95 %)")


def verdict_groups(diagnosis: Diagnosis, day: FollowUp | None = None) -> tuple[tuple[str, Lines], ...]:
    """What the verdict rests on, and what to measure next, under their titles; causes stand in front."""
    said = statements(diagnosis)
    groups: list[tuple[str, Lines]] = []
    for group in CauseGroup:
        rows = [(s.about, s.text) for s in said if s.group is group]
        looked = named_groups(diagnosis).get(group, ())
        rows += [("Look at", f"{check_words(f)} ({f.name})") for f in looked if f.check]
        if rows:
            groups.append((group.value, Lines(tuple(rows))))
    steps = tuple((step.do, f"{step.settles}.") for step in next_steps(diagnosis, day))
    return (*groups, *([("Next", Lines(steps))] if steps else []))


def estimate_words(values: Sequence[Value]) -> str:
    """Estimates of a cause's parameters in the units of people; each by its last name where there are several."""
    said: list[str] = []
    for v in values:
        if v.sd == 0.0:  # a convention is adopted, not estimated
            said.append(f"set to {v.value:g} {v.unit}".strip())
            continue
        label = v.name.rpartition(".")[2] + " " if len(values) > 1 else ""
        before = f" (was {people_size(Parameter(v.name, v.unit), v.initial)})" if v.initial != 0.0 else ""
        said.append(f"{label}{people_estimate(Parameter(v.name, v.unit), v.value, v.sd)}{before}")
    return "; ".join(said)


def cause_table(diagnosis: Diagnosis) -> ReportTable:
    """Names that are not doubtful and what cannot be told from them, with all the evidence."""
    rows = _with_alternatives(diagnosis, diagnosis.sure)
    if not diagnosis.findings:
        strongest = sorted((x for x in diagnosis.table if x.status is Status.EXCLUDED), key=lambda x: -x.s)[:3]
        rows = [_row(x, diagnosis) for x in strongest]
    return ReportTable(
        _EVIDENCE,
        tuple(rows),
        "s: signal of a cause in units of noise, given the fitted parameters. Adjusted p: how often the largest of all "
        "causes looks as strong without any effect. Delta EBIC: decrease of the extended BIC with the cause. Held-out "
        "gain: decrease of the held-out error with this cause, given the other named ones. Below 10 deg two causes do "
        "nearly the same to these readings.",
    )


def doubtful_table(diagnosis: Diagnosis) -> ReportTable:
    """Names without which held-out poses are predicted as well, and what cannot be told from them."""
    return ReportTable(
        _EVIDENCE,
        tuple(_with_alternatives(diagnosis, diagnosis.doubtful)),
        "Doubtful: significant in these readings, but the held-out error is not clearly smaller with them. An "
        "extended robot is written without them.",
    )


def alone_table(diagnosis: Diagnosis) -> ReportTable:
    """Causes that are plain by themselves and show nothing given the named ones."""
    alone = diagnosis.plain_alone
    rows = tuple(
        (
            x.name,
            number(x.s, ".1f"),
            chance(x.p_value),
            _nearest(x),
            limit_words(x),
        )
        for x in alone
    )
    return ReportTable(
        (status_words(alone[0], diagnosis) if rows else "", "s alone", "adjusted p alone", *_BESIDE),
        rows,
        "Each of these looks plain by itself, because it does in part what a named cause does. Beside the named ones "
        "nothing of it is left; the bound says how large it could still be.",
        folded=_many(f"{len(rows)} causes are plain by themselves, but explained by the named ones", len(rows)),
    )


def _with_alternatives(diagnosis: Diagnosis, findings: Sequence[NamedCause]) -> list[tuple[str, ...]]:
    """Rows of findings, and of what cannot be told from them."""
    lines = {x.name: x for x in diagnosis.table}
    named, alternatives = {f.name for f in diagnosis.findings}, {r.name for f in findings for r in f.alternatives}
    tied = (x for x in diagnosis.table if x.name in alternatives - named and x.status is Status.TIED)
    return [*(_named(f, lines.get(f.name)) for f in findings), *(_row(x, diagnosis) for x in tied)]


def _nearest(x: Line) -> str:
    return f"{x.nearest}, {degrees(x.angle)}" if x.nearest else "-"


def _named(f: NamedCause, line: Line | None) -> tuple[str, ...]:
    alternatives = ", ".join(f"{r.name}, {degrees(r.angle)}" for r in f.alternatives)
    near = "-" if line is None else _nearest(line)
    return (
        f.name,
        estimate_words(f.values),
        f"{f.s:.1f}",
        chance(f.p_value),
        f"{f.ebic_gain:.1f}",
        f"{100 * f.heldout_gain:.0f} %" if np.isfinite(f.heldout_gain) else "-",
        alternatives or near,
        "doubtful" if f.doubtful else Status.NAMED.value,
    )


def _row(x: Line, diagnosis: Diagnosis) -> tuple[str, ...]:
    named = ((f.name, r.angle) for f in diagnosis.findings for r in f.alternatives if r.name == x.name)
    nearest, angle = next(named, (x.nearest, x.angle))
    near = f"{nearest}, {degrees(angle)}" if nearest else "-"
    status = status_words(x, diagnosis)
    status = f"{status} {limit_words(x)}" if status == Status.EXCLUDED.value else status
    return (
        x.name,
        estimate_words(x.values) or "-",
        number(x.s, ".1f"),
        chance(x.p_value),
        "-",
        "-",
        near,
        status,
    )


def all_causes_table(diagnosis: Diagnosis) -> ReportTable:
    """Every cause that was tried, strongest first: what it showed, and what is excluded."""
    order = list(Status)
    lines = sorted(diagnosis.table, key=lambda x: (order.index(x.status), -x.s if np.isfinite(x.s) else 0.0))
    rows = tuple(
        (
            x.name,
            status_words(x, diagnosis),
            number(x.s, ".1f"),
            chance(x.p_value),
            limit_words(x) or "-",
            _nearest(x),
        )
        for x in lines
    )
    return ReportTable(
        ("cause", "status", "s", "adjusted p", "bound, 95 %", "nearest alternative, angle"),
        rows,
        "Excluded above: a cause larger than this would have shown in these readings given the named ones. Invisible "
        "here: the fitted parameters absorb it, or no reading depends on it; nothing is said about it.",
    )


def excluded_table(diagnosis: Diagnosis, short: bool = False) -> ReportTable:
    """One row for each kind of effect: above which size each place is excluded; short: without stiffnesses."""
    excluded = _excluded(diagnosis)
    named = ((*kind_and_place(x.name), limit_words(x, not short)) for x in sorted(excluded, key=lambda x: x.name))
    kinds = grouped((kind, f"{where} {limit}".strip()) for kind, where, limit in named)
    return ReportTable(
        ("no", "above (95 %)"),
        tuple((kind, "; ".join(bounds)) for kind, bounds in kinds.items()),
        "What these readings would have shown. It is not a statement about smaller ones.",
        folded=_many(f"upper limits (95 %) for {len(excluded)} effects: {excluded_words(diagnosis)}", len(excluded)),
    )


def _excluded(diagnosis: Diagnosis) -> list[Line]:
    """Causes of which the readings say how large they are at most, without those that are plain by themselves."""
    alone = {x.name for x in diagnosis.plain_alone}
    excluded = (x for x in diagnosis.table if x.status is Status.EXCLUDED and x.name not in alone)
    return [x for x in excluded if limit_words(x)]


def unseen_table(diagnosis: Diagnosis) -> ReportTable:
    """One row for each kind of effect of which these readings say nothing, and why."""
    unseen = [x for x in diagnosis.table if x.status in (Status.INVISIBLE, Status.UNTESTED)]
    reasons = (limit_words(x) if x.status is Status.UNTESTED else x.status.value for x in unseen)
    named = ((*kind_and_place(x.name), why) for x, why in zip(unseen, reasons, strict=True))
    kinds = grouped(((kind, why), where) for kind, where, why in named)
    rows = [(kind, ", ".join(w for w in places if w) or "-", why) for (kind, why), places in kinds.items()]
    return ReportTable(
        ("not observable", "at", "because"),
        tuple(rows),
        "Invisible here: the fitted parameters absorb it, or no reading depends on it. What needs a column was not "
        "tested: record it, and it is.",
        folded=_many(_unseen_words(unseen), len(unseen)),
    )


def _unseen_words(unseen: Sequence[Line]) -> str:
    """How many causes nothing is said about, and which columns would change that."""
    untested = [x for x in unseen if x.status is Status.UNTESTED]
    said = f"{len(unseen) - len(untested)} effects are not observable with these data"
    if untested:
        needs = ", ".join(sorted({n for x in untested for n in x.needs}))
        said += f"; {len(untested)} were not tested: they need {needs}"
    return said


def _many(said: str, count: int) -> str:
    """What stands in the place of a long table."""
    return said if count > FOLDED else ""


def error_rows(diagnosis: Diagnosis) -> ReportTable:
    """3D RMS on the readings and held out."""
    e, learned = diagnosis.rms.space, diagnosis.learned
    gain = mm(diagnosis.rms.in_space(learned.heldout)) if learned is not None and learned.holds else ""
    law = [("extended with the learned correction", "-", gain)] if gain else []
    rows = (
        ("nominal model", mm(e.nominal), "-"),
        ("identified", mm(e.identified), mm(e.heldout_identified)),
        ("extended with the named causes", mm(e.extended), mm(e.heldout_extended)),
        *law,
        ("noise alone", mm(e.noise), mm(e.noise)),
    )
    return ReportTable(
        ("3D RMS, mm", "on the readings", "held-out"),
        rows,
        "Held-out: at poses that neither the fit nor the choice of causes has used. The extension is worth its "
        "parameters where it brings this error near the noise.",
    )


def convention_table(diagnosis: Diagnosis) -> ReportTable:
    """Conventions under which the readings fit better than as given."""
    rows = tuple(
        (
            c.name,
            three(c.value),
            mm(c.rms_given),
            mm(c.rms),
            f"{c.evidence:.1f}",
            "adopted" if c.compelling else "no",
        )
        for c in diagnosis.conventions
    )
    return ReportTable(
        ("convention", "value", "as given, mm", "with it, mm", "log evidence", "compelling"),
        rows,
        "Wrong controller angles, axes, signs and units, and slips in single rows, were applied and refitted before "
        "any cause was looked for. Only a compelling one counts; it says that the file, not the robot, is off.",
    )


def outlier_table(diagnosis: Diagnosis) -> ReportTable:
    """Rows that the audit of the noise took out."""
    r = diagnosis.readings
    names = [m.name for m in diagnosis.experiment.markers]
    rows = tuple(
        (
            str(int(r.line[i])),
            r.states.pose[int(r.plus[i])],
            names[int(r.marker[i])],
            ", ".join(f"{1e3 * v:z.3f}" for v in r.value[i].tolist()),
        )
        for i in diagnosis.outliers.tolist()
    )
    return ReportTable(
        ("row", "pose", "marker", "reading, mm"),
        rows,
        "Rows that do not belong to the others, whatever the cause; they took no part in the search.",
    )


def suspect_table(found: FollowUp) -> ReportTable:
    """What the first day leaves open, and a second one is to settle."""
    rows = tuple((suspect_words(s), f"{100 * s.share:.0f} %") for s in found.suspects[:_STRONGEST])
    return ReportTable(
        ("remaining explanation", "share of the evidence"),
        rows,
        "The visits are chosen so that these explanations predict readings as different as possible.",
    )


def leftover_table(diagnosis: Diagnosis) -> ReportTable:
    """What the named causes leave, the plainest first."""
    shown = diagnosis.leftovers[:_STRONGEST]
    more = len(diagnosis.leftovers) - len(shown)
    return ReportTable(
        ("unexplained: an extra motion at", "that depends on", "p"),
        tuple((place_words(x.law), variable_words(x.law), chance(x.p_value)) for x in shown),
        "A smooth extra motion, of no cause in the library, that the readings still hold. The first row is where to "
        "look; the others are often the same motion seen from elsewhere" + (f" ({more} more)." if more else "."),
    )


def place_table(diagnosis: Diagnosis) -> ReportTable:
    """Where what is left may be."""
    rows = (
        (place_words(x.law), f"{100 * x.share:.0f} %", variable_words(x.law), ", ".join(map(place_words, x.equivalent)))
        for x in diagnosis.places
    )
    return ReportTable(
        ("it may be", "share of the evidence", "where it depends most likely on", "equivalent places"),
        tuple(rows),
        "The places that hold 95 % of the evidence together, a smooth law of one variable or two at each. These "
        "readings cannot separate them.",
    )


def trend_table(diagnosis: Diagnosis) -> ReportTable:
    """On what the residuals depend, before and after."""
    after = {t.variable: t for t in diagnosis.after.trends}
    rows = tuple(
        (
            t.variable,
            chance(t.p_value),
            f"{100 * t.share:.0f} %",
            *((chance(s.p_value), f"{100 * s.share:.0f} %") if (s := after.get(t.variable)) else ("-", "-")),
        )
        for t in diagnosis.before.trends[:_STRONGEST]
    )
    return ReportTable(
        ("residuals depend on", "p before", "share before", "p after", "share after"),
        rows,
        "p: chance of such a dependence from noise alone, all variables counted. Small ones before that are large "
        "after are what the named causes explain; small ones after are what is still missing.",
    )


def degrees(angle: float) -> str:
    """An angle between causes; `-` where there is none."""
    return f"{np.rad2deg(angle):.0f} deg" if np.isfinite(angle) else "-"


def chance(p: float) -> str:
    """A p-value in two digits."""
    if not np.isfinite(p):
        return "-"
    return "< 1e-16" if p < 1e-16 else f"{p:.2g}"
