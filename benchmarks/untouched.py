"""Effects of the second generator that no library holds and that nothing has been developed on.

They differ in law from those of `touched.py`, and from the library's. Each says which place it has and on which
variable it depends, in the words of that file; a variable may be the approach too: where a joint came from, by the pose
that was visited before. Where a law multiplies its own torque by another joint's angle or torque, by the approach or
by the attitude, the variable is that other one. Sizes are those of real arms. Whoever changes this file starts the
record anew.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from independent_arm import Arm, Array, Hidden, Rest, Spring, Vector
from touched import DOWN, Maker, Unknown, drive, gear, typical

# ---------------------------------------------------------------- what laws need


def _unit(rng: np.random.Generator) -> Array:
    """A random direction (3,)."""
    way = rng.standard_normal(3)
    return np.asarray(way / np.linalg.norm(way), dtype=np.float64)


def _vector(way: Array) -> Vector:
    return (float(way[0]), float(way[1]), float(way[2]))


def _across(arm: Arm, k: int) -> tuple[Vector, ...]:
    """The two axes of link k's frame that are not joint k's."""
    return tuple(_vector(np.eye(3)[i]) for i in range(3) if abs(arm.links[k].axis[i]) < 0.5)


def _one_across(arm: Arm, k: int, rng: np.random.Generator) -> Vector:
    axes = _across(arm, k)
    return axes[int(rng.integers(len(axes)))]


def _level(rng: np.random.Generator) -> Vector:
    """A random horizontal axis."""
    heading = rng.uniform(0.0, 2.0 * np.pi)
    return (float(np.cos(heading)), float(np.sin(heading)), 0.0)


def _side(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _share(arm: Arm, force: Array) -> Array:
    """Size (N,) of forces (N, 3) by the payload's weight."""
    return np.asarray(np.linalg.norm(force, axis=1) / (9.81 * arm.payload), dtype=np.float64)


def _within(arm: Arm, k: int, rng: np.random.Generator) -> float:
    """An angle (rad) in the middle half of a joint's range."""
    low, high = arm.links[k].limits
    return float(np.deg2rad(rng.uniform(0.75 * low + 0.25 * high, 0.25 * low + 0.75 * high)))


def _came(arm: Arm, still: Rest, k: int) -> Array:
    """By how much (N,) joint k turned, rad, from the pose that was visited before; 0 at the first."""
    visits = still.visits
    rows = np.argsort(visits.order, kind="stable")
    angle, number = arm.joints(visits.shown)[rows, k], visits.number[rows]
    new = np.concatenate([[True], number[1:] != number[:-1]])
    stops = angle[new]
    before = np.concatenate([stops[:1], stops[:-1]])
    out = np.zeros(len(rows))
    out[rows] = angle - before[np.cumsum(new) - 1]
    return out


def _soft(arm: Arm, k: int, kind: str, variable: str, law: Callable[[Array, Rest], Array], most: float) -> Unknown:
    """A drive that gives by its own torque and the arm, up to `most` times its compliance."""
    c = arm.compliance[k]
    return Unknown(kind, f"j{k + 1}", variable, gear(arm, k, law), 0.1 * c, most * c)


# ---------------------------------------------------------------- drives


