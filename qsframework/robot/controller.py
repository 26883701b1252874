"""What the pendant shows and what the URDF means: q = matrix @ pendant + offset."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from qsframework.errors import InputError, Place, Problem
from qsframework.files import Document
from qsframework.plugin import Array, RobotFacts
from qsframework.plugin.facts import frozen
from qsframework.robot.spec import RobotSpec


@dataclass(frozen=True, eq=False)
class Controller:
    """Affine map from pendant angles to URDF joint angles; limits hold for what the pendant shows.

    matrix (n, n), offset (n,), lower and upper (n,) rad, tolerance rad
    """

    matrix: Array
    offset: Array
    lower: Array
    upper: Array
    tolerance: float

    def to_joints(self, pendant: Array) -> Array:
        """URDF joint angles (N, n) of pendant angles (N, n)."""
        return pendant @ self.matrix.T + self.offset

    def to_pendant(self, q: Array) -> Array:
        """Pendant angles (N, n) of URDF joint angles (N, n)."""
        return np.asarray(np.linalg.solve(self.matrix, (q - self.offset).T).T, dtype=np.float64)

    def outside(self, pendant: Array) -> npt.NDArray[np.bool_]:
        """Which pendant angles (N, n) break a limit by more than the tolerance; NaN does."""
        return ~((pendant >= self.lower - self.tolerance) & (pendant <= self.upper + self.tolerance))


def read_controller(document: Document, spec: RobotSpec, facts: RobotFacts) -> Controller:
    """The controller of robot.yaml, whose `controller:` has every joint. InputError with all problems."""
    n = facts.n
    matrix, offset, limits = np.eye(n), np.zeros(n), np.zeros((n, 2))
    problems: list[Problem] = []
    for k, joint in enumerate(facts.joints):
        entry = spec.controller[joint]
        here: Place = {"file": str(document.path), "line": document.line("controller", joint)}
        if len(entry.limits) != 2 or entry.limits[0] >= entry.limits[1]:
            found = ", ".join(f"{math.degrees(v):g}" for v in entry.limits)
            problems.append(Problem(f"{joint}: limits must be [lower, upper]", **here, found=f"[{found}] deg"))
        else:
            limits[k] = entry.limits
        try:
            if entry.equals is not None:
                matrix[k], offset[k] = parse_expression(entry.equals, n)
        except InputError as error:
            problems += [replace(p, message=f"{joint}: {p.message}", **here) for p in error.problems]
    if not problems and abs(np.linalg.det(matrix)) < 1e-9:
        message = "controller: the pendant's angles do not determine the joints; two `equals` depend on each other"
        problems.append(Problem(message, file=str(document.path), line=document.line("controller")))
    if problems:
        raise InputError(problems)
    lower, upper = frozen(limits[:, 0]), frozen(limits[:, 1])
    return Controller(frozen(matrix), frozen(offset), lower, upper, spec.limits_tolerance)


_TERM = re.compile(
    r"\s*(?P<sign>[+-])?\s*(?:(?P<factor>\d+(?:\.\d*)?|\.\d+)\s*\*?\s*)?(?:(?P<joint>J\d+)|(?P<unit>deg|rad))\s*",
    re.ASCII,
)
_LONGEST = 200


def parse_expression(text: str, n: int) -> tuple[Array, float]:
    """Coefficients (n,) and constant (rad) of an expression such as `J3 + J2` or `-J4 + 90 deg`.

    Raises InputError for anything but signed multiples of J1..Jn and angles.
    """
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
            row[index - 1] += value
        elif match["factor"] is None:
            raise InputError(f"{text!r}: an angle needs its number, such as 90 deg")
        else:
            constant += value * (np.pi / 180.0 if match["unit"] == "deg" else 1.0)
        position = match.end()
    if not row.any():
        raise InputError(f"{text!r} names no joint; write for example J3 + J2")
    return row, constant
