"""Tilt of a bearing and torsion of the link before it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, cast

import numpy as np

from qsframework.plugin import Parameter, RobotFacts, Spring, VirtualJoint, place


@dataclass(frozen=True)
class OffaxisCompliance(Spring):
    """A joint's bearing and the link that carries it give about an axis that no motor turns.

    The axis is fixed in the previous link: x, y or z of the joint's frame at zero angle. Where the joint slides, its
    carriage gives, and the axis travels with it.
    """

    joint: str = place()
    axis: str = place(axis=True)
    slides = True
    role = "bearing"
    equation = "eps = c tau, tau = the moment about the axis"
    source = "Klimchik et al., off-axis terms of the virtual joint model"
    check = "Play of the main bearing, cracks and bolts of the link before this joint."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter(self.name, "rad/(N m)", nominal=0.0, typical=robot.sizes.compliance(4e-3), lower=0.0),)

    def virtual_joints(self, robot: RobotFacts) -> tuple[VirtualJoint, ...]:
        axis = cast("Literal['x', 'y', 'z']", self.axis)  # `build_effects` lets no other through
        side = "after" if robot.slides(self.joint) else "before"
        return (VirtualJoint(robot.link_of(self.joint), axis, "rotation", side),)

    def validate(self, robot: RobotFacts) -> None:
        robot.joint_index(self.joint)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[OffaxisCompliance, ...]:
        """Every joint about the two coordinate axes that are not its own; one that slides about all three."""
        return tuple(
            cls(joint, name)
            for k, joint in enumerate(robot.joints)
            for i, name in enumerate("xyz")
            if robot.sliding[k] or abs(robot.axes[k] @ np.eye(3)[i]) < 0.5
        )
