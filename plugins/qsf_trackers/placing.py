"""Where points lie against where the arm puts its markers: their unit, the tracker's frame, which belong elsewhere."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import numpy.typing as npt

from qsf_trackers.campaign import Campaign
from qsf_trackers.matching import TrackerPoint, label
from qsf_trackers.tables import Listing
from qsframework.errors import InputError, Problem, refuse
from qsframework.experiment import Experiment, Frame, motion_rows, other_angles, procrustes
from qsframework.plugin import Array, Indices

UNITS = {"mm": 1e-3, "m": 1.0, "inch": 0.0254, "cm": 1e-2, "um": 1e-6, "foot": 0.3048}
"""Units that trackers export, in m."""
_LIKE = 0.15
"""Share by which a spread may differ from the arm's own for a unit to be proposed."""
_FLAT = 0.02
"""Share of their length by which points must spread across the line along which they spread farthest."""
_DRAWS = 300
_SEED = 0
"""Frames that are tried are the same at every run."""
_MOST_AGREE = 0.5
"""Share of the points that must agree with one frame before the others are called wrong one by one."""
_FEWEST_AGREE = 4
"""Any three points agree with some frame."""
_NEARLY_ALL = 0.9
"""Share of the points that must agree under another convention for it to be named."""
_NESTS = 0.15
"""m by which nests that were guessed, not measured, are off at most."""
_NEAR = 1e-2
"""m: a point that another marker, pose or unit brings so near is probably that."""


@dataclass(frozen=True, eq=False)
class Aligned:
    """The robot's base in the tracker's frame, from `count` points of `kind` "unloaded" or "known".

    missed (count,): what each point misses, m; covariance (6, 6): of a shift along the tracker's axes, m, and of a
    turn about them, rad, at the origin of the base, from the scatter of what is missed (NaN where three points leave
    none); names: of the points
    """

    kind: str
    frame: Frame
    missed: Array
    covariance: Array
    names: tuple[str, ...]

    @property
    def count(self) -> int:
        """Points."""
        return len(self.missed)

    @property
    def rms(self) -> float:
        """Of what is missed, m."""
        return float(np.sqrt(np.mean(self.missed**2)))

    @property
    def sd(self) -> Array:
        """Standard deviations (6,) of shift, m, and turn, rad."""
        return np.sqrt(np.diag(self.covariance))


def expected_places(points: Sequence[TrackerPoint], pendant: Array, experiment: Experiment) -> Array:
    """Where a rigid nominal arm puts the marker of each point: (N, 3) m, base frame, at pendant angles (N, n) rad."""
    markers = [experiment.marker_names.index(p.taken.marker) for p in points]
    return experiment.rigid_places(experiment.robot.controller.to_joints(pendant))[np.arange(len(points)), markers]


def align(kind: str, there: Array, points: Array, names: tuple[str, ...], series: str, where: str) -> Aligned:
    """The frame from points (N, 3) m as the tracker sees them, and as they lie to the base.

    InputError where there are fewer than three, or where they lie in a line: about it nothing tells the turn.
    """
    if len(there) < 3:
        hint = "Measure at least three that do not lie in a line, better six around the arm."
        message = "a frame needs three points"
        raise InputError(Problem(message, where, found=f"{len(there)}: {', '.join(names) or 'none'}", hint=hint))
    for what, values in (("", there), (" as the tracker sees them", points)):
        length, across = _spread(values)
        if across < _FLAT * length or length < 1e-3:
            message = f"the points{what} lie in a line, about which the rotation of the frame is not identifiable"
            found = f"{1e3 * across:.3g} mm across, {1e3 * length:.4g} mm along ({', '.join(names[:6])})"
            hint = "Measure one more point away from that line."
            raise InputError(Problem(message, where, found=found, hint=hint))
    frame = procrustes(there, points, series)
    left = points - frame.apply(there)
    return Aligned(kind, frame, np.linalg.norm(left, axis=1), _covariance(frame, there, left), names)


def _spread(points: Array) -> tuple[float, float]:
    """RMS along the line of the largest spread, and across it."""
    values = np.linalg.svd(points - points.mean(axis=0), compute_uv=False) / math.sqrt(len(points))
    return float(values[0]), float(np.hypot(values[1], values[2])) if len(values) > 2 else float(values[1])


def _covariance(frame: Frame, there: Array, left: Array) -> Array:
    """Of shift and turn, by least squares with equal noise on every coordinate."""
    J = motion_rows(there @ frame.rotation.T)  # from the base's origin, on the tracker's axes
    dof = len(J) - 6
    variance = float(np.sum(left**2)) / dof if dof > 0 else math.nan
    return np.asarray(variance * np.linalg.inv(J.T @ J), dtype=float)


