"""The load differs from what was hung on by a law learned from readings."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import KW_ONLY, dataclass
from typing import ClassVar

import numpy as np

from qsf_plugins.dependence import Dependence, down_in, within
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
class _LearnedWrench(Dependence, Load):
    """What a law adds to the wrench at the tool; `at`: `tool`."""

    order = 2
    by_state = True
    role = "learned"
    source = "learned from readings by qsf diagnose, as learned"

    @abstractmethod
    def shapes(self, loads: Loads, context: Context) -> Array:
        """What each weight adds (N, 6, p) to the wrench."""

    @abstractmethod
    def wrong(self, robot: RobotFacts) -> Iterator[Problem]:
        """What is wrong with factors, ranges and settings."""

    def validate(self, robot: RobotFacts) -> None:
        problems = list(self.wrong(robot))
        if self.at != "tool":
            problems.append(Problem(f"{self.name}: the load hangs at the tool", found=self.at, allowed="tool"))
        if problems:
            raise InputError(problems)

    def apply(self, loads: Loads, x: Array, context: Context) -> Array:
        return loads.wrench + self.shapes(loads, context) @ x


@dataclass(frozen=True)
class LearnedLoad(_LearnedWrench):
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
    parts: ClassVar[tuple[str, ...]] = ("load",)
    equation = "w = w_0 + sum w_i f_i(force, order)"
    check = "Load cell, weights, cables and what else may pull."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        count = self.width(OWN) * (9 if "force" in self.factors else 21 if "direction" in self.factors else 1)
        names = [f"{self.name}.w{i}" for i in range(1, count + 1)]
        typical = self.prior or 0.01 * robot.sizes.weight
        return tuple(Parameter(n, "N", typical=typical, pull=self.prior or None) for n in names)

    def wrong(self, robot: RobotFacts) -> Iterator[Problem]:
        yield from self.problems(robot, OWN)
        if self.factors == ("force",) and not self.lowest < self.highest:
            yield Problem(f"{self.name}: lowest must lie below highest")
        if self.prior < 0.0 or not self.scale > 0.0:
            yield Problem(f"{self.name}: scale must be above 0, prior not negative")

    def shapes(self, loads: Loads, context: Context) -> Array:
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
        along = self.product(lead, OWN, context, lambda: np.zeros((len(force), 3)))
        return np.concatenate([along, np.zeros_like(along)], axis=1)

    def ranges(self, torque: Array, context: Context) -> tuple[Range, ...]:
        found = list(self.seen(OWN, context))
        if "force" in self.factors and context.loaded:
            size = np.linalg.norm(context.poses.wrench[:, :3], axis=1)
            found.append(Range("the force of the load", "N", size, self.lowest, self.highest))
        return tuple(found)


@dataclass(frozen=True)
class LearnedLoadPoint(_LearnedWrench):
    """The point where the load acts shifts in the flange's frame by a smooth law that was learned from readings.

    `at`: `tool`. `by` may be the `attitude` of the flange, the `order`, or an angle.
    """

    _: KW_ONLY
    prior: float = setting("m", 0.0)
    """sd by which a fit holds each weight to zero, as the evidence chose it; 0: nothing holds them."""
    parts: ClassVar[tuple[str, ...]] = ("point",)
    equation = "moment = moment_0 + (R r) x f, r = sum w_i f_i(attitude, order, angle), R the rotation of the flange"
    replaces = ("learned_point", "the flange's frame")
    check = "Where the cable or the weight hangs, and what may slide there."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        names = [f"{self.name}.{axis}.w{i}" for axis in "xyz" for i in range(1, self.width(()) + 1)]
        return tuple(Parameter(n, "m", typical=self.prior or 0.01, pull=self.prior or None) for n in names)

    def wrong(self, robot: RobotFacts) -> Iterator[Problem]:
        yield from self.problems(robot, ())
        if self.prior < 0.0:
            yield Problem(f"{self.name}: prior must not be negative", found=f"{self.prior:g} m")

    def shapes(self, loads: Loads, context: Context) -> Array:
        one = np.ones((len(context), 1))
        functions = self.product(one, (), context, lambda: down_in(loads.rotation, context.robot))
        arms = loads.rotation.transpose(0, 2, 1)  # row i: the i-th axis of the flange
        moments = np.cross(arms, loads.wrench[:, None, :3]).transpose(0, 2, 1)
        turning = (moments[..., None] * functions[:, None, None, :]).reshape(len(context), 3, -1)
        return np.concatenate([np.zeros_like(turning), turning], axis=1)

    def ranges(self, torque: Array, context: Context) -> tuple[Range, ...]:
        return tuple(self.seen((), context))
