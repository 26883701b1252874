"""Stage 6: from the markers' positions to what the instrument says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics.state import State
from qsframework.plugin import Array, Conditions, Reading, Sensor, SensorTerm


@dataclass(frozen=True, eq=False)
class Sensed:
    """Readings (K, 3, N) of one state and how they react to the markers' motion.

    by_position, by_rotation (N, K, 3, 3): to a shift, and to a small rotation of the marker's link;
    by_parameters: for each sensor (N, K, 3, p), already passed through the later sensors
    """

    position: Array
    by_position: Array
    by_rotation: Array
    by_parameters: tuple[Array, ...]
    turned: Array


def sense(
    sensors: Sequence[tuple[Sensor, Array]],
    state: State,
    eps: Array | None,
    names: Sequence[str],
    conditions: Conditions,
) -> Sensed:
    """Read the markers at the commanded pose deflected by eps (ne, N)."""
    position = np.stack([m.position for m in state.markers])
    turn = np.zeros_like(position)
    if eps is not None:
        position = position + np.stack([np.einsum("ecn,en->cn", m.linear, eps) for m in state.markers])
        turn = np.stack([np.einsum("ecn,en->cn", m.angular, eps) for m in state.markers])
    links = [state.placed.matrix(m.link) for m in state.markers]
    turned = exponential(turn.transpose(2, 0, 1))
    rotation = turned @ np.stack(links, axis=1)
    reading = position.transpose(2, 0, 1)
    terms: list[SensorTerm] = []
    for sensor, x in sensors:
        terms.append(sensor.read(Reading(reading, rotation), x, names, conditions))
        reading = terms[-1].position
    by_position = np.broadcast_to(np.eye(3), (*reading.shape, 3))
    by_rotation = np.zeros((*reading.shape, 3))
    for term in terms:
        by_position = term.d_position @ by_position
        by_rotation = term.d_position @ by_rotation
        if term.d_rotation is not None:
            by_rotation = by_rotation + term.d_rotation
    return Sensed(
        reading.transpose(1, 2, 0),
        by_position,
        by_rotation,
        tuple(_through(terms[i + 1 :], term.dx) for i, term in enumerate(terms)),
        turn,
    )


def _through(later: Sequence[SensorTerm], dx: Array) -> Array:
    for term in later:
        dx = term.d_position @ dx
    return dx


def _cross_matrix(v: Array) -> Array:
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)


def exponential(v: Array) -> Array:
    """Rotation matrices of rotation vectors (..., 3), Rodrigues."""
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    K = _cross_matrix(v)
    near = angle < 1e-6
    safe = np.where(near, 1.0, angle)
    a = np.where(near, 1.0 - angle**2 / 6.0, np.sin(safe) / safe)
    b = np.where(near, 0.5, (1.0 - np.cos(safe)) / safe**2)
    return np.eye(3) + a * K + b * K @ K


def turn_rate(turn: Array, rate: Array, carried: Array | None) -> Array:
    """Small rotation (N, K, 3) of a link turned by exp(turn) when `turn` changes by `rate` and the
    undeflected link by `carried`; all (K, 3, N)."""
    v = turn.transpose(2, 0, 1)
    total = np.einsum("nkij,kjn->nki", turning(v), rate)
    if carried is not None:
        total = total + np.einsum("nkij,kjn->nki", exponential(v), carried)
    return total


def turning(v: Array) -> Array:
    """Small rotation of exp(v) per unit of v (..., 3): matrices (..., 3, 3), to second order in v."""
    K = _cross_matrix(v)
    return np.eye(3) + 0.5 * K + K @ K / 6.0
