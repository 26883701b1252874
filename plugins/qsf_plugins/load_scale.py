"""The load is not as large as it was thought."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Context, Load, Loads, LoadTerm, Parameter, RobotFacts


@dataclass(frozen=True)
class LoadScale(Load):
    """Force and moment are larger by a common factor 1 + k: a load cell's gain, or a wrong weight."""

    role = "load scale"
    order = 0
    equation = "w = (1 + k) w_0"
    source = "load cells and weights: 1 to 5 % without calibration"
    check = "Calibration of the load cell; weigh the weights."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter(self.name, "", typical=0.02, lower=-0.99),)

    def apply(self, loads: Loads, x: Array, context: Context) -> LoadTerm:
        slope = np.broadcast_to((1.0 + x[0]) * np.eye(6), (len(loads.wrench), 6, 6))
        return LoadTerm(loads.wrench * (1.0 + x[0]), slope, loads.wrench[..., None])

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[LoadScale, ...]:
        return (cls(),)
