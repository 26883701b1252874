"""Figures of a diagnosis: the error budget, residuals before and after, angles between causes, power of the test."""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence
from dataclasses import replace
from textwrap import wrap
from typing import Any

import numpy as np

from qsframework.diagnoses.error_budget import error_budget
from qsframework.diagnoses.learn import curve, dots
from qsframework.diagnoses.options import seen_below
from qsframework.diagnoses.power import detection_rate, threshold
from qsframework.diagnoses.result import Diagnosis, LearnedLaw
from qsframework.experiment import make_rows
from qsframework.hypotheses.search.family_test import FamilyBlock, chance
from qsframework.hypotheses.search.principal_angles import alias_classes, angle_matrix
from qsframework.plugin import Array
from qsframework.report import power_section
from qsframework.report.blocks import Figure, ReportTable
from qsframework.report.numbers import row_table
from qsframework.report.plots import AFTER, BARS, BEFORE, BLACK, BLUE, COLOURS, GREY, ORANGE, SKY, blank, panels
from qsframework.report.words.law import place_words, variable_words
from qsframework.report.words.sizes import mm

_ACROSS, _WIDE = 3, 40
_MOST = 80
"""Causes in the heat map, most visible first."""


def learned_figure(diagnosis: Diagnosis, learned: LearnedLaw) -> Iterator[Figure]:
    """The law that was learned, with two sds to each side, over the range that the readings have."""
    found = curve(learned, diagnosis.experiment.robot.facts)
    if found is None:
        return
    law, shift = learned.leftover.law, learned.leftover.law.part == "shift"
    degrees = found.over in law.angles or found.over == "came"
    x = np.rad2deg(found.x) if degrees else found.x
    felt = "N" if shift else "N m"
    unit = "deg" if degrees else felt if found.over == "torque" else "share of the readings taken"
    under = f" under {found.torque:.3g} {felt}" if found.torque > 0.0 else ""
    moves = "um" if shift else "urad"
    over = "<br>".join(wrap(f"{variable_words(law)}, {unit}", _WIDE))  # a telephone has room for so much
    figure = blank(f"Learned: {learned.name}", over, f"extra motion{under}, {moves}")
    rows = make_rows(diagnosis.readings)
    at, said = dots(learned, rows.take(np.isin(rows.keep, diagnosis.kept)), found)
    several = found.motion.shape[1] > 1
    names = _axes(learned) if several else (place_words(law),)
    for i, name in enumerate(names):
        y, band = 1e6 * found.motion[:, i], 2e6 * found.sd[:, i]
        figure.add_scatter(x=x, y=y, name=html.escape(name), line={"color": COLOURS[i]})
        around = np.concatenate([x, x[::-1]]), np.concatenate([y + band, (y - band)[::-1]])
        look: dict[str, Any] = {"fill": "toself", "fillcolor": COLOURS[i], "opacity": 0.15, "line": {"width": 0}}
        figure.add_scatter(x=around[0], y=around[1], name="2 sd", hoverinfo="skip", showlegend=False, **look)
        dot = {"color": COLOURS[i], "size": 5, "symbol": "circle-open"}
        where = np.rad2deg(at[:, i]) if degrees else at[:, i]
        figure.add_scatter(
            x=where, y=1e6 * said[:, i], mode="markers", name=f"readings, {html.escape(name)}", marker=dot
        )
    note = (
        "Empirical correction (95 % band); the linear spring is removed. Rings: the curve and the residual motion of "
        "each visit. Look for rings that leave the band together."
    )
    yield Figure(figure, note)


def _axes(learned: LearnedLaw) -> tuple[str, ...]:
    """Names of the coordinates that a law moves, as its weights have them."""
    ends = [name.rpartition("]")[2].split(".")[1] for name in learned.cause.names]
    return tuple(dict.fromkeys(ends))


