"""The load does not pull where it was thought to pull."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Context, Load, Loads, LoadTerm, Parameter, RobotFacts, exponential


@dataclass(frozen=True)
class LoadDirection(Load):
    """Force and moment are turned by a rotation vector (rx, ry, 0) in the base frame."""

    role = "load direction"
    order = 1
    equation = "w = turn(rx, ry, 0) w_0"
    source = "cables and weights: 0.5 to 2 deg"
    check = "Plumb line of the weight, angle of the cable, level of the base frame."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"{self.name}.{axis}", "rad", typical=0.01) for axis in ("rx", "ry"))

    def apply(self, loads: Loads, x: Array, context: Context) -> LoadTerm:
        R = exponential(np.array([x[0], x[1], 0.0]))
        turned = np.zeros((6, 6), dtype=R.dtype)
        turned[:3, :3] = turned[3:, 3:] = R
        wrench = loads.wrench @ turned.T
        return LoadTerm(wrench, np.broadcast_to(turned, (len(wrench), 6, 6)))

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[LoadDirection, ...]:
        return (cls(),)
