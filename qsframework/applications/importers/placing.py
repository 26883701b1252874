"""Where points lie against where the arm puts its markers: the tracker's frame, and points that belong elsewhere."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from qsframework.elastostatics import make_model
from qsframework.errors import InputError, Problem
from qsframework.experiment import Experiment, Frame
from qsframework.experiment.frames import procrustes
from qsframework.plugin import Array, Indices, Poses

UNITS = {"mm": 1e-3, "m": 1.0, "inch": 0.0254, "cm": 1e-2, "um": 1e-6, "foot": 0.3048}
"""Units that trackers export, in m."""
_LIKE = 0.15
"""Share by which a spread may differ from the arm's own for a unit to be proposed."""
_FLAT = 0.02
"""Share of their length by which points must spread across the line along which they spread farthest."""
_DRAWS = 300
_SEED = 0
"""Frames that are tried are the same at every run."""


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


def marker_places(experiment: Experiment, pendant: Array) -> Array:
    """Where a rigid nominal arm puts every marker: (N, K, 3) m, base frame, for pendant angles (N, n) rad."""
    robot = experiment.robot
    sites = [(m.name, experiment.site(m.link, m.xyz)) for m in experiment.markers]
    rigid = make_model(robot.facts, [], [], experiment.load_site, sites, robot.gravity)
    poses = Poses(pendant, robot.controller.to_joints(pendant), np.zeros((len(pendant), 6)))
    return rigid.positions(poses)


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
    arms = there @ frame.rotation.T  # from the base's origin, on the tracker's axes
    rows = np.zeros((len(arms), 3, 6))
    rows[:, :, :3] = np.eye(3)
    x, y, z = arms.T
    zero = np.zeros_like(x)
    rows[:, :, 3:] = np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=1).reshape(-1, 3, 3)
    J = rows.reshape(-1, 6)
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