def budget_figure(diagnosis: Diagnosis) -> Figure:
    """The held-out error from the identified model on, cause by cause, down to the noise."""
    space = diagnosis.rms.in_space
    steps = [replace(s, readings=space(s.readings), heldout=space(s.heldout)) for s in error_budget(diagnosis)]
    nominal, *body, noise = steps
    if len(body) > 1:
        body.append(replace(body[-1], label="extended"))
    names = [html.escape(s.label) for s in body]
    held = 1e3 * np.array([s.heldout for s in body])
    before = np.concatenate([held[:1], held[:-1]])
    whole = np.isin(np.arange(len(body)), (0, len(body) - 1))
    figure = blank("Error budget", "3D RMS, mm", "", 150 + 50 * len(body))
    for said, look, kind in (
        ("held-out", {"color": SKY}, whole),
        ("reduced by", {"color": BLUE}, ~whole & (held <= before)),
        ("rises by", BARS[0], ~whole & (held > before)),
    ):
        foot, top = np.where(whole, 0.0, np.minimum(held, before)), np.where(whole, held, np.maximum(held, before))
        at = np.flatnonzero(kind)
        if len(at):
            bars = {"y": [names[i] for i in at], "x": (top - foot)[at], "base": foot[at], "width": 0.6}
            figure.add_bar(**bars, orientation="h", name=said, marker=look)
    ends = [f"{name}<br>{v:.3f} mm" for name, v in zip(names, held, strict=True)]
    order = {"categoryorder": "array", "categoryarray": names, "autorange": "reversed"}
    figure.update_layout(barmode="overlay", yaxis={**order, "tickvals": names, "ticktext": ends})
    figure.add_scatter(
        x=[1e3 * s.readings for s in body],
        y=names,
        mode="markers",
        name="on the readings",
        marker={"symbol": "diamond", "size": 9, "color": BLACK},
    )
    band: dict[str, Any] = {"fillcolor": GREY, "opacity": 0.2, "line_width": 0, "layer": "below"}
    figure.add_vrect(0.0, 1e3 * noise.heldout, name="noise", showlegend=True, **band)
    return Figure(
        figure,
        f"Bars: the held-out error; the number is what is left after each step. The nominal model: "
        f"{mm(nominal.heldout)} mm. Look for steps that bring it clearly nearer to the noise (grey); what reaches "
        "beyond the grey at the end is unexplained. Diamonds far inside the bars: the model follows the noise.",
        row_table(
            ("3D RMS", "held-out, mm", "on the readings, mm"),
            [[s.label for s in steps], [1e3 * s.heldout for s in steps], [1e3 * s.readings for s in steps]],
        ),
    )


