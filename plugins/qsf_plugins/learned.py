"""Laws learned from readings: what nobody has written, with its weights, its prior and its range."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar

import numpy as np

from qsf_plugins.dependence import Dependence, down, within
from qsframework.plugin import (
    KNOTS,
    Array,
    At,
    Context,
    InputError,
    LawTerm,
    Parameter,
    Problem,
    Range,
    RobotFacts,
    SpringLaw,
    bent,
    by_torque,
    magnitude,
    setting,
)

OWN = ("torque", "others", "moment")
"""Factors that look at what the springs carry."""
_FEWEST = 3
"""Knots: fewer make no curve."""
_STEP = 1e-30


@dataclass(frozen=True)
class Learned(Dependence, SpringLaw):
    """A place turns more by a smooth law that was learned from readings; beyond what they saw it stays constant.

    `at`: a joint for its drive; a link, base and flange among them, for its three rotations. Further factors of `by`:
    `torque`, the one there; `others`, those about other axes, of the other drives or of the same place, by which it
    gives or, with `torque`, gives more. Without any of these, and where it is not `loaded` or `always`, the law grows
    with the torque there. Torques count in units of `scale`, that of the largest reading.
    """

    _: KW_ONLY
    part: str = "drive"
    """drive, or link for the three rotations of a link, of the base or of the tool."""
    moves: str = ""
    """Of a place that could move about several axes: the one about which it does, such as rx; none: all of them."""
    scale: float = setting("N m", 1.0)
    lowest: float = setting("N m", 0.0)
    highest: float = setting("N m", 0.0)
    knots: tuple[float, ...] = ()
    """Of a law by the torque alone: where its curve may bend, as shares of the scale, in order; none: KNOTS."""
    prior: float = setting("rad", 0.0)
    """sd by which a fit holds each weight to zero, as the evidence chose it; 0: nothing holds them."""
    equation = "eps = c T + sum w_i f_i(T, angles, attitude, order, ...)"
    by_state = True
    role = "learned"
    source = "learned from readings by qsf diagnose: Gaussian process of the law, weights by best linear prediction"
    check = "What at this place could follow this curve."
    parts: ClassVar[tuple[str, ...]] = ("drive", "link")
    unit: ClassVar[str] = "rad"
    felt: ClassVar[tuple[str, str, str]] = ("torque", "about", "N m")
    """What acts on a coordinate, how its axis is said, and the unit."""

    def __post_init__(self) -> None:
        given: Any = self.knots  # a file may hold anything
        if isinstance(given, Sequence) and not isinstance(given, str):
            object.__setattr__(self, "knots", tuple(self.knots) or KNOTS)

    def coordinates(self, robot: RobotFacts) -> tuple[str, ...]:
        """Names of what moves: none where it is one."""
        return (self.moves,) if self.moves else self.axes(robot)

    def axes(self, robot: RobotFacts) -> tuple[str, ...]:
        """Names of all that could move at this place."""
        return ("",) if self.part == "drive" else ("rx", "ry", "rz")

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        size = robot.sizes.rotation(1e-4) if self.unit == "rad" else 1e-4
        count = range(1, self._lead(robot) * self.width(OWN) + 1)
        ends = [f"{c}.w{i}" if c else f"w{i}" for c in self.coordinates(robot) for i in count]
        names = [f"{self.name}.{end}" for end in ends]
        return tuple(Parameter(n, self.unit, typical=self.prior or size, pull=self.prior or None) for n in names)

    def springs(self, robot: RobotFacts) -> tuple[At, ...]:
        return (*self.moving(robot), *(self._others(robot) if {"others", "moment"} & set(self.factors) else ()))

    def moving(self, robot: RobotFacts) -> tuple[At, ...]:
        """The springs whose coordinates give more, before those whose torques are only looked at."""
        if self.part == "drive":
            return (("gear", self.at),)
        return tuple(self._spring(robot, axis) for axis in self.coordinates(robot))

    def _spring(self, robot: RobotFacts, axis: str) -> At:
        if self.at in (robot.base, robot.flange):
            return ("base" if self.at == robot.base else "tool", axis)
        return ("link", f"{self.at}/{axis}")

    def _others(self, robot: RobotFacts) -> tuple[At, ...]:
        """Springs whose torques count beside the own ones: those of the other drives, or about the other axes."""
        if self.part == "drive":
            return tuple(("gear", joint) for joint in robot.driven if joint != self.at)
        mine = self.coordinates(robot)
        return tuple(self._spring(robot, axis) for axis in self.axes(robot) if axis not in mine)

    def validate(self, robot: RobotFacts) -> None:
        problems: list[Problem] = []
        if self.part not in self.parts:
            problems.append(Problem(f"{self.name}: unknown part", found=repr(self.part), allowed=", ".join(self.parts)))
        else:
            (robot.link_index if self.part in ("link", "shift") else robot.joint_index)(self.at)
        problems += self.problems(robot, OWN)
        if self.moves and self.part in self.parts and self.moves not in self.axes(robot):
            allowed = ", ".join(filter(None, self.axes(robot))) or "none"
            problems.append(
                Problem(f"{self.name}: no such motion of this place", found=repr(self.moves), allowed=allowed)
            )
        other = "others" if self.part == "shift" else "moment"
        if other in self.factors:
            allowed = "moment" if self.part == "shift" else "others"
            problems.append(Problem(f"{self.name}: no such factor of a {self.part}", found=other, allowed=allowed))
        if self.factors == ("torque",):
            problems += self._torque_problems()
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

    def extra(self, torque: Array, x: Array, context: Context) -> LawTerm:
        """The law is linear in its weights; each coordinate's slope by its own torque is exact by complex step."""
        count = len(self.coordinates(context.robot))
        weights = x.reshape(count, -1)
        shapes = self.shapes(torque, context)
        value, slope = np.zeros_like(torque), np.zeros(torque.shape)
        value[:, :count] = np.einsum("nkm,km->nk", shapes, weights)
        for k in range(count) if not np.iscomplexobj(torque) else ():
            turned = torque.astype(complex)
            turned[:, k] += 1j * _STEP * self.scale
            slope[:, k] = np.imag(self.shapes(turned, context)[:, k] @ weights[k]) / (_STEP * self.scale)
        dx = np.zeros((*torque.shape, count, weights.shape[1]), dtype=shapes.dtype)
        for k in range(count):
            dx[:, k, k] = shapes[:, k]
        return LawTerm(value, slope, dx.reshape(*torque.shape, -1))

    def shapes(self, torque: Array, context: Context) -> Array:
        """The functions (N, c, m) that the weights of the c moving coordinates multiply."""
        count = len(self.coordinates(context.robot))
        u = torque[:, :count] / self.scale
        if self.factors == ("torque",):
            return by_torque(within(u, self.lowest / self.scale, self.highest / self.scale), self.knots)
        lead = np.ones((*u.shape, 1))
        if {"others", "moment"} & set(self.factors):
            lead = self._coupled(torque, u, context.robot)
        elif "torque" in self.factors:
            lead = bent(within(u, self.lowest / self.scale, self.highest / self.scale))
        elif "attitude" in self.factors:
            lead = np.stack([u, 0.5 * u / np.sqrt(u * u + 0.04)], axis=-1)
        elif not {"loaded", "always"} & set(self.factors):
            lead = u[..., None]
        return self.product(lead, OWN, context, lambda: down(context, *self._frame(context.robot)))

    def _lead(self, robot: RobotFacts) -> int:
        """Functions of the torques."""
        if self.factors == ("torque",):
            return len(self.knots) + 3
        if "others" in self.factors:
            return 2 * (len(self.springs(robot)) - (self.part == "drive"))
        if "torque" in self.factors:
            return 3
        return 2 if "attitude" in self.factors and not {"loaded", "always"} & set(self.factors) else 1

    def _coupled(self, torque: Array, u: Array, robot: RobotFacts) -> Array:
        """Torques about other axes, and these by how large the own one is."""
        if self.part == "drive":
            sizes = np.array([robot.load_at(joint) for _, joint in self._others(robot)])
            others = (torque[:, 1:] / sizes)[:, None, :]
        else:
            others = np.repeat(torque[:, None, :] / self.scale, u.shape[1], axis=1)
        if "torque" in self.factors:
            own = within(u, self.lowest / self.scale, self.highest / self.scale)[..., None]
            return np.concatenate([own * others, own * magnitude(others)], axis=-1)
        return np.concatenate([others, others * magnitude(u)[..., None]], axis=-1)

    def _frame(self, robot: RobotFacts) -> tuple[int, Array]:
        """The link, and the frame (4, 4) on it, in which the attitude counts."""
        return robot.frame_of(robot.link_of(self.at) if self.part == "drive" else self.at)

    def ranges(self, torque: Array, context: Context) -> tuple[Range, ...]:
        found = list(self.seen(OWN, context))
        if "torque" in self.factors:
            what, along, unit = self.felt
            names = [f" {along} {axis[-1]}" if axis else "" for axis in self.coordinates(context.robot)]
            labels = [f"the {what} on {self.at}{name}" for name in names]
            found += [Range(n, unit, torque[:, k], self.lowest, self.highest) for k, n in enumerate(labels)]
        return tuple(found)


