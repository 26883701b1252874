"""The seven kinds of effect, one per stage of the pipeline.

An effect is a frozen dataclass whose fields are its configuration. It declares its parameters and
gives its law for a batch of N poses; `x` (p,) always holds the values of its own parameters in the
order of `parameters(robot)`, `context` the poses, this state's conditions and the robot. A law gives
its value alone, as an array, or a term with its derivatives too. It neither stores nor changes anything.
"""

from __future__ import annotations

import dataclasses
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any, ClassVar, Self, cast

import numpy as np

from qsframework.errors import InputError, Problem
from qsframework.plugin.facts import Array, Branch, Context, RobotFacts
from qsframework.plugin.parameter import Parameter
from qsframework.plugin.settings import place_fields
from qsframework.plugin.terms import (
    Coordinate,
    GeometryTerm,
    LawTerm,
    Loads,
    LoadTerm,
    LoopTerm,
    Point,
    Range,
    Reading,
    SensorTerm,
    StiffnessTerm,
    TensionTerm,
    TorqueTerm,
)

At = tuple[str, str]
"""Role and place of an effect."""
_LINKS = ("link", "marker", "first", "second")
"""Fields that name no joint, though a link or a marker may be called as one."""


def _fields(effect: Any) -> tuple[dataclasses.Field[Any], ...]:
    """The configuration of an effect, which is a dataclass; none where it has none."""
    return dataclasses.fields(effect) if dataclasses.is_dataclass(effect) else ()


@cache
def _in_files(name: str) -> str:
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


def _flat(value: Any) -> Iterator[str]:
    """The texts in nested tuples."""
    for one in cast("tuple[Any, ...]", value) if isinstance(value, tuple) else ():
        yield from (one,) if isinstance(one, str) else _flat(one)


class Effect(ABC):
    """What all kinds share. The docstring's first line is the sentence on the physics."""

    stage: ClassVar[int]
    order: ClassVar[int] = 0
    """Place among the effects of the same stage; the wrench and the reading pass in this order."""
    source: ClassVar[str] = ""
    """Where the law is published."""
    equation: ClassVar[str] = ""
    """The law as one line of plain text, for reports."""
    check: ClassVar[str] = ""
    """What to look at on the real robot when this effect is found."""
    needs: ClassVar[tuple[str, ...]] = ()
    """Columns that the readings must have: "time", "temperature", "approach"."""
    by_state: ClassVar[bool] = False
    """Whether the law itself, not only what it is asked at, differs between a pose's loaded and unloaded state."""
    slides: ClassVar[bool] = False
    """Whether the law also holds at a joint that slides, in its units; else it is refused and not offered there."""
    whole: ClassVar[bool] = False
    """Whether its values belong together, so that a file which states one states all."""
    role: ClassVar[str] = ""
    """What the effect is to the rest of the arm, such as "gear": by it others refer to effects, never by a name."""

    replaces: ClassVar[tuple[str, str]] = ("", "")
    """An effect of another name, which old files may hold, and in which frame its parameters are stated since."""

    def __init_subclass__(cls, **more: object) -> None:
        super().__init_subclass__(**more)

    @classmethod
    def effect_name(cls) -> str:
        """The name in files: `BaseCompliance` -> `base_compliance`."""
        return _in_files(cls.__name__)

    @property
    def where(self) -> str:
        """The place, as in `effect[where]`; by default the place fields that are given, joined by a slash."""
        return "/".join(filter(None, (str(getattr(self, name)) for name in place_fields(type(self)))))

    @property
    def name(self) -> str:
        """The instance's name: `effect[where]`."""
        return f"{self.effect_name()}[{self.where}]" if self.where else self.effect_name()

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        """The p parameters; none by default."""
        return ()

    def validate(self, robot: RobotFacts) -> None:  # noqa: B027 - most effects fit every robot
        """Raise InputError if the configuration does not fit the robot."""

    def require_fit(self, robot: RobotFacts) -> None:
        """Raise InputError if the effect does not fit the robot: by its joints that slide, or by `validate`."""
        sliding = [joint for joint in self._joints(robot) if robot.slides(joint)]
        if sliding and not self.slides:
            turning = [joint for joint in robot.joints if not robot.slides(joint)]
            message = f"{self.name}: {', '.join(dict.fromkeys(sliding))} slides, and this effect is of joints that turn"
            raise InputError(Problem(message, allowed=", ".join(turning) or "none on this arm"))
        turns = [f.name for f in _fields(self) if f.metadata.get("unit") in ("N m", "rad")]
        given = [name for name in turns if sliding and getattr(self, name)]
        if given:
            text = f"{self.name}: {sliding[0]} slides, and {', '.join(given)} is a torque or an angle"
            raise InputError(Problem(text, hint="Leave it out: what the payload makes of it is taken."))
        self.validate(robot)

    def _joints(self, robot: RobotFacts) -> list[str]:
        """The robot's joints that the configuration names."""
        values = [getattr(self, f.name) for f in _fields(self) if f.name not in _LINKS]
        listed = [v for value in values for v in ((value,) if isinstance(value, str) else _flat(value))]
        return [v for v in listed if v in robot.joints]

    def validate_values(self, x: Array, robot: RobotFacts) -> None:  # noqa: B027 - bounds say enough for most
        """Raise InputError if these nominal values (p,) of a file do not fit the robot or each other."""

    def ranges(self, torque: Array, context: Context) -> tuple[Range, ...]:
        """Where its law holds, of which a prediction beyond is said in words; none by default: everywhere.

        torque: (N, k) N m on the k coordinates of the springs that a SpringLaw bends, (N, 0) of other kinds
        """
        return ()

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[Self, ...]:
        """Every instance that a diagnosis may try on this robot; none by default."""
        return ()

    @classmethod
    def structures(cls, robot: RobotFacts) -> tuple[Self, ...]:
        """Instances that an arm of this kind may have though its file does not say so, such as a loop at the elbow.

        They are other structures to compare with, not causes that a diagnosis tries; none by default.
        """
        return ()

    @classmethod
    def beside(cls, effects: Sequence[Effect], parameters: Sequence[Parameter]) -> tuple[Self, ...]:
        """Instances that a diagnosis may try beside effects that the robot has, such as friction in its balancer.

        parameters: of these effects, with their nominal values; none by default
        """
        return ()


