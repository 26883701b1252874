"""What effects of the second generator that no library holds are made of.

Each says which place it has and on which variable it depends: a place is a drive, link, base, tool, marker, the load or
the readings; a variable is the own torque, the own angle, another joint's torque or angle, the load, the attitude
against gravity, the order of the readings, the approach: where a joint came from, by the pose that was visited before,
or hysteresis: what the poses before that have left, too. Where a law multiplies its own torque by another joint's angle
or torque, by the approach or by the attitude, the variable is that other one. Sizes are those of real arms.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from independent_arm import GRAVITY, Arm, Array, Hidden, Rest, Spring, Vector

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


def any_way(rng: np.random.Generator) -> Array:
    """A random direction (3,)."""
    way = rng.standard_normal(3)
    return np.asarray(way / np.linalg.norm(way), dtype=np.float64)


def vector(way: Array) -> Vector:
    return (float(way[0]), float(way[1]), float(way[2]))


def axes_across(arm: Arm, k: int) -> tuple[Vector, ...]:
    """The two axes of link k's frame that are not joint k's."""
    return tuple(vector(np.eye(3)[i]) for i in range(3) if abs(arm.links[k].axis[i]) < 0.5)


def one_across(arm: Arm, k: int, rng: np.random.Generator) -> Vector:
    axes = axes_across(arm, k)
    return axes[int(rng.integers(len(axes)))]


def any_level(rng: np.random.Generator) -> Vector:
    """A random horizontal axis."""
    heading = rng.uniform(0.0, 2.0 * np.pi)
    return (float(np.cos(heading)), float(np.sin(heading)), 0.0)


def either_side(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def of_payload(arm: Arm, force: Array) -> Array:
    """Size (N,) of forces (N, 3) by the payload's weight."""
    return np.asarray(np.linalg.norm(force, axis=1) / (9.81 * arm.payload), dtype=np.float64)


def middle_angle(arm: Arm, k: int, rng: np.random.Generator) -> float:
    """An angle (rad) in the middle half of a joint's range."""
    low, high = arm.links[k].limits
    return float(np.deg2rad(rng.uniform(0.75 * low + 0.25 * high, 0.25 * low + 0.75 * high)))


def came_by(arm: Arm, still: Rest, k: int) -> Array:
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


def softer(arm: Arm, k: int, kind: str, variable: str, law: Callable[[Array, Rest], Array], most: float) -> Unknown:
    """A drive that gives by its own torque and the arm, up to `most` times its compliance."""
    c = arm.compliance[k]
    return Unknown(kind, f"j{k + 1}", variable, gear(arm, k, law), 0.1 * c, most * c)


def beyond(value: Array, hold: float) -> Array:
    """The part (N,) of a moment that is larger than what holds, either way."""
    return np.asarray(np.sign(value) * np.maximum(np.abs(value) - hold, 0.0), dtype=np.float64)


def rises(value: Array, at: float, width: float) -> Array:
    """From 0 to 1 (N,) about a value."""
    return np.asarray(0.5 * (1.0 + np.tanh((value - at) / width)), dtype=np.float64)


def main_compliance(arm: Arm) -> float:
    """Mean of the three main gears, rad/(N m)."""
    return float(np.mean(arm.compliance[:3]))


def line_of(arm: Arm, k: int) -> Array:
    """From joint k to the next one (3,) m, frame of link k."""
    return np.asarray(arm.links[k + 1].origin, dtype=np.float64)


def across(line: Array, rng: np.random.Generator) -> Vector:
    """A random axis across a line."""
    way = np.cross(line, any_way(rng))
    return vector(np.asarray(way / np.linalg.norm(way), dtype=np.float64))


def shifted_marker(m: int, law: Callable[[Rest], Array]) -> Callable[[float], Hidden]:
    """Marker m is shifted by (N, 3) m, base frame, of the arm at rest."""

    def make(size: float) -> Hidden:
        def read(p: Array, still: Rest) -> Array:
            out = p.copy()
            out[:, m] += size * law(still)
            return out

        return Hidden(readings=(read,))

    return make


def carried(still: Rest, step: Callable[[float, int], float]) -> Array:
    """A state (N,) that lasts from visit to visit, 0 before the first: step(state, row) is the one after that row."""
    out, state = np.zeros(len(still.visits.order)), 0.0
    for i in map(int, np.argsort(still.visits.order, kind="stable")):
        state = step(state, i)
        out[i] = state
    return out


def dragged(still: Rest, value: Array, wide: float) -> Array:
    """Where (N,) something lies that is dragged along by a value as soon as that is farther from it than `wide`."""
    return carried(still, lambda lies, i: float(np.clip(lies, value[i] - wide, value[i] + wide)))


def borne(arm: Arm, k: int) -> float:
    """Torque (N m) that the payload can put on joint k: less than on a stretched arm where that lies along its axis."""
    first, *further = [np.array(v) for v in (*(link.origin for link in arm.links[k + 1 :]), arm.tool)]
    reach = float(np.linalg.norm(np.cross(arm.links[k].axis, first))) + sum(float(np.linalg.norm(v)) for v in further)
    return 9.81 * arm.payload * reach


def span(arm: Arm, k: int) -> float:
    """Range of a joint, rad."""
    low, high = arm.links[k].limits
    return float(np.deg2rad(high - low))


def springs(
    k: int,
    where: str,
    axes: tuple[Vector, ...],
    law: Callable[[Array, Rest], Array],
    at: Vector = (0.0, 0.0, 0.0),
    slide: bool = False,
) -> Callable[[float], Hidden]:
    """Places of an arm that turn about axes, or slide along them, each by its own moment or force (N,) and the arm."""

    def make(size: float) -> Hidden:
        def sized(own: Array, still: Rest) -> Array:
            return size * law(own, still)

        return Hidden(springs=tuple(Spring(k, where, axis, slide=slide, at=at, law=sized) for axis in axes))

    return make


def tracker(law: Callable[[Array, Rest], Array], station: Array) -> Callable[[float], Hidden]:
    """A tracker at a station m turns by rotation vectors (N, 3), of the markers (N, K, 3) m and the arm at rest."""

    def make(size: float) -> Hidden:
        def read(p: Array, still: Rest) -> Array:
            return np.asarray(p + size * np.cross(law(p, still)[:, None], p - station), dtype=np.float64)

        return Hidden(readings=(read,))

    return make


def station(rng: np.random.Generator) -> Array:
    """Where a tracker may stand (3,) m, base frame."""
    return np.array([rng.uniform(4.5, 6.0), rng.uniform(-2.0, 2.0), rng.uniform(-0.5, 1.0)])
