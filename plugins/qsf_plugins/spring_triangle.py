"""The triangle of a spring balancer: base line lc, arm l2, spring s. Equations (7)-(11) of the paper."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsf_plugins.vectors import turns
from qsframework.plugin import Array, InputError, Point, Problem, RobotFacts


@dataclass(frozen=True)
class SpringTriangle:
    """Sides lc and l2 (m) that meet at the joint; b is the angle between them, s the spring's length."""

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

    def moment(self, b: Array, free_length: float) -> Array:
        """M_c / K_c (m^2), equation (9): lc l2 (1 - s0/s) sin b."""
        return self.lc * self.l2 * (1.0 - free_length / self.length(b)) * np.sin(b)

    def moment_free_length(self, b: Array) -> Array:
        """d (M_c / K_c) / d s0."""
        return -self.lc * self.l2 * np.sin(b) / self.length(b)

    def eta(self, b: Array, free_length: float) -> Array:
        """eta(b), equation (11) corrected: cos b + (s0 lc l2 / s^3) sin^2 b - (s0 / s) cos b."""
        s = self.length(b)
        return np.cos(b) + free_length * self.lc * self.l2 / s**3 * np.sin(b) ** 2 - free_length / s * np.cos(b)

    def eta_free_length(self, b: Array) -> Array:
        """d eta / d s0."""
        s = self.length(b)
        return self.lc * self.l2 / s**3 * np.sin(b) ** 2 - np.cos(b) / s

    def eta_angle(self, b: Array, free_length: float) -> Array:
        """d eta / d b."""
        s, area = self.length(b), self.lc * self.l2
        bend = 3.0 * area * np.cos(b) / s**3 - 3.0 * area**2 * np.sin(b) ** 2 / s**5 + 1.0 / s
        return np.sin(b) * (free_length * bend - 1.0)

    def pivots(self, robot: RobotFacts, joint: str, zero: float) -> tuple[Point, Point]:
        """Where the spring ends, on the previous link and on the joint's: b is zero + q, and l2 lies along the arm."""
        k = robot.joint_index(joint)
        axis = robot.axes[k]
        arm = robot.placements[k + 1][:3, 3] if k + 1 < robot.n else np.zeros(3)
        arm = arm - axis * (axis @ arm)
        if not np.linalg.norm(arm) > 1e-9:  # the next joint lies on the axis: any direction across it
            arm = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        arm = arm / np.linalg.norm(arm)
        base = robot.placements[k] @ np.append(self.lc * turns(axis, np.array([-zero]))[0] @ arm, 1.0)
        return _point(robot.links[k], base[:3]), _point(robot.link_of(joint), self.l2 * arm)


def _point(link: str, xyz: Array) -> Point:
    x, y, z = (float(c) for c in xyz)
    return Point(link, (x, y, z))