class Geometry(Effect):
    """Stage 0: joint angles and placements differ from the nominal ones."""

    stage = 0
    moves_placements: ClassVar[bool] = False
    """Whether `errors` gives twists of the joints' placements."""

    @abstractmethod
    def errors(self, x: Array, context: Context) -> GeometryTerm | Array:
        """Errors of the actuators' angles (N, n) rad, and of the joints' placements."""


class Loop(Effect):
    """Stage 1: a closed kinematic loop, or another coupling, between actuators and joints.

    It may also turn branches, the moving links beside the arm; their actuators stand at zero. Its parameters are
    the errors of its bars' lengths (m), which are also the coordinates that an elastic bar deflects. Loops may build
    on each other: the joints that one turns may lead another.
    """

    stage = 1

    @abstractmethod
    def joints(self, robot: RobotFacts) -> tuple[str, ...]:
        """The k joints of the loop, of the arm and of branches; actuators have the same names."""

    def leaders(self, robot: RobotFacts) -> tuple[str, ...]:
        """Those of `joints` that it reads and does not turn: their joint angles stand for their actuators."""
        return ()

    @abstractmethod
    def actuators(self, q: Array, robot: RobotFacts) -> Array:
        """Actuator angles (N, k) that the controller commands to reach joint angles q (N, k)."""

    @abstractmethod
    def closure(self, actuators: Array, bars: Array, context: Context) -> LoopTerm | Array:
        """Joint angles (N, k) at actuator angles (N, k) and bar errors (N, m)."""

    def transmission_angle(self, q: Array, robot: RobotFacts) -> Array:
        """Angle (N,) rad in [0, pi/2] between the bars; 0 where the loop is flat and transmits nothing."""
        return np.full(len(q), 0.5 * np.pi)

    def side(self, q: Array, robot: RobotFacts) -> Array:
        """On which side of flat it stands (N,), -1 or 1, at angles (N, k) of those of its joints that are the arm's: no
        arm gets to the other. 1 of a loop that reaches its angles on one side only."""
        return np.ones(len(q))

    @property
    def smallest_transmission_angle(self) -> float:
        """The margin (rad) below which no pose is planned."""
        return 0.0

    def branches(self, robot: RobotFacts) -> tuple[Branch, ...]:
        """Links beside the arm that it brings along because no URDF draws them, parents first."""
        return ()

    def carried(self, robot: RobotFacts) -> tuple[tuple[str, ...], ...]:
        """For each passive joint, seen from the driven actuator, the loop's own branches that lie beyond it."""
        return ((),) if self.parameters(robot) else ()

    def outline(self, q: Array, robot: RobotFacts) -> Array | None:
        """For pictures: ends (N, bars, 2, 3) m of the bars at joint angles q (N, k), NaN where the loop is open.

        In the frame of the first of `joints` before it turns; None: nothing to draw.
        """
        return None


