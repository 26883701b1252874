"""Joint angles that are linear combinations of actuators: rods, belts, coupled wrists, a URDF's mimic."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from qsframework.plugin import Array, Context, InputError, Loop, LoopTerm, Parameter, Problem, RobotFacts, setting

_SINGULAR = 1e-9


@dataclass(frozen=True)
class Coupling(Loop):
    """A joint follows others, or several joints share their actuators.

    joint, follows, offset: the joint's angle is the sum of the leaders' joint angles, each times its
    factor, plus the offset, plus what its own actuator adds. A joint that `controller:` leaves out has
    no actuator and stands where the others put it: a palletizer's wrist, a URDF's mimic. One with an
    actuator is driven from a link before it, such as by a belt or a shaft through the arm.

    tied, matrix: the angles of the tied joints are the matrix times those of their actuators, such as
    in a differential wrist.

    Joints that slide may follow joints that slide: the stages of a telescopic column.

    The joint may be that of a branch, a link beside the arm: the lever of a counterweight, a rod.

    Springs act at the actuators, and what follows moves along when they give. A joint_compliance at a
    joint without an actuator is the give of the rods or belts that hold it.
    """

    joint: str = setting(default="")
    follows: tuple[tuple[str, float], ...] = setting(default=())
    """In a spec a mapping, such as {joint_2: 1, joint_3: -1}."""
    offset: float = setting("rad", 0.0)
    tied: tuple[str, ...] = setting(default=())
    matrix: tuple[tuple[float, ...], ...] = setting(default=())
    """In a spec one list for each tied joint."""
    equation = "q = A q_leaders + M phi + offset"
    source = "Linear transmissions; <mimic> of URDF"
    check = "Rods, belts or shafts that couple the joints, and their play."
    slides = True

    def __post_init__(self) -> None:
        one, several = bool(self.joint or self.follows), bool(self.tied or self.matrix)
        if one == several or (one and not self.joint):
            raise InputError(
                Problem(
                    "coupling: needs joint and follows, or tied and matrix",
                    allowed="joint: joint_5, follows: {joint_2: 1, joint_3: -1}; "
                    "tied: [joint_5, joint_6], matrix: [[0.5, 0.5], [0.5, -0.5]]",
                )
            )
        object.__setattr__(self, "follows", _factors(self.joint, self.follows))
        object.__setattr__(self, "tied", tuple(self.tied))
        if several:
            object.__setattr__(self, "matrix", _square(self.tied, self.matrix))

    @property
    def where(self) -> str:
        return self.joint or "+".join(self.tied)

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return ()

    def joints(self, robot: RobotFacts) -> tuple[str, ...]:
        return (*self.leaders(robot), self.joint) if self.joint else self.tied

    def leaders(self, robot: RobotFacts) -> tuple[str, ...]:
        return tuple(leader for leader, _ in self.follows)

    def validate(self, robot: RobotFacts) -> None:
        every = self.joints(robot)
        for joint in every:
            robot.turning_index(joint)
        travels = [joint for joint in every if robot.slides(joint)]
        if 0 < len(travels) < len(every):
            hint = "Joints that slide follow joints that slide, joints that turn those that turn."
            raise InputError(Problem(f"{self.name}: {', '.join(travels)} slides, and the others turn", hint=hint))

    def _map(self) -> Array:
        """Joint angles (k, k) per leader and actuator."""
        if self.tied:
            return np.array(self.matrix)
        out = np.eye(len(self.follows) + 1)
        out[-1, :-1] = [factor for _, factor in self.follows]
        return out

    def _shift(self) -> Array:
        return np.array([0.0] * len(self.follows) + [self.offset] * bool(self.joint) + [0.0] * len(self.tied))

    def actuators(self, q: Array, robot: RobotFacts) -> Array:
        return np.asarray(np.linalg.solve(self._map(), (q - self._shift()).T).T, dtype=np.float64)

    def closure(self, actuators: Array, bars: Array, context: Context) -> LoopTerm:
        slope, batch = self._map(), len(actuators)
        k = len(slope)
        return LoopTerm(
            actuators @ slope.T + self._shift(),
            np.broadcast_to(slope, (batch, k, k)),
            np.zeros((batch, k, k, k)),
        )


def _factors(joint: str, given: Any) -> tuple[tuple[str, float], ...]:
    """Leaders with their factors, of a mapping or of pairs."""
    listed = given
    pairs: list[tuple[Any, Any]] = list(listed.items()) if isinstance(given, Mapping) else list(listed)
    wrong = [f"{leader}: {factor!r}" for leader, factor in pairs if not _number(factor) or leader == joint]
    if wrong or (joint and not pairs) or len({leader for leader, _ in pairs}) < len(pairs):
        allowed = "other joints with numbers, such as {joint_2: 1, joint_3: -1}"
        found = ", ".join(wrong) or str(pairs)
        raise InputError(Problem(f"coupling[{joint}]: follows must name its leaders", found=found, allowed=allowed))
    return tuple((str(leader), float(factor)) for leader, factor in pairs)


def _square(tied: tuple[str, ...], given: Any) -> tuple[tuple[float, ...], ...]:
    """The matrix of tied joints, which must have an inverse."""
    rows: list[list[Any]] = [_listed(row) for row in given]
    count = len(tied)
    square = len(rows) == count > 1 and all(len(row) == count and all(_number(v) for v in row) for row in rows)
    if not square or len(set(tied)) < count or abs(np.linalg.det(np.array(rows, dtype=float))) < _SINGULAR:
        allowed = f"{count} lists of {count} numbers that no two joints make alike"
        raise InputError(Problem(f"coupling of {', '.join(tied)}: wrong matrix", found=str(rows), allowed=allowed))
    return tuple(tuple(float(v) for v in row) for row in rows)


def _listed(row: Any) -> list[Any]:
    given = row
    return list(given) if isinstance(row, list | tuple) else [given]


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))
