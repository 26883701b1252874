"""The physical balancer spring at a joint."""

from __future__ import annotations

import math
from dataclasses import dataclass

from qsf_plugins.spring_triangle import SIDES, SpringTriangle, check_label, spring
from qsframework.plugin import Array, Context, ParallelSpring, Parameter, Point, RobotFacts, TorqueTerm, place, setting


@dataclass(frozen=True)
class GravityCompensator(ParallelSpring):
    """A spring between two links exerts the torque -M_c on the joint, equations (7)-(9).

    This is the spring that preloads the gear. Its stiffness, equation (11), arrives through the
    derivative of its torque and nowhere else. Where its pivots lie are parameters too.
    """

    joint: str = place()
    lc: float = setting("m", span=SIDES)
    """From the joint's axis to the spring's pivot on the previous link."""
    l2: float = setting("m", span=SIDES)
    """From the joint's axis to the spring's pivot on the link that the joint moves."""
    zero: float = setting("rad", 0.0)
    """Angle b between these two lines at zero joint angle; b grows with the joint angle."""
    label: str = place("")
    """Of several springs at one joint, which."""
    equation = "M_c = K_c lc l2 (1 - s0 / s) sin b  (9), s^2 = lc^2 + l2^2 - 2 lc l2 cos b  (7)"
    source = "Klimchik et al., equations (7)-(11), (11) corrected"
    check = "Pressure or preload of the balancer, wear and place of its pivots."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (
            Parameter(f"{self.name}.stiffness", "N/m", nominal=0.0, typical=15.0 * robot.sizes.weight, lower=0.0),
            Parameter(
                f"{self.name}.free_length", "m", nominal=0.7, typical=0.7, lower=0.0, null=None, domain=(0.0, math.inf)
            ),
            *SpringTriangle(self.lc, self.l2).parameters(self.name, self.zero),
        )

    def validate(self, robot: RobotFacts) -> None:
        robot.joint_index(self.joint)
        check_label(self.name, self.label)
        SpringTriangle(self.lc, self.l2).check(self.name)

    def validate_values(self, x: Array, robot: RobotFacts) -> None:
        SpringTriangle(x[2], x[3]).check(self.name)

    def outline(self, robot: RobotFacts) -> tuple[Point, Point]:
        return SpringTriangle(self.lc, self.l2).pivots(robot, self.joint, self.zero)

    def joints(self, robot: RobotFacts) -> tuple[str, ...]:
        return (self.joint,)

    def torque(self, q: Array, x: Array, context: Context) -> TorqueTerm:
        stiffness, free_length, lc, l2, zero = x
        return SpringTriangle(lc, l2).torque(q[:, 0] + zero, spring(stiffness, free_length))