def cause_figure(diagnosis: Diagnosis) -> Figure:
    """Residuals along their main direction against every joint angle, the load, and the order of the rows."""
    direction, before, after = main_direction(diagnosis)
    r, kept = diagnosis.readings, diagnosis.kept
    facts = diagnosis.experiment.robot.facts
    q = facts.units.shown(r.poses.q[r.plus[kept]])
    force = np.linalg.norm(r.poses.wrench[r.plus[kept], :3], axis=1)
    joints = [f"{joint}, {facts.units[k].shown}" for k, joint in enumerate(facts.joints)]
    titles, against = [*joints, "force, N", "row of the readings file"], [*q.T, force, r.line[kept]]
    lines = -(-len(titles) // _ACROSS)
    title = "Residuals against joints, load and order"
    figure = panels(title, lines, _ACROSS, [html.escape(t) for t in titles], 230 * lines + 60)
    poses, labels = _poses(diagnosis), _labels(diagnosis)
    for k, x in enumerate(against):
        for values, look, name in ((before, BEFORE, "before"), (after, AFTER, "after")):
            figure.add_scatter(
                x=x,
                y=1e3 * values,
                mode="markers",
                name=name,
                legendgroup=name,
                showlegend=k == 0,
                marker={**look, "size": 5},
                customdata=poses,
                text=labels,
                row=k // _ACROSS + 1,
                col=k % _ACROSS + 1,
            )
    for row in range(lines):
        figure.update_yaxes(row=row + 1, col=1, title={"text": "residual, mm"})
    return Figure(
        figure,
        f"Measured minus predicted, along the residuals' main direction ({_vector(direction)}, base frame). Look "
        "for diamonds that bend or slope: they say on which joint the missing effect depends; full circles should be "
        "a level cloud. Residuals that grow with the force: a spring or a load is wrong; a slope or a step in the "
        "order of the rows: drift.",
        row_table(
            ("row", "pose", "marker", *joints, "force, N", "before, mm", "after, mm"),
            [*_named_rows(diagnosis), *q.T.tolist(), force.tolist(), (1e3 * before).tolist(), (1e3 * after).tolist()],
        ),
        wide=True,
    )


def marker_figure(diagnosis: Diagnosis) -> Figure:
    """Lengths of the residuals at each marker, before and after."""
    r = diagnosis.readings
    marker = r.marker[diagnosis.kept]
    names = np.array([html.escape(m.name) for m in diagnosis.experiment.markers])
    poses = _poses(diagnosis)
    figure = blank("Residuals at each marker", "", "length of the residual, mm")
    pairs = zip(diagnosis.residuals(), (BEFORE, AFTER), ("before", "after"), strict=True)
    for residuals, look, name in pairs:
        figure.add_box(
            x=names[marker],
            y=1e3 * np.linalg.norm(residuals, axis=1),
            name=name,
            marker={**look, "size": 4},
            customdata=poses,
            boxpoints="all",
            pointpos=0.0,
            jitter=0.5,
        )
    figure.update_layout(boxmode="group")
    return Figure(
        figure,
        "Look for one marker that stands out, and stays so after the extension: its mount or its stated place is "
        "wrong, and not the robot.",
        _marker_table(diagnosis),
    )


def _marker_table(diagnosis: Diagnosis) -> ReportTable:
    """RMS and largest length of the residuals at each marker, before and after."""
    marker = diagnosis.readings.marker[diagnosis.kept]
    rows: list[tuple[str, ...]] = []
    for k, m in enumerate(diagnosis.experiment.markers):
        sizes: list[Array] = [1e3 * np.linalg.norm(r[marker == k], axis=1) for r in diagnosis.residuals()]
        if len(sizes[0]):
            cells = (f"{v:.4f}" for s in sizes for v in (float(np.sqrt(np.mean(s**2))), float(s.max())))
            rows.append((m.name, str(len(sizes[0])), *cells))
    header = ("marker", "rows", "before: RMS mm", "largest mm", "after: RMS mm", "largest mm")
    return ReportTable(header, tuple(rows), "Lengths of the residual vectors.")


def _named_rows(diagnosis: Diagnosis) -> list[list[str]]:
    """Row of the file, pose and marker of every residual, a list each."""
    r, kept = diagnosis.readings, diagnosis.kept
    names, poses = [m.name for m in diagnosis.experiment.markers], r.pose
    lines = [str(line) for line in r.line[kept].tolist()]
    return [lines, [poses[i] for i in map(int, kept)], [names[k] for k in r.marker[kept].tolist()]]


def angle_figure(diagnosis: Diagnosis) -> Figure | None:
    """Angles between the visible causes; None where fewer than two are visible."""
    subspaces = diagnosis.case.subspaces()
    heads = [c[0] for c in alias_classes(subspaces)]
    heads = sorted(heads, key=lambda i: -subspaces[i].reach)[:_MOST]
    if len(heads) < 2:
        return None
    shown = [subspaces[i] for i in heads]
    return power_section.angle_figure(
        [x.cause.name for x in shown],
        angle_matrix(shown),
        f"The {len(shown)} visible causes that these readings show best, alike ones side by side; of causes that do "
        "the same (within 1 deg) one stands for all. Look for dark squares: causes that these poses cannot separate, "
        "whatever their size: other poses, loads or markers would.",
    )


def power_figure(diagnosis: Diagnosis) -> Figure:
    """How surely a cause of visible size s is detected in these readings, with what they hold."""
    blocks = [FamilyBlock(s.Q, s.one_sided) for s in diagnosis.case.subspaces() if s.visible]
    limit = float(np.quantile(chance(blocks, seed=diagnosis.seed), seen_below(diagnosis.level)))
    of = {s.cause.name: (s.Q.shape[1], s.one_sided) for s in diagnosis.case.subspaces() if s.visible}
    top = max([12.0, *(1.15 * f.s for f in diagnosis.findings)])
    s = np.linspace(0.0, top, 200)
    figure = blank("Power of the test on these readings", "s, visible size in units of noise", "chance of detection")
    for dof, sided in sorted(set(of.values())):
        rate = detection_rate(s, dof, sided, threshold(dof, sided, limit))
        name = f"{dof} direction{'s' if dof > 1 else ''}{', can only grow' if sided else ''}"
        figure.add_scatter(x=s, y=rate, mode="lines", name=name)
    for f in diagnosis.findings:
        if f.name in of:
            dof, sided = of[f.name]
            y = detection_rate(f.s, dof, sided, threshold(dof, sided, limit))
            figure.add_scatter(
                x=[f.s],
                y=[float(y)],
                mode="markers+text",
                text=[html.escape(f.name)],
                showlegend=False,
                textposition="bottom left",
                marker={"size": 11, "color": ORANGE, "symbol": "star"},
            )
    return Figure(
        figure,
        f"One line for each number of directions that a cause has; without any effect something is named in "
        f"{100 * diagnosis.level:g} % of data sets. Look where the lines rise, and for the causes named here (stars): "
        "a cause to the left of the rise can be there without being seen; its bound says how large.",
    )


def _poses(diagnosis: Diagnosis) -> list[str]:
    """The pose of every residual, as plots carry it."""
    return [html.escape(pose) for pose in _named_rows(diagnosis)[1]]


def main_direction(diagnosis: Diagnosis) -> tuple[Array, Array, Array]:
    """The direction (3,) in which the residuals are largest before the extension, and residuals (R,) along it, m."""
    before, after = diagnosis.residuals()
    direction = np.linalg.svd(before, full_matrices=False)[2][0]
    direction = direction * np.sign(direction[int(np.argmax(np.abs(direction)))])
    return direction, before @ direction, after @ direction


def _labels(diagnosis: Diagnosis) -> list[str]:
    rows = zip(*_named_rows(diagnosis), strict=True)
    return [html.escape(f"pose {pose}, {marker}, row {line}") for line, pose, marker in rows]


def _vector(direction: Sequence[float] | Array) -> str:
    return ", ".join(f"{v:.2f}" for v in direction)
