"""The end of a serial chain of turning, stretching links: position, first and second derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Indices, turns


@dataclass(frozen=True, eq=False)
class SerialPoint:
    """n links, each turning about an axis at the end of the one before; all as they lie at zero angles.

    start (3,) m, axes (n, 3) unit, arms (n, 3) m from each link's joint to its end.
    turns (n,) and stretches (n,) say which entry of the variables v turns and lengthens each link, -1 for none.
    """

    start: Array
    axes: Array
    arms: Array
    turns: Indices
    stretches: Indices

    def place(self, v: Array) -> tuple[Array, Array, Array, Array]:
        """End point (N, 3), moved axes, arms and directions of stretch (N, n, 3) at variables v (N, V)."""
        batch = len(v)
        rotation = np.broadcast_to(np.eye(3), (batch, 3, 3))
        moved = np.zeros((3, batch, len(self.axes), 3))
        lengths = np.linalg.norm(self.arms, axis=1, keepdims=True)
        along = self.arms / np.where(lengths > 0.0, lengths, 1.0)
        for i, (turn, stretch) in enumerate(zip(self.turns, self.stretches, strict=True)):
            moved[0, :, i] = rotation @ self.axes[i]
            rotation = rotation @ turns(self.axes[i], v[:, turn])
            moved[2, :, i] = rotation @ along[i]
            moved[1, :, i] = rotation @ self.arms[i]
            if stretch >= 0:
                moved[1, :, i] += v[:, stretch, None] * moved[2, :, i]
        return self.start + moved[1].sum(axis=1), moved[0], moved[1], moved[2]

    def first(self, v: Array) -> tuple[Array, Array]:
        """End point (N, 3) and its slope (N, 3, V)."""
        point, axes, arms, along = self.place(v)
        slope = np.zeros((*point.shape, v.shape[1]))
        for i, (turn, stretch) in enumerate(zip(self.turns, self.stretches, strict=True)):
            slope[:, :, turn] = np.cross(axes[:, i], arms[:, i:].sum(axis=1))
            if stretch >= 0:
                slope[:, :, stretch] = along[:, i]
        return point, slope

    def second(self, v: Array) -> Array:
        """Curvature (N, 3, V, V) of the end point: what lies before turns the columns of what lies after."""
        _, axes, _, _ = self.place(v)
        _, slope = self.first(v)
        out = np.zeros((*slope.shape, v.shape[1]))
        for i, turn in enumerate(self.turns):
            later = [*self.turns[i:], *(s for s in self.stretches[i:] if s >= 0)]
            for j in later:
                out[:, :, turn, j] = out[:, :, j, turn] = np.cross(axes[:, i], slope[:, :, j])
        return out
