"""What the pendant shows and what the URDF means: q = matrix @ pendant + offset."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from qsframework.errors import InputError, Problem, ProblemPlace
from qsframework.files import Document
from qsframework.plugin import Array, Loop, RobotFacts
from qsframework.plugin.facts import frozen
from qsframework.plugin.loops import follow
from qsframework.robot.spec import JointSpec, RobotSpec
from qsframework.units import JointUnits, allowed_names

_FOLLOWS = 1e-9
"""rad or m; what float64 loses on the way."""


@dataclass(frozen=True)
class Drive:
    """What the controller makes of one angle of the pendant.

    external: it counts it among its external axes; ratio: turns of the motor per turn of the joint, negative where
    they turn against each other; counts: of the encoder per turn of the motor. None where nobody states it.
    """

    external: bool = False
    ratio: float | None = None
    counts: float | None = None


@dataclass(frozen=True, eq=False)
class Controller:
    """Affine map from m values of the pendant to n URDF joint values; limits hold for what the pendant shows.

    Angles in rad, travels of joints that slide in m. matrix (n, m), offset (n,), lower and upper (m,), tolerance;
    driven (m,): the joints that have an actuator, the others (m < n) follow them; drives (m,), or none where nothing
    is stated; sliding (n,): which joints slide
    """

    matrix: Array
    offset: Array
    _: KW_ONLY
    lower: Array
    upper: Array
    tolerance: float
    driven: tuple[int, ...]
    sliding: tuple[bool, ...]
    drives: tuple[Drive, ...] = ()

    @cached_property
    def units(self) -> JointUnits:
        """Of what the pendant shows (m,)."""
        return JointUnits(tuple(self.sliding[k] for k in self.driven))

    @property
    def external(self) -> tuple[int, ...]:
        """Which angles of the pendant are external axes of the controller."""
        return tuple(k for k, drive in enumerate(self.drives) if drive.external)

    @property
    def axes(self) -> int:
        """m, the angles on the pendant."""
        return len(self.lower)

    @property
    def following(self) -> Array:
        """Angle of each joint per angle of those that have an actuator (n, m)."""
        return np.asarray(self.matrix @ np.linalg.inv(self.matrix[list(self.driven)]), dtype=np.float64)

    def to_joints(self, pendant: Array) -> Array:
        """URDF joint angles (N, n) of pendant angles (N, m)."""
        return pendant @ self.matrix.T + self.offset

    def to_pendant(self, q: Array) -> Array:
        """Pendant angles (N, m) of URDF joint angles (N, n). InputError where a joint is not where it has to follow."""
        rows = list(self.driven)
        back = np.linalg.solve(self.matrix[rows], (q - self.offset)[:, rows].T).T
        pendant = np.asarray(back, dtype=np.float64)
        if len(rows) < len(self.matrix):
            off = np.abs(self.to_joints(pendant) - q)
            if (off > _FOLLOWS).any():
                i, k = np.argwhere(off > _FOLLOWS)[0].tolist()
                unit = JointUnits(self.sliding)[k]
                raise InputError(
                    Problem(
                        f"joint {k + 1} follows other joints and cannot stand alone at pose {i + 1}",
                        found=unit.text(float(q[i, k])),
                        allowed=unit.text(float(self.to_joints(pendant)[i, k])),
                    )
                )
        return pendant

    def range_of(self, k: int) -> tuple[float, float]:
        """The limits, rad or m, of one value of the pendant."""
        return float(self.lower[k]), float(self.upper[k])

    def once_around(self) -> tuple[Array, Array]:
        """Between which values (m,) a search begins: the limits, of a joint that turns one turn about zero at most."""
        turn = np.where(self.units.sliding, np.inf, np.pi)
        lower, upper = np.maximum(self.lower, -turn), np.minimum(self.upper, turn)
        return lower, np.maximum(lower, upper)

    def ranges(self) -> Array:
        """Lowest and highest URDF angle (n, 2) rad of each joint within the limits of what the pendant shows."""
        middle, half = self.to_joints(0.5 * (self.lower + self.upper)[None])[0], 0.5 * (self.upper - self.lower)
        reach = np.abs(self.matrix) @ half
        return frozen(np.stack([middle - reach, middle + reach], axis=1))

    def outside(self, pendant: Array) -> npt.NDArray[np.bool_]:
        """Which pendant angles (N, m) break a limit by more than the tolerance; NaN does."""
        return ~((pendant >= self.lower - self.tolerance) & (pendant <= self.upper + self.tolerance))


def read_actuated(document: Document, spec: RobotSpec, facts: RobotFacts) -> Controller:
    """The map from the pendant to the m joints that an actuator drives, of which `controller:` has every one.

    InputError with all problems.
    """
    m = len(facts.driven)
    matrix, offset, limits = np.eye(m), np.zeros(m), np.zeros((m, 2))
    problems: list[Problem] = []
    for k, joint in enumerate(facts.driven):
        entry = spec.controller[joint]
        here: ProblemPlace = {"file": str(document.path), "line": document.line("controller", joint)}
        slides = facts.slides(joint)
        problems += [replace(p, **here) for p in _joint_problems(joint, entry, slides)]
        if not problems:
            limits[k] = entry.travel if slides else entry.limits
        try:
            if entry.equals is not None:
                matrix[k], offset[k] = parse_expression(entry.equals, [facts.slides(j) for j in facts.driven], slides)
        except InputError as error:
            problems += [replace(p, message=f"{joint}: {p.message}", **here) for p in error.problems]
    if not problems and abs(np.linalg.det(matrix)) < 1e-9:
        problems.append(document.problem(f"controller: {_tied(matrix, facts.driven)}", "controller"))
    if problems:
        raise InputError(problems)
    lower, upper = frozen(limits[:, 0]), frozen(limits[:, 1])
    sliding = tuple(facts.slides(joint) for joint in facts.driven)
    entries = [spec.controller[joint] for joint in facts.driven]
    drives = tuple(Drive(e.external, e.motor_ratio, e.counts_per_turn) for e in entries)
    return Controller(
        frozen(matrix),
        frozen(offset),
        lower=lower,
        upper=upper,
        tolerance=spec.limits_tolerance,
        driven=tuple(range(m)),
        sliding=sliding,
        drives=drives,
    )


def _joint_problems(joint: str, entry: JointSpec, slides: bool) -> Iterator[Problem]:
    """What an entry of `controller:` says that is not of a joint that slides, or turns, and what it lacks."""
    units, moves = JointUnits((slides,))[0], "slides" if slides else "turns"
    limits = entry.travel if slides else entry.limits
    other = entry.limits if slides else entry.travel
    if other is not None or limits is None:
        said = "limits in mm" if slides else "limits in deg"
        message = f"{joint} {moves} and needs {said}"
        yield Problem(message, allowed=allowed_names("limits", units.si))
    elif len(limits) != 2 or limits[0] >= limits[1]:
        found = ", ".join(f"{v * units.per:g}" for v in limits)
        yield Problem(f"{joint}: limits must be [lower, upper]", found=f"[{found}] {units.shown}")
    if (entry.torque_limit if slides else entry.force_limit) is not None:
        allowed = allowed_names("force_limit" if slides else "torque_limit", units.load)
        yield Problem(f"{joint} {moves}: what its actuator bears is in {units.load}", allowed=allowed)
    if slides and (entry.motor_ratio is not None or entry.counts_per_turn is not None):
        yield Problem(
            f"{joint} slides: motor_ratio and counts_per_turn are of joints that turn", hint="Leave them out."
        )
    if entry.motor_ratio == 0.0:
        yield Problem(f"{joint}: motor_ratio must not be zero", found="0")


def joint_limits(actuated: Controller, facts: RobotFacts) -> Array:
    """Lowest and highest URDF value (n, 2), rad or m, of each joint; a turn to each side of one that no actuator
    drives."""
    limits = np.tile([-2.0 * np.pi, 2.0 * np.pi], (facts.n, 1))
    limits[[facts.joint_index(joint) for joint in facts.driven]] = actuated.ranges()
    return frozen(limits)


def read_controller(document: Document, actuated: Controller, facts: RobotFacts, loops: Sequence[Loop]) -> Controller:
    """The map to all n joints.

    loops: those of the robot; where they stand with their actuators at zero is where joints without one follow.
    InputError where one does not follow in proportion.
    """
    m, driven = actuated.axes, [facts.joint_index(joint) for joint in facts.driven]
    q = np.zeros((m + 2, facts.n))
    q[:, driven] = actuated.to_joints(np.vstack([np.eye(m), np.zeros((1, m)), 0.3 * np.ones((1, m))]))
    q = follow(loops, q, facts)[:, : facts.n]
    bent = np.abs(q[m] + 0.3 * (q[:m] - q[m]).sum(axis=0) - q[m + 1]) > _FOLLOWS
    if bent.any():
        text = f"controller: {facts.joints[int(np.argmax(bent))]} does not follow in proportion to the pendant's angles"
        hint = "A joint without an actuator needs a coupling, or a parallelogram."
        raise InputError(document.problem(text, "effects", hint=hint))
    matrix, sliding = frozen((q[:m] - q[m]).T), facts.sliding
    return replace(actuated, matrix=matrix, offset=frozen(q[m]), driven=tuple(driven), sliding=sliding)


def _tied(matrix: Array, joints: Sequence[str]) -> str:
    """Which joints a singular matrix ties together, and which angles of the pendant move none of them alone."""
    left, values, right = np.linalg.svd(matrix)
    null = values < 1e-9 * max(float(values[0]), 1.0)
    tied = [joint for k, joint in enumerate(joints) if np.abs(left[k, null]).max() > 1e-6]
    free = [f"J{k + 1}" for k in range(len(joints)) if np.abs(right[null, k]).max() > 1e-6]
    what = f"{free[0]} moves no joint" if len(free) == 1 else f"{', '.join(free)} can change and no joint moves"
    return f"by their `equals` the angles of {', '.join(tied)} depend on each other, so that {what}"


_TERM = re.compile(
    r"\s*(?P<sign>[+-])?\s*(?:(?P<factor>\d+(?:\.\d*)?|\.\d+)\s*\*?\s*)?(?:(?P<joint>J\d+)|(?P<unit>deg|rad|mm|m))\s*",
    re.ASCII,
)
_LONGEST = 200


_SI = {"deg": np.pi / 180.0, "rad": 1.0, "mm": 1e-3, "m": 1.0}


def parse_expression(text: str, sliding: Sequence[bool], slides: bool = False) -> tuple[Array, float]:
    """Coefficients (n,) and constant (rad, m) of an expression such as `J3 + J2`, `-J4 + 90 deg` or `-J1 + 500 mm`.

    sliding (n,): which of J1..Jn are travels; slides: whether the joint's own value is one. InputError for anything but
    signed multiples of those that are as the joint is, and angles, or lengths.
    """
    n = len(sliding)
    if len(text) > _LONGEST:
        raise InputError(f"the expression {text[:40]!r}... is too long; write terms such as J3 + J2, -J4, J2 + 90 deg")
    row, constant, position = np.zeros(n), 0.0, 0
    while position < len(text):
        match = _TERM.match(text, position)
        if match is None or (position > 0 and match["sign"] is None):
            raise InputError(
                f"cannot read {text!r} at {text[position:]!r}; write terms such as J3 + J2, -J4, J2 + 90 deg"
            )
        value = float(match["factor"] or 1.0) * (-1.0 if match["sign"] == "-" else 1.0)
        if match["joint"]:
            index = int(match["joint"][1:])
            if not 1 <= index <= n:
                raise InputError(f"{text!r} names {match['joint']}, the robot has J1 to J{n}")
            if sliding[index - 1] != slides:
                one, other = ("slides", "turns") if slides else ("turns", "slides")
                raise InputError(f"{text!r}: this joint {one}, and {match['joint']} {other}")
            row[index - 1] += value
        elif match["factor"] is None:
            raise InputError(f"{text!r}: an angle needs its number, such as 90 deg")
        elif (match["unit"] in ("mm", "m")) != slides:
            raise InputError(
                f"{text!r}: {match['unit']} is no unit of this joint, which {'slides' if slides else 'turns'}"
            )
        else:
            constant += value * _SI[match["unit"]]
        position = match.end()
    if not row.any():
        raise InputError(f"{text!r} names no joint; write for example J3 + J2")
    return row, constant
