"""The triangle of a balancer: base line lc, arm l2, and the side s along which it pulls, equations (7)-(11).

A pull F(s) does the work F ds, so its moment about the joint is M = F ds/db, whatever exerts it; the derivatives of
M follow from those of F and of s.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, InputError, Parameter, Point, Problem, RobotFacts, TorqueTerm, turns

_SHARE, _ANGLE = 0.02, 0.02
"""Natural sizes of an error: of a pivot's distance, as a share of both sides; of the angle, rad."""
_LEAST, _APART, _QUARTER = 0.01, 1e-6, 0.5 * math.pi
"""Share of a side that a fit leaves of it at least; share by which the sides differ at least; turn of the angle."""
SIDES = 0.01, 5.0
"""m: from the joint to a pivot, and between two pivots, of any arm: the largest reach 4 m."""
_LABEL = re.compile(r"[A-Za-z0-9_-]*")


@dataclass(frozen=True)
class Tension:
    """A pull F (N,) N that draws the pivots together at lengths s (N,), by s twice, and by the p parameters of its law.

    ds, dss (N,); dx, dsx (N, p)
    """

    value: Array
    ds: Array
    dss: Array
    dx: Array
    dsx: Array


def spring(stiffness: float, free_length: float) -> Callable[[Array], Tension]:
    """Equation (8), F = K_c (s - s0), by K_c and s0."""

    def pull(s: Array) -> Tension:
        stretch, one = s - free_length, np.ones_like(s)
        dx, dsx = np.stack([stretch, -stiffness * one], axis=1), np.stack([one, 0.0 * one], axis=1)
        return Tension(stiffness * stretch, stiffness * one, 0.0 * one, dx, dsx)

    return pull


@dataclass(frozen=True)
class SpringTriangle:
    """Sides lc and l2 (m) that meet at the joint; b is the angle between them, s the distance of their ends."""

    lc: float
    l2: float

    def check(self, name: str) -> None:
        """InputError where a side is not above 0 or where the spring has no length at b = 0."""
        if min(self.lc, self.l2) <= 0.0 or self.lc == self.l2:
            found = f"lc = {self.lc:g} m, l2 = {self.l2:g} m"
            raise InputError(Problem(f"{name}: lc and l2 must be above 0 and differ", found=found))

    def length(self, b: Array) -> Array:
        """s(b), equation (7): s^2 = lc^2 + l2^2 - 2 lc l2 cos b."""
        return np.sqrt(self.lc**2 + self.l2**2 - 2.0 * self.lc * self.l2 * np.cos(b))

    def torque(self, b: Array, law: Callable[[Array], Tension]) -> TorqueTerm:
        """-M on the joint at b (N,), equation (9) for any law, with dM/db, (11) for a spring.

        By the law's parameters, then by lc, l2 and b itself, of which an error of the attachment's angle is one.
        """
        s, (first, second, third) = self.length(b), self._slopes(b)
        F = law(s)
        s_b, s_bb = first[:, 2], second[:, 2]

        def along(by_s: Array, by_slope: Array, by_bend: Array) -> Array:
            return by_s[:, None] * first + by_slope[:, None] * second + by_bend[:, None] * third

        M, M_b = F.value * s_b, F.ds * s_b**2 + F.value * s_bb
        M_v = along(F.ds * s_b, F.value, np.zeros_like(s))
        M_bv = along(F.dss * s_b**2 + F.ds * s_bb, 2.0 * F.ds * s_b, F.value)
        dx = np.concatenate([F.dx * s_b[:, None], M_v], axis=1)
        dqx = np.concatenate([F.dsx * s_b[:, None] ** 2 + F.dx * s_bb[:, None], M_bv], axis=1)
        return TorqueTerm(
            value=-M[:, None],
            dq=-M_b[:, None, None],
            dx=-dx[:, None, :],
            dqq=-M_bv[:, 2, None, None, None],
            dqx=-dqx[:, None, None, :],
        )

    def _slopes(self, b: Array) -> tuple[Array, Array, Array]:
        """s, s_b and s_bb, each (N, 3) by v = (lc, l2, b): from (7) by s s_v = w_v / 2, w = s^2, and so on."""
        lc, l2, cos, sin = self.lc, self.l2, np.cos(b), np.sin(b)
        s = self.length(b)[:, None]
        half = np.stack([lc - l2 * cos, l2 - lc * cos, lc * l2 * sin], axis=1)
        half_b = np.stack([l2 * sin, lc * sin, lc * l2 * cos], axis=1)
        half_bb = np.stack([l2 * cos, lc * cos, -lc * l2 * sin], axis=1)
        first = half / s
        second = (half_b - first[:, 2:] * first) / s
        third = (half_bb - second[:, 2:] * first - 2.0 * first[:, 2:] * second) / s
        return first, second, third

    def parameters(self, name: str, zero: float) -> tuple[Parameter, ...]:
        """The pivots' distances and the angle at zero joint angle, which a fit estimates only where it names them.

        Equation (7) is the same with the two sides exchanged, and with a side below 0 and the angle turned by half a
        turn: each side stays on its own side of their geometric mean, the angle within a quarter of a turn.
        """
        size, mean = _SHARE * (self.lc + self.l2), math.sqrt(abs(self.lc * self.l2))
        sides = ((f"{name}.lc", self.lc), (f"{name}.l2", self.l2))
        low, high = (
            (1.0 - _APART) * mean,
            (1.0 + _APART) * mean,
        )
        spans = ((_LEAST * v, low) if v < mean else (high, math.inf) for _, v in sides)
        return (
            *(
                stated(side, "m", value, size, by_name=True, domain=domain)
                for (side, value), domain in zip(sides, spans, strict=True)
            ),
            stated(
                f"{name}.zero",
                "rad",
                zero,
                _ANGLE,
                lower=-math.inf,
                by_name=True,
                domain=(zero - _QUARTER, zero + _QUARTER),
            ),
        )

    def pivots(self, robot: RobotFacts, joint: str, zero: float) -> tuple[Point, Point]:
        """Where the spring ends, on the previous link and on the joint's: b is zero + q, and l2 lies along the arm."""
        k = robot.joint_index(joint)
        axis = robot.axes[k]
        arm = robot.placements[k + 1][:3, 3] if k + 1 < robot.n else np.zeros(3)
        arm = arm - axis * (axis @ arm)
        if not np.linalg.norm(arm) > 1e-9:  # the next joint lies on the axis: any direction across it
            arm = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        arm = arm / np.linalg.norm(arm)
        base = robot.placements[k] @ np.append(self.lc * turns(axis, -zero) @ arm, 1.0)
        return _point(robot.links[k], base[:3]), _point(robot.link_of(joint), self.l2 * arm)


def stated(
    name: str,
    unit: str,
    nominal: float,
    typical: float,
    *,
    lower: float = 0.0,
    by_name: bool = False,
    domain: tuple[float, float] = (-math.inf, math.inf),
) -> Parameter:
    """A parameter whose nominal value stands with the effect, and that cannot switch it off."""
    return Parameter(
        name,
        unit,
        nominal=nominal,
        typical=typical,
        nominal_sd=typical,
        lower=lower,
        null=None,
        source="stated with the effect",
        by_name=by_name,
        domain=domain,
    )


def check_label(name: str, label: str) -> None:
    """InputError where a balancer's label cannot be part of a name."""
    if not _LABEL.fullmatch(label):
        raise InputError(Problem(f"{name}: a label is letters, digits, _ and -", found=repr(label)[:80]))


def _point(link: str, xyz: Array) -> Point:
    x, y, z = (float(c) for c in xyz)
    return Point(link, (x, y, z))
