"""Stage 5: the wrench that acts, the masses that hang, and the torques they put on the coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from qsframework.elastostatics.motion import MotionRate, combine
from qsframework.elastostatics.state import PlacedSite, PlacedSiteRate, State
from qsframework.plugin import Array, Context, Load, Loads, LoadTerm, RobotFacts, laws
from qsframework.robot.gravity import element_gravity
from qsframework.robot.kinematics import Twists, twists_along


@dataclass(frozen=True, eq=False)
class Applied:
    """The wrench (N, 6) after all load effects, and the bodies' mass moments (n + 1 + b, 4).

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
    wrench, moments = context.poses.wrench, context.robot.moments
    passed: list[tuple[Load, Loads, Array]] = []
    for effect, x in effects:
        passed.append((effect, Loads(wrench, rotation, moments), x))
        term = laws.loaded(*passed[-1], context)
        wrench = term.wrench
        moments = moments if term.moments is None else moments + of_bodies(term.moments, context.robot)
    return Applied(wrench, moments, tuple(passed), context)


def of_bodies(moments: Array, facts: RobotFacts) -> Array:
    """Mass moments of all bodies from an effect's, which may know the arm's links only."""
    missing = len(facts.bodies) - len(moments)
    return np.concatenate([moments, np.zeros((missing, *moments.shape[1:]))]) if missing else moments


def wrench_along(terms: Sequence[LoadTerm], turn: Array | None, start: Array | None, first: int = 0) -> Array:
    """Derivative (..., N, 6) of the final wrench: `start` enters after term `first - 1`, `turn` (..., 3, N) at every
    term."""
    batch = len(terms[0].wrench)
    change = np.zeros((batch, 6)) if start is None else start
    for term in terms[first:]:
        change = np.einsum("nij,...nj->...ni", term.d_wrench, change)
        if turn is not None and term.d_rotation is not None:
            change = change + np.einsum("nij,...jn->...ni", term.d_rotation, turn)
    return change


def wrench_torque(column: PlacedSite | PlacedSiteRate, wrench: Array) -> Array:
    """tau = D' w on the coordinates, (ne, N), for a wrench (6, N)."""
    return np.einsum("ecn,cn->en", column.linear, wrench[:3]) + np.einsum("ecn,cn->en", column.angular, wrench[3:])


def gravity_torque(state: State, moments: Array, gravity: Array) -> Array:
    """Torque of the masses on the coordinates, (ne, N) N m."""
    return combine(state.motion.coefficients, element_gravity(state.placed, moments, gravity))


def gravity_torque_along(state: State, masses: Sequence[Twists], gravity: Array, rate: MotionRate) -> Array:
    """Derivative of `gravity_torque` along element rates; masses: the state's `mass_columns`."""
    total = np.zeros((state.coordinates, state.motion.q.shape[-1]))
    for columns in masses if state.coordinates else ():  # a rigid arm asks for the geometry alone, and often
        slope = twists_along(columns, rate.elements[: columns.upstream], state.motion.used)
        total += combine(state.motion.coefficients, np.einsum("ecn,c->en", slope.linear, gravity))
        total += combine(rate.coefficients, np.einsum("ecn,c->en", columns.linear, gravity))
    return total
