"""A pedestal that lifts off the floor on one side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import (
    Array,
    At,
    Context,
    Effect,
    InputError,
    Parameter,
    Problem,
    RobotFacts,
    Spring,
    SpringLaw,
    place,
    setting,
)


@dataclass(frozen=True)
class BaseLift(SpringLaw):
    """The base gives more beyond the moment up to which its bolts hold it down, on either side of its own.

    It bends the base's own spring in this direction, which the robot or the experiment must list. The moment holds the
    arm's own weight too, so one side comes before the other.
    """

    direction: str = place()
    preload: float = setting("N m", 0.0)
    """Moment up to which the bolts hold; 0: that of the payload at full reach."""
    equation = "eps = c T + c+ (T - T_p) where T > T_p, c- (T + T_p) where T < -T_p"
    source = "bolted joints: stiff until the preload is used up, then only the bolts carry"
    check = "Torque of the anchor bolts, grout under the plate, gaps on the side that lifts."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        size = robot.sizes.compliance(1e-3)
        return tuple(Parameter(f"{self.name}.{s}", "rad/(N m)", typical=size, lower=0.0) for s in ("plus", "minus"))

    def springs(self, robot: RobotFacts) -> tuple[At, ...]:
        return (("base", self.direction),)

    def validate(self, robot: RobotFacts) -> None:
        if self.direction not in ("rx", "ry", "rz"):
            raise InputError(Problem(f"{self.name}: a base lifts about rx, ry or rz", found=repr(self.direction)))
        if self.preload < 0.0:
            raise InputError(Problem(f"{self.name}: preload must not be negative", found=f"{self.preload:g} N m"))

    def extra(self, torque: Array, x: Array, context: Context) -> Array:
        held = self.preload or context.robot.sizes.torque
        return x[0] * _beyond(torque, held) - x[1] * _beyond(-torque, held)

    @classmethod
    def beside(cls, effects: Sequence[Effect], parameters: Sequence[Parameter]) -> tuple[BaseLift, ...]:
        found = [e.where for e in effects if isinstance(e, Spring) and e.role == "base"]
        return tuple(cls(where) for where in found if where in ("rx", "ry", "rz"))


def _beyond(torque: Array, held: float) -> Array:
    """Torque beyond what is held, with a corner of 5 %; 0 at no torque."""
    r = 0.05 * held
    return 0.5 * (torque + np.sqrt((torque - held) ** 2 + r**2) - np.sqrt(held**2 + r**2))
