"""The load acts beside the point that was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Context, Load, Loads, LoadTerm, Parameter, RobotFacts, cross_matrix


@dataclass(frozen=True)
class LoadPointOffset(Load):
    """The force acts at an offset r from the load point, in the flange's frame: it adds the moment r x f there."""

    order = 2
    equation = "moment = moment_0 + (R r) x f, R the rotation of the flange"
    replaces = ("payload_centre", "the flange's frame, as point_mm of the load")
    source = "statics: moment of a force about another point"
    check = "Where the cable is hooked, where the weight's centre hangs."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"{self.name}.{axis}", "m", typical=0.01) for axis in "xyz")

    def apply(self, loads: Loads, x: Array, context: Context) -> LoadTerm:
        force, arm = loads.wrench[:, :3], loads.rotation @ x
        wrench, slope = loads.wrench.copy(), np.tile(np.eye(6), (len(force), 1, 1))
        wrench[:, 3:] += np.cross(arm, force)
        slope[:, 3:, :3] = cross_matrix(arm)
        by_arm = np.concatenate([np.zeros((len(force), 3, 3)), -cross_matrix(force)], axis=1)
        return LoadTerm(wrench, slope, by_arm @ loads.rotation, -by_arm @ cross_matrix(arm))

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[LoadPointOffset, ...]:
        return (cls(),)
