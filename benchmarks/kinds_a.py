"""Sixteen effects of the second generator that no library holds: the first of four sets of like difficulty.

They were written by somebody who had not seen what is to find them: memory, thresholds, hidden states and smooth laws,
at drives, bearings, links, base, tool, a marker, the load and the readings. None is in `touched.py`, `untouched.py` or
the other sets.
"""

from __future__ import annotations

import numpy as np
from independent_arm import Arm, Array, Hidden, Rest, moved
from unknown import (
    DOWN,
    Maker,
    Unknown,
    across,
    any_level,
    any_way,
    beyond,
    borne,
    carried,
    dragged,
    drive,
    either_side,
    gear,
    line_of,
    main_compliance,
    of_payload,
    one_across,
    rises,
    shifted_marker,
    softer,
    span,
    springs,
    station,
    tracker,
    typical,
    vector,
)

# ---------------------------------------------------------------- drives


def dragged_seal(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The lip of a shaft's seal is dragged along and pulls the joint back, until the load shakes it free."""
    k = drive(arm, rng)
    wide = rng.uniform(0.2, 0.4) * span(arm, k)

    def law(T: Array, still: Rest) -> Array:
        angle = arm.joints(still.visits.shown)[:, k]
        return (still.visits.loaded - 1.0) * (angle - dragged(still, angle, wide)) / wide

    return Unknown("dragged_seal", f"j{k + 1}", "hysteresis", gear(arm, k, law), 1e-5, 4e-4)


def strained_bolts(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Each load beyond what they hold strains the bolts of a gear's ring a little more, and the drive gives more."""
    k = drive(arm, rng)
    hold, soon = rng.uniform(0.2, 0.5) * borne(arm, k), rng.uniform(2.0, 5.0)

    def law(T: Array, still: Rest) -> Array:
        more = np.abs(beyond(T, hold)) / hold
        strained = carried(still, lambda so_far, i: so_far + float(more[i]))
        return still.visits.loaded * T * np.tanh(strained / soon)

    return softer(arm, k, "strained_bolts", "torque x order", law, 2.0)


def cup_springs(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A worm is held between two packs of cup springs: it gives beyond their preload, either way, until they bottom."""
    k = drive(arm, rng)
    preload, travel = rng.uniform(0.1, 0.3) * borne(arm, k), rng.uniform(0.2, 0.5) * borne(arm, k)

    def law(T: Array, still: Rest) -> Array:
        return np.clip(beyond(T, preload), -travel, travel)

    return softer(arm, k, "cup_springs", "own torque", law, 3.0)


def jumped_tooth(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A belt runs over a wheel off its centre and jumps some teeth at one visit: its law of the angle is turned."""
    k, phase, when = drive(arm, rng), rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.3, 0.7)
    jump = either_side(rng) * rng.uniform(0.8, 2.0)

    def law(T: Array, still: Rest) -> Array:
        return T * np.cos(still.angles[:, k] + phase + jump * (still.visits.order >= when))

    return softer(arm, k, "jumped_tooth", "torque x angle", law, 0.9)


def pressed_helix(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The next drive's torque pushes a helical pinion along its axis, into mesh to one side and out to the other."""
    k, side = drive(arm, rng), either_side(rng)
    full = 0.4 * typical(arm, k + 1)

    def law(T: Array, still: Rest) -> Array:
        return T * np.tanh(side * still.torque[:, k + 1] / full)

    return softer(arm, k, "pressed_helix", "other torque", law, 0.9)


def jamming_rod(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A counterbalance's rod jams when joint 2 has been far down and then bears a share, until that was far up."""
    low, high = np.deg2rad(arm.links[1].limits)
    free, jams = low + rng.uniform(0.3, 0.45) * (high - low), low + rng.uniform(0.6, 0.75) * (high - low)

    def law(T: Array, still: Rest) -> Array:
        lean = still.visits.shown[:, 1]
        return -T * carried(still, lambda jammed, i: 1.0 if lean[i] > jams else 0.0 if lean[i] < free else jammed)

    return softer(arm, 1, "jamming_rod", "torque x angle", law, 0.9)


# ---------------------------------------------------------------- bearings and links


def loose_race(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Beyond a moment, either way, a bearing's preload is gone and it tilts at once through its clearance."""
    k = drive(arm, rng, (1, 2, 3))
    hold, width = rng.uniform(0.03, 0.12) * typical(arm, k), 0.02 * typical(arm, k)

    def law(own: Array, still: Rest) -> Array:
        return rises(own, hold, width) - rises(-own, hold, width)

    make = springs(k, "before", (one_across(arm, k, rng),), law)
    return Unknown("loose_race", f"j{k + 1}", "own torque", make, 2e-5, 8e-4)


def bulging_wall(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The next drive sits on a thin wall of the link, which bulges, and kinks its end, only under torques inwards."""
    k, inwards = drive(arm, rng, (1, 2, 3)), either_side(rng)
    line, c = line_of(arm, k), arm.compliance[k + 1]

    def law(own: Array, still: Rest) -> Array:
        return np.maximum(inwards * still.torque[:, k + 1], 0.0)

    make = springs(k, "after", (across(line, rng),), law, at=vector(line))
    return Unknown("bulging_wall", f"l{k + 1}", "other torque", make, 0.05 * c, 1.0 * c)


def sheared_dowel(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A dowel in a link's flange shears at one of the readings: from there on the link bends more."""
    k, when, c = drive(arm, rng, (1, 2)), rng.uniform(0.3, 0.7), main_compliance(arm)
    line = line_of(arm, k)

    def law(own: Array, still: Rest) -> Array:
        return own * (still.visits.order >= when)

    make = springs(k, "after", (across(line, rng),), law, at=vector(0.5 * line))
    return Unknown("sheared_dowel", f"l{k + 1}", "torque x order", make, 0.05 * c, 1.0 * c)


# ---------------------------------------------------------------- base and tool


def stretched_anchor(arm: Arm, rng: np.random.Generator) -> Unknown:
    """An anchor is stretched by the largest moment so far, and lets the base tilt under load to its side."""
    side, hold, c = either_side(rng), rng.uniform(0.2, 0.5) * typical(arm, 0), main_compliance(arm)

    def law(own: Array, still: Rest) -> Array:
        pull = np.maximum(side * own, 0.0)
        largest = carried(still, lambda so_far, i: max(so_far, float(pull[i])))
        return side * still.visits.loaded * pull * np.clip(largest / hold - 1.0, 0.0, 1.5)

    make = springs(0, "foot", (any_level(rng),), law)
    return Unknown("stretched_anchor", "base", "torque x order", make, 0.01 * c, 0.5 * c)


def grout_wedge(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The grout below the base is thicker on one side, where the base tilts more than its mean, and less opposite."""
    thick, c = rng.uniform(-2.0, 2.0), main_compliance(arm)

    def law(own: Array, still: Rest) -> Array:
        return own * np.cos(still.angles[:, 0] - thick)

    make = springs(0, "foot", ((1, 0, 0), (0, 1, 0)), law)
    return Unknown("grout_wedge", "base", "other angle", make, 0.01 * c, 0.3 * c)


def telescoping_tool(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A tool on a spring slides along its axis beyond the preload to one side, until the spring bottoms."""
    k, side, weight = len(arm.links) - 1, either_side(rng), 9.81 * arm.payload
    preload, travel = rng.uniform(0.1, 0.3) * weight, rng.uniform(0.2, 0.4) * weight

    def law(own: Array, still: Rest) -> Array:
        return side * np.clip(side * own - preload, 0.0, travel) / travel

    make = springs(k, "after", (arm.links[k].axis,), law, slide=True)
    return Unknown("telescoping_tool", "tool", "own torque", make, 5e-5, 2e-3)


# ---------------------------------------------------------------- marker, load, readings


def wandering_nest(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A magnet's nest stays where the pulls of the loads have dragged it to; without load it snaps home."""
    m, way, wide = int(rng.integers(len(arm.markers))), any_way(rng), rng.uniform(0.2, 0.4)

    def law(still: Rest) -> Array:
        along = moved(still.turned[:, -1], way)
        pull = np.einsum("ni,ni->n", along, still.visits.force) / (9.81 * arm.payload)
        return (still.visits.loaded * dragged(still, pull, wide))[:, None] * along

    return Unknown("wandering_nest", f"m{m + 1}", "direction of the force", shifted_marker(m, law), 5e-5, 1e-3)


def half_full_tank(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The load is a tank that is not full: its weight runs to the low side of the tool."""
    axis = arm.links[-1].axis

    def make(size: float) -> Hidden:
        def load(force: Array, moment: Array, R: Array) -> tuple[Array, Array]:
            up = moved(R, axis)
            low = DOWN - (up @ DOWN)[:, None] * up
            return force, moment + np.cross(size * low, force)

        return Hidden(loads=(load,))

    return Unknown("half_full_tank", "load", "attitude", make, 0.01, 0.1)


def clipped_cell(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A load cell saturates: what pulls beyond a part of the payload is more than the table says."""
    ends = rng.uniform(0.5, 0.75)

    def make(size: float) -> Hidden:
        def load(force: Array, moment: Array, R: Array) -> tuple[Array, Array]:
            more = np.maximum(of_payload(arm, force) - ends, 0.0) / (1.0 - ends)
            return force * (1.0 + size * more)[:, None], moment

        return Hidden(loads=(load,))

    return Unknown("clipped_cell", "load", "load", make, 0.03, 0.4)


def relieved_floor(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The load stood on the floor beside the tracker, which leans back by the weight that is lifted from there."""
    axis = np.array(any_level(rng))

    def law(p: Array, still: Rest) -> Array:
        return of_payload(arm, still.visits.force)[:, None] * axis

    return Unknown("relieved_floor", "readings", "load", tracker(law, station(rng)), 5e-6, 2e-4)


KINDS_A: tuple[Maker, ...] = (
    dragged_seal,
    strained_bolts,
    cup_springs,
    jumped_tooth,
    pressed_helix,
    jamming_rod,
    loose_race,
    bulging_wall,
    sheared_dowel,
    stretched_anchor,
    grout_wedge,
    telescoping_tool,
    wandering_nest,
    half_full_tank,
    clipped_cell,
    relieved_floor,
)
