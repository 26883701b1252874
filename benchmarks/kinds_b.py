"""Sixteen effects of the second generator that no library holds: the second of four sets of like difficulty.

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
    came_by,
    carried,
    drive,
    either_side,
    gear,
    line_of,
    main_compliance,
    middle_angle,
    of_payload,
    one_across,
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


def twisted_hose(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A hose is wound up by the moves of a joint, forgets each only after some more, and lets go under the load."""
    k, keeps = drive(arm, rng, (2, 3, 4, 5)), rng.uniform(0.4, 0.7)

    def law(T: Array, still: Rest) -> Array:
        came = came_by(arm, still, k)
        wound = carried(still, lambda so_far, i: keeps * so_far + float(came[i]))
        return (still.visits.loaded - 1.0) * np.tanh(2.0 * wound / span(arm, k))

    return Unknown("twisted_hose", f"j{k + 1}", "approach", gear(arm, k, law), 1e-5, 4e-4)


def fretted_spline(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Each time that a load turns a drive's torque to the other side its spline frets, and gives more under load."""
    k, often = drive(arm, rng), rng.uniform(3.0, 6.0)
    width = 0.05 * borne(arm, k)

    def law(T: Array, still: Rest) -> Array:
        rows = np.argsort(still.visits.order, kind="stable")
        sides = np.tanh(T[rows] / width)
        turned = np.zeros_like(T)
        turned[rows] = 0.5 * np.cumsum(np.abs(np.diff(sides, prepend=sides[:1])))
        return still.visits.loaded * T * np.tanh(turned / often)

    return softer(arm, k, "fretted_spline", "torque x order", law, 2.0)


def touching_buffer(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Beyond a torque, either way, a drive's casing touches rubber buffers, which bear a share of what is more."""
    k = drive(arm, rng)
    touches = rng.uniform(0.2, 0.5) * borne(arm, k)

    def law(T: Array, still: Rest) -> Array:
        return -beyond(T, touches)

    return softer(arm, k, "touching_buffer", "own torque", law, 0.9)


def segment_ends(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A drive turns a segment in place of a whole ring, which gives ever more towards its two free ends."""
    k = drive(arm, rng, (1, 2, 4))
    middle = float(np.deg2rad(np.mean(arm.links[k].limits))) + rng.uniform(-0.1, 0.1) * span(arm, k)

    def law(T: Array, still: Rest) -> Array:
        return T * (2.0 * (still.angles[:, k] - middle) / span(arm, k)) ** 2

    return softer(arm, k, "segment_ends", "torque x angle", law, 2.0)


def idler_bracket(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A wrist's belt runs over an idler on the joint before, which slackens or tightens it as that joint turns."""
    k, phase = drive(arm, rng, (3, 4, 5)), rng.uniform(0.0, 2.0 * np.pi)

    def law(T: Array, still: Rest) -> Array:
        return T * np.sin(still.angles[:, k - 1] + phase)

    return softer(arm, k, "idler_bracket", "other angle", law, 0.9)


def one_way_rod(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A counterbalance's rod sticks after a way down of joint 2 and bears a share, until a long way up frees it."""
    long, short = rng.uniform(0.15, 0.35) * span(arm, 1), 0.05 * span(arm, 1)

    def law(T: Array, still: Rest) -> Array:
        came = came_by(arm, still, 1)
        return -T * carried(still, lambda sticks, i: 1.0 if came[i] > short else 0.0 if came[i] < -long else sticks)

    return softer(arm, 1, "one_way_rod", "hysteresis", law, 0.9)


def dry_upper_end(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A wrist gear's oil runs to its lower end: the steeper its axis stands, the more its dry end gives."""
    k = drive(arm, rng, (3, 4, 5))
    axis = arm.links[k].axis

    def law(T: Array, still: Rest) -> Array:
        return T * (moved(still.turned[:, k], axis) @ DOWN) ** 2

    return softer(arm, k, "dry_upper_end", "attitude", law, 2.0)


# ---------------------------------------------------------------- bearings and links


def snap_ring(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A thrust to one side that beats the friction pushes a bearing along its seat, up to the snap ring."""
    k, side, weight = drive(arm, rng, (1, 2, 3)), either_side(rng), 9.81 * arm.payload
    friction, free = rng.uniform(0.05, 0.15) * weight, rng.uniform(0.1, 0.2) * weight

    def law(own: Array, still: Rest) -> Array:
        return side * np.clip(side * own - friction, 0.0, free) / free

    make = springs(k, "before", (arm.links[k].axis,), law, slide=True)
    return Unknown("snap_ring", f"j{k + 1}", "own torque", make, 3e-5, 1e-3)


def racked_frame(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A link of two plates is racked sideways by the force, most where the next joint stands at one angle."""
    k = drive(arm, rng, (1, 2))
    line, most = line_of(arm, k), middle_angle(arm, k + 1, rng)
    c = main_compliance(arm) * float(line @ line)

    def law(own: Array, still: Rest) -> Array:
        return own * np.cos(still.angles[:, k + 1] - most) ** 2

    make = springs(k, "after", (across(line, rng),), law, slide=True)
    return Unknown("racked_frame", f"l{k + 1}", "other angle", make, 0.05 * c, 2.0 * c)


def hot_motor(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The next joint's moves heat a motor on one side of a link, which is bent until it has cooled below the load."""
    k, keeps = drive(arm, rng, (1, 2)), rng.uniform(0.2, 0.5)
    line = line_of(arm, k)

    def law(own: Array, still: Rest) -> Array:
        came = np.abs(came_by(arm, still, k + 1)) / span(arm, k + 1)
        return (still.visits.loaded - 1.0) * carried(still, lambda heat, i: keeps * heat + float(came[i]))

    make = springs(k, "after", (across(line, rng),), law, at=vector(0.5 * line))
    return Unknown("hot_motor", f"l{k + 1}", "approach", make, 1e-5, 4e-4)


# ---------------------------------------------------------------- base and tool


def unequal_anchors(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The anchors of the base's two sides were tightened differently: each lets it lift beyond a moment of its own."""
    first, second = rng.uniform(0.15, 0.5, 2) * typical(arm, 0)
    share, c = rng.uniform(0.3, 0.7), main_compliance(arm)

    def law(own: Array, still: Rest) -> Array:
        return np.maximum(own - first, 0.0) - share * np.maximum(-own - second, 0.0)

    make = springs(0, "foot", (any_level(rng),), law)
    return Unknown("unequal_anchors", "base", "own torque", make, 0.02 * c, 0.5 * c)


def walking_wedge(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The swings of joint 1 walk a levelling wedge out from below the base, which gives more with the way swung."""
    far, c = rng.uniform(8.0, 20.0), main_compliance(arm)

    def law(own: Array, still: Rest) -> Array:
        swung = np.abs(came_by(arm, still, 0))
        return own * np.tanh(carried(still, lambda so_far, i: so_far + float(swung[i])) / far)

    make = springs(0, "foot", (any_level(rng),), law)
    return Unknown("walking_wedge", "base", "torque x order", make, 0.02 * c, 0.4 * c)


def cracked_adapter(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The tool's adapter cracks at one of the readings: from there on it tilts when it is bent to that side."""
    k, side, when = len(arm.links) - 1, either_side(rng), rng.uniform(0.3, 0.7)

    def law(own: Array, still: Rest) -> Array:
        return side * np.maximum(side * own, 0.0) * (still.visits.order >= when)

    make = springs(k, "after", (one_across(arm, k, rng),), law)
    return Unknown("cracked_adapter", "tool", "torque x order", make, 0.2 * arm.compliance[k], 3.0 * arm.compliance[k])


# ---------------------------------------------------------------- marker, load, readings


def dished_plate(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A reflector sits beside the hook on a plate, which large loads draw in more than in proportion."""
    m, way = int(rng.integers(len(arm.markers))), any_way(rng)

    def law(still: Rest) -> Array:
        return (of_payload(arm, still.visits.force) ** 2)[:, None] * moved(still.turned[:, -1], way)

    return Unknown("dished_plate", f"m{m + 1}", "load", shifted_marker(m, law), 3e-5, 8e-4)


def short_cell(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The cell in the rope to one side reads too little: pulls to that side, and no others, are larger than written."""
    way = np.array(any_level(rng))

    def make(size: float) -> Hidden:
        def load(force: Array, moment: Array, R: Array) -> tuple[Array, Array]:
            return force + size * np.maximum(force @ way, 0.0)[:, None] * way, moment

        return Hidden(loads=(load,))

    return Unknown("short_cell", "load", "direction of the force", make, 0.05, 0.5)


def crane_side(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The winch that pulls sideways stands on the tracker's floor, which leans to the side of its pull."""

    def law(p: Array, still: Rest) -> Array:
        return np.cross(DOWN, still.visits.force) / (9.81 * arm.payload)

    return Unknown("crane_side", "readings", "direction of the force", tracker(law, station(rng)), 1e-5, 3e-4)


KINDS_B: tuple[Maker, ...] = (
    twisted_hose,
    fretted_spline,
    touching_buffer,
    segment_ends,
    idler_bracket,
    one_way_rod,
    dry_upper_end,
    snap_ring,
    racked_frame,
    hot_motor,
    unequal_anchors,
    walking_wedge,
    cracked_adapter,
    dished_plate,
    short_cell,
    crane_side,
)