class Spring(Effect):
    """Stage 2: elastic coordinates, one compliance parameter for each.

    Parameters that are no compliance, if any, are what `mixing` depends on.
    """

    stage = 2

    @abstractmethod
    def virtual_joints(self, robot: RobotFacts) -> tuple[Coordinate, ...]:
        """Where the spring lets the arm give."""

    def compliances(self, robot: RobotFacts) -> tuple[int, ...]:
        """Of each elastic coordinate, which parameter is its compliance: each of its own unless said."""
        return tuple(range(len(self.parameters(robot))))

    def mixing(self, x: Array, context: Context) -> Array:
        """Motion of the virtual joints per elastic coordinate, ([N,] virtual joints, coordinates)."""
        return np.eye(len(self.virtual_joints(context.robot)))


class ParallelSpring(Effect):
    """Stage 3: a torque beside the gears. Overrides one or more of the three faces."""

    stage = 3

    def joints(self, robot: RobotFacts) -> tuple[str, ...]:
        """The k joints that `torque` and `stiffness` act on and depend on."""
        return ()

    def torque(self, q: Array, x: Array, context: Context) -> TorqueTerm | Array | None:
        """The physical torque (N, k) on the joints at angles q (N, k); its stiffness follows from its slope."""
        return None

    def stiffness(self, q: Array, x: Array, context: Context) -> StiffnessTerm | Array | None:
        """An equivalent stiffness (N, k, k) with no torque at the commanded pose."""
        return None

    def ends(self, robot: RobotFacts) -> tuple[Point, Point] | None:
        """The two points that `tension` pulls together."""
        return None

    def outline(self, robot: RobotFacts) -> tuple[Point, Point] | None:
        """For pictures: the two pivots of the spring; None: nothing to draw."""
        return self.ends(robot)

    def tension(self, length: Array, x: Array, context: Context) -> TensionTerm | Array:
        """The pull (N,) at a distance (N,) between the two ends."""
        raise TypeError(f"{self.name} has ends but no tension")


class SpringLaw(Effect):
    """Stage 4: eps = c T + f(T), T the torque that the gear carries, preload included."""

    stage = 4

    @abstractmethod
    def springs(self, robot: RobotFacts) -> tuple[At, ...]:
        """Role and place of the springs whose k coordinates follow this law, such as ("gear", "joint_2")."""

    @abstractmethod
    def extra(self, torque: Array, x: Array, context: Context) -> LawTerm | Array:
        """f (N, k) at torques (N, k), each coordinate's by its own torque."""


class Load(Effect):
    """Stage 5: the wrench and the masses differ from what the experiment says."""

    stage = 5

    @abstractmethod
    def apply(self, loads: Loads, x: Array, context: Context) -> LoadTerm | Array:
        """The wrench (N, 6), and the masses to add."""


class Sensor(Effect):
    """Stage 6: the instrument's reading differs from the marker's position."""

    stage = 6

    @abstractmethod
    def read(self, reading: Reading, x: Array, context: Context) -> SensorTerm | Array:
        """What the instrument says (N, k, 3) m of the markers."""
