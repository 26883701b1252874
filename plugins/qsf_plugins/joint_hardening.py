"""A gear that grows stiffer, or softer, with the torque that it carries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, At, Context, InputError, LawTerm, Parameter, RobotFacts, SpringLaw, place, setting

_ROUND = 0.05
"""Radius of the knee's corner, as a share of the knee."""


@dataclass(frozen=True)
class JointHardening(SpringLaw):
    """A gear gives eps = c T + f(T): cubic, f = c3 T^3, or a further compliance beyond a knee torque.

    Without `knee` the parameter is c3, rad/(N m)^3, or m/N^3 where the joint slides. With `knee_Nm` it is the change of
    compliance, rad/(N m), where |T| exceeds the knee; the corner is a hyperbola over 5 % of the knee, once
    continuously differentiable. Negative values harden. T holds the preload of gravity and compensators.
    """

    joint: str = place()
    knee: float = setting("N m", 0.0)
    """Torque beyond which the compliance changes; 0 for the cubic law."""
    slides = True
    equation = "eps = c T + c3 T^3; with a knee: a further compliance where |T| exceeds it"
    source = "gear catalogues: piecewise-linear stiffness; a change of 10 to 20 % of the sag is common"
    check = "Gear type and wear; compare small and large loads at this joint alone."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        unit, full = robot.unit_of(self.joint), robot.load_at(self.joint)
        motion = robot.sizes.motion_of(unit, 0.1e-3 if robot.slides(self.joint) else 1e-3)
        if self.knee:
            return (Parameter(self.name, unit.give, typical=2.0 * motion / full),)
        cubic = "m/N^3" if robot.slides(self.joint) else "rad/(N m)^3"
        return (Parameter(self.name, cubic, typical=12.0 * motion / full**3),)

    def springs(self, robot: RobotFacts) -> tuple[At, ...]:
        return (("gear", self.joint),)

    def validate(self, robot: RobotFacts) -> None:
        robot.joint_index(self.joint)
        if self.knee < 0.0:
            raise InputError(f"{self.name}: knee must not be negative, found {self.knee:g} N m")

    def extra(self, torque: Array, x: Array, context: Context) -> LawTerm:
        shape, slope = self._knee(torque) if self.knee else (torque**3, 3.0 * torque**2)
        return LawTerm(x[0] * shape, x[0] * slope, shape[..., None])

    def _knee(self, torque: Array) -> tuple[Array, Array]:
        """sign(T) (s(|T| - k) - s(-k)) with s(u) = (u + sqrt(u^2 + r^2)) / 2, and its slope."""
        r = _ROUND * self.knee
        u = np.abs(torque) - self.knee
        root = np.sqrt(u**2 + r**2)
        zero = 0.5 * (-self.knee + np.sqrt(self.knee**2 + r**2))
        return np.sign(torque) * (0.5 * (u + root) - zero), 0.5 * (1.0 + u / root)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[JointHardening, ...]:
        return tuple(cls(joint) for joint in robot.driven)
