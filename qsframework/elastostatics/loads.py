"""Stage 5: the wrench that acts, the masses that hang, and the torques they put on the coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from qsframework.elastostatics.motion import MotionRate, combine
from qsframework.elastostatics.state import Column, ColumnRate, State
from qsframework.plugin import Array, Context, Load, Loads, LoadTerm, laws
from qsframework.robot.gravity import element_gravity, nominal_moments
from qsframework.robot.kinematics import Twists, cross, twists_along


@dataclass(frozen=True, eq=False)
class Applied:
    """The wrench (N, 6) after all load effects, and the links' mass moments (n + 1, 4).

    passed: what came into each effect, whose terms are taken where they are asked for
    """

    wrench: Array
    moments: Array
    passed: tuple[tuple[Load, Loads, Array], ...]
    context: Context

    @cached_property
    def terms(self) -> tuple[LoadTerm, ...]:
        """Each effect's term with its derivatives."""
        return tuple(laws.apply(effect, loads, x, self.context) for effect, loads, x in self.passed)


def apply_loads(effects: Sequence[tuple[Load, Array]], rotation: Array, context: Context) -> Applied:
    """Pass the wrench and the masses through the load effects in their order."""
    wrench, moments = context.poses.wrench, nominal_moments(context.robot)
    passed: list[tuple[Load, Loads, Array]] = []
    for effect, x in effects:
        passed.append((effect, Loads(wrench, rotation, moments), x))
        term = laws.loaded(*passed[-1], context)
        wrench = term.wrench
        moments = moments if term.moments is None else moments + term.moments
    return Applied(wrench, moments, tuple(passed), context)


def wrench_along(terms: Sequence[LoadTerm], turn: Array | None, start: Array | None, first: int = 0) -> Array:
    """Derivative (N, 6) of the final wrench: `start` enters after term `first - 1`, `turn` (3, N) at every term."""
    batch = len(terms[0].wrench)
    change = np.zeros((batch, 6)) if start is None else start
    for term in terms[first:]:
        change = np.einsum("nij,nj->ni", term.d_wrench, change)
        if turn is not None and term.d_rotation is not None:
            change = change + np.einsum("nij,jn->ni", term.d_rotation, turn)
    return change


def wrench_torque(column: Column | ColumnRate, wrench: Array) -> Array:
    """tau = D' w on the coordinates, (ne, N), for a wrench (6, N)."""
    return np.einsum("ecn,cn->en", column.linear, wrench[:3]) + np.einsum("ecn,cn->en", column.angular, wrench[3:])


def weighted_columns(state: State, link: int, moments: Array) -> Twists:
    """Jacobian of mass times position of a link's centre, element by element."""
    placed = state.placed
    stop = placed.chain.stops[link]
    mass, r = moments[0], placed.rotations[link]
    weight = mass * placed.positions[link] + moments[1] * r[0] + moments[2] * r[1] + moments[3] * r[2]
    linear = cross(placed.axes[:stop], weight - mass * placed.origins[:stop])
    angular = placed.axes[:stop]
    translations = [e for e in range(stop) if not placed.chain.elements[e].rotation]
    if translations:
        angular = angular.copy()
        linear[translations] = mass * placed.axes[translations]
        angular[translations] = 0.0
    return Twists(linear, angular)


def gravity_torque(state: State, moments: Array, gravity: Array) -> Array:
    """Torque of the masses on the coordinates, (ne, N) N m."""
    return combine(state.motion.coefficients, element_gravity(state.placed, moments, gravity))


def gravity_torque_along(state: State, moments: Array, gravity: Array, rate: MotionRate) -> Array:
    """Derivative of `gravity_torque` along element rates."""
    total = np.zeros((state.coordinates, state.motion.q.shape[-1]))
    if not state.coordinates:
        return total  # a rigid arm asks for the geometry alone, and often
    for link in np.flatnonzero(np.any(moments, axis=1)):
        columns = weighted_columns(state, int(link), moments[link])
        slope = twists_along(columns, rate.elements[: columns.upstream])
        total += combine(state.motion.coefficients, np.einsum("ecn,c->en", slope.linear, gravity))
        total += combine(rate.coefficients, np.einsum("ecn,c->en", columns.linear, gravity))
    return total
