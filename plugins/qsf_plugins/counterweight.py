"""A mass on a lever that balances a link."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Context, Load, Loads, LoadTerm, Parameter, RobotFacts, place, setting


@dataclass(frozen=True)
class Counterweight(Load):
    """A mass at a point of a link or branch: it shifts the loaded and the unloaded arm alike (paper, section 3.3).

    It changes the response to a load only through the equilibrium, unless the load flips the side
    on which a passive joint is pressed: see the constraint `flip_margin`.
    """

    link: str = place()
    x: float = setting("m", span=(0.0, 5.0))
    y: float = setting("m", span=(0.0, 5.0))
    z: float = setting("m", span=(0.0, 5.0))
    order = 4
    equation = "tau_0 gains J' (m g), J that of the mass's point"
    source = "Klimchik et al., section 3.3"
    check = "Mass and lever of the counterweight, play of the passive joints."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter(self.name, "kg", typical=0.3 * robot.sizes.payload, lower=0.0),)

    def validate(self, robot: RobotFacts) -> None:
        robot.body_index(self.link)

    def apply(self, loads: Loads, x: Array, context: Context) -> LoadTerm:
        slope = np.zeros((*loads.moments.shape, 1))
        slope[context.robot.body_index(self.link), :, 0] = (1.0, self.x, self.y, self.z)
        return LoadTerm(moments=slope @ x, moments_dx=slope)
