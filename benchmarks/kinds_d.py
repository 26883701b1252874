"""Sixteen effects of the second generator that no library holds: the fourth of four sets of like difficulty.

They were written by somebody who had not seen what is to find them: memory, thresholds, hidden states and smooth laws,
at drives, bearings, links, base, tool, a marker, the load and the readings. None is in the other three sets.
"""

from __future__ import annotations

import numpy as np
from independent_arm import Arm, Array, Hidden, Rest, Visits, moved
from unknown import (
    DOWN,
    Maker,
    Unknown,
    across,
    any_level,
    any_way,
    borne,
    came_by,
    carried,
    dragged,
    drive,
    either_side,
    line_of,
    main_compliance,
    middle_angle,
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


def _arrives(still: Rest) -> Array:
    """1 (N,) at the first reading of each visit, 0 at the others."""
    rows, number = np.argsort(still.visits.order, kind="stable"), still.visits.number
    out = np.ones(len(rows))
    out[rows[1:]] = number[rows[1:]] != number[rows[:-1]]
    return out


# ---------------------------------------------------------------- drives


def dry_teeth(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Short moves bring no fresh oil between a gear's teeth: the shorter the last one, the more the drive gives."""
    k = drive(arm, rng)
    short = rng.uniform(0.15, 0.3) * span(arm, k)

    def law(T: Array, still: Rest) -> Array:
        return T * np.exp(-np.abs(came_by(arm, still, k)) / short)

    return softer(arm, k, "dry_teeth", "approach", law, 2.0)


def rubber_coupling(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A rubber coupling follows its torque slowly: it gives by a mean of the torques so far, of which the old fade."""
    k, keeps = drive(arm, rng), rng.uniform(0.5, 0.8)

    def law(T: Array, still: Rest) -> Array:
        first = T[np.argmin(still.visits.order)]
        return first + carried(still, lambda mean, i: keeps * mean + (1.0 - keeps) * float(T[i] - first))

    return softer(arm, k, "rubber_coupling", "hysteresis", law, 2.0)


def tooth_by_tooth(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The teeth of a spline seat one after the other as the torque winds it up, so that it gives by soft steps."""
    k = drive(arm, rng)
    step, phase = rng.uniform(0.4, 0.8) * borne(arm, k), rng.uniform(0.0, 2.0 * np.pi)

    def law(T: Array, still: Rest) -> Array:
        return step / (2.0 * np.pi) * np.sin(2.0 * np.pi * T / step + phase)

    return softer(arm, k, "tooth_by_tooth", "own torque", law, 2.0)


def soft_half(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A gear's ring is joined of two halves, of which one was not hardened: beyond the seam the drive gives more."""
    k, side = drive(arm, rng), either_side(rng)
    seam, width = middle_angle(arm, k, rng), 0.01 * span(arm, k)

    def law(T: Array, still: Rest) -> Array:
        return T * rises(side * still.angles[:, k], side * seam, width)

    return softer(arm, k, "soft_half", "torque x angle", law, 1.5)


def ovalised_ring(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The torque of the drive before, of either sign, presses a gear's ring oval, and the drive gives the more."""
    k = drive(arm, rng, (2, 3, 4, 5))

    def law(T: Array, still: Rest) -> Array:
        return T * np.abs(still.torque[:, k - 1]) / typical(arm, k - 1)

    return softer(arm, k, "ovalised_ring", "other torque", law, 2.0)


def taut_cable(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Beyond an angle of the next joint a cable is taut and turns an encoder's housing: the joint is not as shown."""
    k, side, turned = drive(arm, rng, (1, 2)), either_side(rng), either_side(rng)
    taut, far = middle_angle(arm, k + 1, rng), 0.25 * span(arm, k + 1)
    one = turned * np.eye(len(arm.links))[k]

    def make(size: float) -> Hidden:
        def pulled(q: Array, visits: Visits) -> Array:
            return (size * np.maximum(side * (q[:, k + 1] - taut), 0.0) / far)[:, None] * one

        return Hidden(angles=(pulled,))

    return Unknown("taut_cable", f"j{k + 1}", "other angle", make, 2e-3, 4e-2)


# ---------------------------------------------------------------- bearings and links


def barrelled_rollers(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A bearing's barrelled rollers touch along ever more of their length: it stiffens as the moment grows."""
    k, c = drive(arm, rng, (1, 2, 3)), arm.compliance
    soft = rng.uniform(0.02, 0.08) * typical(arm, k)

    def law(own: Array, still: Rest) -> Array:
        return own / np.sqrt(1.0 + np.abs(own) / soft)

    make = springs(k, "before", (one_across(arm, k, rng),), law)
    return Unknown("barrelled_rollers", f"j{k + 1}", "own torque", make, 0.1 * c[k], 2.0 * c[k])


def pressed_out_grease(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Each load presses some grease out of a bearing, which tilts the more by the load; a long swing brings it back."""
    k, c = drive(arm, rng, (1, 2, 3)), arm.compliance
    long, much = rng.uniform(0.2, 0.4) * span(arm, k), rng.uniform(0.6, 1.5) * typical(arm, k)

    def law(own: Array, still: Rest) -> Array:
        swings = _arrives(still) * np.abs(came_by(arm, still, k)) > long
        more = still.visits.loaded * np.abs(own) / much
        pressed = carried(still, lambda so_far, i: float(more[i]) + (0.0 if swings[i] else so_far))
        return still.visits.loaded * own * np.tanh(pressed)

    make = springs(k, "before", (one_across(arm, k, rng),), law)
    return Unknown("pressed_out_grease", f"j{k + 1}", "hysteresis", make, 0.1 * c[k], 2.0 * c[k])


def growing_crack(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A crack in a link's weld opens under moments to one side only, and each opening makes it longer."""
    k, side, c = drive(arm, rng, (1, 2)), either_side(rng), main_compliance(arm)
    line, much, soon = line_of(arm, k), 0.2 * typical(arm, k), rng.uniform(3.0, 8.0)

    def law(own: Array, still: Rest) -> Array:
        opens = np.maximum(side * own, 0.0)
        grown = carried(still, lambda so_far, i: so_far + float(np.tanh(opens[i] / much)))
        return side * opens * np.tanh(grown / soon)

    make = springs(k, "after", (across(line, rng),), law, at=vector(0.5 * line))
    return Unknown("growing_crack", f"l{k + 1}", "torque x order", make, 0.05 * c, 1.0 * c)


# ---------------------------------------------------------------- base and tool


def three_feet(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The base stands on three feet: it tilts more where joint 1 turns the arm between two, and less above one."""
    foot, c = rng.uniform(0.0, 2.0 * np.pi / 3.0), main_compliance(arm)

    def law(own: Array, still: Rest) -> Array:
        return 0.5 * own * (1.0 - np.cos(3.0 * (still.angles[:, 0] - foot)))

    make = springs(0, "foot", ((1, 0, 0), (0, 1, 0)), law)
    return Unknown("three_feet", "base", "other angle", make, 0.01 * c, 0.4 * c)


def dragged_sledge(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The base is clamped on rails: pulls along them that beat the friction drag it on, and it stays until the next."""
    weight = 9.81 * arm.payload
    friction = rng.uniform(0.1, 0.3) * weight

    def law(own: Array, still: Rest) -> Array:
        return dragged(still, own, friction) / weight

    make = springs(0, "foot", (any_level(rng),), law, slide=True)
    return Unknown("dragged_sledge", "base", "hysteresis", make, 5e-5, 1.5e-3)


def floating_gripper(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A gripper with play leans to where the wrist's last move threw it, until the load pulls it straight."""
    k = len(arm.links) - 1
    by, axis = drive(arm, rng, (3, 4)), one_across(arm, k, rng)
    soon = rng.uniform(0.1, 0.25) * span(arm, by)

    def law(own: Array, still: Rest) -> Array:
        return (1.0 - still.visits.loaded) * np.tanh(came_by(arm, still, by) / soon)

    make = springs(k, "after", (axis,), law)
    return Unknown("floating_gripper", "tool", "approach", make, 3e-5, 1e-3)


# ---------------------------------------------------------------- marker, load, readings


def brushed_holder(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The load's sling lies against a reflector's holder, and pushes it away, where it pulls to that side."""
    m, way = int(rng.integers(len(arm.markers))), any_way(rng)

    def law(still: Rest) -> Array:
        along = moved(still.turned[:, -1], way)
        pull = np.einsum("ni,ni->n", along, still.visits.force) / (9.81 * arm.payload)
        return np.maximum(pull, 0.0)[:, None] * along

    return Unknown("brushed_holder", f"m{m + 1}", "direction of the force", shifted_marker(m, law), 5e-5, 1e-3)


def tipped_eye(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The eye in which the load hangs tips over to one side of the tool as soon as that leans beyond an angle."""
    side, lever, tips = any_way(rng), any_way(rng), rng.uniform(-0.3, 0.3)

    def make(size: float) -> Hidden:
        def load(force: Array, moment: Array, R: Array) -> tuple[Array, Array]:
            over = rises(moved(R, side) @ DOWN, tips, 0.05)
            return force, moment + np.cross((size * over)[:, None] * moved(R, lever), force)

        return Hidden(loads=(load,))

    return Unknown("tipped_eye", "load", "attitude", make, 0.01, 0.12)


def bowed_cell(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A load cell is right at nothing and at the payload and bowed between: half loads are not what the table says."""
    side = either_side(rng)

    def make(size: float) -> Hidden:
        def load(force: Array, moment: Array, R: Array) -> tuple[Array, Array]:
            return force * (1.0 + side * size * (1.0 - of_payload(arm, force)))[:, None], moment

        return Hidden(loads=(load,))

    return Unknown("bowed_cell", "load", "load", make, 0.03, 0.4)


def shared_slab(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The tracker stands on the arm's own slab, which bends to where the arm reaches, by the torque of joint 2."""

    def law(p: Array, still: Rest) -> Array:
        about = moved(still.turned[:, 1], arm.links[1].axis)
        return (still.torque[:, 1] / typical(arm, 1))[:, None] * about

    return Unknown("shared_slab", "readings", "other torque", tracker(law, station(rng)), 5e-6, 2e-4)


KINDS_D: tuple[Maker, ...] = (
    dry_teeth,
    rubber_coupling,
    tooth_by_tooth,
    soft_half,
    ovalised_ring,
    taut_cable,
    barrelled_rollers,
    pressed_out_grease,
    growing_crack,
    three_feet,
    dragged_sledge,
    floating_gripper,
    brushed_holder,
    tipped_eye,
    bowed_cell,
    shared_slab,
)
