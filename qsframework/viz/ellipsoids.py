"""How stiff the arm is in each direction: the ellipsoid that the tip reaches under a force of one size, all around."""

from __future__ import annotations

import numpy as np

from qsframework.elastostatics import Model, cartesian_compliance
from qsframework.plugin import Array, Poses
from qsframework.viz.scene import Colour, Scene

COLOUR: Colour = (0.95, 0.55, 0.1, 0.45)
_SMALLEST = 1e-3
"""Part of the longest half axis below which a flat ellipsoid is not drawn flatter."""


def half_axes(model: Model, poses: Poses, x: Array | None, force: float) -> Array:
    """Half axes (N, 3, 3), columns, m, of {C f : |f| = force}, C the tip's translational compliance under the load."""
    C = cartesian_compliance(model, poses, x)[:, :3, :3]
    U, size, _ = np.linalg.svd(C)
    return np.asarray(U * (force * size)[:, None, :], dtype=np.float64)


def draw_ellipsoid(scene: Scene, path: str, centre: Array, axes: Array, scale: float, colour: Colour = COLOUR) -> None:
    """The half axes (3, 3) about a point (3,), exaggerated; nothing where nothing gives."""
    size = np.linalg.norm(axes, axis=0)
    if size.max() <= 0.0:
        return
    least = np.maximum(_SMALLEST * size.max() / np.maximum(size, 1e-300), 1.0)
    scene.ellipsoid(path, centre, scale * axes * least, colour)
