"""Residual vectors of a fit: measured minus predicted, exaggerated, at every marker of every pose that was measured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsframework.experiment import Experiment, Frame, ReadingRows, Readings, make_rows
from qsframework.plugin import Array
from qsframework.viz.scene import Colour, Scene

COLOUR: Colour = (0.75, 0.1, 0.5, 1.0)


def residuals(
    experiment: Experiment, readings: Readings, x: Array, frames: Sequence[Frame] = (), linear: bool = False
) -> tuple[ReadingRows, Array]:
    """Rows that are used, and measured minus predicted (R, 3) m in the base's axes, at parameters x.

    frames: of the series that nobody knows, as a fit found them; those that it does not hold are found anew
    """
    rows, model = make_rows(readings), experiment.model()
    held = {f.series: f for f in frames}
    names = [readings.frames[f] for f in rows.estimated]
    own = [held[n] for n in names] if set(names) <= set(held) else rows.start(model, x)
    missed = rows.padded(np.nan_to_num(rows.measured) - rows.predict(model, x, own, linear))
    if readings.axes is not None:
        missed = np.einsum("rji,rj->ri", readings.axes[rows.keep], missed)
    known = dict(zip(rows.estimated, own, strict=True))
    for f, frame in enumerate(readings.known):
        at = rows.frame == f
        if at.any():
            missed[at] = missed[at] @ (frame or known[f]).rotation
    return rows, missed


def draw_residuals(scene: Scene, path: str, starts: Array, vectors: Array, factor: float) -> None:
    """Arrows from points (R, 3) along residuals (R, 3) m times the factor."""
    for i, (start, residual) in enumerate(zip(starts, vectors, strict=True)):
        scene.arrow(f"{path}/{i}", start, factor * residual, 0.010, COLOUR)
