"""A gear that is softer at some angles than at others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, At, Context, InputError, Parameter, Problem, RobotFacts, SpringLaw, place, setting


@dataclass(frozen=True)
class GearWaves(SpringLaw):
    """A gear's compliance changes with its joint's angle: an uneven ring, a bearing that carries more on one side."""

    joint: str = place()
    waves_per_turn: float = setting(default=1.0)
    """How often per turn of the joint."""
    equation = "eps = (c + a sin(n q) + b cos(n q)) T"
    source = "stiffness of strain-wave and cycloidal gears by the angle: some per cent to 20 %"
    check = "Gear and bearing of this joint at the angles where it is most compliant."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        size = robot.sizes.rotation(4e-3) / robot.load_at(self.joint)
        return tuple(Parameter(f"{self.name}.{wave}", "rad/(N m)", typical=size) for wave in ("sin", "cos"))

    def springs(self, robot: RobotFacts) -> tuple[At, ...]:
        return (("gear", self.joint),)

    def validate(self, robot: RobotFacts) -> None:
        robot.joint_index(self.joint)
        if not self.waves_per_turn > 0.0:
            raise InputError(Problem(f"{self.name}: waves_per_turn must be above 0", found=f"{self.waves_per_turn:g}"))

    def extra(self, torque: Array, x: Array, context: Context) -> Array:
        angle = self.waves_per_turn * context.poses.q[:, context.robot.joint_index(self.joint), None]
        return (x[0] * np.sin(angle) + x[1] * np.cos(angle)) * torque

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[GearWaves, ...]:
        return tuple(cls(joint) for joint in robot.driven)
