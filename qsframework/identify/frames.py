"""The tracker's frame of a series of readings: y = R p + t for a point p in the robot's base frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Indices, Parameter

AXES = ("x", "y", "z", "rx", "ry", "rz")
_STEPS = 50
_SETTLED = 1e-6


@dataclass(frozen=True, eq=False)
class Frame:
    """The robot's base in a tracker's frame: rotation (3, 3) and origin (3,) m."""

    series: str
    rotation: Array
    origin: Array

    def apply(self, points: Array) -> Array:
        """Points (..., 3) of the base frame as the tracker sees them."""
        return points @ self.rotation.T + self.origin

    def moved(self, twist: Array) -> Frame:
        """The frame shifted by twist[:3] and turned by the rotation vector twist[3:], both on the tracker's axes."""
        return Frame(self.series, rotation(twist[3:]) @ self.rotation, self.origin + twist[:3])

    @property
    def pose(self) -> Array:
        """Origin (3,) m and rotation vector (3,) rad."""
        return np.concatenate([self.origin, rotation_vector(self.rotation)])

    def parameters(self) -> tuple[Parameter, ...]:
        """Motions of the frame: along the tracker's axes, and small turns about them."""
        name = f"frame[{self.series}]" if self.series else "frame"
        units = ("m",) * 3 + ("rad",) * 3
        return tuple(Parameter(f"{name}.{a}", u, typical=1e-2) for a, u in zip(AXES, units, strict=True))


def cross_matrix(v: Array) -> Array:
    """The matrices (..., 3, 3) of v x for v (..., 3)."""
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)


def rotation(v: Array) -> Array:
    """exp of a rotation vector (3,), Rodrigues."""
    K, angle = cross_matrix(v), float(np.linalg.norm(v))
    if angle < 1e-8:
        return np.eye(3) + K + 0.5 * K @ K
    return np.eye(3) + np.sin(angle) / angle * K + (1.0 - np.cos(angle)) / angle**2 * K @ K


def rotation_vector(R: Array) -> Array:
    """The vector (3,) along the axis of a rotation, as long as its angle in rad, 0 to pi."""
    sine = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    size, cosine = float(np.linalg.norm(sine)), 0.5 * (float(np.trace(R)) - 1.0)
    if cosine > -0.5:
        return sine if size < 1e-12 else np.asarray(np.arctan2(size, cosine) / size * sine)
    axis = np.linalg.eigh(0.5 * (R + R.T))[1][:, 2]  # near half a turn the sine loses the axis
    along = float(axis @ sine)
    return np.asarray(np.copysign(np.arctan2(abs(along), cosine), along) * axis)


def turning(v: Array) -> Array:
    """Rotation of exp(v) per unit of v, on fixed axes: the left Jacobian (3, 3) of SO(3)."""
    K, angle = cross_matrix(v), float(np.linalg.norm(v))
    if angle < 1e-4:
        return np.eye(3) + 0.5 * K + K @ K / 6.0
    return np.eye(3) + (1.0 - np.cos(angle)) / angle**2 * K + (angle - np.sin(angle)) / angle**3 * K @ K


def procrustes(points: Array, readings: Array, series: str = "") -> Frame:
    """The rigid motion that brings points (R, 3) closest to readings (R, 3), by singular values (Kabsch)."""
    a, b = points.mean(axis=0), readings.mean(axis=0)
    U, _, Vt = np.linalg.svd((points - a).T @ (readings - b))
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(Vt.T @ U.T))])
    R = (Vt.T * sign) @ U.T
    return Frame(series, R, b - R @ a)


def start(
    points: Array, offsets: Array, readings: Array, series: Sequence[tuple[str, Indices]], prior: Array
) -> tuple[list[Frame], Array]:
    """Frames of all series and the markers' offsets o (k,) m, by Gauss-Newton from the rigid motions.

    points (R, 3) at no offset; offsets (R, 3, k): d point / d o; series: name and rows of each; prior (k,)
    m: the standard deviation of each offset, which holds those that the readings hardly tell
    """
    o = np.zeros(offsets.shape[2])
    count = 6 * len(series)
    for _ in range(_STEPS):
        here = points + offsets @ o
        frames = [procrustes(here[rows], readings[rows], name) for name, rows in series]
        if not len(o):
            return frames, o
        A, r = np.zeros((len(points), 3, count + len(o))), np.empty_like(points)
        for i, (frame, (_, rows)) in enumerate(zip(frames, series, strict=True)):
            seen = frame.apply(here[rows])
            A[rows, :, 6 * i : 6 * i + 3] = np.eye(3)
            A[rows, :, 6 * i + 3 : 6 * i + 6] = -cross_matrix(seen - frame.origin)
            A[rows, :, count:] = frame.rotation @ offsets[rows]
            r[rows] = readings[rows] - seen
        held = np.zeros((len(o), A.shape[2]))
        held[:, count:] = np.diag(max(float(np.sqrt(np.mean(r**2))), _SETTLED) / prior)
        rows, target = np.vstack([A.reshape(-1, A.shape[2]), held]), np.concatenate([r.ravel(), -held[:, count:] @ o])
        change = np.linalg.lstsq(rows, target, rcond=1e-12)[0][count:]
        o = o + change
        if np.abs(change).max() < _SETTLED:
            break
    here = points + offsets @ o
    return [procrustes(here[rows], readings[rows], name) for name, rows in series], o
