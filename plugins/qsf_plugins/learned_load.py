"""The load differs from what was hung on by a law that readings taught."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import ClassVar

import numpy as np

from qsf_plugins.dependence import Dependence, within
from qsf_plugins.learned import require_whole
from qsframework.plugin import (
    Array,
    Context,
    InputError,
    Load,
    Loads,
    Parameter,
    Problem,
    Range,
    RobotFacts,
    magnitude,
    setting,
    smooth,
)

OWN = ("force", "direction")


@dataclass(frozen=True)
class LearnedLoad(Dependence, Load):
    """The force at the load point differs from what was said by a smooth law that was learned from readings.

    `at`: `tool`. Further factors of `by`: `force`, along it, by how large it is; `direction`, along the axes of the
    base, by its components. Without these it grows with the force. Forces count in units of `scale`, the largest.
    """

    _: KW_ONLY
    scale: float = setting("N", 1.0)
    lowest: float = setting("N", 0.0)
    highest: float = setting("N", 0.0)
    prior: float = setting("N", 0.0)
    """sd by which a fit holds each weight to zero, as the evidence chose it; 0: nothing holds them."""
    order = 2
    by_state = True
    role = "learned"
    parts: ClassVar[tuple[str, ...]] = ("load",)
    equation = "w = w_0 + sum w_i f_i(force, order)"
    source = "learned from readings by qsf diagnose, as learned"
    check = "Load cell, weights, cables and what else may pull."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        count = self.width(OWN) * (9 if "force" in self.factors else 21 if "direction" in self.factors else 1)
        names = [f"{self.name}.w{i}" for i in range(1, count + 1)]
        typical = self.prior or 0.01 * robot.sizes.weight
        return tuple(Parameter(n, "N", typical=typical, pull=self.prior or None) for n in names)

    def validate(self, robot: RobotFacts) -> None:
        problems = list(self.problems(robot, OWN))
        if self.at != "tool":
            problems.append(Problem(f"{self.name}: the load hangs at the tool", found=self.at, allowed="tool"))
        if self.factors == ("force",) and not self.lowest < self.highest:
            problems.append(Problem(f"{self.name}: lowest must lie below highest"))
        if self.prior < 0.0 or not self.scale > 0.0:
            problems.append(Problem(f"{self.name}: scale must be above 0, prior not negative"))
        if problems:
            raise InputError(problems)

    def validate_values(self, x: Array, robot: RobotFacts) -> None:
        require_whole(self.name, self.parameters(robot), x)

    def apply(self, loads: Loads, x: Array, context: Context) -> Array:
        more = self.shapes(loads, context) @ x
        return np.concatenate([loads.wrench[:, :3] + more, loads.wrench[:, 3:]], axis=1)

    def shapes(self, loads: Loads, context: Context) -> Array:
        """What each weight adds (N, 3, p) to the force."""
        force = loads.wrench[:, :3] / self.scale
        if "force" in self.factors:
            size = np.sqrt(np.sum(force * force, axis=1))
            middle, half = 0.5 * (self.highest + self.lowest), 0.5 * (self.highest - self.lowest)
            v = (within(size * self.scale, self.lowest, self.highest) - middle) / half
            lead = force[:, :, None] * smooth(v)[:, None, :]
        elif "direction" in self.factors:
            on = np.full((len(force), 1), float(context.loaded))
            parts = np.concatenate([on, force, magnitude(force) * on], axis=1)
            lead = (np.eye(3)[None, :, :, None] * parts[:, None, None, :]).reshape(len(force), 3, -1)
        else:
            lead = force[:, :, None]
        return self.product(lead, OWN, context, lambda: np.zeros((len(force), 3)))

    def ranges(self, torque: Array, context: Context) -> tuple[Range, ...]:
        found = list(self.seen(OWN, context))
        if "force" in self.factors and context.loaded:
            size = np.linalg.norm(context.poses.wrench[:, :3], axis=1)
            found.append(Range("the force of the load", "N", size, self.lowest, self.highest))
        return tuple(found)
