"""Effects of the second generator that no library holds and on which learning has been developed.

They were written before any threshold was chosen, and were run once: their results are known, and what learns laws from
readings has been changed since with them in view. What has not been seen is in `untouched.py`.

Each says which place it has and on which variable it depends: a place is a drive, link, base, tool, marker, the load or
the readings; a variable is the own torque, the own angle, another joint's torque or angle, the load, the attitude
against gravity, or the order of the readings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from independent_arm import GRAVITY, Arm, Array, Hidden, Rest, Spring

DOWN = GRAVITY / np.linalg.norm(GRAVITY)


@dataclass(frozen=True)
class Unknown:
    """An effect at a place of one arm: make(size) hides it; sizes from the usual one up to the largest that is real."""

    kind: str
    place: str
    variable: str
    make: Callable[[float], Hidden]
    first: float
    most: float


Maker = Callable[[Arm, np.random.Generator], Unknown]


def drive(arm: Arm, rng: np.random.Generator, among: tuple[int, ...] = (1, 2, 3, 4)) -> int:
    """One of the joints, counted from 0, that the arm has."""
    return int(rng.choice([k for k in among if k < len(arm.links)]))


def gear(arm: Arm, k: int, law: Callable[[Array, Rest], Array]) -> Callable[[float], Hidden]:
    """Extra angle of actuator k by its own torque (N,) and the arm."""
    one = np.eye(len(arm.links))[k]
    return lambda size: Hidden(gears=(lambda still: size * law(still.torque[:, k], still)[:, None] * one,))


def typical(arm: Arm, k: int) -> float:
    """Torque (N m) that the payload puts on joint k of a stretched arm."""
    reach = sum(float(np.linalg.norm(link.origin)) for link in arm.links[k + 1 :]) + float(np.linalg.norm(arm.tool))
    return 9.81 * arm.payload * reach


# ---------------------------------------------------------------- drives


def dead_band(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A gear that sticks up to a torque, which depends on its angle: within it nothing gives."""
    k, phase = drive(arm, rng), rng.uniform(0.0, 2.0 * np.pi)
    band = 0.25 * typical(arm, k)

    def law(T: Array, still: Rest) -> Array:
        B = band * (1.0 + 0.8 * np.sin(2.0 * still.angles[:, k] + phase))
        return -np.clip(T, -B, B)

    return Unknown(
        "dead_band", f"j{k + 1}", "torque x angle", gear(arm, k, law), 0.1 * arm.compliance[k], 0.9 * arm.compliance[k]
    )


