"""Rotation vectors: what they turn by per unit, back from matrices, and from quaternions, beside those of effects."""

from __future__ import annotations

import numpy as np

from qsframework.plugin import Array, cross_matrix, exponential

__all__ = ["cross_matrix", "exponential", "from_quaternion", "left_jacobian", "rotation_vector"]


def left_jacobian(v: Array) -> Array:
    """Rotation of exp(v) per unit of v (..., 3), on fixed axes: matrices (..., 3, 3)."""
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    K = cross_matrix(v)
    near = angle < 1e-3
    safe = np.where(near, 1.0, angle)
    a = np.where(near, 0.5 - angle**2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    b = np.where(near, 1.0 / 6.0 - angle**2 / 120.0, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + a * K + b * K @ K


def rotation_vector(R: Array) -> Array:
    """The vector (3,) along the axis of one rotation (3, 3), as long as its angle in rad, 0 to pi."""
    sine = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    size, cosine = float(np.linalg.norm(sine)), 0.5 * (float(np.trace(R)) - 1.0)
    if cosine > -0.5:
        return sine if size < 1e-12 else np.asarray(np.arctan2(size, cosine) / size * sine)
    axis = np.linalg.eigh(0.5 * (R + R.T))[1][:, 2]  # near half a turn the sine loses the axis
    along = float(axis @ sine)
    return np.asarray(np.copysign(np.arctan2(abs(along), cosine), along) * axis)


def from_quaternion(wxyz: Array) -> Array:
    """Rotation matrix (3, 3) of a quaternion (4,), scalar first, of any length but zero."""
    w, *v = wxyz / np.linalg.norm(wxyz)
    K = cross_matrix(np.array(v))
    return np.eye(3) + 2.0 * w * K + 2.0 * K @ K