@dataclass(frozen=True, eq=False)
class PlacementFit:
    """A frame that most points agree with: which (N,) of them, and how far (N,) each point is off, m."""

    frame: Frame
    agrees: npt.NDArray[np.bool_]
    off: Array


def agreed_frame(there: Array, points: Array, within: float) -> PlacementFit | None:
    """The frame in which most points (N, 3) lie within a distance (m) of where they should; None where they are too
    few, or lie in a line.

    Frames are tried from three points each; what most agree with is then fitted to those.
    """
    if len(there) < 4:
        return None
    length, across = _spread(there)
    if length < within or across < _FLAT * length:
        return None
    rng = np.random.default_rng(_SEED)
    fit: PlacementFit | None = None
    for _ in range(_DRAWS):
        three = rng.choice(len(there), 3, replace=False)
        own = _spread(there[three])
        if own[1] < 0.1 * own[0]:
            continue
        found = _fit(there, points, three, within)
        if fit is None or found.agrees.sum() > fit.agrees.sum():
            fit = found
        if found.agrees.all():
            break
    for _ in range(3):
        if fit is not None and fit.agrees.sum() > 3:
            fit = _fit(there, points, np.flatnonzero(fit.agrees), within)
    return fit


def _fit(there: Array, points: Array, rows: Indices, within: float) -> PlacementFit:
    """The frame that suits these rows best, and how far all are off."""
    frame = procrustes(there[rows], points[rows])
    off = np.linalg.norm(points - frame.apply(there), axis=1)
    return PlacementFit(frame, off < within, off)


def likely_unit(raw: Array, there: Array) -> str | None:
    """The unit by which raw coordinates (N, 3) spread as the points (N, 3) m do; None where none does."""
    spread = float(np.sqrt(raw.var(axis=0).sum()))
    own = float(np.sqrt(there.var(axis=0).sum()))
    if spread <= 0.0 or own < 1e-2:
        return None
    name, size = min(UNITS.items(), key=lambda u: abs(math.log(u[1] * spread / own)))
    return name if abs(math.log(size * spread / own)) < _LIKE else None


@dataclass(frozen=True)
class Placed:
    """How the points of a series lie to the nominal arm, in the frame that suits them best: m, of `count`.

    count 0: too few, or too much in a line, to say anything
    """

    series: str
    count: int
    rms: float
    largest: float


def check_units(points: Sequence[TrackerPoint], there: Array) -> None:
    """InputError where nobody says the unit of a file's coordinates, or where they do not spread as the places (N, 3) m
    of their markers do, but would in another unit."""
    problems: list[Problem] = []
    for listing in dict.fromkeys(p.listing for p in points):
        rows = [i for i, p in enumerate(points) if p.listing is listing]
        raw = np.array([points[i].xyz for i in rows]) / UNITS.get(listing.unit, 1.0)
        likely = likely_unit(raw, there[rows])
        if not listing.unit:
            problems.append(unit_problem(listing, likely))
        elif likely not in (None, listing.unit) and listing.unit in UNITS:
            message = f"the coordinates are said to be in {listing.unit}, but spread as the arm does if they are in"
            problems.append(listing.problem(None, "x", f"{message} {likely}", hint="Correct the unit."))
    refuse(problems)


def unit_problem(listing: Listing, likely: str | None = None) -> Problem:
    """What is wrong with coordinates of which nobody says the unit."""
    hint = "State it." if likely is None else f"State it; the points spread as the arm does if it is {likely}."
    message = "nothing says the unit of the coordinates"
    return listing.problem(None, "x", message, hint=hint, argument=("unit", likely or "mm"))


def series_of(points: Sequence[TrackerPoint]) -> dict[str, list[int]]:
    """The points of each series, by their places."""
    out: dict[str, list[int]] = {}
    for i, point in enumerate(points):
        out.setdefault(point.series, []).append(i)
    return out


