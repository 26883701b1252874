"""Friction in a balancer: the pose remembers from which side it was reached."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass

import numpy as np

from qsf_plugins.gravity_compensator import GravityCompensator
from qsf_plugins.spring_triangle import SIDES, SpringTriangle, check_label, spring
from qsframework.plugin import (
    Array,
    Context,
    Effect,
    InputError,
    ParallelSpring,
    Parameter,
    Problem,
    RobotFacts,
    TorqueTerm,
    place,
    setting,
)


@dataclass(frozen=True, kw_only=True)
class CompensatorFriction(ParallelSpring):
    """The balancer's moment M_c is larger or smaller by a share mu, against the side of approach."""

    joint: str = place()
    lc: float = setting("m", span=SIDES)
    l2: float = setting("m", span=SIDES)
    _: KW_ONLY
    spring_stiffness: float = setting("N/m")
    """Of the balancer's spring: friction is a share of its force."""
    free_length: float = setting("m", span=SIDES)
    zero: float = setting("rad", 0.0)
    label: str = place("")
    """Of several balancers at one joint, which."""
    needs = ("approach",)
    equation = "T = -mu a |M_c|, a = +1 or -1 by the side of approach, M_c from (9)"
    source = "friction of gas and spring balancers: 3 to 10 % of the force"
    check = "Seals and guides of the balancer; approach poses from both sides."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter(self.name, "", typical=0.05, lower=0.0),)

    def validate(self, robot: RobotFacts) -> None:
        robot.joint_index(self.joint)
        check_label(self.name, self.label)
        SpringTriangle(self.lc, self.l2).check(self.name)
        if self.spring_stiffness <= 0.0 or self.free_length < 0.0:
            found = f"spring_stiffness = {self.spring_stiffness:g} N/m, free_length = {self.free_length:g} m"
            raise InputError(Problem(f"{self.name}: the spring must be above 0", found=found))

    def joints(self, robot: RobotFacts) -> tuple[str, ...]:
        return (self.joint,)

    def torque(self, q: Array, x: Array, context: Context) -> TorqueTerm:
        law = spring(self.spring_stiffness, self.free_length)
        moment = SpringTriangle(self.lc, self.l2).torque(q[:, 0] + self.zero, law)
        assert moment.dqq is not None
        against = context.recorded("approach", self.name) * np.sign(-moment.value[:, 0])  # -M_c times this is -a |M_c|
        value, dq = moment.value * against[:, None], moment.dq * against[:, None, None]
        dqq = moment.dqq * against[:, None, None, None]
        return TorqueTerm(x[0] * value, x[0] * dq, value[:, :, None], x[0] * dqq, dq[..., None])

    @classmethod
    def beside(cls, effects: Sequence[Effect], parameters: Sequence[Parameter]) -> tuple[CompensatorFriction, ...]:
        """Friction of every balancer spring whose stiffness the robot states."""
        value = {p.name: p.nominal for p in parameters}

        def of(e: GravityCompensator) -> CompensatorFriction:
            lc, l2, K, s0, zero = (value[f"{e.name}.{n}"] for n in ("lc", "l2", "stiffness", "free_length", "zero"))
            return cls(joint=e.joint, lc=lc, l2=l2, spring_stiffness=K, free_length=s0, zero=zero, label=e.label)

        found = [of(e) for e in effects if isinstance(e, GravityCompensator)]
        return tuple(e for e in found if e.spring_stiffness > 0.0)
