"""A mass on a lever that balances a link."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Load, Loads, LoadTerm, Parameter, RobotFacts, place, setting


@dataclass(frozen=True)
class Counterweight(Load):
    """A mass at a point of a link or branch: it shifts the loaded and the unloaded arm alike (paper, section 3.3).

    It changes the response to a load only through the equilibrium, unless the load flips the side
    on which a passive joint is pressed: see the constraint `flip_margin`.
    """

    link: str = place()
    x: float = setting("m")
    y: float = setting("m")
    z: float = setting("m")
    order = 4
    equation = "tau_0 gains J' (m g), J that of the mass's point"
    source = "Klimchik et al., section 3.3"
    check = "Mass and lever of the counterweight, play of the passive joints."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter(self.name, "kg", typical=0.3 * robot.sizes.payload, lower=0.0),)

    def validate(self, robot: RobotFacts) -> None:
        robot.body_index(self.link)

    def apply(self, loads: Loads, x: Array, robot: RobotFacts) -> LoadTerm:
        moments_dx = np.zeros((len(robot.bodies), 4, 1))
        moments_dx[robot.body_index(self.link), :, 0] = (1.0, self.x, self.y, self.z)
        slope = np.broadcast_to(np.eye(6), (len(loads.wrench), 6, 6))
        return LoadTerm(
            loads.wrench, slope, np.zeros((len(loads.wrench), 6, 1)), moments=moments_dx @ x, moments_dx=moments_dx
        )
