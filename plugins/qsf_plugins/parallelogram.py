"""The parallelogram that drives the elbow of a heavy arm from its shoulder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from functools import cache
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from qsf_plugins.planar_loop import (
    FLAT,
    Slopes,
    bend_by_inputs,
    branch_stands,
    driven_term,
    implicit,
    length_error,
    link_length,
    parallel_sign,
    planar_outline,
    refuse,
    slope_by_inputs,
    with_branches,
    zeros,
)
from qsframework.plugin import (
    Array,
    Branch,
    Context,
    InputError,
    Loop,
    LoopTerm,
    Parameter,
    Problem,
    RobotFacts,
    cos_sin,
    place,
    setting,
)

Complex = npt.NDArray[np.complex128]
_SHORTEST = 1e-6
"""m between two axes that are not one."""
_APART = 1e-3
"""m by which a drawn lever or bar may stand beside its place."""


@dataclass(frozen=True)
class Parallelogram(Loop):
    """Lever, bar and link 2 move as a parallelogram, so that the forearm keeps its attitude when link 2 turns.

    The driven joint's actuator turns the lever: q_driven = phi_driven - s q_driver, with s = +1
    where the two axes point alike and -1 where they are opposed. This is the correction of the
    paper's equations (12)-(16). Its parameter is the error of the coupling bar's length; with one,
    the loop is the four-bar that the lengths then make.

    A flat parallelogram with a perfect bar still closes, but any length error or elasticity of the
    bar is amplified by 1 / sin of the transmission angle. Nearer to flat than 1e-6 rad the derivatives by
    the bar stay at their values there: finite and huge. With a bar error such a pose is refused.

    Lever and bar may be links of the URDF, with masses and solids: the lever turns on the driver's axis, the bar at the
    lever's end. They stand there at zero joint angles as they are drawn. Where the URDF does not draw them their masses
    are enough: even rods, named after the driven joint, such as joint_3_lever and joint_3_bar.
    """

    driven: str = place()
    driver: str = setting()
    lever: float = setting("m")
    """Length of the lever and of its copy on the driven link."""
    margin: float = setting("rad", float(np.deg2rad(15.0)))
    """Smallest transmission angle of a planned pose."""
    _: KW_ONLY
    zero: float = setting("rad", float(np.pi / 2))
    """Angle from link 2 to the lever, about the driver's axis, at zero joint angles. Its sign says
    to which side a longer bar turns the driven link."""
    lever_joint: str = ""
    """The lever's joint beside the arm, on the driver's axis."""
    bar_joint: str = ""
    """The bar's joint beside the arm, at the lever's end."""
    lever_mass: float = setting("kg", 0.0)
    """Of a lever that the URDF does not draw, from axis to pivot."""
    bar_mass: float = setting("kg", 0.0)
    """Of a bar that the URDF does not draw."""
    equation = "q_driven = phi_driven - s q_driver, s = +1 or -1  (12)-(16), corrected"
    source = "Klimchik et al., section 3.1, corrected"
    check = "Play in the bearings of the coupling bar, length of the bar."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (length_error(self.name),)

    def joints(self, robot: RobotFacts) -> tuple[str, ...]:
        return (self.driver, self.driven, *self._branches)

    @property
    def _branches(self) -> tuple[str, ...]:
        """Joints of lever and bar, of the URDF or of its own."""
        own = (f"{self.driven}_lever", f"{self.driven}_bar") if max(self.lever_mass, self.bar_mass) > 0.0 else ()
        return tuple(joint for joint in (self.lever_joint, self.bar_joint) if joint) or own

    def branches(self, robot: RobotFacts) -> tuple[Branch, ...]:
        """Lever and bar that no URDF draws: even rods, in frames parallel to the driver's at zero joint angles."""
        if self.lever_joint or not self._branches:
            return ()
        k, (lever, bar) = robot.joint_index(self.driver), self._branches
        (shoulder, low), (_, high) = self.outline(np.zeros((1, 2)), robot)[0, :2]
        end = np.eye(4)
        end[:3, 3] = low - shoulder
        parts = (
            (lever, robot.links[k], robot.placements[k], self.lever_mass, low - shoulder),
            (bar, lever, end, self.bar_mass, high - low),
        )
        return tuple(
            Branch(joint=own, link=own, parent=on, placement=at, axis=robot.axes[k], mass=mass, centre=0.5 * along)
            for own, on, at, mass, along in parts
        )

    def leaders(self, robot: RobotFacts) -> tuple[str, ...]:
        return (self.driver,)

    def validate(self, robot: RobotFacts) -> None:
        self._sign(robot)
        if not self.lever > 0.0:
            raise InputError(f"{self.name}: lever must be a positive length, found {self.lever:g} m")
        if not link_length(robot, self.driver, self.driven) > _SHORTEST:
            raise InputError(f"{self.name}: {self.driver} and {self.driven} have one axis: no link for a parallelogram")
        self._check_branches(robot)

    def _check_branches(self, robot: RobotFacts) -> None:
        """InputError where lever and bar do not stand where the parallelogram has them at zero joint angles."""
        if min(self.lever_mass, self.bar_mass) < 0.0 or (self.lever_joint and self.lever_mass + self.bar_mass > 0.0):
            found = f"lever_mass = {self.lever_mass:g} kg, bar_mass = {self.bar_mass:g} kg"
            hint = "Masses are not below 0, and where the URDF draws lever and bar they stand there."
            raise InputError(Problem(f"{self.name}: wrong masses", found=found, hint=hint))
        if self.bar_joint and not self.lever_joint:
            raise InputError(Problem(f"{self.name}: the bar hangs on the lever", hint="Give lever_joint too."))
        corners = self.outline(np.zeros((1, 2)), robot)[0, :2, 0]
        for count in range(1, 1 + bool(self.lever_joint) + bool(self.bar_joint)):
            joint, corner = self._branches[count - 1], corners[count - 1]
            _, at = branch_stands(robot, self.driver, self._branches[:count])
            if np.linalg.norm(at - corner) > _APART:
                found, wanted = (", ".join(f"{c:.4g}" for c in v) for v in (at, corner))
                text = f"{self.name}: {joint} stands elsewhere at zero joint angles"
                raise InputError(Problem(text, found=f"[{found}] m across {self.driver}", allowed=f"[{wanted}] m"))

    @classmethod
    def structures(cls, robot: RobotFacts) -> tuple[Parallelogram, ...]:
        """At joints with parallel axes; a lever of half the link, no margin: a perfect loop transmits as any other."""
        pairs = [p for p in pairwise(robot.joints) if set(p) <= set(robot.driven) and _may_carry(robot, *p)]
        return tuple(cls(b, a, 0.5 * link_length(robot, a, b), 0.0) for a, b in pairs)

    def _sign(self, robot: RobotFacts) -> float:
        return parallel_sign(robot, self.driver, self.driven)

    def actuators(self, q: Array, robot: RobotFacts) -> Array:
        sign = self._sign(robot)
        driver, driven = q[:, 0], q[:, 1] + sign * q[:, 0]
        # a perfect bar keeps along link 2: beta = 0
        perfect = (sign * driven, driver - sign * driven)
        own = [q[:, 2 + i] - sense * perfect[i] for i, sense in enumerate(self._senses(robot))]
        return np.array([driver, driven, *own]).T

    def _senses(self, robot: RobotFacts) -> list[float]:
        """Senses of the axes of lever and bar against the driver's."""
        return [branch_stands(robot, self.driver, self._branches[: i + 1])[0] for i in range(len(self._branches))]

    def closure(self, actuators: Array, bars: Array, context: Context) -> LoopTerm:
        return self._closed(actuators, bars, context.robot)

    def _closed(self, actuators: Array, bars: Array, robot: RobotFacts) -> LoopTerm:
        sign, link = self._sign(robot), link_length(robot, self.driver, self.driven)
        perfect = actuators[:, 1] - sign * actuators[:, 0]
        psi, bar = self.zero + sign * perfect, bars[:, 0]
        swing = np.zeros_like(psi)
        if bar.any():
            swing = self._swing(psi, bar, link)
            bad = ~np.isfinite(swing) | ((np.abs(self._sine(psi, swing, bar, link)) < FLAT) & (bar != 0.0))
            refuse(self.name, "cannot close, or is flat,", bad, actuators[:, :2], (self.driver, self.driven), bars)
        slopes = cache(lambda: self._slopes(psi, swing, bar, link))
        term = driven_term(actuators[:, 0], perfect + sign * swing, slopes, sign)
        if not self._branches:
            return term
        return with_branches(term, self._turned(actuators, psi, swing, slopes, robot), actuators[:, 2:])

    def _turned(
        self, actuators: Array, psi: Array, swing: Array, slopes: Callable[[], Slopes], robot: RobotFacts
    ) -> LoopTerm:
        """The lever turns by s phi_driven, the bar from it by phi_driver + beta - s phi_driven, about the driver."""
        sign, link = self._sign(robot), link_length(robot, self.driver, self.driven)
        senses = np.array(self._senses(robot))
        bar = cache(lambda: self._bar_vector(psi, swing, link))
        beta = np.angle(bar()[0]) if swing.any() else swing  # a perfect bar keeps along link 2
        angles = [sign * actuators[:, 1], actuators[:, 0] + beta - sign * actuators[:, 1]][: len(senses)]
        by_y = cache(lambda: _bar_slopes(*bar(), slopes()))

        def first() -> Array:
            q_u = zeros(len(psi), 2, 3)
            q_u[:, 0, 1] = sign
            q_u[:, 1] = slope_by_inputs(by_y(), sign) + np.array([1.0, -sign, 0.0])
            return senses[:, None] * q_u[:, : len(senses)]

        def second() -> Array:
            q_uu = np.zeros((len(psi), 2, 3, 3))
            q_uu[:, 1] = bend_by_inputs(by_y(), sign)
            return senses[:, None, None] * q_uu[:, : len(senses)]

        return LoopTerm(senses * np.array(angles).T, first, second)

    def _bar_vector(self, psi: Array, swing: Array, link: float) -> tuple[Complex, Complex, Complex]:
        """The bar Z = L + a e^(i rho) - a e^(i psi) from the lever's end, with its two levers, complex (N,) m."""
        cos, sin = cos_sin(psi)
        lever = self.lever * (cos + 1j * sin)
        rocker = lever * np.exp(1j * swing) if swing.any() else lever
        return link + rocker - lever, lever, rocker

    def carried(self, robot: RobotFacts) -> tuple[tuple[str, ...], ...]:
        return ((), self._branches[1:]) if self._branches[1:] else ((),)

    def _swing(self, psi: Array, bar: Array, link: float) -> Array:
        """rho - psi (N,): by how much a bar error turns the driven link; NaN where the loop is open.

        (2 P - k) t^2 - 2 Q t - k = 0 with t = tan(swing / 2), by the root that vanishes with k.
        """
        a, k = self.lever, bar * (link + 0.5 * bar)
        P, Q = a * (a - link * np.cos(psi)), link * a * np.sin(psi)
        root = Q * Q + k * (2.0 * P - k)
        denominator = Q + np.copysign(np.sqrt(np.where(root < 0.0, np.nan, root)), Q)
        return 2.0 * np.arctan(-k / np.where(denominator == 0.0, np.where(k == 0.0, 1.0, np.nan), denominator))

    def _slope(self, psi: Array, swing: Array, link: float) -> Array:
        """F_rho (N,), see `_slopes`."""
        return self.lever**2 * np.sin(swing) - link * self.lever * np.sin(psi + swing)

    def _sine(self, psi: Array, swing: Array, bar: Array, link: float) -> Array:
        """The sine (N,) of the transmission angle."""
        return self._slope(psi, swing, link) / (self.lever * (link + bar))

    def _slopes(self, psi: Array, swing: Array, bar: Array, link: float) -> Slopes:
        """Derivatives of rho by (psi, bar).

        F = (L^2 + 2 a^2 - (L + bar)^2) / 2 + L a (cos rho - cos psi) - a^2 cos(rho - psi)
        """
        exact = self._perfect(psi, link)
        if not bar.any():
            return exact
        a, rho = self.lever, psi + swing
        cos, sin = a * a * np.cos(swing), a * a * np.sin(swing)
        F_r = self._slope(psi, swing, link)
        zero = np.zeros_like(psi)
        F_y = np.stack([link * a * np.sin(psi) - sin, -(link + bar)], axis=1)
        F_ry = np.stack([-cos, zero], axis=1)
        F_yy = np.stack([link * a * np.cos(psi) + cos, zero, zero, zero - 1.0], axis=1).reshape(-1, 2, 2)
        flat = np.abs(self._sine(psi, swing, bar, link)) < FLAT
        safe = np.where(flat, np.copysign(FLAT * a * link, F_r), F_r)
        slopes = implicit(safe, F_y, cos - link * a * np.cos(rho), F_ry, F_yy)
        straight = bar == 0.0
        return Slopes(
            np.where(straight[:, None], exact.first, slopes.first),
            lambda: np.where(straight[:, None, None], exact.second, slopes.second),
        )

    def _perfect(self, psi: Array, link: float) -> Slopes:
        """rho = psi exactly; its derivatives by the bar are kept finite where the loop is flat."""
        cos, sine = cos_sin(psi)
        sine = np.where(np.abs(sine) < FLAT, np.copysign(FLAT, sine), sine)
        first = zeros(len(psi), 2)
        first[:, 0], by_bar = 1.0, -1.0 / (self.lever * sine)
        first[:, 1] = by_bar

        def second() -> Array:
            out = np.zeros((len(psi), 2, 2))
            out[:, 0, 1] = out[:, 1, 0] = -cos / sine * by_bar
            out[:, 1, 1] = by_bar**2 * (self.lever / link - cos) / sine - 1.0 / (link * self.lever * sine)
            return out

        return Slopes(first, second)

    def transmission_angle(self, q: Array, robot: RobotFacts) -> Array:
        """Angle between link 2 and the lever, folded into [0, 90] deg."""
        return np.abs(np.arcsin(np.sin(self.zero + self._sign(robot) * q[:, 1])))

    def side(self, q: Array, robot: RobotFacts) -> Array:
        return np.copysign(1.0, np.sin(self.zero + self._sign(robot) * q[:, 1]))

    @property
    def smallest_transmission_angle(self) -> float:
        return self.margin

    def outline(self, q: Array, robot: RobotFacts) -> Array:
        side = np.stack([np.full(len(q), self.lever), self.zero + self._sign(robot) * q[:, 1]])
        return planar_outline(robot, self.driver, self.driven, q, side, side)


def _bar_slopes(Z: Complex, lever: Complex, rocker: Complex, slopes: Slopes) -> Slopes:
    """beta, the angle of the bar Z from link 2, by y = (psi, bar); slopes: those of rho."""
    # one contiguous array for each entry: of complex matrices (N, 2, 2) numpy is several times slower
    lever, rocker = lever / Z, rocker / Z
    r, by_psi = slopes.first.T, (1.0, 0.0)
    each = [1j * (rocker * r[i] - lever * by_psi[i]) for i in range(2)]

    def second() -> Array:
        out = np.empty((len(Z), 2, 2))
        for i, j in ((0, 0), (0, 1), (1, 1)):
            bent = rocker * (1j * slopes.second[:, i, j] - r[i] * r[j]) + lever * by_psi[i] * by_psi[j]
            out[:, i, j] = out[:, j, i] = (bent - each[i] * each[j]).imag
        return out

    return Slopes(np.array([e.imag for e in each]).T, second)


def _may_carry(robot: RobotFacts, driver: str, driven: str) -> bool:
    """Whether two joints have parallel axes that are not one."""
    try:
        parallel_sign(robot, driver, driven)
    except InputError:
        return False
    return link_length(robot, driver, driven) > _SHORTEST
