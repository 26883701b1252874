"""Effects of the second generator that no library holds and on which learning has been developed.

The first sixteen, the twenty-six after them, fifteen more and the last sixteen were written before any threshold of
their day was chosen and were run once: their results are known, and what learns laws from readings has been changed
since with them in view. A sixteenth of the fifteen, the soft bar of a parallelogram, was the library's
`bar_compliance`. What has not been seen is in `untouched.py`.
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


# ---------------------------------------------------------------- drives


def hertz_teeth(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Crowned teeth touch in points: they give by the power 2/3 of the torque."""
    k = drive(arm, rng)
    full = typical(arm, k)

    def law(T: Array, still: Rest) -> Array:
        return T * (full**2 / (T**2 + (0.01 * full) ** 2)) ** (1.0 / 6.0)

    return softer(arm, k, "hertz_teeth", "own torque", law, 3.0)


def lost_preload(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A preloaded bearing of a gear comes free on one side, beyond a torque, and the gear gives more from there on."""
    k = drive(arm, rng, (1, 2, 4))
    side, begin = either_side(rng), rng.uniform(0.1, 0.5) * typical(arm, k)

    def law(T: Array, still: Rest) -> Array:
        return side * np.maximum(side * T - begin, 0.0)

    return softer(arm, k, "lost_preload", "own torque", law, 2.0)


def worn_sector(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A ring is worn where the arm has worked for years: in one sector of its angle it gives more, with short ends."""
    k = drive(arm, rng)
    middle, half = middle_angle(arm, k, rng), rng.uniform(0.3, 0.6)

    def law(T: Array, still: Rest) -> Array:
        return T * np.clip((half - np.abs(still.angles[:, k] - middle)) / 0.15, 0.0, 1.0)

    return softer(arm, k, "worn_sector", "torque x angle", law, 2.0)


def eccentric_pinion(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A pinion off its centre opens and closes the play of its teeth as the joint turns."""
    k, phase = drive(arm, rng, (1, 2, 3, 4, 5)), rng.uniform(0.0, 2.0 * np.pi)
    width = 0.05 * typical(arm, k)

    def law(T: Array, still: Rest) -> Array:
        return 0.5 * (1.0 + np.sin(3.0 * still.angles[:, k] + phase)) * np.tanh(T / width)

    return Unknown("eccentric_pinion", f"j{k + 1}", "torque x angle", gear(arm, k, law), 3e-5, 1.5e-3)


def binding_balancer(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The rod of a balancer sticks in its guide and holds against the load, by the lever that it has at the angle."""
    ratio, zero = rng.uniform(0.2, 0.4), rng.uniform(-0.3, 0.3)
    width = 0.1 * typical(arm, 1)

    def law(T: Array, still: Rest) -> Array:
        lean = still.angles[:, 1] - zero
        lever = np.abs(np.sin(lean)) / np.sqrt(1.0 + ratio**2 - 2.0 * ratio * np.cos(lean))
        return -still.visits.loaded * lever * np.tanh(T / width)

    return Unknown("binding_balancer", "j2", "torque x angle", gear(arm, 1, law), 3e-5, 1e-3)


def bent_shaft(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A wrist drive's shaft runs through a universal joint at the joint before: the more that is bent, the more it
    gives."""
    k = drive(arm, rng, (3, 4, 5))

    def law(T: Array, still: Rest) -> Array:
        bent = np.sin(still.angles[:, k - 1]) ** 2
        return T * 0.2 * bent / (1.0 - 0.8 * bent)

    return softer(arm, k, "bent_shaft", "other angle", law, 3.0)


def turned_encoder(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The next drive's reaction twists the casting on which a joint's encoder sits, and the controller follows it."""
    k = drive(arm, rng, (1, 2, 3, 4))

    def law(T: Array, still: Rest) -> Array:
        return still.torque[:, k + 1]

    return softer(arm, k, "turned_encoder", "other torque", law, 3.0)


def squeezed_ring(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The torque of the drive before, either way, makes the ring of a gear oval, and its teeth bear on fewer places."""
    k = drive(arm, rng, (2, 3, 4, 5))
    full = typical(arm, k - 1)

    def law(T: Array, still: Rest) -> Array:
        return T * np.minimum(np.abs(still.torque[:, k - 1]) / full, 1.5)

    return softer(arm, k, "squeezed_ring", "other torque", law, 2.0)


def worn_flank(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A gear comes to rest on the flank on which it came; one of the two is worn and gives more."""
    k, side = drive(arm, rng), either_side(rng)

    def law(T: Array, still: Rest) -> Array:
        return 0.5 * T * (1.0 + np.tanh(side * came_by(arm, still, k) / 0.1))

    return softer(arm, k, "worn_flank", "approach", law, 2.0)


def oil_film(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A long way draws oil between rollers and cam: the film is thicker, and gives more, the farther the joint came."""
    k = drive(arm, rng)
    way = rng.uniform(0.4, 0.8)

    def law(T: Array, still: Rest) -> Array:
        return T * (1.0 - np.exp(-np.abs(came_by(arm, still, k)) / way))

    return softer(arm, k, "oil_film", "approach", law, 2.0)


def broken_bolt(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A bolt of a gear's ring breaks at one of the readings: from there on the drive gives more."""
    k, begin = drive(arm, rng), rng.uniform(0.3, 0.7)

    def law(T: Array, still: Rest) -> Array:
        return T * (still.visits.order >= begin)

    return softer(arm, k, "broken_bolt", "torque x order", law, 2.0)


def lobed_ring(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Three screws clamp an encoder's ring; under load it bulges between them and the angle is read wrongly."""
    k, phase = drive(arm, rng), rng.uniform(0.0, 2.0 * np.pi)
    one = np.eye(len(arm.links))[k]

    def make(size: float) -> Hidden:
        return Hidden(
            angles=(lambda q, v: (size * of_payload(arm, v.force) * np.sin(3.0 * q[:, k] + phase))[:, None] * one,)
        )

    return Unknown("lobed_ring", f"j{k + 1}", "own angle", make, 3e-5, 1e-3)


def hanging_motor(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A heavy motor pulls its pinion out of mesh where it hangs below, and lies in it where it does not."""
    k, mount = drive(arm, rng, (2, 3, 4, 5)), any_way(rng)

    def law(T: Array, still: Rest) -> Array:
        return T * np.maximum((still.turned[:, k - 1] @ mount) @ DOWN, 0.0)

    return softer(arm, k, "hanging_motor", "attitude", law, 2.0)


# ---------------------------------------------------------------- links and bearings


def oval_race(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A bearing's race is oval: how much it tilts by the moment across it depends on its joint's angle."""
    k, phase = drive(arm, rng), rng.uniform(0.0, 2.0 * np.pi)
    axis = one_across(arm, k, rng)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * own * np.cos(still.angles[:, k] + phase) ** 2

        return Hidden(springs=(Spring(k, "before", axis, law=law),))

    return Unknown("oval_race", f"j{k + 1}", "torque x angle", make, 0.1 * arm.compliance[k], 2.0 * arm.compliance[k])


def gaping_flange(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The bolted flange of a link opens on one side beyond the moment that its bolts hold."""
    k = drive(arm, rng, (1, 2))
    axis, side, hold = one_across(arm, k, rng), either_side(rng), rng.uniform(0.02, 0.1) * typical(arm, k)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * side * np.maximum(side * own - hold, 0.0)

        return Hidden(springs=(Spring(k, "after", axis, law=law),))

    return Unknown("gaping_flange", f"l{k + 1}", "own torque", make, 0.1 * arm.compliance[k], 2.0 * arm.compliance[k])


def resting_strut(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A strut beside a link stiffens it where the next joint's angle lays the arm against it, and nowhere else."""
    k = drive(arm, rng, (1, 2))
    axis, side, begin = one_across(arm, k, rng), either_side(rng), middle_angle(arm, k + 1, rng)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * own * (1.0 - np.clip(side * (still.angles[:, k + 1] - begin) / 0.3, 0.0, 1.0))

        return Hidden(springs=(Spring(k, "after", axis, law=law),))

    return Unknown("resting_strut", f"l{k + 1}", "other angle", make, 0.1 * arm.compliance[k], 2.0 * arm.compliance[k])


def flattened_tube(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A thin tube flattens when it is bent, by the square of the moment, and then twists more easily."""
    k = drive(arm, rng, (1, 2))
    line = np.array(arm.links[k + 1].origin, dtype=np.float64)
    line /= np.linalg.norm(line)
    first: Array = np.asarray(np.cross(line, np.eye(3)[int(np.argmin(np.abs(line)))]), dtype=np.float64)
    first /= np.linalg.norm(first)
    second: Array = np.asarray(np.cross(line, first), dtype=np.float64)
    bends = (Spring(k, "after", vector(first)), Spring(k, "after", vector(second)))
    full = typical(arm, k)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * own * np.minimum((still.springs[:, -2:] ** 2).sum(axis=1) / full**2, 4.0)

        return Hidden(springs=(Spring(k, "after", vector(line), law=law), *bends))

    return Unknown(
        "flattened_tube", f"l{k + 1}", "other torque", make, 0.1 * arm.compliance[k], 2.0 * arm.compliance[k]
    )


# ---------------------------------------------------------------- base and tool


def settling_floor(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The ground below a plate settles under the moments of a day, by the logarithm of how many there were."""
    axis = any_level(rng)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * own * np.log1p(still.visits.order / 0.05)

        return Hidden(springs=(Spring(0, "foot", axis, law=law),))

    return Unknown("settling_floor", "base", "torque x order", make, 0.02 * arm.compliance[0], 0.3 * arm.compliance[0])


def cracked_plinth(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A plinth has a crack on one side: it gives while the arm stands over it, by the angle of joint 1."""
    axis, towards = any_level(rng), rng.uniform(-2.0, 2.0)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            over = 0.5 * (1.0 + np.tanh((np.cos(still.angles[:, 0] - towards) - 0.3) / 0.15))
            return size * own * over

        return Hidden(springs=(Spring(0, "foot", axis, law=law),))

    return Unknown("cracked_plinth", "base", "other angle", make, 0.02 * arm.compliance[0], 0.5 * arm.compliance[0])


def three_balls(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A tool changer seats on three balls: it tilts less where a moment presses on one, more where between two."""
    k, phase = len(arm.links) - 1, rng.uniform(0.0, 2.0 * np.pi)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            way = np.arctan2(still.springs[:, -1], still.springs[:, -2])
            return size * own * 0.5 * (1.0 + np.cos(3.0 * way + phase))

        return Hidden(springs=tuple(Spring(k, "after", axis, law=law) for axis in axes_across(arm, k)))

    return Unknown(
        "three_balls", "tool", "direction of the force", make, 0.1 * arm.compliance[k], 2.0 * arm.compliance[k]
    )


# ---------------------------------------------------------------- markers, readings, load


def pressed_bracket(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The hook presses on a reflector's bracket, and bends it, where the force points to its side of the tool."""
    m, side, way = int(rng.integers(len(arm.markers))), any_way(rng), any_way(rng)

    def make(size: float) -> Hidden:
        def read(p: Array, still: Rest) -> Array:
            R = still.turned[:, -1]
            press = np.einsum("ni,ni->n", R @ side, still.visits.force) / (9.81 * arm.payload)
            out = p.copy()
            out[:, m] += size * np.maximum(press, 0.0)[:, None] * (R @ way)
            return out

        return Hidden(readings=(read,))

    return Unknown("pressed_bracket", f"m{m + 1}", "direction of the force", make, 5e-5, 2e-3)


def softening_glue(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The glue below a reflector softens from reading to reading, and yields under the jolt of the load ever more."""
    m, way = int(rng.integers(len(arm.markers))), any_way(rng)

    def make(size: float) -> Hidden:
        def read(p: Array, still: Rest) -> Array:
            out = p.copy()
            out[:, m] += size * (still.visits.loaded * still.visits.order**2)[:, None] * (still.turned[:, -1] @ way)
            return out

        return Hidden(readings=(read,))

    return Unknown("softening_glue", f"m{m + 1}", "order", make, 5e-5, 2e-3)


def bending_floor(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The load bends the floor below the tracker where joint 1 carries it to that side."""
    towards, way = rng.uniform(-2.0, 2.0), any_way(rng)

    def make(size: float) -> Hidden:
        def read(p: Array, still: Rest) -> Array:
            near = np.maximum(np.cos(still.angles[:, 0] - towards), 0.0)
            return p + size * (of_payload(arm, still.visits.force) * near)[:, None, None] * way

        return Hidden(readings=(read,))

    return Unknown("bending_floor", "readings", "other angle", make, 3e-5, 1e-3)


def retightened_stand(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A tracker's stand leans when the load is brought, by how loose its clamp is, which is tightened at times."""
    period, phase, way = rng.uniform(0.25, 0.45), rng.uniform(0.0, 1.0), any_way(rng)

    def make(size: float) -> Hidden:
        def read(p: Array, still: Rest) -> Array:
            loose = np.mod(still.visits.order / period + phase, 1.0)
            return p + size * (still.visits.loaded * loose)[:, None, None] * way

        return Hidden(readings=(read,))

    return Unknown("retightened_stand", "readings", "order", make, 3e-5, 1e-3)


def rope_pulley(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A pulley turns the load's rope out of the plumb line, and its friction takes a share by the angle of wrap."""

    def make(size: float) -> Hidden:
        def load(force: Array, moment: Array, R: Array) -> tuple[Array, Array]:
            wrap = np.arctan2(np.linalg.norm(force[:, :2], axis=1), -force[:, 2])
            return force * np.exp(-size * wrap)[:, None], moment

        return Hidden(loads=(load,))

    return Unknown("rope_pulley", "load", "direction of the force", make, 0.03, 0.3)


def sliding_shackle(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A shackle slides along its pin to the lower end, so that the load acts there."""
    pin = any_way(rng)

    def make(size: float) -> Hidden:
        def load(force: Array, moment: Array, R: Array) -> tuple[Array, Array]:
            along = R @ pin
            return force, moment + np.cross(size * np.tanh(along @ DOWN / 0.1)[:, None] * along, force)

        return Hidden(loads=(load,))

    return Unknown("sliding_shackle", "load", "attitude", make, 5e-3, 5e-2)


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
    view_of = np.abs(np.array(arm.links[k].axis, dtype=np.float64))

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            hangs = np.maximum((still.turned[:, -1] @ view_of) @ DOWN, 0.0)
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
    hertz_teeth,
    lost_preload,
    worn_sector,
    eccentric_pinion,
    binding_balancer,
    bent_shaft,
    turned_encoder,
    squeezed_ring,
    worn_flank,
    oil_film,
    broken_bolt,
    lobed_ring,
    hanging_motor,
    oval_race,
    gaping_flange,
    resting_strut,
    flattened_tube,
    settling_floor,
    cracked_plinth,
    three_balls,
    pressed_bracket,
    softening_glue,
    bending_floor,
    retightened_stand,
    rope_pulley,
    sliding_shackle,
    scissor_pinion,
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
