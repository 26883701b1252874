"""Loads as arrows with their values: forces straight, moments about their arrow with a double head."""

from __future__ import annotations

import numpy as np

from qsframework.plugin import Array
from qsframework.viz.scene import Colour, Scene

FORCE: Colour = (0.8, 0.1, 0.1, 1.0)
MOMENT: Colour = (0.55, 0.1, 0.65, 1.0)
_INK = {"force": "#a01010", "moment": "#6b1278"}
_LONGEST = 0.7
"""Length (m) of the arrow of the plan's largest force, and of its largest moment."""


def draw_loads(scene: Scene, path: str, point: Array, wrench: Array, largest: Array) -> None:
    """A wrench (6,) at a point (3,); largest (2,): N and N m of the longest arrows of the scene."""
    for name, vector, most, colour, unit in (
        ("force", wrench[:3], largest[0], FORCE, "N"),
        ("moment", wrench[3:], largest[1], MOMENT, "N m"),
    ):
        if most > 0.0:
            arrow = _LONGEST / most * vector
            scene.arrow(f"{path}/{name}", point, arrow, 0.018, colour)
            if (size := float(np.linalg.norm(vector))) > 0.0:
                scene.text(f"{path}/{name}", f"{size:.4g} {unit}", point + arrow, _INK[name])
            if name == "moment":
                scene.arrow(f"{path}/{name}/second", point, 0.85 * arrow, 0.018, colour)


def largest_loads(wrench: Array) -> Array:
    """The largest force (N) and moment (N m) of wrenches (N, 6)."""
    return np.array([np.linalg.norm(wrench[:, part], axis=1).max(initial=0.0) for part in (slice(0, 3), slice(3, 6))])
