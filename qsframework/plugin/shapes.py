"""Smooth shapes of one variable, of which learned laws are made: to weigh them equally is to expect nothing special."""

from __future__ import annotations

from functools import cache

import numpy as np

from qsframework.plugin.facts import Array

KNOTS: tuple[float, ...] = tuple(np.linspace(-1.0, 1.0, 9).tolist())
"""Where a smooth function of a variable between -1 and 1 may bend."""
FINE: tuple[float, ...] = tuple(np.linspace(-1.0, 1.0, 21).tolist())
"""The same where something may come and go."""
_REACH = 1.8
"""Knots over which a smooth function changes."""
_SOFT = 0.01
"""Share of the variable's range over which its sign changes."""
_BENDS = (0.1, 0.3)
"""The same of shapes that stand for what saturates."""
_NEAR, _FAR = 0.05, 0.5
"""rad that a joint must turn to come from a side, and to come from far."""


def smooth(u: Array, knots: tuple[float, ...] = KNOTS) -> Array:
    """Functions (..., k) of a variable between -1 and 1, each large at one of k knots; independent weights of equal
    size make a Gaussian process."""
    away = u[..., None] - np.array(knots)
    return np.asarray(np.exp(-0.5 * np.square(away / _length(knots))) @ _whitening(knots))


@cache
def _length(knots: tuple[float, ...]) -> float:
    return _REACH * (knots[-1] - knots[0]) / max(len(knots) - 1, 1)


@cache
def _whitening(knots: tuple[float, ...]) -> Array:
    """(k, k): from the process at its knots to independent weights."""
    at = np.array(knots)
    values, vectors = np.linalg.eigh(np.exp(-0.5 * np.square((at[:, None] - at) / _length(knots))))
    return np.asarray(vectors / np.sqrt(np.maximum(values, 1e-8 * values[-1])), dtype=np.float64)


def circular(angle: Array, waves: int = 2) -> Array:
    """Functions (..., 1 + 2 w) of an angle, rad: a constant, and a cosine and a sine for each of w waves per turn, the
    faster the less."""
    turns = [f(k * angle) / k for k in range(1, waves + 1) for f in (np.cos, np.sin)]
    return np.stack([np.ones_like(angle), *turns], axis=-1)


def by_coming(way: Array) -> Array:
    """Functions (..., 3) of the way, rad, by which a joint came: its side, how far, and both; 0 without any."""
    far = way * way / (way * way + _FAR**2)
    return np.stack([way / np.sqrt(way * way + _NEAR**2), far, way / np.sqrt(way * way + _FAR**2)], axis=-1)


def by_torque(u: Array, knots: tuple[float, ...] = KNOTS) -> Array:
    """Functions (..., k + 3) of a torque that vanish without it: u times smooth ones of k knots, its sign, and what
    saturates."""
    sides = [u / np.sqrt(u * u + soft**2) for soft in (_SOFT, *_BENDS)]
    return np.concatenate([u[..., None] * smooth(u, knots), np.stack(sides, axis=-1)], axis=-1)


def bent(u: Array) -> Array:
    """Functions (..., 3) of a torque that vanish without it: itself, what grows faster and what saturates."""
    return np.stack([u, u * magnitude(u), 0.5 * u / np.sqrt(u * u + _BENDS[0] ** 2)], axis=-1)


def magnitude(u: Array) -> Array:
    """|u|, rounded off where it is small, so that it has derivatives."""
    return np.asarray(np.sqrt(u * u + _SOFT**2))


def by_attitude(down: Array) -> Array:
    """Functions (..., 9) of a direction (..., 3) of length 1: a constant, its components, and what turns twice."""
    x, y, z = (down[..., i] for i in range(3))
    twice = [x * x - 1.0 / 3.0, y * y - 1.0 / 3.0, x * y, x * z, y * z]
    return np.stack([np.ones_like(x), x, y, z, *twice], axis=-1)
