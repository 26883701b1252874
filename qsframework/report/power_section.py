"""What a plan would detect and name, in a report: sizes, what stays invisible, angles, power curves."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np

from qsframework.diagnoses.foresight import Foresight, Outlook, Prospect
from qsframework.diagnoses.unknown import SIZE, PlaceOutlook
from qsframework.plugin import Array, Indices
from qsframework.report.blocks import Figure, Plot, ReportTable, Section, Text
from qsframework.report.numbers import MATRIX, matrix_table
from qsframework.report.plots import DASHES, GREY, blank
from qsframework.report.words.forecast import (
    curve_words,
    foresight_words,
    kind_words,
    smallest_words,
    unknown_words,
    why_words,
)
from qsframework.report.words.law import place_words
from qsframework.report.words.sizes import grouped, kind_and_place

_OUTLOOKS = (Outlook.NAMED, Outlook.DETECTED, Outlook.INVISIBLE)
_LABELS = 50
"""Causes up to which the axes of the heat map carry all names."""


def size_table(foresight: Foresight) -> ReportTable:
    """Every visible cause: the smallest sizes that are detected and named, the nearest rival, the status."""
    seen = [p for p in foresight.prospects if p.status is not Outlook.INVISIBLE]
    rows = tuple((p.name, smallest_words(p), smallest_words(p, named=True), _alternative(p), _status(p)) for p in seen)
    return ReportTable(
        ("cause", "smallest size detected", "named", "nearest alternative, angle", "status"),
        rows,
        f"Detected: shown in {100 * foresight.power:.0f} % of measurements of this plan, at "
        f"{100 * foresight.level:.2g} % false alarms over all causes together. Named: also separated from all others, "
        f"its aliases apart, in {100 * foresight.share:.0f} %. Of a cause with several parameters each stands for "
        "itself, the others at zero.",
        _folded("causes that the plan would show", len(rows)),
    )


def kinds_table(foresight: Foresight) -> ReportTable:
    """Every kind of effect: the places where it would be named, only detected, or not be seen."""
    named = [(*kind_and_place(p.name), p.status) for p in foresight.prospects]
    places = grouped(((kind, outlook), where or "yes") for kind, where, outlook in named)
    kinds = sorted({kind for kind, *_ in named})
    rows = tuple((kind, *(", ".join(places.get((kind, o), ())) for o in _OUTLOOKS)) for kind in kinds)
    return ReportTable(
        ("effect", "can be named", "detected, not separated", "invisible here"),
        rows,
        "Every effect of the library by its places, at realistic sizes.",
    )


def hidden_table(foresight: Foresight) -> ReportTable:
    """What the plan cannot show, and why; one row for each kind of effect and reason."""
    named = ((*kind_and_place(p.name), p.why) for p in foresight.prospects if p.status is Outlook.INVISIBLE)
    kinds = grouped(((kind, why), where) for kind, where, why in named)
    rows = [(f"{kind} {', '.join(where)}".strip(), kind_words(why)) for (kind, why), where in kinds.items()]
    rows += [(u.name, f"needs the column {' and '.join(u.needs)}") for u in foresight.untested]
    return ReportTable(
        ("invisible here", "why"),
        tuple(rows),
        "A later diagnosis of this plan's readings says nothing about these.",
    )


def unknown_table(foresight: Foresight) -> ReportTable:
    """Every place where something that no library holds may act, and what it would be taken for."""
    places = () if foresight.unknown is None else foresight.unknown.places
    rows = tuple((place_words(p.place), *_outlook(p)) for p in sorted(places, key=lambda p: p.chance))
    return ReportTable(
        ("something unknown moves", "ranked first", "else most often"),
        rows,
        f"Effects of s = {SIZE:g} by plain laws: a constant once a load hangs, with the torque there, with the order "
        "of the readings, with the angle there.",
        _folded("places of unknown effects", len(rows)),
    )


def _outlook(p: PlaceOutlook) -> tuple[str, str]:
    if not p.shown:
        return "no reading shows it", ""
    other = f"{place_words(p.instead)} ({100 * p.instead_chance:.0f} %)" if p.instead is not None else ""
    return f"{100 * p.chance:.0f} %", other


def pair_table(foresight: Foresight) -> ReportTable:
    """Pairs of causes that the plan cannot separate."""
    rows = tuple(
        (p.first, p.second, f"{np.rad2deg(p.angle):.1f} deg", f"{p.s:.0f}" if p.s < 1e3 else "never")
        for p in foresight.pairs
    )
    return ReportTable(
        ("cause", "alternative", "angle", "separated from s"),
        rows,
        "Below 10 deg two causes do nearly the same to the readings. s: visible size in units of noise from which the "
        "right one is named in most measurements; `qsf diagnose` designs poses that widen the angle, or says what else "
        "to measure.",
        _folded("pairs of causes that are hardly separated", len(rows)),
    )


def _folded(what: str, rows: int) -> str:
    return f"The {rows} {what}" if rows > MATRIX else ""


def _status(p: Prospect) -> str:
    return f"{p.status.value}: {why_words(p)}" if p.why else p.status.value


def _alternative(prospect: Prospect) -> str:
    return f"{prospect.nearest}, {np.rad2deg(prospect.angle):.0f} deg" if prospect.nearest else "-"


def angle_figure(names: Sequence[str], angles: Array, caption: str) -> Figure:
    """Heat map of the angles (G, G) rad between causes; those alike stand side by side."""
    seen = np.flatnonzero(np.isfinite(angles).any(axis=0))
    order = seen[_seriated(angles[np.ix_(seen, seen)])]
    shown = np.minimum(np.rad2deg(angles[np.ix_(order, order)]), 90.0)
    labels = [html.escape(names[int(i)]) for i in order]
    figure = blank("Angles between causes", "", "")
    figure.add_heatmap(
        z=shown,
        x=labels,
        y=labels,
        zmin=0.0,
        zmax=90.0,
        colorscale="Cividis",
        colorbar={"title": {"text": "angle, deg"}},
        hovertemplate="%{x}<br>%{y}<br>%{z:.1f} deg<extra></extra>",
    )
    size = max(420, 200 + 13 * len(order)) if len(order) <= _LABELS else 700
    every = {"tickfont": {"size": 9}, "showticklabels": len(order) <= _LABELS, "automargin": True}
    figure.update_layout(
        height=size,
        xaxis={**every, "tickangle": 90, "dtick": 1},
        yaxis={**every, "autorange": "reversed", "dtick": 1},
    )
    numbers = matrix_table([names[int(i)] for i in order], -shown, shown, ".0f")
    return Figure(figure, caption, numbers, wide=True)


def _seriated(angles: Array) -> Indices:
    """An order (G,) in which causes that look alike are neighbours: groups by average linkage, joined at the ends that
    are most alike."""
    apart = np.minimum(np.where(np.isfinite(angles), angles, 0.0), 0.5 * np.pi)
    groups: list[list[int]] = [[i] for i in range(len(apart))]
    between = np.array(apart)  # mean angles between groups
    while len(groups) > 1:
        np.fill_diagonal(between, np.inf)
        a, b = sorted(map(int, np.unravel_index(np.argmin(between), between.shape)))
        first, second = groups[a], groups.pop(b)
        share = len(first) / (len(first) + len(second))
        between[a] = between[:, a] = share * between[a] + (1.0 - share) * between[b]
        between = np.delete(np.delete(between, b, axis=0), b, axis=1)
        ways = [(one, two) for one in (first, first[::-1]) for two in (second, second[::-1])]
        one, two = min(ways, key=lambda way: float(apart[way[0][-1], way[1][0]]))
        groups[a] = one + two
    return np.array([i for group in groups for i in group], dtype=np.intp)


def power_figure(foresight: Foresight) -> Plot:
    """Detection rate against s."""
    figure = blank("Chance of detection", "s: visible size in units of noise", "detected, %")
    for i, curve in enumerate(foresight.curves):
        line, name = {"dash": DASHES[i % len(DASHES)]}, html.escape(curve_words(curve))
        figure.add_scatter(x=curve.s, y=100.0 * curve.rate, mode="lines", line=line, name=name)
    figure.add_hline(100.0 * foresight.power, line={"color": GREY, "width": 1, "dash": "dot"})
    return figure


def power_section(foresight: Foresight) -> Section:
    """Everything that can be said before measuring."""
    names = [p.name for p in foresight.prospects]
    blocks: list[Text | ReportTable | Figure] = [Text(said) for said in foresight_words(foresight)[:1]]
    blocks += [kinds_table(foresight), size_table(foresight)]
    caption = (
        "Look where the curves cross the dotted line: there a cause is detected with the required power. s grows with "
        "the effect and with the square root of the number of readings; a cause with more parameters must show more "
        "before it is distinguished from noise."
    )
    blocks.append(Figure(power_figure(foresight), caption))
    if np.isfinite(foresight.angles).any():
        caption = (
            "Look for dark squares off the diagonal: causes that do the same to these readings, whatever their size. "
            "Bright ones are easily separated."
        )
        blocks.append(angle_figure(names, foresight.angles, caption))
    if foresight.pairs:
        blocks.append(pair_table(foresight))
    if foresight.unknown is not None:
        blocks += [Text(said) for said in unknown_words(foresight.unknown)]
        blocks.append(unknown_table(foresight))
    blocks.append(hidden_table(foresight))
    return Section("What this plan would show", tuple(blocks))
