"""A link is heavier than it was thought."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Context, Load, Loads, LoadTerm, Parameter, RobotFacts, place


@dataclass(frozen=True)
class LinkMass(Load):
    """A link's mass and first moments (mass times centre, in the link's frame) are larger than in the URDF.

    They load the gears in both states of a displacement: they show where a law is not linear, in the
    full equilibrium and in absolute positions.
    """

    link: str = place()
    order = 3
    equation = "tau_0 gains J' (dm g) and the moment of d(m c) under gravity"
    source = "statics; masses of industrial arms are rarely published"
    check = "Cables, hoses and equipment carried by the link."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        moment = 0.0045 * robot.sizes.payload * robot.sizes.reach
        mass = Parameter(f"{self.name}.mass", "kg", typical=0.03 * robot.sizes.payload)
        return (mass, *(Parameter(f"{self.name}.m{axis}", "kg m", typical=moment) for axis in "xyz"))

    def validate(self, robot: RobotFacts) -> None:
        robot.body_index(self.link)

    def apply(self, loads: Loads, x: Array, context: Context) -> LoadTerm:
        slope = np.zeros((*loads.moments.shape, 4))
        slope[context.robot.body_index(self.link)] = np.eye(4)
        return LoadTerm(moments=slope @ x, moments_dx=slope)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[LinkMass, ...]:
        return tuple(cls(link) for link in robot.bodies[1:])
