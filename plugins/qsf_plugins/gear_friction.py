"""Dry friction in a gear: it stops short on the side from which it came, until a load slips it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, At, Context, InputError, Parameter, Problem, RobotFacts, SpringLaw, place, setting


@dataclass(frozen=True)
class GearFriction(SpringLaw):
    """A gear sticks short of where it would go, by the side of approach; a load that is large enough slips it.

    The parameter is half the width of the hysteresis. In the unloaded state the gear sticks on the side from which
    the pose was reached. In the loaded state it slips with the torque that it carries, T: fully where T is far above
    `slip`, not at all where it is far below.
    """

    joint: str = place()
    slip: float = setting("N m", 0.0)
    """Torque that slips it; 0: a tenth of the payload's at full reach, where the joint slides of its weight."""
    slides = True
    needs = ("approach",)
    equation = (
        "eps = c T - h ((1 - r) a + r sign(T)), a the side of approach, r = T^2 / (T^2 + T_s^2) under load, else 0"
    )
    source = "Coulomb friction; hysteresis of industrial gears: 0.5 to 2 arcmin"
    check = "Approach the poses from both sides; lubrication and preload of the gear."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        unit = robot.unit_of(self.joint)
        return (Parameter(self.name, unit.si, typical=robot.sizes.motion_of(unit, 0.2e-3), lower=0.0),)

    def springs(self, robot: RobotFacts) -> tuple[At, ...]:
        return (("gear", self.joint),)

    def validate(self, robot: RobotFacts) -> None:
        robot.joint_index(self.joint)
        if self.slip < 0.0:
            raise InputError(Problem(f"{self.name}: slip must not be negative", found=f"{self.slip:g} N m"))

    def extra(self, torque: Array, x: Array, context: Context) -> Array:
        side = context.side[:, None]
        if not context.loaded:
            return -x[0] * side + 0.0 * torque
        robot = context.robot
        square = torque**2 + (self.slip or 0.1 * robot.sizes.load_of(robot.unit_of(self.joint))) ** 2
        slipped = torque**2 / square
        return -x[0] * ((1.0 - slipped) * side + slipped * torque / np.sqrt(square))

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[GearFriction, ...]:
        return tuple(cls(joint) for joint in robot.driven)
