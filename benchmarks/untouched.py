"""Effects of the second generator that no library holds and on which nothing has been developed.

They were written by somebody who had seen only the building blocks and the names of what there was before, not what is
to find them. Each differs in law from those of `touched.py` and `untouched.py` and from the library's.
"""

from __future__ import annotations

import numpy as np
from independent_arm import Arm, Array, Hidden, Rest, Spring
from unknown import (
    DOWN,
    Maker,
    Unknown,
    any_level,
    any_way,
    axes_across,
    came_by,
    drive,
    either_side,
    gear,
    of_payload,
    one_across,
    softer,
    typical,
    vector,
)


def _square_to(line: Array, rng: np.random.Generator) -> Array:
    """A random unit vector (3,) across a unit vector."""
    way = any_way(rng)
    way = way - (way @ line) * line
    return np.asarray(way / np.linalg.norm(way), dtype=np.float64)


# ---------------------------------------------------------------- drives


def dropped_brake(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The servo holds the empty arm, but switches off before the load hangs: the hub of the brake then turns through
    its play, to the side of the torque."""
    k = drive(arm, rng)
    width = 0.05 * typical(arm, k)

    def law(T: Array, still: Rest) -> Array:
        return still.visits.loaded * np.tanh(T / width)

    return Unknown("dropped_brake", f"j{k + 1}", "own torque", gear(arm, k, law), 1e-5, 5e-4)


def skewed_ring(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A ring is bolted on askew: on one half of the turn one flank bears on its edges, on the other half the other
    flank does."""
    k, phase = drive(arm, rng, (3, 4, 5)), rng.uniform(0.0, 2.0 * np.pi)

    def law(T: Array, still: Rest) -> Array:
        return np.abs(T) * np.cos(still.angles[:, k] + phase)

    return softer(arm, k, "skewed_ring", "torque x angle", law, 0.9)


def rubbing_teeth(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Teeth rub by a share of the torque that they carry, either way: a joint that lifted stands too low, one that
    lowered too high, until the jolt of the load frees it."""
    k = drive(arm, rng)

    def law(T: Array, still: Rest) -> Array:
        return -(1.0 - still.visits.loaded) * np.abs(T) * np.tanh(came_by(arm, still, k) / 0.1)

    c = arm.compliance[k]
    return Unknown("rubbing_teeth", f"j{k + 1}", "approach", gear(arm, k, law), 0.02 * c, 0.5 * c)


def slack_belt(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The moment of the joint before bends the bracket of a belt's pulley: bent to one side far enough, the belt loses
    tension and its drive gives more."""
    k = drive(arm, rng, (4, 5))
    side, full = either_side(rng), 0.3 * typical(arm, k - 1)
    begin = rng.uniform(0.0, 0.4) * full

    def law(T: Array, still: Rest) -> Array:
        return T * np.clip((side * still.torque[:, k - 1] - begin) / full, 0.0, 3.0)

    return softer(arm, k, "slack_belt", "other torque", law, 3.0)


def dropped_pinion(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A tapered pinion whose spring is broken drops along its axis where that points down, and the teeth have play."""
    k = drive(arm, rng, (3, 4, 5))
    axis, width = either_side(rng) * np.array(arm.links[k].axis), 0.05 * typical(arm, k)

    def law(T: Array, still: Rest) -> Array:
        return np.maximum((still.turned[:, k] @ axis) @ DOWN, 0.0) * np.tanh(T / width)

    return Unknown("dropped_pinion", f"j{k + 1}", "attitude", gear(arm, k, law), 3e-5, 1.5e-3)


def told_load(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The controller was told of a full load: it lifts joint 2 by what it thinks that this sags at its angle, whatever
    hangs there and however the other joints stand."""
    most, ahead = arm.compliance[1] * typical(arm, 1), rng.uniform(0.3, 0.9)

    def law(T: Array, still: Rest) -> Array:
        return -most * still.visits.loaded * np.sin(still.angles[:, 1] + ahead)

    return Unknown("told_load", "j2", "own angle", gear(arm, 1, law), 0.01, 0.3)


# ---------------------------------------------------------------- bearings and links


def spreading_mesh(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Wheel and pinion push each other apart by the torque that they carry, to whichever side, and the wheel's bearing
    tilts from it."""
    k = drive(arm, rng, (1, 2, 3))
    axis, away = one_across(arm, k, rng), either_side(rng)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * away * np.abs(still.torque[:, k])

        return Hidden(springs=(Spring(k, "before", axis, law=law),))

    c = arm.compliance[k]
    return Unknown("spreading_mesh", f"j{k + 1}", "other torque", make, 0.05 * c, 1.0 * c)


def sunny_side(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Low sun warms the side of a link that joint 1 turns to the window: until the load hangs it has bent away."""
    k = drive(arm, rng, (1, 2))
    line = np.array(arm.links[k + 1].origin, dtype=np.float64)
    line /= np.linalg.norm(line)
    first = _square_to(line, rng)
    second = np.asarray(np.cross(line, first), dtype=np.float64)
    sun = np.array([*any_level(rng)[:2], 0.3])
    sun /= np.linalg.norm(sun)

    def make(size: float) -> Hidden:
        def about(axis: Array) -> Spring:
            def law(own: Array, still: Rest) -> Array:
                shines = still.turned[:, k].transpose(0, 2, 1) @ sun
                return size * still.visits.loaded * (np.cross(shines, line) @ axis)

            return Spring(k, "after", vector(axis), law=law)

        return Hidden(springs=(about(first), about(second)))

    return Unknown("sunny_side", f"l{k + 1}", "other angle", make, 5e-6, 2e-4)


def worn_journal(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A journal lies in a worn bore, on the side to which the force across its axis points, and rolls round in it as
    that turns."""
    k = drive(arm, rng, (3, 4))
    soft = 0.1 * 9.81 * arm.payload

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * own / np.sqrt(still.springs[:, -1] ** 2 + still.springs[:, -2] ** 2 + soft**2)

        return Hidden(springs=tuple(Spring(k, "before", a, slide=True, law=law) for a in axes_across(arm, k)))

    return Unknown("worn_journal", f"j{k + 1}", "direction of the force", make, 3e-5, 1e-3)


# ---------------------------------------------------------------- base and rail


def rolling_carriage(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A carriage rolls on its rail through the play of rack and pinion where the pull along the rail beats the rolling
    friction, and not at all where it does not."""
    rail, friction = any_level(rng), rng.uniform(0.003, 0.01)
    weight = 9.81 * sum(link.mass for link in arm.links)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            holds = friction * (weight - still.visits.force[:, 2])
            return size * 0.5 * (np.tanh((own - holds) / (0.2 * holds)) + np.tanh((own + holds) / (0.2 * holds)))

        return Hidden(springs=(Spring(0, "foot", rail, slide=True, law=law),))

    return Unknown("rolling_carriage", "base", "own torque", make, 3e-5, 5e-4)


def hatch_in_column(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The column below the base has a hatch: the edges of the hole bow out where the arm leans over them, by the square
    of the moment, and the column turns about the vertical."""
    axis, side, way, full = any_level(rng), either_side(rng), either_side(rng), typical(arm, 0)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * way * np.maximum(side * still.springs[:, -1], 0.0) ** 2 / full

        return Hidden(springs=(Spring(0, "foot", (0, 0, 1), law=law), Spring(0, "foot", axis)))

    c = arm.compliance[0]
    return Unknown("hatch_in_column", "base", "other torque", make, 0.01 * c, 0.5 * c)


# ---------------------------------------------------------------- tool


def loosening_bolts(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The bolts of the tool lose their tension from one of the readings on: from there the tool tilts ever more by the
    moment."""
    k, begin = len(arm.links) - 1, rng.uniform(0.3, 0.6)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * own * np.maximum(still.visits.order - begin, 0.0) / (1.0 - begin)

        return Hidden(springs=tuple(Spring(k, "after", axis, law=law) for axis in axes_across(arm, k)))

    return Unknown("loosening_bolts", "tool", "torque x order", make, 0.1 * arm.compliance[k], 3.0 * arm.compliance[k])


def loose_tongs(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Tongs grip the harder the heavier the load is: under a small one their rough jaws hardly touch, and they tilt by
    the moment; under a large one they do not."""
    k, closes = len(arm.links) - 1, rng.uniform(0.15, 0.25)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * own * np.exp((0.4 - of_payload(arm, still.visits.force)) / closes)

        return Hidden(springs=tuple(Spring(k, "after", axis, law=law) for axis in axes_across(arm, k)))

    return Unknown("loose_tongs", "tool", "load", make, 0.1 * arm.compliance[k], 3.0 * arm.compliance[k])


# ---------------------------------------------------------------- markers, readings, load


def rolled_reflector(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A reflector sits on a speck of dirt in its nest: as the arm stops it rolls on the way that it flew, and the jolt
    of the load brings it back."""
    m = int(rng.integers(len(arm.markers)))

    def make(size: float) -> Hidden:
        def read(p: Array, still: Rest) -> Array:
            rows = np.argsort(still.visits.order, kind="stable")
            number, way = still.visits.number[rows], np.zeros((len(rows), 3))
            before = 0
            for i in range(1, len(rows)):
                before = i - 1 if number[i] != number[i - 1] else before
                way[rows[i]] = p[rows[i], m] - p[rows[before], m]
            far = np.sqrt((way**2).sum(axis=1, keepdims=True) + 0.1**2)
            out = p.copy()
            out[:, m] += size * (1.0 - still.visits.loaded)[:, None] * way / far
            return out

        return Hidden(readings=(read,))

    return Unknown("rolled_reflector", f"m{m + 1}", "approach", make, 3e-5, 1e-3)


def hall_heater(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A heater of the hall blows on a leg of the tracker's stand, on and off: from the empty to the loaded reading the
    tracker leans away while it is on, and back while it is off."""
    period, phase = rng.uniform(0.3, 0.6), rng.uniform(0.0, 2.0 * np.pi)
    axis = np.array(any_level(rng))
    stands = np.array([rng.uniform(2.0, 5.0), rng.uniform(-2.0, 2.0), -0.5])

    def make(size: float) -> Hidden:
        def read(p: Array, still: Rest) -> Array:
            blows = np.tanh(np.sin(2.0 * np.pi * still.visits.order / period + phase) / 0.3)
            return p + size * (still.visits.loaded * blows)[:, None, None] * np.cross(axis, p - stands)

        return Hidden(readings=(read,))

    return Unknown("hall_heater", "readings", "order", make, 5e-6, 2e-4)


def sling_over_rim(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The load's sling hangs free of the tool until the tool leans to one side: then it runs over a rim and pulls
    there."""
    line = np.abs(np.array(arm.links[-1].axis, dtype=np.float64))
    across, begin = _square_to(line, rng), rng.uniform(0.3, 1.0)
    rim = np.sin(begin) * across + np.cos(begin) * line
    touches = np.cos(begin) * across - np.sin(begin) * line

    def make(size: float) -> Hidden:
        def load(force: Array, moment: Array, R: Array) -> tuple[Array, Array]:
            plumb = force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-9)
            lies = np.clip(np.einsum("ni,ni->n", R @ touches, plumb) / 0.1, 0.0, 1.0)
            return force, moment + np.cross(size * lies[:, None] * (R @ rim), force)

        return Hidden(loads=(load,))

    return Unknown("sling_over_rim", "load", "attitude", make, 5e-3, 0.1)


UNTOUCHED: tuple[Maker, ...] = (
    dropped_brake,
    skewed_ring,
    rubbing_teeth,
    slack_belt,
    dropped_pinion,
    told_load,
    spreading_mesh,
    sunny_side,
    worn_journal,
    rolling_carriage,
    hatch_in_column,
    loosening_bolts,
    loose_tongs,
    rolled_reflector,
    hall_heater,
    sling_over_rim,
)
