"""Are the points what they were taken for? Their unit, and whether each lies where its pose puts its marker."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.applications.importers.campaign import Campaign
from qsframework.applications.importers.matching import TrackerPoint, label
from qsframework.applications.importers.placing import UNITS, PlacementFit, agreed_frame, likely_unit, marker_places
from qsframework.errors import MOST_PROBLEMS, InputError, Problem
from qsframework.experiment import Experiment
from qsframework.experiment.limits import other_angles
from qsframework.plugin import Array, Indices

_MOST_AGREE = 0.5
"""Share of the points that must agree with one frame before the others are called wrong one by one."""
_FEWEST_AGREE = 4
"""Any three points agree with some frame."""
_NEARLY_ALL = 0.9
"""Share of the points that must agree under another convention for it to be named."""
_NEAR = 1e-2
"""m: a point that another marker, pose or unit brings so near is probably that."""


@dataclass(frozen=True)
class Placed:
    """How the points of a series lie to the nominal arm, in the frame that suits them best: m, of `count`.

    count 0: too few, or too much in a line, to say anything
    """

    series: str
    count: int
    rms: float
    largest: float


def check_units(points: Sequence[TrackerPoint], pendant: Array, experiment: Experiment) -> None:
    """InputError where nobody says the unit of a file's coordinates, or where they spread as in another unit."""
    markers = [m.name for m in experiment.markers]
    places = marker_places(experiment, pendant)
    problems: list[Problem] = []
    for listing in dict.fromkeys(p.listing for p in points):
        rows = [(i, p, p.slot) for i, p in enumerate(points) if p.listing is listing and p.slot is not None]
        there = np.array([places[i, markers.index(s.marker)] for i, _, s in rows])
        xyz = listing.xyz()
        raw = np.array([xyz[p.row] for _, p, _ in rows]) / UNITS.get(listing.unit, 1.0)
        likely = likely_unit(raw, there)
        sheet, column = listing.sheet, listing.column("x")
        if not listing.unit:
            message = "nothing says the unit of the coordinates"
            hint = "State it." if likely is None else f"State it; the points spread as the arm does if it is {likely}."
            argument = ("unit", likely or "mm")
            problems.append(Problem(message, sheet.where, sheet.header_line, column, hint=hint, argument=argument))
        elif likely not in (None, listing.unit) and listing.unit in UNITS:
            message = (
                f"the coordinates are said to be in {listing.unit}, but spread as the arm does if they are in {likely}"
            )
            problems.append(Problem(message, sheet.where, sheet.header_line, column, hint="Correct the unit."))
    if problems:
        raise InputError(problems)


def check_places(
    points: Sequence[TrackerPoint], pendant: Array, campaign: Campaign, experiment: Experiment, within: float
) -> tuple[Placed, ...]:
    """How the points of each series lie to the arm.

    InputError for points that lie farther (m) from where their pose puts their marker than the others allow, each with
    the pose, marker or unit that would suit it.
    """
    markers = [m.name for m in experiment.markers]
    places = marker_places(experiment, pendant)
    out: list[Placed] = []
    problems: list[Problem] = []
    for series in dict.fromkeys(p.series for p in points):
        rows = [(i, p, p.slot) for i, p in enumerate(points) if p.series == series and p.slot is not None]
        own = [p for _, p, _ in rows]
        there = np.array([places[i, markers.index(s.marker)] for i, _, s in rows])
        seen = np.array([p.listing.xyz()[p.row] for p in own])
        fit = agreed_frame(there, seen, within)
        if fit is None:
            out.append(Placed(series, 0, 0.0, 0.0))
            continue
        if fit.agrees.mean() < _MOST_AGREE or fit.agrees.sum() < _FEWEST_AGREE:
            named = [s.marker for _, _, s in rows]
            column = np.array([markers.index(name) for name in named])
            words = _convention(experiment, pendant[[i for i, _, _ in rows]], column, seen, within)
            problems.append(_few_agree(own, fit, within, words))
            continue
        for k in np.flatnonzero(~fit.agrees).tolist():
            problems.append(_misplaced(own[k], fit, float(fit.off[k]), campaign, experiment, within))
        off = fit.off[fit.agrees]
        out.append(Placed(series, len(own), float(np.sqrt(np.mean(off**2))), float(off.max())))
    if problems:
        raise InputError(problems[:MOST_PROBLEMS])
    return tuple(out)


def _convention(experiment: Experiment, pendant: Array, marker: Indices, seen: Array, within: float) -> str | None:
    """The convention in which nearly all points (N, 3) lie where pendant values (N, n) put their markers (N,)."""
    rows = np.arange(len(seen))

    def agrees(values: Array, points: Array) -> bool:
        there = marker_places(experiment, values)[rows, marker]
        fit = agreed_frame(there, points, within)
        return fit is not None and float(fit.agrees.mean()) >= _NEARLY_ALL

    if agrees(pendant, seen * [1.0, 1.0, -1.0]):
        return "as mirror images: two axes of the coordinates are exchanged, or the sign of one is reversed"
    return next(
        (words for words, values in other_angles(experiment.robot.controller, pendant) if agrees(values, seen)), None
    )


def _few_agree(points: Sequence[TrackerPoint], fit: PlacementFit, within: float, convention: str | None) -> Problem:
    """One problem where most points lie elsewhere than they were taken for, with the convention in which they fit."""
    first = next(k for k, agrees in enumerate(fit.agrees.tolist()) if not agrees)
    agree = f"{int(fit.agrees.sum())} of {len(points)} within {1e3 * within:g} mm"
    found = f"in one frame {agree}; this is the first that is not"
    hint = "Is one point too many or missing before it, or are names, angles or the plan of another day?"
    hint = hint if convention is None else f"They fit {convention}. Correct the file, or its headers."
    return points[first].problem(
        "most points do not lie where their poses put the markers", "x", found=found, hint=hint
    )


def _misplaced(
    point: TrackerPoint, fit: PlacementFit, off: float, campaign: Campaign, experiment: Experiment, within: float
) -> Problem:
    """A point that lies elsewhere, and what would suit it: another unit, or another pose or marker."""
    at = point.listing.xyz()[point.row]
    assert point.slot is not None
    message = f"{label(point.slot)}: the point lies {1e3 * off:.0f} mm from where that marker is"
    meant = marker_places(experiment, campaign.poses[point.slot.pose][None])[0]
    expected = fit.frame.apply(meant[[m.name for m in experiment.markers].index(point.slot.marker)])
    factor = UNITS.get(point.listing.unit, 1.0)
    near = max(_NEAR, 3.0 * float(np.median(fit.off[fit.agrees])))
    for unit, size in UNITS.items():
        if unit != point.listing.unit and np.linalg.norm(at / factor * size - expected) < near:
            hint = f"It would be right in {unit}: export all points in one unit."
            return point.problem(message, "x", hint=hint)
    poses = list(campaign.poses)
    every = marker_places(experiment, np.stack([campaign.poses[p] for p in poses]))
    away = np.linalg.norm(fit.frame.apply(every) - at, axis=2)
    p, m = (int(v) for v in np.unravel_index(int(np.argmin(away)), away.shape))
    hint = "Look at its name, or leave it out."
    if away[p, m] < near:
        hint = f"It lies where marker {experiment.markers[m].name} is at pose {poses[p]}: rename it, or leave it out."
    problem = point.problem(message, "x", allowed=f"up to {1e3 * within:g} mm", hint=hint)
    return replace(problem, argument=("ignore", point.name or "PATTERN"))