def soft_knee(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A gear that softens with |torque| through a hyperbolic tangent, at a knee that its angle moves."""
    k, phase = drive(arm, rng), rng.uniform(0.0, 2.0 * np.pi)
    knee = 0.4 * typical(arm, k)

    def law(T: Array, still: Rest) -> Array:
        own = knee * (1.0 + 0.6 * np.cos(still.angles[:, k] + phase))
        return T * np.tanh(np.abs(T) / own) ** 2

    return Unknown(
        "soft_knee", f"j{k + 1}", "torque x angle", gear(arm, k, law), 0.1 * arm.compliance[k], 3.0 * arm.compliance[k]
    )


def wrapping_cable(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A cable that wraps round a wrist joint beyond an angle and then carries a part of its torque."""
    k = drive(arm, rng, (3, 4, 5))
    low, high = np.deg2rad(arm.links[k].limits)
    start, side = rng.uniform(0.1, 0.5), rng.choice([-1.0, 1.0])
    begin = side * start * (high if side > 0 else -low)

    def law(T: Array, still: Rest) -> Array:
        beyond = np.clip(side * (still.angles[:, k] - begin) / 0.4, 0.0, 1.0)
        return -T * beyond**2

    return Unknown(
        "wrapping_cable",
        f"j{k + 1}",
        "torque x angle",
        gear(arm, k, law),
        0.1 * arm.compliance[k],
        0.9 * arm.compliance[k],
    )


def twice_per_turn(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A gear that gives twice per turn, by as much as its neighbour's angle lets it."""
    k, phase = drive(arm, rng, (1, 2, 3)), rng.uniform(0.0, 2.0 * np.pi)

    def law(T: Array, still: Rest) -> Array:
        return T * np.sin(2.0 * still.angles[:, k] + phase) * np.sin(still.angles[:, k + 1])

    return Unknown(
        "twice_per_turn",
        f"j{k + 1}",
        "torque x angle",
        gear(arm, k, law),
        0.1 * arm.compliance[k],
        1.0 * arm.compliance[k],
    )


def wrist_coupling(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The last drive gives by the torque of the one before it, the more the more it is loaded itself."""
    k = len(arm.links) - 1
    own = 0.3 * typical(arm, k)

    def law(T: Array, still: Rest) -> Array:
        return still.torque[:, k - 1] * np.abs(T) / (np.abs(T) + own)

    return Unknown(
        "wrist_coupling",
        f"j{k + 1}",
        "other torque",
        gear(arm, k, law),
        0.1 * arm.compliance[k],
        3.0 * arm.compliance[k],
    )


def running_in(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A gear whose grease warms up: it gives more from reading to reading, and no more in the end."""
    k = drive(arm, rng)

    def law(T: Array, still: Rest) -> Array:
        return T * (1.0 - np.exp(-still.visits.order / 0.3))

    return Unknown(
        "running_in",
        f"j{k + 1}",
        "torque x order",
        gear(arm, k, law),
        0.1 * arm.compliance[k],
        2.0 * arm.compliance[k],
    )


def creep(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A polymer in a gear remembers the torques of the poses before, for some three poses."""
    k = drive(arm, rng)
    lasting = rng.uniform(2.0, 4.0)

    def law(T: Array, still: Rest) -> Array:
        out, kept = np.zeros_like(T), 0.0
        for i in np.argsort(still.visits.order, kind="stable"):
            out[i] = kept * still.visits.loaded[i]
            kept = (kept + T[i] / lasting) * np.exp(-1.0 / lasting)
        return out

    return Unknown("creep", f"j{k + 1}", "order", gear(arm, k, law), 0.1 * arm.compliance[k], 3.0 * arm.compliance[k])


def sliding_counterweight(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A counterweight of joint 2 slides on its rail when the load leans the arm, and turns the joint by its moment."""
    one = np.eye(len(arm.links))[1]

    def make(size: float) -> Hidden:
        def law(still: Rest) -> Array:
            lean = still.angles[:, 1]
            slides = still.visits.loaded * np.tanh(3.0 * np.sin(lean)) * np.cos(lean)
            return (size * slides)[:, None] * one

        return Hidden(gears=(law,))

    return Unknown("sliding_counterweight", "j2", "own angle", make, 2e-5, 1e-3)


# ---------------------------------------------------------------- links and bearings


def warm_link(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A link bends in the sun that falls on it while the load hangs: by the order of the readings, up to an end."""
    k = drive(arm, rng, (1, 2))
    axis = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))[int(rng.integers(2))]

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * still.visits.loaded * (1.0 - np.exp(-still.visits.order / 0.25))

        return Hidden(springs=(Spring(k, "after", axis, law=law),))

    return Unknown("warm_link", f"l{k + 1}", "order", make, 2e-5, 1e-3)


def bearing_play(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Play of a bearing in tilt, which opens only where gravity does not press it to one side."""
    k = drive(arm, rng, (2, 3))
    across = [i for i in range(3) if abs(arm.links[k].axis[i]) < 0.5]
    i = int(rng.choice(across))
    axis = (float(i == 0), float(i == 1), float(i == 2))
    soft = 0.1 * typical(arm, k)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            pressed = still.turned[:, k - 1].transpose(0, 2, 1) @ DOWN
            return size * np.tanh(own / soft) * (1.0 - pressed[:, i] ** 2)

        return Hidden(springs=(Spring(k, "before", axis, law=law),))

    return Unknown("bearing_play", f"j{k + 1}", "own torque x attitude", make, 2e-5, 2e-3)


def twist_by_bending(arm: Arm, rng: np.random.Generator) -> Unknown:
    """An open section twists about the link's line when it is bent across it."""
    k = drive(arm, rng, (1, 2))

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * still.springs[:, -1]

        return Hidden(springs=(Spring(k, "after", (0, 0, 1), law=law), Spring(k, "after", (1, 0, 0))))

    return Unknown(
        "twist_by_bending", f"l{k + 1}", "other torque", make, 0.1 * arm.compliance[k], 2.0 * arm.compliance[k]
    )


# ---------------------------------------------------------------- base, tool, load, readings


def sliding_bolt(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A base plate slides on its grout beyond the friction of its bolts, to the side to which the arm leans."""
    hold = rng.uniform(0.4, 0.8) * typical(arm, 0)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            lean = still.springs[:, -1]
            return size * np.sign(lean) * np.maximum(np.abs(lean) - hold, 0.0) / hold

        return Hidden(springs=(Spring(0, "foot", (1, 0, 0), slide=True, law=law), Spring(0, "foot", (0, 1, 0))))

    return Unknown("sliding_bolt", "base", "own torque", make, 5e-5, 2e-3)


def flange_clearance(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A tool lies loosely in its flange: it shifts to the side to which the load pulls it."""
    soft = 0.15 * 9.81 * arm.payload
    n = len(arm.links)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * np.tanh(own / soft) * still.visits.loaded

        return Hidden(
            springs=tuple(Spring(n - 1, "after", axis, slide=True, law=law) for axis in ((0, 1, 0), (0, 0, 1)))
        )

    return Unknown("flange_clearance", "tool", "direction of the force", make, 3e-5, 1e-3)


def cubic_load_cell(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The load is larger than the cell says, by the cube of it: loads of several sizes show it."""
    full = 9.81 * arm.payload

    def make(size: float) -> Hidden:
        def load(force: Array, moment: Array, R: Array) -> tuple[Array, Array]:
            return force * (1.0 + size * (np.linalg.norm(force, axis=1, keepdims=True) / full) ** 2), moment

        return Hidden(loads=(load,))

    return Unknown("cubic_load_cell", "load", "load", make, 0.02, 0.3)


def leaning_marker(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A reflector's mast leans under the load's jolt, by how level it stands."""
    m = int(rng.integers(len(arm.markers)))
    mast = rng.standard_normal(3)
    mast /= np.linalg.norm(mast)

    def make(size: float) -> Hidden:
        def read(p: Array, still: Rest) -> Array:
            stands = still.turned[:, -1] @ mast
            level = DOWN - (stands @ DOWN)[:, None] * stands
            out = p.copy()
            out[:, m] += size * (still.visits.loaded * np.abs(stands @ DOWN))[:, None] * level
            return out

        return Hidden(readings=(read,))

    return Unknown("leaning_marker", f"m{m + 1}", "attitude", make, 5e-5, 2e-3)


def passing_truck(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Something stands on the floor for a quarter of the readings, and the tracker leans towards it."""
    begin = rng.uniform(0.1, 0.6)
    way = rng.standard_normal(3) * [1.0, 1.0, 0.3]
    way /= np.linalg.norm(way)

    def make(size: float) -> Hidden:
        def read(p: Array, still: Rest) -> Array:
            order = still.visits.order
            there = np.clip((order - begin) / 0.03, 0.0, 1.0) * np.clip((begin + 0.25 - order) / 0.03, 0.0, 1.0)
            return p + size * (there * still.visits.loaded)[:, None, None] * way

        return Hidden(readings=(read,))

    return Unknown("passing_truck", "readings", "order", make, 3e-5, 1e-3)


TOUCHED: tuple[Maker, ...] = (
    dead_band,
    soft_knee,
    wrapping_cable,
    twice_per_turn,
    wrist_coupling,
    running_in,
    creep,
    sliding_counterweight,
    warm_link,
    bearing_play,
    twist_by_bending,
    sliding_bolt,
    flange_clearance,
    cubic_load_cell,
    leaning_marker,
    passing_truck,
)
