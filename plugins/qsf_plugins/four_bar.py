"""Any planar four-bar that drives the elbow from the shoulder; also a parallelogram whose bars differ."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from functools import cache

import numpy as np

from qsf_plugins.planar_loop import (
    FLAT,
    Slopes,
    driven_term,
    implicit,
    length_error,
    link_length,
    parallel_sign,
    planar_outline,
    refuse,
)
from qsframework.plugin import Array, Context, InputError, Loop, LoopTerm, Parameter, RobotFacts, place, setting

BARS = ("bar", "lever", "link", "rocker")


@dataclass(frozen=True)
class FourBar(Loop):
    """A lever on the driver's axis turns the driven joint through a coupling bar and a rocker on the driven link.

    The driven joint's actuator turns the lever; it counts from the same fixed link as the driver, so
    the lever stands at psi = lever_zero + s phi_driven - phi_driver from link 2, and the rocker at
    rho = rocker_zero + s q_driven, both about the driver's axis, with s as for a parallelogram.
    Link 2's length is the distance of the two axes in the URDF. The parameters are the errors of
    the four lengths, the coupling bar first; the error of `link` is that of the loop alone.
    """

    driven: str = place()
    driver: str = setting()
    _: KW_ONLY
    lever: float = setting("m")
    """Lever on the driver's axis."""
    bar: float = setting("m")
    """Coupling bar."""
    rocker: float = setting("m")
    """From the driven axis to the bar's pivot on the driven link."""
    lever_zero: float = setting("rad", float(np.pi / 2))
    """Angle from link 2 to the lever at zero actuator angles."""
    rocker_zero: float = setting("rad", float(np.pi / 2))
    """Angle from link 2 to the rocker at zero joint angles."""
    branch: float = setting("", 1.0)
    """Which of the two assemblies: +1 if the angle from the bar (seen from lever to rocker) to the rocker is
    positive about the driver's axis, as in a parallelogram with its lever at +90 deg; -1 otherwise."""
    margin: float = setting("rad", float(np.deg2rad(15.0)))
    """Smallest transmission angle of a planned pose."""
    equation = "|lever end - rocker end| = bar; G = dq/dphi from its derivative"
    source = "Freudenstein's equation, differentiated"
    check = "Play in the bearings of the coupling bar; the lengths of lever, bar and rocker."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return tuple(length_error(f"{self.name}.{b}") for b in BARS)

    def joints(self, robot: RobotFacts) -> tuple[str, ...]:
        return (self.driver, self.driven)

    def leaders(self, robot: RobotFacts) -> tuple[str, ...]:
        return (self.driver,)

    def validate(self, robot: RobotFacts) -> None:
        sign = self._sign(robot)
        if robot.joint_index(self.driven) != robot.joint_index(self.driver) + 1:
            raise InputError(f"{self.name}: {self.driven} must be the joint after {self.driver}")
        for name in ("lever", "bar", "rocker"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"{self.name}: {name} must be a positive length, found {getattr(self, name):g} m")
        if self.branch not in (1.0, -1.0):
            raise InputError(f"{self.name}: branch must be 1 or -1, found {self.branch:g}")
        self._side(robot, sign)

    def _sign(self, robot: RobotFacts) -> float:
        return parallel_sign(robot, self.driver, self.driven)

    def _lengths(self, robot: RobotFacts, bars: Array) -> Array:
        """Lengths (N, 4) in the order of BARS."""
        link = link_length(robot, self.driver, self.driven)
        return np.array([self.bar, self.lever, link, self.rocker]) + bars

    def _side(self, robot: RobotFacts, sign: float) -> float:
        """On which side of its dead point the lever works: that of the loop closed at zero actuator angles."""
        lengths = self._lengths(robot, np.zeros((1, 4)))
        psi = np.array([self.lever_zero])
        rho = self._rocker(psi, lengths)
        sines = np.zeros((1, 2)) if np.isnan(rho[0]) else _sines(psi, rho, lengths)
        if np.abs(sines).min() < FLAT:
            raise InputError(
                f"{self.name} does not close at zero actuator angles, or is flat there; "
                f"lengths in m: {', '.join(f'{b} {v:g}' for b, v in zip(BARS, lengths[0], strict=True))}"
            )
        return float(np.sign(sines[0, 1]))

    def _rocker(self, psi: Array, lengths: Array) -> Array:
        """rho (N,) on this branch, NaN where the loop is open."""
        b, a, L, r = lengths.T
        rho = _elbow(a * np.cos(psi) - L, a * np.sin(psi), r, b, -self.branch)
        return rho - _polish(psi, rho, lengths)

    def actuators(self, q: Array, robot: RobotFacts) -> Array:
        sign = self._sign(robot)
        psi = self._lever(q, robot, sign)
        refuse(self.name, "has no lever angle that reaches the joint angles", np.isnan(psi), q, self.joints(robot))
        return np.stack([q[:, 0], sign * (_wrap(psi - self.lever_zero) + q[:, 0])], axis=1)

    def _lever(self, q: Array, robot: RobotFacts, sign: float) -> Array:
        """psi (N,) at joint angles q, NaN where no assembly of this branch reaches them."""
        lengths = self._lengths(robot, np.zeros((len(q), 4)))
        b, a, L, r = lengths.T
        rho = self.rocker_zero + sign * q[:, 1]
        psi = _elbow(L + r * np.cos(rho), r * np.sin(rho), a, b, self._side(robot, sign))
        sines = _sines(psi, rho, lengths)
        residual, slope = _residual(psi, rho, lengths), sines[:, 1] * a * b
        psi = psi - residual / np.where(np.abs(slope) < FLAT * a * b, np.inf, slope)
        return np.where(sines[:, 0] * self.branch < 0.0, psi, np.nan)

    def closure(self, actuators: Array, bars: Array, context: Context) -> LoopTerm:
        sign = self._sign(context.robot)
        lengths = self._lengths(context.robot, bars)
        psi = self.lever_zero + sign * actuators[:, 1] - actuators[:, 0]
        rho = self._rocker(psi, lengths)
        bad = np.isnan(rho) | ~(np.abs(_sines(psi, rho, lengths)[:, 0]) >= FLAT)
        refuse(self.name, "cannot close at these actuator angles", bad, actuators, self.joints(context.robot), bars)
        q = sign * _wrap(rho - self.rocker_zero)
        return driven_term(actuators[:, 0], q, cache(lambda: _slopes(psi, rho, lengths)), sign)

    def transmission_angle(self, q: Array, robot: RobotFacts) -> Array:
        """The smaller of the bar's angles with the rocker and with the lever; 0 where q cannot be reached."""
        sign = self._sign(robot)
        psi, rho = self._lever(q, robot, sign), self.rocker_zero + sign * q[:, 1]
        sines = np.abs(_sines(psi, rho, self._lengths(robot, np.zeros((len(q), 4)))))
        return np.arcsin(np.clip(np.nan_to_num(sines), 0.0, 1.0)).min(axis=1)

    @property
    def smallest_transmission_angle(self) -> float:
        return self.margin

    def outline(self, q: Array, robot: RobotFacts) -> Array:
        sign = self._sign(robot)
        lever = np.stack([np.full(len(q), self.lever), self._lever(q, robot, sign)])
        rocker = np.stack([np.full(len(q), self.rocker), self.rocker_zero + sign * q[:, 1]])
        return planar_outline(robot, self.driver, self.driven, q, lever, rocker)


