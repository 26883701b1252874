"""A link is heavier than it was thought."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Load, Loads, LoadTerm, Parameter, RobotFacts, place


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
        mass = Parameter(f"{self.name}.mass", "kg", typical=0.03 * robot.sizes.payload)
        return (
            mass,
            *(
                Parameter(f"{self.name}.{m}", "kg m", typical=0.0045 * robot.sizes.payload * robot.sizes.reach)
                for m in ("mx", "my", "mz")
            ),
        )

    def validate(self, robot: RobotFacts) -> None:
        robot.body_index(self.link)

    def apply(self, loads: Loads, x: Array, robot: RobotFacts) -> LoadTerm:
        moments_dx = np.zeros((len(robot.bodies), 4, 4))
        moments_dx[robot.body_index(self.link)] = np.eye(4)
        slope = np.broadcast_to(np.eye(6), (len(loads.wrench), 6, 6))
        return LoadTerm(
            loads.wrench, slope, np.zeros((len(loads.wrench), 6, 4)), moments=moments_dx @ x, moments_dx=moments_dx
        )

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[LinkMass, ...]:
        return tuple(cls(link) for link in robot.bodies[1:])
