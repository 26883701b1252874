"""A link that bends, twists or stretches: six springs at its frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from qsf_plugins.directions import DIRECTIONS, check_direction, compliance, virtual_joint
from qsframework.plugin import Parameter, RobotFacts, Spring, VirtualJoint, place


@dataclass(frozen=True)
class LinkCompliance(Spring):
    """A link deflects in one of six directions of its own frame, translations x, y, z or rotations rx, ry, rz."""

    link: str = place()
    direction: str = place(axis=True)
    role = "link"
    equation = "eps = c tau, tau = the force along, or the moment about, the link's axis"
    source = "Klimchik et al., virtual joint modelling with six-axis springs"
    check = "Cracks and bolts of the link, bearings at its joint."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (compliance(self.name, self.direction, robot.sizes.give(150e-6), robot.sizes.compliance(2e-3)),)

    def virtual_joints(self, robot: RobotFacts) -> tuple[VirtualJoint, ...]:
        return (virtual_joint(self.link, self.direction),)

    def validate(self, robot: RobotFacts) -> None:
        robot.link_index(self.link)
        check_direction(self.name, self.direction)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[LinkCompliance, ...]:
        """Every link between the base and the flange, in every direction."""
        return tuple(cls(link, d) for link in robot.links[1:-1] for d in DIRECTIONS)
