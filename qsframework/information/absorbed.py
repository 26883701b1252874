"""What the frame and the tool that suit best take up of errors of the tip, by least squares.

The base frame holds only what the model contains: what turns the whole arm moves it all. Where the instrument's frame
is estimated, that part is not measured; where the places of markers are, neither is the tool.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics.so3 import cross_matrix
from qsframework.estimation.projection import least_squares
from qsframework.plugin import Array

FRAME, TOOL = tuple(range(6)), tuple(range(6, 9))
"""Columns of `tip_motions`."""


def tip_motions(position: Array, rotation: Array) -> Array:
    """How a tip at places (N, 3) turned by (N, 3, 3) moves (N, 6, 9), shift and turn, with the base's shift and turn,
    and with a shift of the tool on the flange."""
    out = np.zeros((len(position), 6, 9))
    out[:, :3, :3] = out[:, 3:, 3:6] = np.eye(3)
    out[:, :3, 3:6] = -cross_matrix(position)
    out[:, :3, 6:] = rotation
    return out


@dataclass(frozen=True, eq=False)
class Absorbed:
    """Motions (9, p) of frame and tool that take up one unit of each parameter best."""

    motions: Array

    def left(self, slope: Array, moved: Array) -> Array:
        """What is left of slopes (N, k, p) of a tip that frame and tool move by (N, k, 9)."""
        return slope - moved @ self.motions


def absorbed(slope: Array, moved: Array, which: Sequence[int]) -> Absorbed:
    """What these columns of the motions (N, k, 9) take up of slopes (N, k, p)."""
    own = list(which)
    motions = np.zeros((moved.shape[2], slope.shape[2]))
    motions[own] = least_squares(moved[:, :, own].reshape(-1, len(own)), slope.reshape(-1, slope.shape[2]))
    return Absorbed(motions)