def _wrap(angle: Array) -> Array:
    """Into [-pi, pi]; an angle that is already there is not touched."""
    return angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi))


def _elbow(x: Array, y: Array, near: Array, far: Array, side: float) -> Array:
    """Angle (N,) of an arm of length `near` whose end is `far` from (x, y); NaN where there is none."""
    d2 = x * x + y * y
    height = ((near + far) ** 2 - d2) * (d2 - (near - far) ** 2)
    root = np.sqrt(np.where(height < 0.0, np.nan, height))
    return np.arctan2(y, x) + side * np.arctan2(root, near * near + d2 - far * far)


def _residual(psi: Array, rho: Array, lengths: Array) -> Array:
    """F (N,) = half the squared distance of the two ends less that of the bar, m^2."""
    b, a, L, r = lengths.T
    x, y = L + r * np.cos(rho) - a * np.cos(psi), r * np.sin(rho) - a * np.sin(psi)
    return 0.5 * (x * x + y * y - b * b)


def _sines(psi: Array, rho: Array, lengths: Array) -> Array:
    """Sines (N, 2), signed: F_rho / (rocker bar) and F_psi / (lever bar)."""
    b, a, L, r = lengths.T
    turn = np.sin(rho - psi)
    return np.stack([(a * turn - L * np.sin(rho)) / b, (L * np.sin(psi) - r * turn) / b], axis=1)


def _polish(psi: Array, rho: Array, lengths: Array) -> Array:
    """One Newton step in rho, none where the loop is flat."""
    slope = _sines(psi, rho, lengths)[:, 0] * lengths[:, 3] * lengths[:, 0]
    return _residual(psi, rho, lengths) / np.where(np.abs(slope) < FLAT * lengths[:, 3] ** 2, np.inf, slope)


def _slopes(psi: Array, rho: Array, lengths: Array) -> Slopes:
    """Derivatives of rho by y = (psi, bar, lever, link, rocker), from those of
    F = (L^2 + r^2 + a^2 - b^2) / 2 + L r cos rho - L a cos psi - r a cos(rho - psi)."""
    b, a, L, r = lengths.T
    sp, cp, sr, cr = np.sin(psi), np.cos(psi), np.sin(rho), np.cos(rho)
    sd, cd = np.sin(rho - psi), np.cos(rho - psi)
    o, i = np.zeros_like(psi), np.ones_like(psi)
    F_y = np.stack([L * a * sp - r * a * sd, -b, a - L * cp - r * cd, L + r * cr - a * cp, r + L * cr - a * cd], axis=1)
    F_ry = np.stack([-r * a * cd, o, r * sd, -r * sr, a * sd - L * sr], axis=1)
    rows = [
        [L * a * cp + r * a * cd, o, L * sp - r * sd, a * sp, -a * sd],
        [o, -i, o, o, o],
        [L * sp - r * sd, o, i, -cp, -cd],
        [a * sp, o, -cp, i, cr],
        [-a * sd, o, -cd, cr, i],
    ]
    F_yy = np.stack([np.stack(row, axis=1) for row in rows], axis=1)
    return implicit(r * a * sd - L * r * sr, F_y, r * a * cd - L * r * cr, F_ry, F_yy)
