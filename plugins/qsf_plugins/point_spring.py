"""A spring between two points of any two links: a balancer whose pivots lie anywhere."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from qsf_plugins.spring_triangle import check_label
from qsframework.plugin import Array, Context, ParallelSpring, Parameter, Point, RobotFacts, place, setting


@dataclass(frozen=True)
class PointSpring(ParallelSpring):
    """A spring pulls two points together with K (s - s0); torque and stiffness follow from the geometry.

    The general form of `gravity_compensator`: equations (7)-(11) hold for two points in one plane
    across from one joint only.
    """

    first: str = place()
    """Link of the first pivot."""
    second: str = place()
    """Link of the second pivot."""
    _: KW_ONLY
    first_x: float = setting("m")
    first_y: float = setting("m")
    first_z: float = setting("m")
    second_x: float = setting("m")
    second_y: float = setting("m")
    second_z: float = setting("m")
    label: str = place("")
    """Of several springs between two links, which."""
    equation = "T = -d/dq K (s - s0)^2 / 2, s the distance of the two points"
    source = "potential energy K (s - s0)^2 / 2 of a spring; geometry of balancers: ros-industrial/abb"
    check = "Pressure or preload of the balancer, wear of its pivots."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (
            Parameter(f"{self.name}.stiffness", "N/m", nominal=0.0, typical=15.0 * robot.sizes.weight, lower=0.0),
            Parameter(f"{self.name}.free_length", "m", nominal=0.5, typical=0.5, lower=0.0, null=None),
        )

    def validate(self, robot: RobotFacts) -> None:
        check_label(self.name, self.label)
        robot.link_index(self.first)
        robot.link_index(self.second)

    def ends(self, robot: RobotFacts) -> tuple[Point, Point]:
        return (
            Point(self.first, (self.first_x, self.first_y, self.first_z)),
            Point(self.second, (self.second_x, self.second_y, self.second_z)),
        )

    def tension(self, length: Array, x: Array, context: Context) -> Array:
        stiffness, free_length = x
        return stiffness * (length - free_length)
