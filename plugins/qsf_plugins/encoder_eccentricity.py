"""An encoder's disc turns off its centre, or errs several times per turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from qsframework.plugin import Array, Context, Geometry, GeometryTerm, InputError, Parameter, RobotFacts, place


@dataclass(frozen=True)
class EncoderEccentricity(Geometry):
    """A joint's true angle differs by the sum of a sin(n q) + b cos(n q) from the controller's value.

    `waves_per_turn` lists the n: 1 is a disc off its centre, others are errors of a track or a gear that
    come n times per turn. The parameters are `.sin` and `.cos` for 1, `.sin17` and `.cos17` for 17.
    """

    joint: str = place()
    waves_per_turn: Any = (1,)
    equation = "q = q_0 + sum over n of a_n sin(n q_0) + b_n cos(n q_0)"
    source = "encoders and gears: once per turn 10 to 50 urad; a UR10: 8 and 17 times, 100 to 250 urad"
    check = "Encoder and gear of this joint."

    def __post_init__(self) -> None:
        waves = listed = self.waves_per_turn
        if isinstance(waves, list):  # as files have it; effects can be compared and hashed
            object.__setattr__(self, "waves_per_turn", tuple(listed))

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        names = [f"{wave}{'' if n == 1 else n}" for n in self.waves_per_turn for wave in ("sin", "cos")]
        return tuple(Parameter(f"{self.name}.{name}", "rad", typical=5e-5, nominal_sd=5e-5) for name in names)

    def validate(self, robot: RobotFacts) -> None:
        robot.joint_index(self.joint)
        waves = listed = self.waves_per_turn
        whole = isinstance(waves, tuple) and all(type(n) is int and 1 <= n <= 100_000 for n in listed)
        if not whole or not listed or len(set(listed)) < len(listed):
            raise InputError(
                f"{self.name}: waves_per_turn must be a list of whole numbers from 1 on, each once, such as [1, 17]; "
                f"found {waves!r}"
            )

    def errors(self, x: Array, context: Context) -> GeometryTerm:
        k, poses = context.robot.joint_index(self.joint), context.poses
        angles = poses.q[:, k, None] * np.array(self.waves_per_turn)
        slope = np.zeros((*poses.q.shape, 2 * angles.shape[1]))
        slope[:, k, 0::2], slope[:, k, 1::2] = np.sin(angles), np.cos(angles)
        return GeometryTerm(slope @ x, slope)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[EncoderEccentricity, ...]:
        return tuple(cls(joint) for joint in robot.driven)
