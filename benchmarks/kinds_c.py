"""Sixteen effects of the second generator that no library holds: the third of four sets of like difficulty.

They were written by somebody who had not seen what is to find them: memory, thresholds, hidden states and smooth laws,
at drives, bearings, links, base, tool, a marker, the load and the readings. None is in `touched.py`, `untouched.py` or
the other sets.
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
    axes_across,
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


def _before(still: Rest, value: Array) -> Array:
    """A value (N,) of the state that was read before; its own at the first."""
    rows = np.argsort(still.visits.order, kind="stable")
    out = np.empty_like(value)
    out[rows] = value[np.concatenate([rows[:1], rows[:-1]])]
    return out


# ---------------------------------------------------------------- drives


def kept_flank(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A gear rests on the flank on which its last long move put it; short moves leave it there, the load does not."""
    k = drive(arm, rng)
    long = rng.uniform(0.2, 0.35) * span(arm, k)

    def law(T: Array, still: Rest) -> Array:
        came = came_by(arm, still, k)
        return (still.visits.loaded - 1.0) * carried(
            still, lambda flank, i: float(np.sign(came[i])) if abs(came[i]) > long else flank
        )

    return Unknown("kept_flank", f"j{k + 1}", "approach", gear(arm, k, law), 1e-5, 4e-4)