def check_places(
    points: Sequence[TrackerPoint],
    pendant: Array,
    there: Array,
    campaign: Campaign,
    experiment: Experiment,
    within: float,
) -> tuple[Placed, ...]:
    """How the points of each series lie to the arm.

    InputError for points that lie farther (m) from where their pose puts their marker (N, 3) m than the others allow,
    each with the pose, marker or unit that would suit it.
    """
    out: list[Placed] = []
    problems: list[Problem] = []
    for series, rows in series_of(points).items():
        own = [points[i] for i in rows]
        fit = agreed_frame(there[rows], np.array([p.xyz for p in own]), within)
        if fit is None:
            out.append(Placed(series, 0, 0.0, 0.0))
        elif fit.agrees.mean() < _MOST_AGREE or fit.agrees.sum() < _FEWEST_AGREE:
            problems.append(_few_agree(own, fit, within, _convention(own, pendant[rows], experiment, within)))
        else:
            for k in np.flatnonzero(~fit.agrees).tolist():
                problems.append(_misplaced(own[k], fit, float(fit.off[k]), campaign, experiment, within))
            off = fit.off[fit.agrees]
            out.append(Placed(series, len(own), float(np.sqrt(np.mean(off**2))), float(off.max())))
    refuse(problems)
    return tuple(out)


def _convention(points: Sequence[TrackerPoint], pendant: Array, experiment: Experiment, within: float) -> str | None:
    """The convention in which nearly all points (N, 3) lie where pendant values (N, n) put their markers."""
    seen = np.array([p.xyz for p in points])

    def agrees(values: Array, points_seen: Array) -> bool:
        fit = agreed_frame(expected_places(points, values, experiment), points_seen, within)
        return fit is not None and float(fit.agrees.mean()) >= _NEARLY_ALL

    if agrees(pendant, seen * [1.0, 1.0, -1.0]):
        return "as mirror images: two axes of the coordinates are exchanged, or the sign of one is reversed"
    for a, b in combinations(experiment.marker_names, 2):
        names = [{a: b, b: a}.get(p.taken.marker, p.taken.marker) for p in points]
        own = [replace(p, slot=replace(p.taken, marker=name)) for p, name in zip(points, names, strict=True)]
        fit = agreed_frame(expected_places(own, pendant, experiment), seen, within)
        if fit is not None and float(fit.agrees.mean()) >= _NEARLY_ALL:
            return f"with the markers {a} and {b} exchanged"
    others = other_angles(experiment.robot.controller, pendant)
    return next((words for words, values in others if agrees(values, seen)), None)


def _few_agree(points: Sequence[TrackerPoint], fit: PlacementFit, within: float, convention: str | None) -> Problem:
    """One problem where most points lie elsewhere than they were taken for, with the convention in which they fit."""
    first = int(np.argmin(fit.agrees))
    agree = f"{int(fit.agrees.sum())} of {len(points)} within {1e3 * within:g} mm"
    found = f"in one frame {agree}; this is the first that is not"
    hint = "Is one point too many or missing before it, or are names, angles or the plan of another day?"
    hint = hint if convention is None else f"They fit {convention}. Correct the file, or its headers."
    message = "most points do not lie where their poses put the markers"
    return points[first].problem(message, "x", found=found, hint=hint)


def _misplaced(
    point: TrackerPoint, fit: PlacementFit, off: float, campaign: Campaign, experiment: Experiment, within: float
) -> Problem:
    """A point that lies elsewhere, and what would suit it: another unit, or another pose or marker."""
    message = f"{label(point.taken)}: the point lies {1e3 * off:.0f} mm from where that marker is"
    poses, markers = list(campaign.poses), experiment.marker_names
    pendant = np.stack([campaign.poses[p] for p in poses])
    every = fit.frame.apply(experiment.rigid_places(experiment.robot.controller.to_joints(pendant)))
    expected = every[poses.index(point.taken.pose), markers.index(point.taken.marker)]
    factor = UNITS.get(point.listing.unit, 1.0)
    near = max(_NEAR, 3.0 * float(np.median(fit.off[fit.agrees])))
    for unit, size in UNITS.items():
        if unit != point.listing.unit and np.linalg.norm(point.xyz / factor * size - expected) < near:
            return point.problem(message, "x", hint=f"It would be right in {unit}: export all points in one unit.")
    away = np.linalg.norm(every - point.xyz, axis=2)
    p, m = (int(v) for v in np.unravel_index(int(np.argmin(away)), away.shape))
    hint, argument = "Look at its name, or leave it out.", ("ignore", point.name or "PATTERN")
    if away[p, m] < min(near, 0.5 * off):
        hint = f"It lies where marker {markers[m]} is at pose {poses[p]}: rename it, or leave it out."
    elif (largest := float(fit.off.max())) < _NESTS:
        hint = "Where the reflectors' nests are only roughly known, allow for it."
        argument = ("within", f"{10 * math.ceil(100.0 * largest + 1.0):g}")
    return point.problem(message, "x", allowed=f"up to {1e3 * within:g} mm", hint=hint, argument=argument)
