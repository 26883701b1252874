"""A hose or cable that pulls the arm towards a fixed point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import (
    Array,
    Context,
    InputError,
    ParallelSpring,
    Parameter,
    Point,
    Problem,
    RobotFacts,
    place,
    setting,
)

_CORNER = 0.01
"""m over which it goes from slack to taut."""


@dataclass(frozen=True, kw_only=True)
class Hose(ParallelSpring):
    """A hose hangs from a fixed point of the base and pulls a link, as a spring beyond its slack length."""

    link: str = place()
    x: float = setting("m", 0.0)
    """Where it is tied to the link, in the link's frame."""
    y: float = setting("m", 0.0)
    z: float = setting("m", 0.0)
    from_x: float = setting("m", 0.0)
    """Where it hangs from, in the base frame."""
    from_y: float = setting("m", 0.0)
    from_z: float = setting("m")
    length: float = setting("m", 0.0)
    """Up to which it is slack."""
    equation = "F = k (s - s0) where s > s0, else 0"
    source = "media and welding hoses, dress packs: 20 to 200 N at the wrist"
    check = "Hoses and cables from the ceiling or a boom: take them off and measure again."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter(self.name, "N/m", typical=0.01 * robot.sizes.weight / robot.sizes.reach, lower=0.0),)

    def validate(self, robot: RobotFacts) -> None:
        robot.link_index(self.link)
        if self.length < 0.0:
            raise InputError(Problem(f"{self.name}: length must not be negative", found=f"{self.length:g} m"))

    def ends(self, robot: RobotFacts) -> tuple[Point, Point]:
        anchor = Point(robot.base, (self.from_x, self.from_y, self.from_z))
        return anchor, Point(self.link, (self.x, self.y, self.z))

    def tension(self, length: Array, x: Array, context: Context) -> Array:
        beyond = length - self.length
        return 0.5 * x[0] * (beyond + np.sqrt(beyond**2 + _CORNER**2))

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[Hose, ...]:
        """From straight above the base, one and a half times the reach high, to the flange, always taut."""
        return (cls(link=robot.flange, from_z=1.5 * robot.sizes.reach),)
