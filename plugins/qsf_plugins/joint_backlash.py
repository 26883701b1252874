"""Play between the teeth of a gear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import (
    Array,
    At,
    Context,
    InputError,
    LawTerm,
    Parameter,
    Problem,
    RobotFacts,
    SpringLaw,
    place,
    setting,
)


@dataclass(frozen=True)
class JointBacklash(SpringLaw):
    """A gear lies at one side of its gap b: eps = c T + (b / 2) T / sqrt(T^2 + w^2).

    The width w of the crossing tends to the exact law (b / 2) sign(T) as it tends to 0. T holds the
    preload, so a load shows the gap only where it turns the sign of the torque.
    """

    joint: str = place()
    width: float = setting("N m", 0.0)
    """Torque over which the gear crosses its gap; 0: 0.2 % of the payload's at full reach, on a slide of its weight."""
    slides = True
    equation = "eps = c T + (b / 2) T / sqrt(T^2 + w^2)"
    source = "gear catalogues: 1 to 3 arcmin, below 1 arcmin for reduced backlash; (b / 2) sign(T)"
    check = "Gear play: push the joint to both sides with the drive held."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        size = 1e-4 if robot.slides(self.joint) else 2.9e-4
        return (Parameter(self.name, robot.unit_of(self.joint).si, typical=size, lower=0.0),)

    def springs(self, robot: RobotFacts) -> tuple[At, ...]:
        return (("gear", self.joint),)

    def validate(self, robot: RobotFacts) -> None:
        robot.joint_index(self.joint)
        if self.width < 0.0:
            raise InputError(Problem(f"{self.name}: width must not be negative", found=f"{self.width:g} N m"))

    def extra(self, torque: Array, x: Array, context: Context) -> LawTerm:
        robot = context.robot
        width = self.width or 2e-3 * robot.sizes.load_of(robot.unit_of(self.joint))
        root = np.sqrt(torque**2 + width**2)
        side = 0.5 * torque / root
        return LawTerm(x[0] * side, 0.5 * x[0] * width**2 / root**3, side[..., None])

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[JointBacklash, ...]:
        return tuple(cls(joint) for joint in robot.driven)
