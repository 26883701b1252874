"""A marker, or all that the instrument reads, moves by a law learned from readings."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import ClassVar

import numpy as np

from qsf_plugins.dependence import Dependence, down_in
from qsframework.plugin import (
    Array,
    Context,
    InputError,
    Parameter,
    Problem,
    Range,
    Reading,
    RobotFacts,
    Sensor,
    SensorTerm,
    cross_matrix,
    setting,
)

OWN = ("force",)


@dataclass(frozen=True)
class LearnedOffset(Dependence, Sensor):
    """A marker shifts, or all readings do, by a smooth law learned from them; beyond what they saw it stays constant.

    `at`: a marker, which shifts in the frame of its `xyz`, or `all`, which shift along the axes of the base. A further
    factor of `by` is `force`: the components of the load, in units of `scale`, along the same axes.
    """

    _: KW_ONLY
    scale: float = setting("N", 1.0)
    prior: float = setting("m", 0.0)
    """sd by which a fit holds each weight to zero, as the evidence chose it; 0: nothing holds them."""
    order = 0
    by_state = True
    role = "learned"
    replaces = ("learned_reading", "the frame of the marker's xyz_mm")
    parts: ClassVar[tuple[str, ...]] = ("marker", "readings")
    equation = "p = p_0 + A sum w_i f_i(angles, attitude, order, force)"
    source = "learned from readings by qsf diagnose, as learned"
    check = "What this reflector sits on, or what the instrument stands on."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        count = self.width(OWN) * (3 if "force" in self.factors else 1)
        names = [f"{self.name}.{axis}.w{i}" for axis in "xyz" for i in range(1, count + 1)]
        return tuple(Parameter(n, "m", typical=self.prior or 5e-4, pull=self.prior or None) for n in names)

    def validate(self, robot: RobotFacts) -> None:
        problems = list(self.problems(robot, OWN))
        if self.prior < 0.0 or not self.scale > 0.0:
            problems.append(Problem(f"{self.name}: scale must be above 0, prior not negative"))
        if self.at == "all" and "attitude" in self.factors:
            problems.append(Problem(f"{self.name}: the attitude is that of a marker's frame", found="at: all"))
        if problems:
            raise InputError(problems)

    def read(self, reading: Reading, x: Array, context: Context) -> SensorTerm:
        dx = self.shapes(reading, context)
        position = reading.position + dx @ x
        if {"attitude", "force"} & set(self.factors) or np.iscomplexobj(position):
            return SensorTerm(position, dx=dx)
        same = np.broadcast_to(np.eye(3), (*reading.position.shape, 3))
        turned = None
        if self.at != "all":
            turned = -cross_matrix(position - reading.position)
        return SensorTerm(position, same, dx, turned)

    def shapes(self, reading: Reading, context: Context) -> Array:
        """What each weight adds (N, k, 3, p) to the k markers' positions, base frame."""
        batch, count = reading.position.shape[:2]
        first = 0 if self.at == "all" else reading.index(self.at, self.name)
        own = np.array([float(self.at == "all" or i == first) for i in range(count)])
        along = np.broadcast_to(np.eye(3), reading.rotation[:, first].shape)
        axes = along if self.at == "all" else reading.rotation[:, first]
        lead = np.ones((batch, 1))
        if "force" in self.factors:
            lead = np.einsum("nji,nj->ni", axes, context.poses.wrench[:, :3]) / self.scale * float(context.loaded)
        functions = self.product(lead, OWN, context, lambda: down_in(axes, context.robot))
        moved = (axes[:, :, :, None] * functions[:, None, None, :]).reshape(batch, 3, -1)
        return np.asarray(own[:, None, None] * moved[:, None])

    def ranges(self, torque: Array, context: Context) -> tuple[Range, ...]:
        return tuple(self.seen(OWN, context))
