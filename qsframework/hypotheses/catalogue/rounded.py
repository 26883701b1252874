"""Angles that were rounded before they were written: every visit then errs as if each joint stood a little elsewhere.

Whole degrees in a table are no fault: poses are often commanded so. They are one where the readings scatter by what
rounding makes of them, visit by visit, along the columns of the arm's Jacobian, beside the arm's whole geometry, its
springs and its sag.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from qsframework.estimation.variance_component import variance_component
from qsframework.experiment import Experiment, ObservationModel, Readings
from qsframework.hypotheses.hypothesis import Hypothesis
from qsframework.hypotheses.linearized import of_observations
from qsframework.hypotheses.outliers import widened
from qsframework.plugin import Array, Indices

_STEPS = (10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1)
"""deg: roundings that are asked for."""
_FEWEST = 20
"""Degrees of freedom below which nothing is said."""
_EVIDENCE = 15.0
"""Log of how much likelier errors of the angles must be than larger noise."""
_NEAR = 2.5
"""Times larger or smaller than rounding makes it the error of the angles may be."""
_SHARE = 0.5
"""Of the squares that are left, which errors of the angles must make at least."""
_DIFFERENCE = 1e-6
_MOST = 120
"""States that are looked at: enough to tell."""


def rounded_angles(experiment: Experiment, readings: Readings) -> tuple[Hypothesis, float] | None:
    """The rounding of the angles, where it is what the readings scatter by, with its evidence, nats; None where the
    angles have all digits."""
    seen = widened(experiment, _some(readings))
    rows = seen.rows
    step = _step(experiment, seen)
    if step is None or (rows.minus >= 0).all():  # what both states share, a displacement hardly shows
        return None
    fit = of_observations(experiment, seen).fit
    if fit.dof < _FEWEST:
        return None
    turned = rows.noise.whiten(rows.flat(_turned(experiment, seen)))
    size = float(np.sqrt(np.square(turned).sum(axis=1).mean()))
    found = variance_component(fit, *_by_visit(turned / size, rows.plus[rows.row]))
    angle = found.ratio * float(np.sqrt(found.own / fit.dof)) / size
    usual = step / np.sqrt(12.0)
    if found.gain < 2.0 * _EVIDENCE or found.own > (1.0 - _SHARE) * fit.chi2:
        return None
    if not 1.0 / _NEAR < angle / usual < _NEAR:
        return None
    off = float(np.sqrt(np.square(rows.noise.colour(turned)).sum(axis=1).mean())) * usual
    words = (
        f"the angles are rounded to {float(np.rad2deg(step)):g} deg, which moves the markers by {off * 1e3:.2g} mm a "
        "coordinate: write them with all digits of the controller"
    )
    rounded = Hypothesis(
        "angles_rounded",
        1.0,
        words,
        experiment,
        readings=readings,
        hides=True,
        column="q",
        found=step,
    )
    return rounded, 0.5 * found.gain


def _by_visit(turned: Array, visit: Indices) -> tuple[Array, Indices]:
    """Columns (m, n) as orthogonal ones of each visit's own, which do the same: values (m, n), and where they stand."""
    at: Indices = np.unique(visit, return_inverse=True)[1]
    axes = turned.shape[1]
    products = np.zeros((int(at.max()) + 1, axes, axes))
    np.add.at(products, at, turned[:, :, None] * turned[:, None])
    own = turned[:, None] @ np.linalg.eigh(products)[1][at]
    column: Indices = axes * at[:, None] + np.arange(axes, dtype=np.intp)
    return own[:, 0], column


def _some(readings: Readings) -> Readings:
    """Of many states some, evenly."""
    used = np.unique(readings.plus[readings.use])
    chosen = used[:: -(-len(used) // _MOST)] if len(used) else used
    return readings.masked(~np.isin(readings.plus, chosen))


def _step(experiment: Experiment, seen: ObservationModel) -> float | None:
    """The largest step (rad) that all angles of the used states are multiples of."""
    used = np.unique(seen.rows.plus)
    turning = [k for k, slides in enumerate(experiment.robot.controller.units.sliding) if not slides]
    degrees = np.rad2deg(seen.rows.readings.poses.pendant[used][:, turning])
    for step in _STEPS:
        if np.allclose(degrees / step, np.round(degrees / step), atol=1e-6):
            return float(np.deg2rad(step)) if len(np.unique(np.round(degrees, 6))) >= _FEWEST // 2 else None
    return None


def _turned(experiment: Experiment, seen: ObservationModel) -> Array:
    """Rates (R, 3, n) m per rad at which the rows move with each shown angle."""
    rows, controller = seen.rows, experiment.robot.controller
    poses = rows.readings.poses
    here = rows.predict(seen.model, seen.x, seen.frames, linear=True)
    out: list[Array] = []
    for k in np.flatnonzero(~np.array(controller.units.sliding)).tolist():
        pendant = poses.pendant.copy()
        pendant[:, k] += _DIFFERENCE
        moved = replace(poses, pendant=pendant, q=controller.to_joints(pendant))
        there = replace(rows, readings=rows.readings.with_poses(moved))
        out.append((there.predict(seen.model, seen.x, seen.frames, linear=True) - here) / _DIFFERENCE)
    return np.stack(out, axis=2)
