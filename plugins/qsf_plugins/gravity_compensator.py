"""The physical balancer spring at a joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsf_plugins.spring_triangle import SpringTriangle
from qsframework.plugin import (
    Array,
    Conditions,
    ParallelSpring,
    Parameter,
    Point,
    RobotFacts,
    TorqueTerm,
    place,
    setting,
)


@dataclass(frozen=True)
class GravityCompensator(ParallelSpring):
    """A spring between two links exerts the torque -M_c on the joint, equations (7)-(9).

    This is the spring that preloads the gear. Its stiffness, equation (11), arrives through the
    derivative of its torque and nowhere else.
    """

    joint: str = place()
    lc: float = setting("m")
    """From the joint's axis to the spring's pivot on the previous link."""
    l2: float = setting("m")
    """From the joint's axis to the spring's pivot on the link that the joint moves."""
    zero: float = setting("rad", 0.0)
    """Angle b between these two lines at zero joint angle; b grows with the joint angle."""
    equation = "M_c = K_c lc l2 (1 - s0 / s) sin b  (9), s^2 = lc^2 + l2^2 - 2 lc l2 cos b  (7)"
    source = "Klimchik et al., equations (7)-(11), (11) corrected"
    check = "Pressure or preload of the balancer, wear of its pivots."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (
            Parameter(f"{self.name}.stiffness", "N/m", nominal=0.0, typical=1e5, lower=0.0),
            Parameter(f"{self.name}.free_length", "m", nominal=0.7, typical=0.7, lower=0.0, null=None),
        )

    def validate(self, robot: RobotFacts) -> None:
        robot.joint_index(self.joint)
        SpringTriangle(self.lc, self.l2).check(self.name)

    def outline(self, robot: RobotFacts) -> tuple[Point, Point]:
        return SpringTriangle(self.lc, self.l2).pivots(robot, self.joint, self.zero)

    def joints(self, robot: RobotFacts) -> tuple[str, ...]:
        return (self.joint,)

    def torque(self, q: Array, x: Array, conditions: Conditions) -> TorqueTerm:
        triangle, b = SpringTriangle(self.lc, self.l2), q[:, 0] + self.zero
        stiffness, free_length = x
        area = self.lc * self.l2
        moment, eta = triangle.moment(b, free_length), area * triangle.eta(b, free_length)
        dx = np.stack([moment, stiffness * triangle.moment_free_length(b)], axis=1)
        dqx = np.stack([eta, stiffness * area * triangle.eta_free_length(b)], axis=1)
        dqq = stiffness * area * triangle.eta_angle(b, free_length)
        return TorqueTerm(
            value=-stiffness * moment[:, None],
            dq=-stiffness * eta[:, None, None],
            dx=-dx[:, None, :],
            dqq=-dqq[:, None, None, None],
            dqx=-dqx[:, None, None, :],
        )
