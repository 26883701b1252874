"""Residual vectors of a fit: measured minus predicted, exaggerated, at every marker of every pose that was measured."""

from __future__ import annotations

import numpy as np

from qsframework.experiment import Experiment, Readings
from qsframework.plugin import Array, Indices
from qsframework.viz.scene import Colour, Scene

COLOUR: Colour = (0.75, 0.1, 0.5, 1.0)


def residuals(experiment: Experiment, readings: Readings, x: Array) -> tuple[Indices, Array]:
    """Rows (R,) that are used, and measured minus predicted (R, 3) m, at parameters x."""
    rows = np.flatnonzero(readings.use)
    predicted = experiment.model().predict(readings.poses, x)
    return rows, readings.displacement[rows] - predicted[readings.measurement[rows], readings.marker[rows]]


def draw_residuals(scene: Scene, path: str, starts: Array, vectors: Array, factor: float) -> None:
    """Arrows from points (R, 3) along residuals (R, 3) m times the factor."""
    for i, (start, residual) in enumerate(zip(starts, vectors, strict=True)):
        scene.arrow(f"{path}/{i}", start, factor * residual, 0.010, COLOUR)
