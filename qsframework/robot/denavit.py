"""The arm as a table of Denavit and Hartenberg, standard or modified (Craig), from any placements and axes.

    T(q) = base * prod_k [ Rz(theta_k + q_k) Tz(d_k) Tx(a_k) Rx(alpha_k) ] * tool

is the standard table; the modified one, prod_k [ Rx(alpha_k-1) Tx(a_k-1) Rz(theta_k + q_k) Tz(d_k) ], groups the same
numbers otherwise. Two axes that are nearly parallel have their common normal far away: d is then large, and of these
large numbers the small difference counts. Hayati's fifth number avoids that: such an axis is met where it goes through
the plane across the one before, d is 0, and Ry(beta_k) follows Rx(alpha_k).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from qsframework.plugin import Array
from qsframework.plugin.facts import frozen
from qsframework.plugin.rotations import homogeneous, turns

_PARALLEL = 1e-10
"""Sine of the angle below which two axes count as parallel: their common normal is nowhere."""
_NEARLY = float(np.sin(np.deg2rad(2.0)))
"""The same below which they get Hayati's number, where that is asked for."""


@dataclass(frozen=True, eq=False)
class Serial:
    """An arm of n joints: placements (n, 4, 4) of the joints in the link before, axes (n, 3), tool (4, 4)."""

    placements: Array
    axes: Array
    tool: Array

    def forward(self, q: Array) -> Array:
        """Where the tool is (N, 4, 4) at joint angles (N, n) rad."""
        out = np.tile(np.eye(4), (len(q), 1, 1))
        for k, placement in enumerate(self.placements):
            out = out @ placement @ homogeneous(turns(self.axes[k], q[:, k]), np.zeros((len(q), 3)))
        return out @ self.tool


@dataclass(frozen=True, eq=False, kw_only=True)
class Denavit:
    """theta, d (n,) rad and m; a, alpha, beta (n - 1,) m and rad between one axis and the next; base, tool (4, 4)."""

    theta: Array
    d: Array
    a: Array
    alpha: Array
    beta: Array
    base: Array
    tool: Array

    def serial(self) -> Serial:
        """The same arm by its placements; every joint turns about z."""
        n = len(self.theta)
        placements = np.empty((n, 4, 4))
        for k in range(n):
            before = self.base if k == 0 else along(0, self.a[k - 1], self.alpha[k - 1])
            turned = np.eye(4) if k == 0 else along(1, 0.0, self.beta[k - 1])
            placements[k] = before @ turned @ along(2, self.d[k], self.theta[k])
        return Serial(placements, np.tile([0.0, 0.0, 1.0], (n, 1)), self.tool)


def denavit(serial: Serial, hayati: bool = False) -> Denavit:
    """The table of an arm. Each joint's angle counts as in `serial`; a may be negative, so that theta stays small.

    hayati: nearly parallel axes get beta instead of a far d
    """
    n = len(serial.placements)
    points, axes = _lines(serial)
    frame = _first(points[0], axes[0])
    base = frame
    theta, d, a, alpha, beta = np.zeros(n), np.zeros(n), np.zeros(n - 1), np.zeros(n - 1), np.zeros(n - 1)
    for k in range(n - 1):
        across = hayati and float(np.linalg.norm(np.cross(frame[:3, 2], axes[k + 1]))) < _NEARLY
        foot, x, nearest = (_crossing if across else _normal)(frame, points[k + 1], axes[k + 1])
        theta[k] = np.arctan2(x @ frame[:3, 1], x @ frame[:3, 0])
        d[k] = (foot - frame[:3, 3]) @ frame[:3, 2]
        a[k] = (nearest - foot) @ x
        frame = frame @ along(2, d[k], theta[k])
        towards = frame[:3, :3].T @ axes[k + 1]
        alpha[k] = np.arctan2(-towards[1], towards[2])
        beta[k] = np.arcsin(towards[0]) if across else 0.0
        frame = frame @ along(0, a[k], alpha[k]) @ along(1, 0.0, beta[k])
    end = _end(serial)
    d[-1] = (end[:3, 3] - frame[:3, 3]) @ frame[:3, 2]
    tool = np.linalg.inv(frame @ along(2, d[-1], 0.0)) @ end
    parts = {"theta": theta, "d": d, "a": a, "alpha": alpha, "beta": beta, "base": base, "tool": tool}
    return Denavit(**{name: frozen(value) for name, value in parts.items()})


def _lines(serial: Serial) -> tuple[Array, Array]:
    """A point (n, 3) and the direction (n, 3) of every axis in the base frame, all angles zero."""
    frames = list(accumulate(serial.placements, np.matmul, initial=np.eye(4)))[1:]
    axes = [frame[:3, :3] @ axis for frame, axis in zip(frames, serial.axes, strict=True)]
    return np.stack([frame[:3, 3] for frame in frames]), np.stack(axes)


def _end(serial: Serial) -> Array:
    return serial.forward(np.zeros((1, len(serial.placements))))[0]


def _first(point: Array, axis: Array) -> Array:
    """The frame (4, 4) of the first axis: nearest to the base's origin, its x nearest to the base's x (or y)."""
    x = np.eye(3)[0] - axis[0] * axis
    if np.linalg.norm(x) < 0.1:
        x = np.eye(3)[1] - axis[1] * axis
    x = x / np.linalg.norm(x)
    turned = np.asarray(np.stack([x, np.cross(axis, x), axis], axis=1), dtype=np.float64)
    return homogeneous(turned, point - (point @ axis) * axis)


def _normal(frame: Array, point: Array, axis: Array) -> tuple[Array, Array, Array]:
    """The common normal of the frame's z and the next axis: its foot on z, its direction, its foot on the other.

    Of parallel axes it goes through the frame's origin; the direction is on the side of the frame's x.
    """
    origin, z = frame[:3, 3], frame[:3, 2]
    cross, apart = np.cross(z, axis), point - origin
    if np.linalg.norm(cross) < _PARALLEL:
        foot, nearest = origin, point - ((point - origin) @ axis) * axis
        way = nearest - foot
        x = way / np.linalg.norm(way) if np.linalg.norm(way) > 1e-12 else frame[:3, 0]
    else:
        square = cross @ cross
        foot = origin + (np.cross(apart, axis) @ cross) / square * z
        nearest = point + (np.cross(apart, z) @ cross) / square * axis
        x = cross / np.sqrt(square)
    side = x @ frame[:3, 0]
    return foot, x if side >= -1e-9 else -x, nearest


def _crossing(frame: Array, point: Array, axis: Array) -> tuple[Array, Array, Array]:
    """The same as `_normal` of an axis that is nearly parallel: where it goes through the plane across z."""
    origin, z = frame[:3, 3], frame[:3, 2]
    nearest = point + ((origin - point) @ z) / (axis @ z) * axis
    way = nearest - origin
    x = way / np.linalg.norm(way) if np.linalg.norm(way) > 1e-9 else frame[:3, 0]
    return origin, x if x @ frame[:3, 0] >= -1e-9 else -x, nearest


def along(axis: int, way: float, angle: float) -> Array:
    """Moved along and turned about a coordinate axis (4, 4)."""
    own = np.eye(3)[axis]
    return homogeneous(turns(own, angle), way * own)
