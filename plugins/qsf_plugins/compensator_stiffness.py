"""The equivalent stiffness that a balancer adds to its joint."""

from __future__ import annotations

from dataclasses import dataclass

from qsf_plugins.spring_triangle import SIDES, SpringTriangle, check_label, spring
from qsframework.plugin import (
    Array,
    Context,
    ParallelSpring,
    Parameter,
    Point,
    RobotFacts,
    StiffnessTerm,
    place,
    setting,
)


@dataclass(frozen=True)
class CompensatorStiffness(ParallelSpring):
    """A balancer stiffens its joint by K_eq lc l2 eta(b), equation (10), with no torque at the commanded pose.

    K_eq is what published calibrations report; it is not the spring that exerts the balancer's
    torque (`gravity_compensator`): one value cannot be both.
    """

    joint: str = place()
    lc: float = setting("m", span=SIDES)
    l2: float = setting("m", span=SIDES)
    zero: float = setting("rad", 0.0)
    label: str = place("")
    """Of several balancers at one joint, which."""
    role = "balancer stiffness"
    equation = "K = K_2 + K_eq lc l2 eta(b)  (10), (11)"
    source = "Klimchik et al., equation (10); KUKA KR270: Klimchik et al., ICRA 2013"
    check = "Balancer pressure, stiffness of its mounts, stick of its piston."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (
            Parameter(
                f"{self.name}.stiffness",
                "N/m",
                nominal=0.0,
                typical=0.3 / robot.sizes.compliance(20e-3) / (self.lc * self.l2),
                lower=0.0,
            ),
            Parameter(f"{self.name}.free_length", "m", nominal=0.7, typical=0.7, lower=0.0, null=None),
        )

    def validate(self, robot: RobotFacts) -> None:
        robot.joint_index(self.joint)
        check_label(self.name, self.label)
        SpringTriangle(self.lc, self.l2).check(self.name)

    def outline(self, robot: RobotFacts) -> tuple[Point, Point]:
        return SpringTriangle(self.lc, self.l2).pivots(robot, self.joint, self.zero)

    def joints(self, robot: RobotFacts) -> tuple[str, ...]:
        return (self.joint,)

    def stiffness(self, q: Array, x: Array, context: Context) -> StiffnessTerm:
        torque = SpringTriangle(self.lc, self.l2).torque(q[:, 0] + self.zero, spring(*x))
        assert torque.dqq is not None
        assert torque.dqx is not None
        return StiffnessTerm(-torque.dq, -torque.dqq, -torque.dqx[..., :2])
