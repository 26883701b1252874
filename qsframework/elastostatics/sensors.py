"""Stage 6: from the markers' positions to what the instrument says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from qsframework.elastostatics.so3 import exponential, left_jacobian
from qsframework.elastostatics.state import State
from qsframework.plugin import Array, Context, Reading, Sensor, SensorTerm, laws


@dataclass(frozen=True, eq=False)
class Sensed:
    """Readings (K, 3, N) of one state and how they react to the markers' motion.

    passed: what came into each sensor, whose terms are taken where they are asked for
    """

    position: Array
    passed: tuple[tuple[Sensor, Reading, Array], ...]
    context: Context
    turned: Array

    @cached_property
    def _terms(self) -> tuple[SensorTerm, ...]:
        return tuple(laws.read(sensor, reading, x, self.context) for sensor, reading, x in self.passed)

    @cached_property
    def by_position(self) -> Array:
        """To a shift of the marker, (N, K, 3, 3)."""
        return self._after[0]

    @cached_property
    def by_rotation(self) -> Array:
        """To a small rotation of the marker's link, (N, K, 3, 3)."""
        out = np.zeros((*self.passed[0][1].position.shape, 3))
        for term in self._terms:
            out = term.d_position @ out
            if term.d_rotation is not None:
                out = out + term.d_rotation
        return out

    @cached_property
    def by_parameters(self) -> tuple[Array, ...]:
        """For each sensor (N, K, 3, p), already passed through the later sensors."""
        return tuple(after @ term.dx for after, term in zip(self._after[1:], self._terms, strict=True))

    @cached_property
    def _after(self) -> tuple[Array, ...]:
        """How the reading reacts (N, K, 3, 3) to a shift before each sensor, and after the last."""
        out = [np.broadcast_to(np.eye(3), (*self.passed[0][1].position.shape, 3))]
        for term in reversed(self._terms):
            out.append(out[-1] @ term.d_position)
        return tuple(reversed(out))

    def turn_rate(self, rate: Array, carried: Array | None) -> Array:
        """Small rotation (N, K, 3) of the links, turned by exp(turned), when `turned` changes by `rate` and the
        undeflected link by `carried`; all (K, 3, N)."""
        total = np.einsum("nkij,kjn->nki", self._left, rate)
        return total if carried is None else total + np.einsum("nkij,kjn->nki", self._turn, carried)

    @cached_property
    def turns(self) -> bool:
        """Whether a small rotation of a marker's link shows in its reading."""
        return bool(np.any(self.by_rotation))

    @cached_property
    def _left(self) -> Array:
        return left_jacobian(self.turned.transpose(2, 0, 1))

    @cached_property
    def _turn(self) -> Array:
        return exponential(self.turned.transpose(2, 0, 1))


def sense(
    sensors: Sequence[tuple[Sensor, Array]],
    state: State,
    eps: Array | None,
    names: Sequence[str],
    context: Context,
) -> Sensed:
    """Read the markers at the commanded pose deflected by eps (ne, N); None for a state placed where it settles."""
    position = np.stack([m.position for m in state.markers])
    turn = np.zeros_like(position)
    rotation = np.stack([m.rotation for m in state.markers], axis=1)
    if eps is not None:
        position = position + np.stack([np.einsum("ecn,en->cn", m.linear, eps) for m in state.markers])
        turn = np.stack([np.einsum("ecn,en->cn", m.angular, eps) for m in state.markers])
        rotation = exponential(turn.transpose(2, 0, 1)) @ rotation
    reading = position.transpose(2, 0, 1)
    passed: list[tuple[Sensor, Reading, Array]] = []
    for sensor, x in sensors:
        passed.append((sensor, Reading(reading, rotation, tuple(names)), x))
        reading = laws.seen(*passed[-1], context)
    return Sensed(reading.transpose(1, 2, 0), tuple(passed), context, turn)
