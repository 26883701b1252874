"""A gear whose two flanks are not alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, At, Context, InputError, Parameter, Problem, RobotFacts, SpringLaw, place, setting


@dataclass(frozen=True)
class GearFlank(SpringLaw):
    """A gear gives more, or less, under torques of one sign: one flank of its teeth is worn or meshes better.

    The parameter is the compliance that positive torques meet beyond the gear's own. T holds the preload, so a
    displacement shows it where the torque is positive in the loaded state.
    """

    joint: str = place()
    width: float = setting("N m", 0.0)
    """Torque over which the flanks change; 0: 0.5 % of the payload's at full reach, where it slides of its weight."""
    slides = True
    equation = "eps = c T + c+ (T + sqrt(T^2 + w^2) - w) / 2"
    source = "gears and worm drives: stiffness differs by the side that carries by 5 to 30 %"
    check = "Wear of the teeth; push the joint to both sides with the drive held."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        unit = robot.unit_of(self.joint)
        size = robot.sizes.motion_of(unit, 0.2e-3 if robot.slides(self.joint) else 4e-3)
        return (Parameter(self.name, unit.give, typical=size / robot.load_at(self.joint)),)

    def springs(self, robot: RobotFacts) -> tuple[At, ...]:
        return (("gear", self.joint),)

    def validate(self, robot: RobotFacts) -> None:
        robot.joint_index(self.joint)
        if self.width < 0.0:
            raise InputError(Problem(f"{self.name}: width must not be negative", found=f"{self.width:g} N m"))

    def extra(self, torque: Array, x: Array, context: Context) -> Array:
        robot = context.robot
        width = self.width or 5e-3 * robot.sizes.load_of(robot.unit_of(self.joint))
        return 0.5 * x[0] * (torque + np.sqrt(torque**2 + width**2) - width)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[GearFlank, ...]:
        return tuple(cls(joint) for joint in robot.driven)
