"""A gas balancer at a joint: a cylinder whose gas pulls or pushes by p V^n."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass

import numpy as np

from qsf_plugins.spring_triangle import SIDES, SpringTriangle, Tension, check_label, stated
from qsframework.plugin import (
    Array,
    Context,
    InputError,
    ParallelSpring,
    Parameter,
    Point,
    Problem,
    RobotFacts,
    TorqueTerm,
    place,
    setting,
)

AMBIENT = 101325.0
"""Pressure of the air on the other side of the piston, Pa."""
_LEAST = 0.01
"""Share of what is stated that a fit leaves of it at least."""
_GAS = ("rod side", "piston side", "both sides")


@dataclass(frozen=True)
class GasBalancer(ParallelSpring):
    """Gas in a cylinder between two links exerts the torque -F ds/db on the joint, F = A (p - p_a), p V^n constant.

    Gas on the rod's side of the piston pulls the pivots together, with the area of the ring; on the other side, or on
    both, it pushes them apart, with the area of the piston or of the rod. Where oil stands between piston and gas, the
    volume is that of the gas. The pressure is what a gauge shows, above that of the air.
    """

    joint: str = place()
    lc: float = setting("m", span=SIDES)
    """From the joint's axis to the balancer's pivot on the previous link."""
    l2: float = setting("m", span=SIDES)
    """From the joint's axis to the balancer's pivot on the link that the joint moves."""
    _: KW_ONLY
    length: float = setting("m", span=SIDES)
    """Distance of the pivots at which the gas has the stated pressure and volume: the preload."""
    pressure: float = setting("Pa", span=(1e4, 1e9))
    volume: float = setting("m^3", span=(1e-5, 1e3))
    piston_area: float = setting("m^2", span=(1e-5, 0.5))
    rod_area: float = setting("m^2", 0.0)
    exponent: float = setting("", 1.0)
    """n: 1 for gas that has taken the temperature around it, as in an arm that stands; 1.4 for a fast move."""
    zero: float = setting("rad", 0.0)
    """Angle b at zero joint angle; b grows with the joint angle."""
    gas: str = "rod side"
    label: str = place("")
    """Of several balancers at one joint, which."""
    equation = "M = A (p - p_a) ds/db, p V^n constant, V = V_0 - A (s - s_0)"
    source = "polytropic change of state of a gas; triangle: Klimchik et al., equation (7)"
    check = "Pressure of the gas at the data sheet's pose, its temperature, leaks, wear and place of the pivots."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        name, p, V, n = self.name, self.pressure, self.volume, self.exponent
        least = max(_LEAST * V, V - self._left(np.array([V, n, self.lc, self.l2, self.zero]), robot)[0])
        return (
            stated(f"{name}.pressure", "Pa", p, 0.05 * p, domain=(_LEAST * p, math.inf)),
            stated(f"{name}.volume", "m^3", V, 0.05 * V, by_name=True, domain=(least, math.inf)),
            stated(f"{name}.exponent", "", n, 0.1, by_name=True, domain=(_LEAST * n, math.inf)),
            *SpringTriangle(self.lc, self.l2).parameters(name, self.zero),
        )

    def validate(self, robot: RobotFacts) -> None:
        robot.joint_index(self.joint)
        check_label(self.name, self.label)
        if self.gas not in _GAS:
            raise InputError(Problem(f"{self.name}: gas", found=repr(self.gas)[:80], allowed=", ".join(_GAS)))
        if self._area == 0.0 or not 0.0 <= self.rod_area < self.piston_area:
            found = f"piston_area = {self.piston_area:g} m^2, rod_area = {self.rod_area:g} m^2"
            hint = "Gas on both sides pushes with the rod's area: give rod_area." if self.gas == _GAS[2] else None
            message = f"{self.name}: the piston's area must be above the rod's, and the gas must act on some area"
            raise InputError(Problem(message, found=found, hint=hint))
        if not self.length > 0.0:
            raise InputError(Problem(f"{self.name}: length must be above 0", found=f"{self.length:g} m"))
        self.validate_values(np.array([self.pressure, self.volume, self.exponent, self.lc, self.l2, self.zero]), robot)

    def validate_values(self, x: Array, robot: RobotFacts) -> None:
        """InputError where the gas would have no volume left somewhere within the joint's limits."""
        for name, value in zip(("pressure", "volume", "exponent"), x, strict=False):
            if not value > 0.0:
                raise InputError(Problem(f"{self.name}: {name} must be above 0", found=f"{value:g}"))
        SpringTriangle(x[3], x[4]).check(self.name)
        left, angle = self._left(x[1:], robot)
        if not left > 0.0:
            at = f"{1e3 * left:.3g} l at {self.joint} = {np.rad2deg(angle):.1f} deg"
            needed = f"volume above {1e3 * (x[1] - left):.3g} l"
            hint = "Look at the volume, the areas, the length of the preload and the side of the gas."
            message = f"{self.name}: the gas has no volume left within the joint's limits"
            raise InputError(Problem(message, found=at, allowed=needed, hint=hint))

    def _left(self, x: Array, robot: RobotFacts) -> tuple[float, float]:
        """The smallest volume, m^3, that the gas has within the joint's limits, and the joint's angle there, rad.

        x: volume, exponent, lc, l2 and zero
        """
        volume, _, lc, l2, zero = x
        if robot.limits is None:
            return float(volume), 0.0
        low, high = (float(limit) + zero for limit in robot.limits[robot.joint_index(self.joint)])
        turns = range(int(np.ceil(low / np.pi)), int(np.floor(high / np.pi)) + 1)  # the longest and the shortest
        b = np.array([low, high, *(np.pi * k for k in turns)])
        left = volume - self._area * (SpringTriangle(lc, l2).length(b) - self.length)
        worst = int(np.argmin(left))
        return float(left[worst]), float(b[worst] - zero)

    def outline(self, robot: RobotFacts) -> tuple[Point, Point]:
        return SpringTriangle(self.lc, self.l2).pivots(robot, self.joint, self.zero)

    def joints(self, robot: RobotFacts) -> tuple[str, ...]:
        return (self.joint,)

    @property
    def _area(self) -> float:
        """A, m^2: above 0 where the gas pulls, below 0 where it pushes."""
        ring = self.piston_area - self.rod_area
        return {"rod side": ring, "piston side": -self.piston_area, "both sides": -self.rod_area}[self.gas]

    def torque(self, q: Array, x: Array, context: Context) -> TorqueTerm:
        pressure, volume, exponent, lc, l2, zero = x
        return SpringTriangle(lc, l2).torque(q[:, 0] + zero, self.pull(pressure, volume, exponent))

    def pull(self, pressure: float, volume: float, exponent: float) -> Callable[[Array], Tension]:
        """F at lengths s (N,) m. InputError where the gas has no volume left."""

        def law(s: Array) -> Tension:
            A, n = self._area, exponent
            V = volume - A * (s - self.length)
            if not np.all(V > 0.0):
                raise InputError(f"{self.name}: the gas has no volume left at a length of {s[np.argmin(V)]:.4g} m")
            ratio = (volume / V) ** n
            p, ln = (pressure + AMBIENT) * ratio, np.log(volume / V)
            p_V0 = n * p * (1.0 / volume - 1.0 / V)
            stiff = n * A**2 / V
            dx = A * np.stack([ratio, p_V0, p * ln], axis=1)
            dsx = np.stack([stiff * ratio, stiff * (p_V0 - p / V), stiff * p * (1.0 / n + ln)], axis=1)
            return Tension(A * (p - AMBIENT), stiff * p, stiff * p * (n + 1.0) * A / V, dx, dsx)

        return law