def hertz_teeth(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Crowned teeth touch in points: they give by the power 2/3 of the torque."""
    k = drive(arm, rng)
    full = typical(arm, k)

    def law(T: Array, still: Rest) -> Array:
        return T * (full**2 / (T**2 + (0.01 * full) ** 2)) ** (1.0 / 6.0)

    return _soft(arm, k, "hertz_teeth", "own torque", law, 3.0)


def lost_preload(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A preloaded bearing of a gear comes free on one side, beyond a torque, and the gear gives more from there on."""
    k = drive(arm, rng, (1, 2, 4))
    side, begin = _side(rng), rng.uniform(0.1, 0.5) * typical(arm, k)

    def law(T: Array, still: Rest) -> Array:
        return side * np.maximum(side * T - begin, 0.0)

    return _soft(arm, k, "lost_preload", "own torque", law, 2.0)


def worn_sector(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A ring is worn where the arm has worked for years: in one sector of its angle it gives more, with short ends."""
    k = drive(arm, rng)
    middle, half = _within(arm, k, rng), rng.uniform(0.3, 0.6)

    def law(T: Array, still: Rest) -> Array:
        return T * np.clip((half - np.abs(still.angles[:, k] - middle)) / 0.15, 0.0, 1.0)

    return _soft(arm, k, "worn_sector", "torque x angle", law, 2.0)


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

    return _soft(arm, k, "bent_shaft", "other angle", law, 3.0)


def turned_encoder(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The next drive's reaction twists the casting on which a joint's encoder sits, and the controller follows it."""
    k = drive(arm, rng, (1, 2, 3, 4))

    def law(T: Array, still: Rest) -> Array:
        return still.torque[:, k + 1]

    return _soft(arm, k, "turned_encoder", "other torque", law, 3.0)


def squeezed_ring(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The torque of the drive before, either way, makes the ring of a gear oval, and its teeth bear on fewer places."""
    k = drive(arm, rng, (2, 3, 4, 5))
    full = typical(arm, k - 1)

    def law(T: Array, still: Rest) -> Array:
        return T * np.minimum(np.abs(still.torque[:, k - 1]) / full, 1.5)

    return _soft(arm, k, "squeezed_ring", "other torque", law, 2.0)


def worn_flank(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A gear comes to rest on the flank on which it came; one of the two is worn and gives more."""
    k, side = drive(arm, rng), _side(rng)

    def law(T: Array, still: Rest) -> Array:
        return 0.5 * T * (1.0 + np.tanh(side * _came(arm, still, k) / 0.1))

    return _soft(arm, k, "worn_flank", "approach", law, 2.0)


def oil_film(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A long way draws oil between rollers and cam: the film is thicker, and gives more, the farther the joint came."""
    k = drive(arm, rng)
    way = rng.uniform(0.4, 0.8)

    def law(T: Array, still: Rest) -> Array:
        return T * (1.0 - np.exp(-np.abs(_came(arm, still, k)) / way))

    return _soft(arm, k, "oil_film", "approach", law, 2.0)


def broken_bolt(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A bolt of a gear's ring breaks at one of the readings: from there on the drive gives more."""
    k, begin = drive(arm, rng), rng.uniform(0.3, 0.7)

    def law(T: Array, still: Rest) -> Array:
        return T * (still.visits.order >= begin)

    return _soft(arm, k, "broken_bolt", "torque x order", law, 2.0)


def lobed_ring(arm: Arm, rng: np.random.Generator) -> Unknown:
    """Three screws clamp an encoder's ring; under load it bulges between them and the angle is read wrongly."""
    k, phase = drive(arm, rng), rng.uniform(0.0, 2.0 * np.pi)
    one = np.eye(len(arm.links))[k]

    def make(size: float) -> Hidden:
        return Hidden(
            angles=(lambda q, v: (size * _share(arm, v.force) * np.sin(3.0 * q[:, k] + phase))[:, None] * one,)
        )

    return Unknown("lobed_ring", f"j{k + 1}", "own angle", make, 3e-5, 1e-3)


def hanging_motor(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A heavy motor pulls its pinion out of mesh where it hangs below, and lies in it where it does not."""
    k, mount = drive(arm, rng, (2, 3, 4, 5)), _unit(rng)

    def law(T: Array, still: Rest) -> Array:
        return T * np.maximum((still.turned[:, k - 1] @ mount) @ DOWN, 0.0)

    return _soft(arm, k, "hanging_motor", "attitude", law, 2.0)


# ---------------------------------------------------------------- links and bearings


def oval_race(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A bearing's race is oval: how much it tilts by the moment across it depends on its joint's angle."""
    k, phase = drive(arm, rng), rng.uniform(0.0, 2.0 * np.pi)
    axis = _one_across(arm, k, rng)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * own * np.cos(still.angles[:, k] + phase) ** 2

        return Hidden(springs=(Spring(k, "before", axis, law=law),))

    return Unknown("oval_race", f"j{k + 1}", "torque x angle", make, 0.1 * arm.compliance[k], 2.0 * arm.compliance[k])


def gaping_flange(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The bolted flange of a link opens on one side beyond the moment that its bolts hold."""
    k = drive(arm, rng, (1, 2))
    axis, side, hold = _one_across(arm, k, rng), _side(rng), rng.uniform(0.02, 0.1) * typical(arm, k)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * side * np.maximum(side * own - hold, 0.0)

        return Hidden(springs=(Spring(k, "after", axis, law=law),))

    return Unknown("gaping_flange", f"l{k + 1}", "own torque", make, 0.1 * arm.compliance[k], 2.0 * arm.compliance[k])


def resting_strut(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A strut beside a link stiffens it where the next joint's angle lays the arm against it, and nowhere else."""
    k = drive(arm, rng, (1, 2))
    axis, side, begin = _one_across(arm, k, rng), _side(rng), _within(arm, k + 1, rng)

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
    bends = (Spring(k, "after", _vector(first)), Spring(k, "after", _vector(second)))
    full = typical(arm, k)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * own * np.minimum((still.springs[:, -2:] ** 2).sum(axis=1) / full**2, 4.0)

        return Hidden(springs=(Spring(k, "after", _vector(line), law=law), *bends))

    return Unknown(
        "flattened_tube", f"l{k + 1}", "other torque", make, 0.1 * arm.compliance[k], 2.0 * arm.compliance[k]
    )


# ---------------------------------------------------------------- base and tool


def settling_floor(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The ground below a plate settles under the moments of a day, by the logarithm of how many there were."""
    axis = _level(rng)

    def make(size: float) -> Hidden:
        def law(own: Array, still: Rest) -> Array:
            return size * own * np.log1p(still.visits.order / 0.05)

        return Hidden(springs=(Spring(0, "foot", axis, law=law),))

    return Unknown("settling_floor", "base", "torque x order", make, 0.02 * arm.compliance[0], 0.3 * arm.compliance[0])


def cracked_plinth(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A plinth has a crack on one side: it gives while the arm stands over it, by the angle of joint 1."""
    axis, towards = _level(rng), rng.uniform(-2.0, 2.0)

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

        return Hidden(springs=tuple(Spring(k, "after", axis, law=law) for axis in _across(arm, k)))

    return Unknown(
        "three_balls", "tool", "direction of the force", make, 0.1 * arm.compliance[k], 2.0 * arm.compliance[k]
    )


# ---------------------------------------------------------------- markers, readings, load


def pressed_bracket(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The hook presses on a reflector's bracket, and bends it, where the force points to its side of the tool."""
    m, side, way = int(rng.integers(len(arm.markers))), _unit(rng), _unit(rng)

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
    m, way = int(rng.integers(len(arm.markers))), _unit(rng)

    def make(size: float) -> Hidden:
        def read(p: Array, still: Rest) -> Array:
            out = p.copy()
            out[:, m] += size * (still.visits.loaded * still.visits.order**2)[:, None] * (still.turned[:, -1] @ way)
            return out

        return Hidden(readings=(read,))

    return Unknown("softening_glue", f"m{m + 1}", "order", make, 5e-5, 2e-3)


def bending_floor(arm: Arm, rng: np.random.Generator) -> Unknown:
    """The load bends the floor below the tracker where joint 1 carries it to that side."""
    towards, way = rng.uniform(-2.0, 2.0), _unit(rng)

    def make(size: float) -> Hidden:
        def read(p: Array, still: Rest) -> Array:
            near = np.maximum(np.cos(still.angles[:, 0] - towards), 0.0)
            return p + size * (_share(arm, still.visits.force) * near)[:, None, None] * way

        return Hidden(readings=(read,))

    return Unknown("bending_floor", "readings", "other angle", make, 3e-5, 1e-3)


def retightened_stand(arm: Arm, rng: np.random.Generator) -> Unknown:
    """A tracker's stand leans when the load is brought, by how loose its clamp is, which is tightened at times."""
    period, phase, way = rng.uniform(0.25, 0.45), rng.uniform(0.0, 1.0), _unit(rng)

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
    pin = _unit(rng)

    def make(size: float) -> Hidden:
        def load(force: Array, moment: Array, R: Array) -> tuple[Array, Array]:
            along = R @ pin
            return force, moment + np.cross(size * np.tanh(along @ DOWN / 0.1)[:, None] * along, force)

        return Hidden(loads=(load,))

    return Unknown("sliding_shackle", "load", "attitude", make, 5e-3, 5e-2)


UNTOUCHED: tuple[Maker, ...] = (
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
)
