"""Small vector algebra that several effects share."""

from __future__ import annotations

import numpy as np

from qsframework.plugin import Array, cos_sin


def skew(v: Array) -> Array:
    """[v]x of vectors (..., 3): skew(v) @ w = v x w."""
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)


def turns(axis: Array, angle: Array) -> Array:
    """Rotations (N, 3, 3) about one unit axis by angles (N,)."""
    cross, (cos, sin) = skew(np.asarray(axis, dtype=float)), cos_sin(angle)
    return np.eye(3) + sin[:, None, None] * cross + (1.0 - cos)[:, None, None] * (cross @ cross)


def rotation(v: Array) -> Array:
    """Rotation matrix exp([v]x) (3, 3) of a rotation vector, of complex ones too."""
    square, K = v @ v, skew(v)
    if square.real < 1e-8:
        first, second = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        angle = np.sqrt(square)
        first, second = np.sin(angle) / angle, (1.0 - np.cos(angle)) / square
    return np.eye(3) + first * K + second * K @ K
