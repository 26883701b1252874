"""The pedestal, its bolts and the floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from qsf_plugins.directions import DIRECTIONS, check_direction, compliance, virtual_joint
from qsframework.plugin import Parameter, RobotFacts, Spring, VirtualJoint, place


@dataclass(frozen=True)
class BaseCompliance(Spring):
    """The whole arm moves on its pedestal, about or along one axis of the base frame."""

    direction: str = place(axis=True)
    role = "base"
    equation = "eps = c tau, tau = the force along, or the moment about, the direction at the base"
    source = "pedestal stiffness of 20 to 100 MN m/rad: published calibrations of heavy arms"
    check = "Anchor bolts, foundation, riser plate."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (compliance(self.name, self.direction, robot.sizes.give(15e-6), robot.sizes.compliance(1.5e-3)),)

    def virtual_joints(self, robot: RobotFacts) -> tuple[VirtualJoint, ...]:
        return (virtual_joint(robot.base, self.direction),)

    def validate(self, robot: RobotFacts) -> None:
        check_direction(self.name, self.direction)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[BaseCompliance, ...]:
        return tuple(cls(d) for d in DIRECTIONS)
