"""Laws that readings taught: what nobody has written, with its weights, its prior and its range."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar

import numpy as np

from qsframework.plugin import (
    KNOTS,
    Array,
    At,
    Context,
    InputError,
    Parameter,
    Problem,
    Range,
    RobotFacts,
    SpringLaw,
    by_torque,
    circular,
    place,
    setting,
)

RECORDED = ("order", "time", "temperature", "approach")
_UNITS = {"time": "s", "temperature": "K"}
_FEWEST = 3
"""Knots: fewer make no curve."""


@dataclass(frozen=True)
class Learned(SpringLaw):
    """A place turns more by a smooth law that was learned from readings; beyond what they saw it stays constant.

    `by` is what it depends on: `torque`; angles, one joint or several with a plus between; `order`, `time`,
    `temperature` or `approach`. The torques count in units of `scale`, that of the largest reading. `at`: a joint for
    its drive; a link, base and flange among them, for its three rotations.
    """

    at: str = place()
    by: str = place()
    _: KW_ONLY
    part: str = "drive"
    """drive, or link for the three rotations of a link, of the base or of the tool."""
    scale: float = setting("N m", 1.0)
    lowest: float = setting("N m", 0.0)
    highest: float = setting("N m", 0.0)
    angle_from: float = setting("rad", 0.0)
    angle_to: float = setting("rad", 0.0)
    signs: str = ""
    """Of the angles that are added up, `+-` where the second counts backwards."""
    first: float = 0.0
    last: float = 0.0
    """Range of what was recorded, SI."""
    knots: tuple[float, ...] = ()
    """Of a law by the torque: where its curve may bend, as shares of the scale, in order; none: KNOTS."""
    prior: float = setting("rad", 0.0)
    """sd by which a fit holds each weight to zero, as the evidence chose it; 0: nothing holds them."""
    equation = "eps = c T + sum w_i f_i(T), or T sum w_i f_i(angle), or (w_1 + w_2 T) v"
    by_state = True
    source = "learned from readings by qsf diagnose: Gaussian process of the law, weights by best linear prediction"
    check = "What at this place could follow this curve."
    parts: ClassVar[tuple[str, ...]] = ("drive", "link")
    axes: ClassVar[tuple[str, ...]] = ("rx", "ry", "rz")
    unit: ClassVar[str] = "rad"
    felt: ClassVar[tuple[str, str, str]] = ("torque", "about", "N m")
    """What acts on a coordinate, how its axis is said, and the unit."""

    def __post_init__(self) -> None:
        given: Any = self.knots  # a file may hold anything
        if isinstance(given, Sequence) and not isinstance(given, str):
            object.__setattr__(self, "knots", tuple(self.knots) or KNOTS)

    @property
    def coordinates(self) -> tuple[str, ...]:
        return ("",) if self.part == "drive" else self.axes

    @property
    def count(self) -> int:
        """Weights of one coordinate."""
        return len(self.knots) + 1 if self.by == "torque" else 2 if self.by in RECORDED else 5

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        size = robot.sizes.rotation(1e-4) if self.unit == "rad" else 1e-4
        ends = [f"{c}.w{i}" if c else f"w{i}" for c in self.coordinates for i in range(1, self.count + 1)]
        names = [f"{self.name}.{end}" for end in ends]
        return tuple(Parameter(n, self.unit, typical=self.prior or size, pull=self.prior or None) for n in names)

    def springs(self, robot: RobotFacts) -> tuple[At, ...]:
        if self.part == "drive":
            return (("gear", self.at),)
        if self.at in (robot.base, robot.flange):
            return tuple(("base" if self.at == robot.base else "tool", axis) for axis in self.axes)
        return tuple(("link", f"{self.at}/{axis}") for axis in self.axes)

    def validate(self, robot: RobotFacts) -> None:
        problems: list[Problem] = []
        if self.part not in self.parts:
            problems.append(Problem(f"{self.name}: unknown part", found=repr(self.part), allowed=", ".join(self.parts)))
        else:
            (robot.joint_index if self.part == "drive" else robot.link_index)(self.at)
        if self.by == "torque":
            problems += self._torque_problems()
        elif self.by in RECORDED:
            if not self.first < self.last:
                problems.append(Problem(f"{self.name}: first must lie below last"))
        else:
            for joint in self.by.split("+"):
                if robot.slides(joint):
                    problems.append(Problem(f"{self.name}: {joint} slides and has no angle"))
            if not self.angle_from < self.angle_to:
                problems.append(Problem(f"{self.name}: angle_from must lie below angle_to"))
            if self.signs and (len(self.signs) != len(self.by.split("+")) or not set(self.signs) <= set("+-")):
                allowed = "a + or - for each joint"
                problems.append(Problem(f"{self.name}: wrong signs", found=repr(self.signs), allowed=allowed))
        if not self.scale > 0.0:
            problems.append(Problem(f"{self.name}: scale must be above 0", found=f"{self.scale:g} {self.felt[2]}"))
        if self.prior < 0.0:
            problems.append(Problem(f"{self.name}: prior must not be negative", found=f"{self.prior:g} {self.unit}"))
        if problems:
            raise InputError(problems)

    def _torque_problems(self) -> list[Problem]:
        out: list[Problem] = []
        if not self.lowest < self.highest:
            out.append(Problem(f"{self.name}: lowest must lie below highest"))
        given: Any = self.knots  # a file may hold anything
        listed: list[Any] = list(self.knots) if isinstance(given, tuple) else [given]
        numbers = all(isinstance(k, int | float) and not isinstance(k, bool) and np.isfinite(k) for k in listed)
        if not isinstance(given, tuple) or not numbers:
            allowed = "a list of numbers, such as [-1, -0.5, 0, 0.5, 1]"
            out.append(Problem(f"{self.name}: knots must be numbers", found=repr(self.knots), allowed=allowed))
        elif len(self.knots) < _FEWEST:
            found = f"{len(self.knots)}"
            out.append(Problem(f"{self.name}: too few knots", found=found, allowed=f"{_FEWEST} or more"))
        elif np.any(np.diff(self.knots) <= 0.0):
            k = int(np.flatnonzero(np.diff(self.knots) <= 0.0)[0])
            found = f"{self.knots[k]:g}, then {self.knots[k + 1]:g}"
            out.append(Problem(f"{self.name}: knots out of order", found=found, allowed="each above the one before"))
        return out

    def validate_values(self, x: Array, robot: RobotFacts) -> None:
        names = [p.name for p, v in zip(self.parameters(robot), x, strict=True) if v == 0.0]
        if names and len(names) < len(x):
            raise InputError(
                Problem(
                    f"{self.name}: a value is missing for {', '.join(names)}",
                    found=f"{len(x) - len(names)} weights",
                    allowed=f"{len(x)}, as knots and part of the effect say",
                    hint="All weights of a law belong together; take the file that was written with the effect.",
                )
            )

    def extra(self, torque: Array, x: Array, context: Context) -> Array:
        shapes = self._shapes(torque, context)
        return np.einsum("nkm,km->nk", shapes, x.reshape(shapes.shape[1], -1))

    def ranges(self, torque: Array, context: Context) -> tuple[Range, ...]:
        if self.by == "torque":
            what, along, unit = self.felt
            names = [f" {along} {axis[-1]}" if axis else "" for axis in self.coordinates]
            labels = [f"the {what} on {self.at}{name}" for name in names]
            return tuple(Range(n, unit, torque[:, k], self.lowest, self.highest) for k, n in enumerate(labels))
        if self.by in RECORDED:
            return (Range(f"the {self.by}", _UNITS.get(self.by, ""), self._recorded(context), self.first, self.last),)
        return (Range(f"the angle of {self.by}", "rad", self._angle(context), self.angle_from, self.angle_to),)

    def _shapes(self, torque: Array, context: Context) -> Array:
        """The functions (N, k, m) that the weights multiply."""
        if self.by == "torque":
            return by_torque(_within(torque, self.lowest, self.highest) / self.scale, self.knots)
        u = torque / self.scale
        if self.by in RECORDED:
            middle, half = 0.5 * (self.last + self.first), 0.5 * (self.last - self.first)
            v = ((_within(self._recorded(context), self.first, self.last) - middle) / half)[:, None]
            return np.stack([float(context.loaded) * v * np.ones_like(u), v * u], axis=2)
        angle = _within(self._angle(context), self.angle_from, self.angle_to)
        return u[..., None] * circular(angle)[:, None]

    def _recorded(self, context: Context) -> Array:
        if self.by == "order":
            return context.order
        return context.side if self.by == "approach" else context.recorded(self.by, self.name)

    def _angle(self, context: Context) -> Array:
        signs = [-1.0 if s == "-" else 1.0 for s in self.signs] or [1.0]
        joints = [context.robot.joint_index(joint) for joint in self.by.split("+")]
        signs += [1.0] * (len(joints) - len(signs))
        return context.poses.q[:, joints] @ np.array(signs)


@dataclass(frozen=True)
class LearnedShift(Learned):
    """An end of the arm shifts more by a smooth law learned from readings; beyond what they saw it stays constant.

    As `learned`, of the three shifts of the base or of the tool: forces take the place of torques.
    """

    _: KW_ONLY
    part: str = "shift"
    scale: float = setting("N", 1.0)
    lowest: float = setting("N", 0.0)
    highest: float = setting("N", 0.0)
    prior: float = setting("m", 0.0)
    parts: ClassVar[tuple[str, ...]] = ("shift",)
    axes: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    unit: ClassVar[str] = "m"
    felt: ClassVar[tuple[str, str, str]] = ("force", "along", "N")

    def validate(self, robot: RobotFacts) -> None:
        super().validate(robot)
        if self.at not in (robot.base, robot.flange):
            allowed = f"{robot.base}, {robot.flange}"
            raise InputError(Problem(f"{self.name}: only the ends of the arm shift", found=self.at, allowed=allowed))


def _within(value: Array, low: float, high: float) -> Array:
    """A value held between two bounds; complex steps pass where it is inside."""
    return np.where(value.real < low, low, np.where(value.real > high, high, value))
