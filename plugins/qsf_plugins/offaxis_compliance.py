"""Tilt of a bearing and torsion of the link before it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, cast

import numpy as np

from qsframework.plugin import Array, Context, Parameter, RobotFacts, Spring, VirtualJoint, cross_matrix, place

_APART = 0.1
"""Of the reach, sd of the place of a bearing on its axis: tables put the first joint's frame on the floor, and of the
shipped heavy arms the shoulder is at 0.25 of the reach, its bearing between them."""


@dataclass(frozen=True)
class OffaxisCompliance(Spring):
    """A joint's bearing and the link that carries it give about an axis that no motor turns.

    The axis is fixed in the previous link: x, y or z of the joint's frame at zero angle. Where the joint slides, its
    carriage gives, and the axis travels with it. It tilts about the point of the joint's axis that the robot states as
    `bearing`; where none is stated, about the joint's frame, and what an error of that does to the estimate is counted.
    """

    joint: str = place()
    axis: str = place(axis=True)
    slides = True
    role = "bearing"
    equation = "eps = c tau, tau = the moment about the axis"
    source = "Klimchik et al., off-axis terms of the virtual joint model"
    check = "Play of the main bearing, cracks and bolts of the link before this joint."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        own = Parameter(self.name, "rad/(N m)", nominal=0.0, typical=robot.sizes.compliance(4e-3), lower=0.0)
        apart = _APART * robot.sizes.reach
        where = Parameter(f"{self.name}.bearing", "m", typical=apart, nominal_sd=apart, null=None)
        return (own, where) if self._somewhere(robot) else (own,)

    def compliances(self, robot: RobotFacts) -> tuple[int, ...]:
        return (0,)

    def virtual_joints(self, robot: RobotFacts) -> tuple[VirtualJoint, ...]:
        axis = cast("Literal['x', 'y', 'z']", self.axis)  # `build_effects` lets no other through
        side, link = "after" if robot.slides(self.joint) else "before", robot.link_of(self.joint)
        x, y, z = self._shift(robot).tolist()
        shift = (VirtualJoint(link, (x, y, z), "translation", side),) if self._somewhere(robot) else ()
        return (VirtualJoint(link, axis, "rotation", side), *shift)

    def mixing(self, x: Array, context: Context) -> Array:
        """A tilt about the point at d along the joint's axis is one about its frame and a shift by d."""
        shares = [1.0, *(-d * np.linalg.norm(self._shift(context.robot)) for d in x[1:])]
        return np.array(shares)[:, None]

    def _somewhere(self, robot: RobotFacts) -> bool:
        """Whether nobody says about which point of its axis the bearing tilts, and it matters."""
        k = robot.joint_index(self.joint)
        return not robot.sliding[k] and robot.bearings[k] is None and bool(self._shift(robot).any())

    def _shift(self, robot: RobotFacts) -> Array:
        """By how much, (3,) m, a unit tilt about a point 1 m along the joint's axis moves its frame the other way."""
        return cross_matrix(np.eye(3)["xyz".index(self.axis)]) @ robot.axes[robot.joint_index(self.joint)]

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
