"""What a learned law depends on: a product of factors, each a few functions of a state."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import reduce
from typing import Any, ClassVar

import numpy as np

from qsframework.plugin import (
    FINE,
    KNOTS,
    Array,
    Context,
    Problem,
    Range,
    RobotFacts,
    by_attitude,
    by_coming,
    circular,
    place,
    setting,
    smooth,
    turns,
)

RECORDED = ("order", "time", "temperature", "approach")
_UNITS = {"time": "s", "temperature": "K"}
_WIDTHS = {"attitude": 9, "came": 3}
"""Functions of a factor."""
_MOST_WAVES = 6


@dataclass(frozen=True)
class Dependence:
    """Place, factors, and the range of each that the readings had.

    `by` names the factors, joined by `*`: the angle of a joint, or of two parallel ones with a plus between; `order`,
    `time`, `temperature`, `approach`; `came`, the direction from which the joint came to its pose, of a link the joint
    before it, of the base the first one; `attitude` against gravity; `loaded`, where something happens once a load
    hangs; `always`. What further factors there are says the effect.
    """

    whole: ClassVar[bool] = True
    at: str = place()
    by: str = place()
    _: KW_ONLY
    angle_from: float = setting("rad", 0.0)
    angle_to: float = setting("rad", 0.0)
    signs: str = ""
    """Of the angles that are added up, `+-` where the second counts backwards."""
    other_from: float = setting("rad", 0.0)
    other_to: float = setting("rad", 0.0)
    """Range of a second angle."""
    first: float = 0.0
    last: float = 0.0
    """Range of what was recorded, SI."""
    waves: int = 2
    """Of the first angle, per turn; a second one has one."""

    @property
    def factors(self) -> tuple[str, ...]:
        return tuple(self.by.split("*"))

    def joints(self, own: Sequence[str]) -> tuple[str, ...]:
        """The factors that are angles, given those that the effect has of its own."""
        known = {*RECORDED, "came", "attitude", "loaded", "always", *own}
        return tuple(f for f in self.factors if f not in known)

    def problems(self, robot: RobotFacts, own: Sequence[str]) -> Iterator[Problem]:
        """What is wrong with factors and ranges; unknown joints are refused by the robot."""
        name, angles = self.by, self.joints(own)
        ranges = ((self.angle_from, self.angle_to, "angle"), (self.other_from, self.other_to, "other"))
        if len(angles) > len(ranges):
            yield Problem(f"learned by {name}: too many angles", found=str(len(angles)), allowed="two at most")
        for factor, (low, high, key) in zip(angles, ranges, strict=False):
            for joint in factor.split("+"):
                if robot.slides(joint):
                    yield Problem(f"learned by {name}: {joint} slides and has no angle")
            if not low < high:
                yield Problem(f"learned by {name}: {key}_from must lie below {key}_to")
        if set(self.factors) & set(RECORDED) and not self.first < self.last:
            yield Problem(f"learned by {name}: first must lie below last")
        comes = self.at in (*robot.joints, *robot.links, robot.flange) and not robot.slides(robot.joint_of(self.at))
        if "came" in self.factors and not comes:
            yield Problem(f"learned by {name}: only what a joint turns comes from somewhere", found=self.at)
        given: Any = self.waves  # a file may hold anything
        if type(given) is not int or not 1 <= given <= _MOST_WAVES:
            yield Problem(f"learned by {name}: waves", found=repr(self.waves), allowed=f"1 to {_MOST_WAVES}")
        count = len(angles[0].split("+")) if angles else 1
        if self.signs and (len(self.signs) != count or not set(self.signs) <= set("+-")):
            yield Problem(f"learned by {name}: wrong signs", found=repr(self.signs), allowed="a + or - for each joint")

    def product(self, start: Array, own: Sequence[str], context: Context, down: Callable[[], Array]) -> Array:
        """start (N, ..., m) times the factors that are not the effect's own; down: direction (N, 3) of gravity where
        the attitude counts."""
        angles = self.joints(own)
        parts = [self._functions(f, angles, context, down) for f in self.factors if f not in own]
        return reduce(_times, parts, start)

    def width(self, own: Sequence[str]) -> int:
        """Functions that the factors beside the effect's own come to."""
        angles = self.joints(own)
        sizes = [self._width(f, angles) for f in self.factors if f not in own]
        return int(np.prod(sizes, initial=1))

    def seen(self, own: Sequence[str], context: Context) -> Iterator[Range]:
        """The ranges of angles and of what was recorded."""
        for k, factor in enumerate(self.joints(own)):
            low, high = (self.angle_from, self.angle_to) if k == 0 else (self.other_from, self.other_to)
            yield Range(f"the angle of {factor}", "rad", self._angle(factor, k, context), low, high)
        for factor in self.factors:
            if factor in RECORDED:
                values = self._recorded(factor, context)
                yield Range(f"the {factor}", _UNITS.get(factor, ""), values, self.first, self.last)

    def _functions(self, factor: str, angles: Sequence[str], context: Context, down: Callable[[], Array]) -> Array:
        """(N, k)."""
        if factor == "loaded":
            return np.full((len(context), 1), float(context.loaded))
        if factor == "always":
            return np.ones((len(context), 1))
        if factor == "attitude":
            return by_attitude(down())
        if factor == "came":
            return by_coming(context.came[:, context.robot.joint_index(context.robot.joint_of(self.at))])
        if factor in RECORDED:
            middle, half = 0.5 * (self.last + self.first), 0.5 * (self.last - self.first)
            v = (within(self._recorded(factor, context), self.first, self.last) - middle) / half
            return v[:, None] if factor == "approach" else smooth(v, self._knots)
        k = list(angles).index(factor)
        low, high = (self.angle_from, self.angle_to) if k == 0 else (self.other_from, self.other_to)
        return circular(within(self._angle(factor, k, context), low, high), self._turns(k))

    def _width(self, factor: str, angles: Sequence[str]) -> int:
        if factor in angles:
            return 1 + 2 * self._turns(list(angles).index(factor))
        if factor in _WIDTHS:
            return _WIDTHS[factor]
        return len(self._knots) if factor in ("order", "time", "temperature") else 1

    def _turns(self, k: int) -> int:
        """Waves per turn of the angle k."""
        return self.waves if k == 0 else 1

    @property
    def _knots(self) -> tuple[float, ...]:
        """Where a function of what was recorded may bend."""
        return FINE if self.at == "all" else KNOTS

    def _recorded(self, factor: str, context: Context) -> Array:
        if factor == "order":
            return context.order
        return context.side if factor == "approach" else context.recorded(factor, f"learned by {self.by}")

    def _angle(self, factor: str, k: int, context: Context) -> Array:
        joints = [context.robot.joint_index(joint) for joint in factor.split("+")]
        signs = [-1.0 if s == "-" else 1.0 for s in self.signs if k == 0]
        signs += [1.0] * (len(joints) - len(signs))
        return context.poses.q[:, joints] @ np.array(signs)


