"""The coupling bar of a loop as a spring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from qsframework.plugin import Bar, Effect, InputError, Loop, Parameter, RobotFacts, Spring, place, setting


@dataclass(frozen=True)
class BarCompliance(Spring):
    """A bar of a closed loop gets longer in proportion to the force along it.

    Near a flat loop it counts as 1 / sin^2 of the transmission angle.
    """

    driven: str = place()
    """The driven joint, as in the loop's name."""
    loop: str = setting(default="parallelogram")
    """The kind of loop: parallelogram, four_bar, closed_chain or another that declares bars."""
    bar: float = setting(default=0)
    """Which of the loop's parameters, counted from 0; the coupling bar of a parallelogram or four-bar is 0."""
    role = "bar"
    equation = "bar longer by c F, F = T / r: T the torque on the driven joint, r the bar's lever arm about it"
    source = "Hooke's law; the force is the torque on the driven joint over its lever arm"
    check = "Bolts and bearings of the coupling bar, cracks in its eyes."

    @property
    def where(self) -> str:
        return f"{self.driven}/{int(self.bar)}" if self.bar else self.driven

    def validate(self, robot: RobotFacts) -> None:
        robot.joint_index(self.driven)
        if self.bar < 0 or self.bar != int(self.bar):
            raise InputError(f"{self.name}: bar must be 0 or a positive whole number, found {self.bar:g}")

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter(self.name, "m/N", typical=robot.sizes.give(7e-6), lower=0.0),)

    def virtual_joints(self, robot: RobotFacts) -> tuple[Bar, ...]:
        return (Bar(f"{self.loop}[{self.driven}]", int(self.bar)),)

    @classmethod
    def beside(cls, effects: Sequence[Effect], parameters: Sequence[Parameter]) -> tuple[BarCompliance, ...]:
        """The coupling bar of every loop whose bars have length errors."""
        owners = {p.name.rpartition("].")[0] + "]" if "]." in p.name else p.name for p in parameters}
        loops = [e for e in effects if isinstance(e, Loop) and e.name in owners]
        return tuple(cls(e.where, e.effect_name()) for e in loops)
