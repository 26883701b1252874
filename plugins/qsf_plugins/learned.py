"""A law that readings taught, at a drive or a link: what nobody has written, with its weights and its range."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

import numpy as np

from qsframework.plugin import (
    Array,
    At,
    Context,
    InputError,
    Parameter,
    Problem,
    RobotFacts,
    SpringLaw,
    by_torque,
    circular,
    place,
    setting,
)

RECORDED = ("order", "time", "temperature", "approach")
_TURNS = ("rx", "ry", "rz")


@dataclass(frozen=True)
class Learned(SpringLaw):
    """A place gives more by a smooth law that was learned from readings; beyond what they saw it stays constant.

    `by` is what it depends on: `torque`; angles, one joint or several with a plus between; `order`, `time`,
    `temperature` or `approach`. The torques count in units of `scale`, that of the largest reading.
    """

    at: str = place()
    by: str = place()
    _: KW_ONLY
    part: str = "drive"
    """drive, or link for the three rotations of a link or of the base."""
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
    equation = "eps = c T + sum w_i f_i(T), or T sum w_i f_i(angle), or (w_1 + w_2 T) v"
    by_state = True
    source = "learned from readings by qsf diagnose: Gaussian process of the law, weights by best linear prediction"
    check = "What at this place could follow this curve."

    @property
    def coordinates(self) -> tuple[str, ...]:
        return _TURNS if self.part == "link" else ("",)

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        count = 10 if self.by == "torque" else 2 if self.by in RECORDED else 5
        size = robot.sizes.rotation(1e-4)
        ends = [f"{c}.w{i}" if c else f"w{i}" for c in self.coordinates for i in range(1, count + 1)]
        return tuple(Parameter(f"{self.name}.{end}", "rad", typical=size) for end in ends)

    def springs(self, robot: RobotFacts) -> tuple[At, ...]:
        if self.part == "drive":
            return (("gear", self.at),)
        if self.at == robot.base:
            return tuple(("base", turn) for turn in _TURNS)
        return tuple(("link", f"{self.at}/{turn}") for turn in _TURNS)

    def validate(self, robot: RobotFacts) -> None:
        problems: list[Problem] = []
        if self.part not in ("drive", "link"):
            problems.append(Problem(f"{self.name}: unknown part", found=repr(self.part), allowed="drive, link"))
        elif self.part == "drive":
            robot.joint_index(self.at)
        else:
            robot.link_index(self.at)
        if self.by != "torque" and self.by not in RECORDED:
            for joint in self.by.split("+"):
                robot.joint_index(joint)
            if not self.angle_from < self.angle_to:
                problems.append(Problem(f"{self.name}: angle_from must lie below angle_to"))
        elif self.by == "torque" and not self.lowest < self.highest:
            problems.append(Problem(f"{self.name}: lowest must lie below highest"))
        elif self.by in RECORDED and not self.first < self.last:
            problems.append(Problem(f"{self.name}: first must lie below last"))
        if not self.scale > 0.0:
            problems.append(Problem(f"{self.name}: scale must be above 0", found=f"{self.scale:g} N m"))
        if problems:
            raise InputError(problems)

    def extra(self, torque: Array, x: Array, context: Context) -> Array:
        shapes = self._shapes(torque, context)
        return np.einsum("nkm,km->nk", shapes, x.reshape(shapes.shape[1], -1))

    def _shapes(self, torque: Array, context: Context) -> Array:
        """The functions (N, k, m) that the weights multiply."""
        if self.by == "torque":
            return by_torque(_within(torque, self.lowest, self.highest) / self.scale)
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


def _within(value: Array, low: float, high: float) -> Array:
    """A value held between two bounds; complex steps pass where it is inside."""
    return np.where(value.real < low, low, np.where(value.real > high, high, value))
