"""The arm grows as it warms up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Context, Geometry, GeometryTerm, Parameter, RobotFacts, setting


@dataclass(frozen=True)
class ThermalExpansion(Geometry):
    """Every joint's placement, and the travel of one that slides, is stretched by alpha (T - T0).

    T is the temperature of each state: what warms up between two of them grows between them.
    """

    reference: float = setting("K", 293.15)
    moves_placements = True
    needs = ("temperature",)
    equation = "origin of each joint = (1 + alpha (T - T0)) its nominal origin"
    source = "cast iron and steel: 11 to 12 um/(m K)"
    check = "Warm-up before measuring; temperature of the links."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter(self.name, "1/K", typical=1.2e-5),)

    def errors(self, x: Array, context: Context) -> GeometryTerm:
        robot, (batch, n) = context.robot, context.poses.q.shape
        warmth = context.recorded("temperature", self.name) - self.reference
        reach = np.einsum("kij,ki->kj", robot.placements[:, :3, :3], robot.placements[:, :3, 3])
        twists = np.zeros((batch, n, 6, 1))
        twists[:, :, :3, 0] = warmth[:, None, None] * reach
        travels = np.where(robot.sliding, warmth[:, None] * context.poses.q, 0.0)[..., None]
        return GeometryTerm(travels @ x, travels, twists @ x, twists)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[ThermalExpansion, ...]:
        return (cls(),)
