"""Targets before and after a correction: where the tool stands, how far the command moves, and what error is left."""

from __future__ import annotations

import numpy as np

from qsframework.plugin import Array
from qsframework.viz.deflection import draw_ellipsoid
from qsframework.viz.scene import Colour, Scene
from qsframework.viz.scenes import AFTER, BEFORE

_LEFT: Colour = (0.1, 0.3, 0.9, 0.4)
_LARGEST = 0.12
"""Half axis, m, at which the largest expected error is drawn."""
_COVERAGE = 2.0
_FACTOR = 100.0
"""Of arrows."""


def draw_targets(scene: Scene, points: Array, before: Array, moved: Array, covariance: Array) -> float:
    """Arrows at targets (N, 3) m along their error before and along the command's move (N, 3) m, enlarged 100 times;
    ellipsoids (k = 2) of the error after, covariance (N, 3, 3) m^2. By how much these are enlarged."""
    size, axes = np.linalg.eigh(covariance)
    half = axes * _COVERAGE * np.sqrt(np.maximum(size, 0.0))[:, None, :]
    enlarged = _LARGEST / max(float(np.linalg.norm(half, axis=1).max(initial=0.0)), 1e-12)
    for i, point in enumerate(points):
        scene.arrow(f"targets/{i}/before", point, _FACTOR * before[i], 0.012, BEFORE)
        scene.arrow(f"targets/{i}/command", point, _FACTOR * moved[i], 0.012, AFTER)
        draw_ellipsoid(scene, f"targets/{i}/left", point, half[i], enlarged, _LEFT)
    scene.layer("targets", "targets")
    return enlarged
