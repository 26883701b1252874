"""The arm grows as it warms up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Geometry, GeometryTerm, InputError, Parameter, Poses, RobotFacts, setting


@dataclass(frozen=True)
class ThermalExpansion(Geometry):
    """Every joint's placement is stretched by alpha (T - T0).

    T is the temperature of the loaded state, taken for both states of a displacement: this effect
    is about the arm's size, not about its growth between two readings.
    """

    reference: float = setting("K", 293.15)
    moves_placements = True
    needs = ("temperature",)
    equation = "origin of each joint = (1 + alpha (T - T0)) its nominal origin"
    source = "cast iron and steel: 11 to 12 um/(m K)"
    check = "Warm-up before measuring; temperature of the links."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter(self.name, "1/K", typical=1.2e-5),)

    def errors(self, poses: Poses, x: Array, robot: RobotFacts) -> GeometryTerm:
        if poses.loaded.temperature is None:
            raise InputError(f"{self.name} needs the column temperature_degC in the readings")
        batch, n = poses.q.shape
        warmth = poses.loaded.temperature - self.reference
        reach = np.einsum("kij,ki->kj", robot.placements[:, :3, :3], robot.placements[:, :3, 3])
        twists = np.zeros((batch, n, 6, 1))
        twists[:, :, :3, 0] = warmth[:, None, None] * reach
        return GeometryTerm(np.zeros((batch, n)), np.zeros((batch, n, 1)), twists @ x, twists)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[ThermalExpansion, ...]:
        return (cls(),)