def reversed_load(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Rollers have to bed in anew: a drive gives more under a load whose torque has the other side than the last."""
    k = drive(arm, rng)
    width = rng.uniform(0.1, 0.3) * borne(arm, k)

    def law(T: Array, still: Rest) -> Array:
        return 0.5 * still.visits.loaded * T * (1.0 - np.tanh(T * _before(still, T) / width**2))

    return softer(arm, k, "reversed_load", "hysteresis", law, 2.0)


def yielding_key(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A shaft's key, held by a press fit up to a torque, gives by the square of what is more, either way."""
    k = drive(arm, rng)
    holds = rng.uniform(0.1, 0.35) * borne(arm, k)

    def law(T: Array, still: Rest) -> Array:
        more = beyond(T, holds)
        return more * np.abs(more) / borne(arm, k)

    return softer(arm, k, "yielding_key", "own torque", law, 3.0)


def capstan_belt(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A belt winds on its pulley as the joint turns to one side and grips exponentially: the drive gives ever less."""
    k, side = drive(arm, rng), either_side(rng)
    middle, turns = float(np.deg2rad(np.mean(arm.links[k].limits))), rng.uniform(0.25, 0.5) * span(arm, k)

    def law(T: Array, still: Rest) -> Array:
        return T * np.exp(-side * (still.angles[:, k] - middle) / turns)

    return softer(arm, k, "capstan_belt", "torque x angle", law, 1.5)


def pushed_bracket(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The torque of the drive before, of either sign, pushes a drive's bracket to one side, by its square."""
    k, side = drive(arm, rng, (2, 3, 4, 5)), either_side(rng)

    def law(T: Array, still: Rest) -> Array:
        return side * still.torque[:, k - 1] ** 2 / typical(arm, k - 1)

    return softer(arm, k, "pushed_bracket", "other torque", law, 1.5)


def slipped_clutch(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A clutch slips by a tooth on the way to one of the poses: from there on the joint is not where it is shown."""
    k, when, side = drive(arm, rng, (1, 2)), rng.uniform(0.3, 0.7), either_side(rng)
    one = side * np.eye(len(arm.links))[k]

    def make(size: float) -> Hidden:
        def slip(q: Array, visits: Visits) -> Array:
            return (size * (visits.number >= when * visits.number.max()))[:, None] * one

        return Hidden(angles=(slip,))

    return Unknown("slipped_clutch", f"j{k + 1}", "order", make, 2e-3, 4e-2)


# ---------------------------------------------------------------- bearings and links


def tight_arc(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A bearing is tight on one arc: the farther its joint is from there, the smaller moments open its clearance."""
    k, c = drive(arm, rng, (1, 2, 3)), arm.compliance
    tight, holds = middle_angle(arm, k, rng), rng.uniform(0.04, 0.12) * typical(arm, k)

    def law(own: Array, still: Rest) -> Array:
        hold = holds * (1.0 + 0.8 * np.cos(still.angles[:, k] - tight))
        return np.sign(own) * np.maximum(np.abs(own) - hold, 0.0)

    make = springs(k, "before", (one_across(arm, k, rng),), law)
    return Unknown("tight_arc", f"j{k + 1}", "torque x angle", make, 0.1 * c[k], 2.0 * c[k])


def leaf_stack(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A link of stacked plates bends more where they stand upright, and gravity does not press them together."""
    k, c = drive(arm, rng, (1, 2)), main_compliance(arm)
    line = line_of(arm, k)
    axis = across(line, rng)
    normal = np.cross(line / np.linalg.norm(line), axis)

    def law(own: Array, still: Rest) -> Array:
        return own * (1.0 - (moved(still.turned[:, k], normal) @ DOWN) ** 2)

    make = springs(k, "after", (axis,), law, at=vector(0.5 * line))
    return Unknown("leaf_stack", f"l{k + 1}", "attitude", make, 0.05 * c, 1.0 * c)


def popping_panel(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Under load a link's panel pops in beyond a bending moment, kinks the link, and pops back beyond an opposite."""
    k = drive(arm, rng, (1, 2))
    line, pops = line_of(arm, k), rng.uniform(0.02, 0.08) * typical(arm, k)

    def law(own: Array, still: Rest) -> Array:
        return still.visits.loaded * carried(
            still, lambda side, i: float(np.sign(own[i])) if abs(own[i]) > pops else side
        )

    make = springs(k, "after", (across(line, rng),), law, at=vector(0.5 * line))
    return Unknown("popping_panel", f"l{k + 1}", "own torque", make, 2e-5, 5e-4)


# ---------------------------------------------------------------- base and tool


def lost_nut(arm: Arm, rng: np.random.Generator) -> Unknown:
    """An anchor loses its nut at one of the readings: from there on the base lifts beyond a moment on that side."""
    side, when, c = either_side(rng), rng.uniform(0.3, 0.7), main_compliance(arm)
    holds = rng.uniform(0.0, 0.2) * typical(arm, 0)

    def law(own: Array, still: Rest) -> Array:
        return side * np.maximum(side * own - holds, 0.0) * (still.visits.order >= when)

    make = springs(0, "foot", (any_level(rng),), law)
    return Unknown("lost_nut", "base", "torque x order", make, 0.02 * c, 0.5 * c)


def rubber_pads(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The base stands on rubber pads, which stiffen the more they are pressed, to either side."""
    soft, c = rng.uniform(0.15, 0.4) * typical(arm, 0), main_compliance(arm)

    def law(own: Array, still: Rest) -> Array:
        return soft * np.arctan(own / soft)

    make = springs(0, "foot", ((1, 0, 0), (0, 1, 0)), law)
    return Unknown("rubber_pads", "base", "own torque", make, 0.02 * c, 0.5 * c)


def hooked_plate(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The tool's plate hangs in a hook at one of its edges: the higher the hook stands, the more the plate tilts."""
    k = len(arm.links) - 1
    hook = np.array(axes_across(arm, k)[int(rng.integers(2))]) * either_side(rng)
    axis = vector(np.cross(hook, arm.links[k].axis))

    def law(own: Array, still: Rest) -> Array:
        return own * np.maximum(-moved(still.turned[:, -1], hook) @ DOWN, 0.0)

    make = springs(k, "after", (axis,), law)
    return Unknown("hooked_plate", "tool", "attitude", make, 0.1 * arm.compliance[k], 3.0 * arm.compliance[k])


# ---------------------------------------------------------------- marker, load, readings


def cracked_mast(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A reflector's mast beside the hook cracks at one of the readings: from there on it nods by the load's force."""
    m, when = int(rng.integers(len(arm.markers))), rng.uniform(0.3, 0.7)

    def law(still: Rest) -> Array:
        return still.visits.force / (9.81 * arm.payload) * (still.visits.order >= when)[:, None]

    return Unknown("cracked_mast", f"m{m + 1}", "order", shifted_marker(m, law), 5e-5, 1e-3)


def fairlead(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The rope runs through a fairlead on the tool: what pulls to its side acts there in place of the hook."""
    side, lever = any_way(rng), any_way(rng)

    def make(size: float) -> Hidden:
        def load(force: Array, moment: Array, R: Array) -> tuple[Array, Array]:
            across_it = moved(R, side)
            part: Array = np.maximum((across_it * force).sum(axis=1), 0.0)[:, None] * across_it
            return force, moment + np.cross(moved(R, size * lever), part)

        return Hidden(loads=(load,))

    return Unknown("fairlead", "load", "direction of the force", make, 0.02, 0.2)


def mislabelled_disc(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The disc that is laid on for the larger loads is heavier than its label says; small loads are right."""
    laid_on = rng.uniform(0.5, 0.8)

    def make(size: float) -> Hidden:
        def load(force: Array, moment: Array, R: Array) -> tuple[Array, Array]:
            there = of_payload(arm, force) > laid_on
            return force + size * 9.81 * arm.payload * there[:, None] * DOWN, moment

        return Hidden(loads=(load,))

    return Unknown("mislabelled_disc", "load", "load", make, 0.01, 0.2)


def sticking_head(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The tracker's head sticks: it lags behind the side from which the markers came, until the load's jolt."""
    stands, lag = station(rng), rng.uniform(0.05, 0.2)

    def law(p: Array, still: Rest) -> Array:
        azimuth = np.arctan2(stands[1] - p[:, 0, 1], stands[0] - p[:, 0, 0])
        lags = (1.0 - still.visits.loaded) * np.tanh((azimuth - _before(still, azimuth)) / lag)
        return lags[:, None] * DOWN

    return Unknown("sticking_head", "readings", "approach", tracker(law, stands), 5e-6, 1e-4)


KINDS_C: tuple[Maker, ...] = (
    kept_flank,
    reversed_load,
    yielding_key,
    capstan_belt,
    pushed_bracket,
    slipped_clutch,
    tight_arc,
    leaf_stack,
    popping_panel,
    lost_nut,
    rubber_pads,
    hooked_plate,
    cracked_mast,
    fairlead,
    mislabelled_disc,
    sticking_head,
)
