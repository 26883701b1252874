"""Effects of the second generator that no library holds and on which nothing has been developed.

They were written by somebody who had seen only the building blocks and the names of what there was before, not what is
to find them. Each differs in law from those of `touched.py` and `untouched.py` and from the library's.
"""

from __future__ import annotations

import numpy as np
from independent_arm import Arm, Array, Hidden, Rest, Spring, moved
from unknown import (
    DOWN,
    Maker,
    Unknown,
    across,
    any_level,
    any_way,
    came_by,
    drive,
    either_side,
    gear,
    line_of,
    main_compliance,
    middle_angle,
    of_payload,
    one_across,
    rises,
    shifted_marker,
    softer,
    typical,
    vector,
)

_LEVEL = np.array([1.0, 1.0, 0.0])
"""Keeps the level part of a force."""


# ---------------------------------------------------------------- drives


def twin_pinions(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Two motors, set against each other, drive one gear. Where the torque exceeds their weak preload, the pinion that
    holds back changes its flank and the joint steps through its play, once at either side."""
    k = drive(arm, rng, (1, 2, 4))
    preload, width = rng.uniform(0.2, 0.4) * typical(arm, k), 0.06 * typical(arm, k)

    def law(T: Array, still: Rest) -> Array:
        return np.tanh((T - preload) / width) + np.tanh((T + preload) / width)

    return Unknown("twin_pinions", f"j{k + 1}", "own torque", gear(arm, k, law), 1e-5, 4e-4)


def hammered_key(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The key of a shaft is hammered loose in its slot by the changes of load: from some reading on the hub has a play
    that grows, and it lies at the side of the torque."""
    k = drive(arm, rng)
    width, start = 0.1 * typical(arm, k), rng.uniform(0.1, 0.4)

    def law(T: Array, still: Rest) -> Array:
        grown = np.maximum(still.visits.order - start, 0.0) / (1.0 - start)
        return grown * np.tanh(T / width)

    return Unknown("hammered_key", f"j{k + 1}", "torque x order", gear(arm, k, law), 2e-5, 1e-3)


def bent_cardan(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The last joint is driven through a cardan shaft that is bent together with the joint before it: the more it is
    bent, the more it gives."""
    k = len(arm.links) - 1
    straight = rng.uniform(-0.25, 0.25)

    def law(T: Array, still: Rest) -> Array:
        return T * (1.0 - np.cos(still.angles[:, k - 1] - straight))

    return softer(arm, k, "bent_cardan", "other angle", law, 3.0)


def sag_table(arm: Arm, rng: np.random.Generator) -> Unknown:
    """As soon as a payload is on, the controller turns a joint by a table of the sag over the angle of that joint
    alone, whatever the other joints do."""
    k = drive(arm, rng, (1, 2))
    most, side = middle_angle(arm, k, rng), either_side(rng)

    def law(T: Array, still: Rest) -> Array:
        return side * still.visits.loaded * np.cos(still.angles[:, k] - most) ** 2

    return Unknown("sag_table", f"j{k + 1}", "own angle", gear(arm, k, law), 1e-5, 4e-4)


def rubber_spider(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The rubber spider of a motor's coupling is still twisted back after a move, more so after a long one, when the
    empty arm is read. It has relaxed by the time that the load hangs."""
    k = drive(arm, rng, (0, 1, 2))
    usual = rng.uniform(0.5, 1.2)

    def law(T: Array, still: Rest) -> Array:
        came = came_by(arm, still, k)
        return (still.visits.loaded - 1.0) * np.sign(came) * (1.0 - np.exp(-np.abs(came) / usual))

    return Unknown("rubber_spider", f"j{k + 1}", "approach", gear(arm, k, law), 1e-5, 4e-4)


# ---------------------------------------------------------------- bearings and links


def split_housing(arm: Arm, rng: np.random.Generator) -> Unknown:
    """One half of a bearing's housing is a cap on bolts: when the arm has turned over to that side, the bearing tilts
    more easily."""
    k = drive(arm, rng, (0, 1, 2, 3))
    seam, side, axis = middle_angle(arm, k, rng), either_side(rng), one_across(arm, k, rng)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * own * rises(side * still.angles[:, k], side * seam, 0.2)

        return Hidden(springs=(Spring(k, "before", axis, law=law),))

    return Unknown(
        "split_housing", f"j{k + 1}", "torque x angle", make, 0.05 * main_compliance(arm), 1.0 * main_compliance(arm)
    )


def seating_extension(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A link was lengthened by a piece that does not sit squarely on its dowels. More than a certain load seats it with
    a click, and the link is kinked by a small angle as long as that load hangs."""
    k = drive(arm, rng, (1, 2, 3))
    line = line_of(arm, k)
    axis, at, enough = across(line, rng), vector(0.5 * line), rng.uniform(0.45, 0.75)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * rises(of_payload(arm, still.visits.force), enough, 0.04)

        return Hidden(springs=(Spring(k, "after", axis, at=at, law=law),))

    return Unknown("seating_extension", f"l{k + 1}", "load", make, 2e-5, 5e-4)


def whipping_shaft(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The long shaft of a wrist's drive runs through the forearm. Above a certain torque, of either sign, it bows out
    against its steady bearing and bends the forearm to that side."""
    k, other = drive(arm, rng, (2, 3)), drive(arm, rng, (4, 5))
    line, full = line_of(arm, k), typical(arm, other)
    axis, at, free = across(line, rng), vector(0.5 * line), rng.uniform(0.15, 0.3) * full

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * np.maximum(np.abs(still.torque[:, other]) - free, 0.0) / full

        return Hidden(springs=(Spring(k, "after", axis, at=at, law=law),))

    return Unknown("whipping_shaft", f"l{k + 1}", "other torque", make, 5e-5, 1.5e-3)


# ---------------------------------------------------------------- base


def four_feet(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The base plate stands on four levelling feet: it tilts less while the arm points over a foot, and more while it
    points between two, than the average that the maker's springs hold already."""
    phase = rng.uniform(0.0, 0.5 * np.pi)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * own * np.cos(4.0 * (still.angles[:, 0] - phase))

        return Hidden(springs=(Spring(0, "foot", (1, 0, 0), law=law), Spring(0, "foot", (0, 1, 0), law=law)))

    return Unknown("four_feet", "base", "other angle", make, 0.01 * main_compliance(arm), 0.2 * main_compliance(arm))


def wound_stand(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The stand only lies on the floor: friction keeps it wound up about the vertical, against the last swing of joint
    1, until the load is hung on and shakes it free."""
    wide = rng.uniform(0.1, 0.25)
    up = float(arm.links[0].axis[2])

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * up * (still.visits.loaded - 1.0) * np.tanh(came_by(arm, still, 0) / wide)

        return Hidden(springs=(Spring(0, "foot", (0, 0, 1), law=law),))

    return Unknown("wound_stand", "base", "approach", make, 1e-5, 3e-4)


# ---------------------------------------------------------------- tool


def slack_balls(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The locking balls of a tool changer are wedged tight by the weight of a tool that hangs. The more the tool lies
    or stands, the more play they leave, by which it tilts to the side of the moment."""
    k = len(arm.links) - 1
    axis, out = one_across(arm, k, rng), np.array(arm.links[k].axis, dtype=np.float64)
    out = out * np.sign(out @ np.array(arm.tool))
    width = 0.1 * typical(arm, k)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            stands = 0.5 * (1.0 - moved(still.turned[:, -1], out) @ DOWN)
            return size * stands * np.tanh(own / width)

        return Hidden(springs=(Spring(k, "after", axis, law=law),))

    return Unknown("slack_balls", "tool", "attitude", make, 5e-5, 1.5e-3)


def leaking_clamp(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A hydraulic clamp holds the tool and loses its pressure during the campaign: the moment above which the tool
    opens the gap and tilts becomes smaller and smaller."""
    k = len(arm.links) - 1
    axis, hold, lost = one_across(arm, k, rng), rng.uniform(0.35, 0.7) * typical(arm, k), rng.uniform(0.7, 1.0)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            left = 1.0 - lost * still.visits.order
            return size * np.sign(own) * np.maximum(np.abs(own) - hold * left, 0.0)

        return Hidden(springs=(Spring(k, "after", axis, law=law),))

    return Unknown("leaking_clamp", "tool", "torque x order", make, 0.2 * arm.compliance[k], 3.0 * arm.compliance[k])


# ---------------------------------------------------------------- markers, readings and the load


def snapping_cover(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A reflector is glued on the sheet cover of the wrist, which dishes inwards at once when the torque of a wrist
    joint exceeds a limit to one side."""
    m, other = int(rng.integers(len(arm.markers))), drive(arm, rng, (4, 5))
    side, full, way = either_side(rng), typical(arm, other), any_way(rng)
    limit = rng.uniform(0.15, 0.35) * full

    def law(still: Rest) -> Array:
        share = rises(side * still.torque[:, other], limit, 0.05 * full)
        return share[:, None] * moved(still.turned[:, -1], way)

    return Unknown("snapping_cover", f"m{m + 1}", "other torque", shifted_marker(m, law), 3e-5, 6e-4)


def second_ball(arm: Arm, rng: np.random.Generator) -> Unknown:
    """From a change of shift on, the reflector at one marker is taken off while the load is hung on, and another ball,
    which sits a little differently in the nest, is put back for the loaded reading."""
    m, way, shift = int(rng.integers(len(arm.markers))), any_way(rng), rng.uniform(0.3, 0.7)

    def law(still: Rest) -> Array:
        other = still.visits.loaded * (still.visits.order >= shift)
        return other[:, None] * moved(still.turned[:, -1], way)

    return Unknown("second_ball", f"m{m + 1}", "order", shifted_marker(m, law), 3e-5, 5e-4)


def parked_forklift(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The forklift that brings the load stays parked below the flange. The nearer to the tracker that is, by the angle
    of joint 1, the more it bends the floor and tilts the tracker's stand."""
    heading, axis = middle_angle(arm, 0, rng), np.array(any_level(rng))
    station = np.array([rng.uniform(3.0, 5.0), rng.uniform(-2.0, 2.0), rng.uniform(-0.5, 1.0)])

    def make(size: float) -> Hidden:
        def read(p: Array, still: Rest) -> Array:
            near = still.visits.loaded * np.exp(2.0 * (np.cos(still.angles[:, 0] - heading) - 1.0))
            return p + size * near[:, None, None] * np.cross(axis, p - station)

        return Hidden(readings=(read,))

    return Unknown("parked_forklift", "readings", "other angle", make, 1e-5, 1.5e-4)


def second_eye(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Weights hang at the point that the files name, but the rope that pulls sideways is hooked into another eye of the
    tool: the level part of the force has another lever arm."""
    way = any_way(rng)

    def make(size: float) -> Hidden:
        def load(force: Array, moment: Array, R: Array) -> tuple[Array, Array]:
            return force, moment + np.cross(moved(R, size * way), force * _LEVEL)

        return Hidden(loads=(load,))

    return Unknown("second_eye", "load", "direction of the force", make, 0.02, 0.2)


UNTOUCHED: tuple[Maker, ...] = (
    twin_pinions,
    hammered_key,
    bent_cardan,
    sag_table,
    rubber_spider,
    split_housing,
    seating_extension,
    whipping_shaft,
    four_feet,
    wound_stand,
    slack_balls,
    leaking_clamp,
    snapping_cover,
    second_ball,
    parked_forklift,
    second_eye,
)