@dataclass(frozen=True)
class LearnedBearing(Learned):
    """A joint's bearing tilts by a smooth law learned from readings; beyond what they saw it stays constant.

    As `learned`, about the axes that are not the joint's own, in the link that carries it.
    """

    _: KW_ONLY
    part: str = "bearing"
    parts: ClassVar[tuple[str, ...]] = ("bearing",)

    def axes(self, robot: RobotFacts) -> tuple[str, ...]:
        axis = robot.axes[robot.joint_index(self.at)]
        return tuple(f"r{a}" for i, a in enumerate("xyz") if abs(axis[i]) < 0.5)

    def _spring(self, robot: RobotFacts, axis: str) -> At:
        return ("bearing", f"{self.at}/{axis[1:]}")

    def _frame(self, robot: RobotFacts) -> tuple[int, Array]:
        return robot.joint_index(self.at), np.eye(4)


@dataclass(frozen=True)
class LearnedShift(Learned):
    """A link shifts more by a smooth law that was learned from readings; beyond what they saw it stays constant.

    As `learned`, of the three shifts of a link, base and tool among them: forces take the place of torques; a further
    factor is `moment`, about all axes there.
    """

    _: KW_ONLY
    part: str = "shift"
    scale: float = setting("N", 1.0)
    lowest: float = setting("N", 0.0)
    highest: float = setting("N", 0.0)
    prior: float = setting("m", 0.0)
    parts: ClassVar[tuple[str, ...]] = ("shift",)
    unit: ClassVar[str] = "m"
    felt: ClassVar[tuple[str, str, str]] = ("force", "along", "N")

    def axes(self, robot: RobotFacts) -> tuple[str, ...]:
        return ("x", "y", "z")

    def _others(self, robot: RobotFacts) -> tuple[At, ...]:
        return tuple(self._spring(robot, axis) for axis in ("rx", "ry", "rz"))

    def _lead(self, robot: RobotFacts) -> int:
        return 3 * 3 if "moment" in self.factors else super()._lead(robot)

    def _coupled(self, torque: Array, u: Array, robot: RobotFacts) -> Array:
        """What every moment does to every shift."""
        count = len(self.coordinates(robot))
        moments = bent(torque[:, count:] / robot.sizes.torque).reshape(len(torque), 1, -1)
        return np.repeat(moments, count, axis=1)
