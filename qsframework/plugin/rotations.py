"""Rotations: vectors and matrices, all for batches (..., 3) and (..., 3, 3), of complex numbers too where that has a
meaning: derivatives may be taken by a complex step."""

from __future__ import annotations

import numpy as np

from qsframework.plugin.facts import Array


def cos_sin(angle: Array) -> tuple[Array, Array]:
    """Cosine and sine of angles, rad, to the last digits of 1: by the tangent of their halves,
    cos = (1 - t^2) / (1 + t^2), sin = 2 t / (1 + t^2). On many processors numpy has a tangent that is eight times as
    fast as its sine."""
    if np.iscomplexobj(angle):  # by complex step a tangent loses what is left of it near pi
        return np.cos(angle), np.sin(angle)
    half = np.tan(0.5 * angle)
    square = half * half
    share = 1.0 / (1.0 + square)
    return (1.0 - square) * share, 2.0 * half * share


def cross_matrix(v: Array) -> Array:
    """The matrices (..., 3, 3) of v x for v (..., 3): cross_matrix(v) @ w = v x w."""
    out: Array = np.zeros((*v.shape, 3), np.result_type(v, np.float64))
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out


def turns(axis: Array, angle: Array | float) -> Array:
    """Rotations (..., 3, 3) about one unit axis (3,) by angles (...), rad."""
    cross, (cos, sin) = cross_matrix(axis), cos_sin(np.asarray(angle)[..., None, None])
    return np.eye(3) + sin * cross + (1.0 - cos) * (cross @ cross)


def exponential(v: Array) -> Array:
    """Rotation matrices of rotation vectors (..., 3), Rodrigues."""
    square, K = (v * v).sum(axis=-1)[..., None, None], cross_matrix(v)
    near = np.abs(square) < 1e-8
    safe = np.where(near, 1.0, square)
    angle = np.sqrt(safe)
    a = np.where(near, 1.0 - square / 6.0, np.sin(angle) / angle)
    b = np.where(near, 0.5 - square / 24.0, (1.0 - np.cos(angle)) / safe)
    return np.eye(3) + a * K + b * K @ K


def homogeneous(rotation: Array, at: Array) -> Array:
    """Placements (..., 4, 4) of rotations (..., 3, 3), or of one for all, at positions (..., 3)."""
    out = np.zeros((*at.shape[:-1], 4, 4))
    out[..., :3, :3], out[..., :3, 3], out[..., 3, 3] = rotation, at, 1.0
    return out