def _times(one: Array, other: Array) -> Array:
    """Every function of one (N, ..., m) with every one of the other (N, k): (N, ..., m k)."""
    spread = other.reshape(len(other), *(1,) * (one.ndim - 1), other.shape[1])
    found = one[..., None] * spread
    return np.asarray(found.reshape(*one.shape[:-1], -1))


def within(value: Array, low: float, high: float) -> Array:
    """A value held between two bounds; complex steps pass where it is inside."""
    return np.where(value.real < low, low, np.where(value.real > high, high, value))


def down(context: Context, link: int, frame: Array) -> Array:
    """Direction (N, 3) of gravity in a frame (4, 4) on a link of the chain, at the angles that are commanded."""
    robot, poses = context.robot, context.poses
    R: Any = np.broadcast_to(np.eye(3), (len(context), 3, 3))
    for k in range(link):
        R = R @ robot.placements[k][:3, :3]
        if not robot.sliding[k]:
            R = R @ turns(robot.axes[k], poses.q[:, k])
    return down_in(R @ frame[:3, :3], robot)


def down_in(rotation: Array, robot: RobotFacts) -> Array:
    """Direction (N, 3) of gravity in frames that are turned against the base by rotations (N, 3, 3)."""
    along = robot.gravity / (np.linalg.norm(robot.gravity) or 1.0)
    return np.asarray(np.einsum("nji,j->ni", rotation, along))
