"""The tool and its flange."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from qsf_plugins.directions import DIRECTIONS, check_direction, compliance, virtual_joint
from qsframework.plugin import Parameter, RobotFacts, Spring, VirtualJoint, place


@dataclass(frozen=True)
class FlangeCompliance(Spring):
    """The tool moves on the flange, about or along one axis of the flange's frame."""

    direction: str = place(axis=True)
    role = "tool"
    replaces = ("tool_compliance", "the flange's frame")
    equation = "eps = c tau, tau = the force along, or the moment about, the flange's axis"
    source = "six springs at the flange; tip effect of 0.05 to 0.5 mm on heavy arms"
    check = "Flange bolts, tool changer, spindle mount."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (compliance(self.name, self.direction, robot.sizes.give(0.7e-3), 2e-3 / (0.1 * robot.sizes.torque)),)

    def virtual_joints(self, robot: RobotFacts) -> tuple[VirtualJoint, ...]:
        return (virtual_joint(robot.flange, self.direction),)

    def validate(self, robot: RobotFacts) -> None:
        check_direction(self.name, self.direction)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[FlangeCompliance, ...]:
        return tuple(cls(d) for d in DIRECTIONS)
