"""The load acts beside the point that was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Context, Load, Loads, Parameter, RobotFacts


@dataclass(frozen=True)
class PayloadCentre(Load):
    """The force acts at an offset r, fixed in the last link: it adds the moment r x f at the load point."""

    order = 2
    equation = "moment = moment_0 + (R r) x f, R the rotation of the last link"
    source = "statics: moment of a force about another point"
    check = "Where the cable is hooked, where the weight's centre hangs."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"{self.name}.{axis}", "m", typical=0.01) for axis in "xyz")

    def apply(self, loads: Loads, x: Array, context: Context) -> Array:
        force, moment = loads.wrench[:, :3], loads.wrench[:, 3:]
        return np.concatenate([force, moment + np.cross(loads.rotation @ x, force)], axis=1)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[PayloadCentre, ...]:
        return (cls(),)
