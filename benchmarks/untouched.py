"""Effects of the second generator that no library holds and that nothing has been developed on.

They were written by somebody who had not seen what is to find them, and differ in law from those of `touched.py` and
from the library's. A kind that needs a parallelogram hides nothing in an arm without one, so that another arm is drawn.
Whoever changes this file starts the record anew.
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
    beyond,
    came_by,
    drive,
    either_side,
    gear,
    middle_angle,
    softer,
    typical,
    vector,
)

# ---------------------------------------------------------------- drives


def scissor_pinion(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A split pinion's spring closes the play of its teeth, until a torque to one side beats it and the play is run
    through."""
    k = drive(arm, rng)
    side, spring = either_side(rng), rng.uniform(0.15, 0.5) * typical(arm, k)
    width = 0.05 * typical(arm, k)

    def law(T: Array, still: Rest) -> Array:
        return side * 0.5 * (1.0 + np.tanh((side * T - spring) / width))

    return Unknown("scissor_pinion", f"j{k + 1}", "own torque", gear(arm, k, law), 3e-5, 1.5e-3)


def soft_bar(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The bar of a parallelogram gives along its line: drive 3 gives more the flatter the loop stands."""

    def law(T: Array, still: Rest) -> Array:
        if not arm.lever:
            return 0.0 * T
        return T / np.maximum(np.cos(still.angles[:, 2]) ** 2, 0.02)

    c = arm.compliance[2]
    return Unknown("soft_bar", "j3", "torque x angle", gear(arm, 2, law), 0.02 * c, 0.5 * c)


def lunch_break(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A gear gives more as it warms up, cools down while people are at lunch, and warms up once more."""
    k, pause = drive(arm, rng), rng.uniform(0.35, 0.65)

    def law(T: Array, still: Rest) -> Array:
        order = still.visits.order
        since = np.where(order < pause, order, order - pause)
        return T * (1.0 - np.exp(-since / 0.15))

    return softer(arm, k, "lunch_break", "torque x order", law, 2.0)


def taut_harness(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The harness over the wrist is taut where the joint before has turned to one side, and then carries a part of a
    drive's torque."""
    k = drive(arm, rng, (4, 5))
    side, begin = either_side(rng), middle_angle(arm, k - 1, rng)

    def law(T: Array, still: Rest) -> Array:
        return -T * np.clip(side * (still.angles[:, k - 1] - begin) / 0.5, 0.0, 1.0)

    return softer(arm, k, "taut_harness", "other angle", law, 0.9)


def shared_box(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The gears of joints 2 and 3 are bolted to one box: beyond what the bolts hold, the torque of one drive turns the
    other."""
    k = drive(arm, rng, (1, 2))
    hold = rng.uniform(0.2, 0.6) * typical(arm, 3 - k)

    def law(T: Array, still: Rest) -> Array:
        return beyond(still.torque[:, 3 - k], hold)

    return softer(arm, k, "shared_box", "other torque", law, 2.0)


def hasty_reading(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The first reading is taken while a servo still creeps in: the joint is short of its target by a share of the way
    that it came, and is there when the load hangs."""
    k = drive(arm, rng)

    def law(T: Array, still: Rest) -> Array:
        return (still.visits.loaded - 1.0) * came_by(arm, still, k)

    return Unknown("hasty_reading", f"j{k + 1}", "approach", gear(arm, k, law), 1e-5, 1e-3)


def pressed_hose(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The pressure that is on while the load is held straightens a hose that the joint's own angle bends."""
    k = drive(arm, rng, (2, 4))
    most = arm.compliance[k] * typical(arm, k)

    def law(T: Array, still: Rest) -> Array:
        return -most * still.visits.loaded * np.tanh(still.angles[:, k] / 0.8)

    return Unknown("pressed_hose", f"j{k + 1}", "own angle", gear(arm, k, law), 0.01, 0.2)


# ---------------------------------------------------------------- bearings and links


def axial_float(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A bearing without its disc spring floats along the joint's axis, to the side to which the thrust along the axis
    pushes it."""
    k = drive(arm, rng, (1, 2, 3))
    soft = 0.15 * 9.81 * arm.payload

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * np.tanh(own / soft)

        return Hidden(springs=(Spring(k, "before", arm.links[k].axis, slide=True, law=law),))

    return Unknown("axial_float", f"j{k + 1}", "own torque", make, 3e-5, 1e-3)


def cracked_weld(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A crack along a link's weld opens where bending pulls it apart, and there the link twists more."""
    k = drive(arm, rng, (1, 2))
    line = np.array(arm.links[k + 1].origin, dtype=np.float64)
    line /= np.linalg.norm(line)
    across = next(link.axis for link in arm.links[k:] if abs(np.dot(link.axis, line)) < 0.5)
    bend = Spring(k, "after", across)
    side, begin = either_side(rng), rng.uniform(-0.2, 0.2) * typical(arm, k)
    soft = 0.1 * typical(arm, k)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * own * 0.5 * (1.0 + np.tanh(side * (still.springs[:, -1] - begin) / soft))

        return Hidden(springs=(Spring(k, "after", vector(line), law=law), bend))

    return Unknown("cracked_weld", f"l{k + 1}", "other torque", make, 0.1 * arm.compliance[k], 2.0 * arm.compliance[k])


# ---------------------------------------------------------------- base and floor


def missing_shim(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A foot of the pedestal has no shim: the arm rocks over the other feet until that one lands, and then no more."""
    axis, hold = any_level(rng), rng.uniform(0.2, 0.5) * typical(arm, 0)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * np.clip(own / hold, -1.0, 1.0)

        return Hidden(springs=(Spring(0, "foot", axis, law=law),))

    return Unknown("missing_shim", "base", "own torque", make, 1e-5, 5e-4)


def rocked_carriage(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The swing of joint 1 rocks the carriage below the base to one side of its rollers' play; the load's jolt rocks it
    back."""
    axis = any_level(rng)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * (1.0 - still.visits.loaded) * np.tanh(came_by(arm, still, 0) / 0.5)

        return Hidden(springs=(Spring(0, "foot", axis, law=law),))

    return Unknown("rocked_carriage", "base", "approach", make, 1e-5, 3e-4)


# ---------------------------------------------------------------- tool


def collision_guard(arm: Arm, rng: np.random.Generator) -> Unknown:
    """An overload clutch of the tool lifts out of its seat beyond the moment that its springs hold, to whichever
    side."""
    k = len(arm.links) - 1
    hold = rng.uniform(0.3, 0.7) * typical(arm, k)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            whole = np.hypot(still.springs[:, -1], still.springs[:, -2])
            return size * own * np.maximum(whole - hold, 0.0) / np.maximum(whole, hold)

        return Hidden(springs=tuple(Spring(k, "after", axis, law=law) for axis in axes_across(arm, k)))

    return Unknown("collision_guard", "tool", "own torque", make, 0.1 * arm.compliance[k], 3.0 * arm.compliance[k])


def gaping_changer(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A tool changer's lock gapes where the tool hangs straight down from it, and then tilts more by the moment."""
    k = len(arm.links) - 1
    face = np.abs(np.array(arm.links[k].axis, dtype=np.float64))

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            hangs = np.maximum((still.turned[:, -1] @ face) @ DOWN, 0.0)
            return size * own * hangs**2

        return Hidden(springs=tuple(Spring(k, "after", axis, law=law) for axis in axes_across(arm, k)))

    return Unknown("gaping_changer", "tool", "attitude", make, 0.1 * arm.compliance[k], 3.0 * arm.compliance[k])


# ---------------------------------------------------------------- markers, readings, load


def brushing_harness(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The tool's harness lies against a reflector where a wrist joint has turned to one side, and pushes it when the
    load pulls it tight."""
    m, k = int(rng.integers(len(arm.markers))), len(arm.links) - 1 - int(rng.integers(2))
    side, begin, way = either_side(rng), middle_angle(arm, k, rng), any_way(rng)

    def make(size: float) -> Hidden:
        def read(p: Array, still: Rest) -> Array:
            lies = np.clip(side * (still.angles[:, k] - begin) / 0.3, 0.0, 1.0)
            out = p.copy()
            out[:, m] += size * (still.visits.loaded * lies)[:, None] * (still.turned[:, -1] @ way)
            return out

        return Hidden(readings=(read,))

    return Unknown("brushing_harness", f"m{m + 1}", "other angle", make, 5e-5, 2e-3)


def sinking_tripod(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The tracker's tripod was set up just before: it still leans over from a reading to the next, less and less."""
    axis, lasting = any_way(rng) * [1.0, 1.0, 0.3], rng.uniform(0.15, 0.35)
    stands = np.array([rng.uniform(2.0, 5.0), rng.uniform(-2.0, 2.0), 0.5])

    def make(size: float) -> Hidden:
        def read(p: Array, still: Rest) -> Array:
            leans = still.visits.loaded * np.exp(-still.visits.order / lasting)
            return p + size * leans[:, None, None] * np.cross(axis, p - stands)

        return Hidden(readings=(read,))

    return Unknown("sinking_tripod", "readings", "order", make, 1e-5, 3e-4)


def forgotten_tackle(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Hook, chain and pan were not weighed: they pull straight down by the same weight under a small load as under a
    large one."""
    full = 9.81 * arm.payload

    def make(size: float) -> Hidden:
        def load(force: Array, moment: Array, R: Array) -> tuple[Array, Array]:
            hangs = np.linalg.norm(force, axis=1, keepdims=True) > 0.0
            return force + size * full * hangs * DOWN, moment

        return Hidden(loads=(load,))

    return Unknown("forgotten_tackle", "load", "load", make, 0.01, 0.15)


UNTOUCHED: tuple[Maker, ...] = (
    scissor_pinion,
    soft_bar,
    lunch_break,
    taut_harness,
    shared_box,
    hasty_reading,
    pressed_hose,
    axial_float,
    cracked_weld,
    missing_shim,
    rocked_carriage,
    collision_guard,
    gaping_changer,
    brushing_harness,
    sinking_tripod,
    forgotten_tackle,
)
