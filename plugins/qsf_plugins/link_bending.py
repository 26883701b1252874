"""A link that bends along its whole length."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Context, InputError, Parameter, Problem, RobotFacts, Spring, VirtualJoint, place

_POINTS = 0.5 - 0.5 / np.sqrt(3.0), 0.5 + 0.5 / np.sqrt(3.0)
"""Of the length: two Gauss points integrate an even beam under an end force and an end moment exactly."""
_SHORTEST = 0.05


@dataclass(frozen=True)
class LinkBending(Spring):
    """A link bends along its length as an even beam does, beside what its ends and bearings give.

    About two axes across the line to the next joint, `u` and `v`. The parameter is L / (2 E I): half of the end's
    turn under a unit moment.
    """

    link: str = place()
    across: str = place()
    """u or v."""
    equation = "w'' = M(s) / (E I), s along the link"
    source = "beam theory: end deflection F L^3 / (3 E I) + M L^2 / (2 E I)"
    check = "Cross-section and material of the link; cracks along it."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter(self.name, "rad/(N m)", typical=robot.sizes.compliance(1e-3), lower=0.0),)

    def compliances(self, robot: RobotFacts) -> tuple[int, ...]:
        return (0, 0)

    def validate(self, robot: RobotFacts) -> None:
        if self.across not in ("u", "v"):
            raise InputError(Problem(f"{self.name}: unknown axis", found=repr(self.across), allowed="u, v"))
        if self.link not in [e.link for e in self.places(robot)]:
            robot.link_index(self.link)
            raise InputError(f"{self.name}: this link has no length to bend along")

    def _axes(self, robot: RobotFacts) -> tuple[Array, Array, float]:
        """The axis that it bends about, the direction in which its end then moves, and its length, m."""
        reach = robot.placements[robot.link_index(self.link), :3, 3]
        length = float(np.linalg.norm(reach))
        first = np.cross(reach, np.eye(3)[int(np.argmin(np.abs(reach)))])
        axis = first if self.across == "u" else np.cross(reach, first)
        axis = np.asarray(axis / np.linalg.norm(axis), dtype=np.float64)
        return axis, np.asarray(np.cross(axis, reach / length), dtype=np.float64), length

    def virtual_joints(self, robot: RobotFacts) -> tuple[VirtualJoint, ...]:
        axis, side, _ = self._axes(robot)
        a, b = ((float(v[0]), float(v[1]), float(v[2])) for v in (axis, side))
        return (VirtualJoint(self.link, b, "translation"), VirtualJoint(self.link, a, "rotation"))

    def mixing(self, x: Array, context: Context) -> Array:
        """A turn about a point at s along the link is one about its joint and a shift of -s."""
        _, _, length = self._axes(context.robot)
        return np.array([[-length * s for s in _POINTS], [1.0, 1.0]])

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[LinkBending, ...]:
        """Links of a length; not those along which the next one slides, for it loads them anywhere."""
        long = (np.linalg.norm(robot.placements[1:, :3, 3], axis=1) > _SHORTEST) & ~np.array(robot.sliding[1:])
        links = [link for link, bends in zip(robot.links[1:-1], long, strict=True) if bends]
        return tuple(cls(link, across) for link in links for across in ("u", "v"))
