"""Smooth shapes of one variable, of which learned laws are made: to weigh them equally is to expect nothing special."""

from __future__ import annotations

from functools import cache

import numpy as np

from qsframework.plugin.facts import Array

_LENGTH = 0.45
"""Over which a smooth function of a variable between -1 and 1 changes."""
KNOTS: tuple[float, ...] = tuple(np.linspace(-1.0, 1.0, 9).tolist())
"""Where a smooth function of a variable between -1 and 1 may bend."""
_SOFT = 0.01
"""Share of the variable's range over which its sign changes."""


def smooth(u: Array, knots: tuple[float, ...] = KNOTS) -> Array:
    """Functions (..., k) of a variable between -1 and 1, each large at one of k knots; independent weights of equal
    size make a Gaussian process."""
    away = u[..., None] - np.array(knots)
    return np.asarray(np.exp(-0.5 * np.square(away / _LENGTH)) @ _whitening(knots))


@cache
def _whitening(knots: tuple[float, ...]) -> Array:
    """(k, k): from the process at its knots to independent weights."""
    at = np.array(knots)
    values, vectors = np.linalg.eigh(np.exp(-0.5 * np.square((at[:, None] - at) / _LENGTH)))
    return np.asarray(vectors / np.sqrt(np.maximum(values, 1e-8 * values[-1])), dtype=np.float64)


def circular(angle: Array) -> Array:
    """Functions (..., 5) of an angle, rad: a constant and two waves each per turn and per half turn."""
    waves = [np.cos(angle), np.sin(angle), 0.5 * np.cos(2.0 * angle), 0.5 * np.sin(2.0 * angle)]
    return np.stack([np.ones_like(angle), *waves], axis=-1)


def by_torque(u: Array, knots: tuple[float, ...] = KNOTS) -> Array:
    """Functions (..., k + 1) of a torque that vanish without it: u times smooth ones of k knots, and its sign."""
    return np.concatenate([u[..., None] * smooth(u, knots), (u / np.sqrt(u * u + _SOFT**2))[..., None]], axis=-1)
