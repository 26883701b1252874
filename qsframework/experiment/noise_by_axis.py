"""The noise of rows by the directions of their instrument: along axes that are fixed to it, or its beam and across."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from qsframework.estimation import LinearFit
from qsframework.estimation.axis_noise import AxisNoise, axis_noise
from qsframework.experiment.noise import split_covariances
from qsframework.experiment.observations import ReadingRows
from qsframework.experiment.readings import Readings
from qsframework.plugin import Array


def noise_by_axis(rows: ReadingRows, fit: LinearFit) -> AxisNoise | None:
    """What the whitened residuals of a fit, of all 3 R coordinates, say of the directions and the distances of the
    instrument; None where too few are left."""
    axes, distance = _seen(rows)
    fixed = np.broadcast_to(np.eye(3), axes.shape)
    return axis_noise(fit, [fixed, axes] if np.isfinite(distance).any() else [fixed], rows.mask, distance)


def _seen(rows: ReadingRows) -> tuple[Array, Array]:
    """Unit vectors (R, 3, 3) by rows: of a position its beam, across it level, and across it upwards; of other rows
    those of their coordinates. And the distances (R,) m from the instrument, NaN of other rows."""
    axes, distance = np.tile(np.eye(3), (len(rows.keep), 1, 1)), np.full(len(rows.keep), np.nan)
    touched = np.array([k is not None and k.touched for k in (*rows.readings.known, None)])[rows.frame]
    far = np.linalg.norm(rows.measured, axis=1)
    seen = np.flatnonzero((rows.minus < 0) & ~touched & ~rows.readings.is_gauge[rows.keep] & (far > 0.0))
    beam = rows.measured[seen] / far[seen, None]
    level = np.cross([0.0, 0.0, 1.0], beam)
    level /= np.maximum(np.linalg.norm(level, axis=1, keepdims=True), 1e-9)
    axes[seen] = np.stack([beam, level, np.cross(beam, level)], axis=1)
    distance[seen] = far[seen]
    return axes, distance


def of_axes(rows: ReadingRows, found: AxisNoise) -> Readings:
    """The readings with the noise of these rows as it was found by direction and distance."""
    square = np.square(rows.sigma).mean(axis=1)[:, None, None] * found.factor
    sigma, directed = split_covariances(square)
    own, part = np.array(rows.readings.sigma), np.array(rows.readings.minus_sigma)
    own[rows.keep], part[rows.keep] = sigma, part[rows.keep] * sigma / rows.sigma
    along = np.zeros((len(rows.readings), 2, 3))
    along[rows.keep] = directed
    return replace(rows.readings, sigma=own, minus_sigma=part, directed=along)
