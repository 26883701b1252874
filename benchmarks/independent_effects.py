"""What may be hidden in the arms of the second generator: effects that a library may hold, and other structures.

Laws are written out here in numpy. An effect's name is what a right answer calls it, place included; its size is a
number that is scaled until it shows as much as is wanted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from independent import Campaign, Setting, Unreachable
from independent_arm import (
    COILED,
    GASSED,
    HEAVY,
    LOOP,
    SMALL,
    Arm,
    Array,
    Coil,
    Hidden,
    Rest,
    Rope,
    Spring,
    Vector,
    turn,
)

READINGS = ("displacements", "positions", "mixed")
_LIMIT = 10.0
"""Usual sizes up to which an effect is real."""
_SHORT = 0.05
"""m below which a link does not bend."""


@dataclass(frozen=True)
class Effect:
    """An effect at one place: name of the right answer; make(size) hides `size` times what is usual."""

    name: str
    make: Callable[[float], Hidden]

    @property
    def kind(self) -> str:
        """Without its place."""
        return self.name.partition("[")[0]


Places = Callable[[Arm, np.random.Generator], Iterator[Effect]]
Law = Callable[[Array, Rest], Array]


def _axis(i: int) -> Vector:
    return (float(i == 0), float(i == 1), float(i == 2))


def _soft(arm: Arm) -> float:
    """A usual compliance of bearings and links, rad/(N m): a third of the main gears'."""
    return 0.33 * float(np.mean(arm.compliance[:3]))


def _turn_or_slide(arm: Arm, k: int, where: str, way: str) -> Callable[[float], Hidden]:
    """A spring along or about an axis; 1 m of lever makes a slide of a turn."""
    size = _soft(arm) * (1.0 if way.startswith("r") else 0.1)
    axis, slides = _axis("xyz".index(way[-1])), not way.startswith("r")
    return lambda t: Hidden(springs=(Spring(k, where, axis, t * size, slides),))


def _gear(arm: Arm, k: int, law: Law) -> Callable[[float], Hidden]:
    one = np.eye(len(arm.links))[k]
    return lambda t: Hidden(gears=(lambda still: t * law(still.torque[:, k], still)[:, None] * one,))


def _either(rng: np.random.Generator, make: Callable[[float], Hidden]) -> Callable[[float], Hidden]:
    """More or less of it, by a coin."""
    sign = float(rng.choice([-1.0, 1.0]))
    return lambda t: make(sign * t)


# ---------------------------------------------------------------- springs


def offaxis_compliance(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """A bearing tilts, or the link before it twists."""
    for k, link in enumerate(arm.links):
        for i in (i for i in range(3) if abs(link.axis[i]) < 0.5):
            name = f"offaxis_compliance[j{k + 1}/{'xyz'[i]}]"
            yield Effect(name, _turn_or_slide(arm, k, "before", f"r{'xyz'[i]}"))


def link_compliance(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """A link gives at its frame."""
    for k in range(len(arm.links) - 1):
        for way in ("x", "y", "z", "rx", "ry", "rz"):
            yield Effect(f"link_compliance[l{k + 1}/{way}]", _turn_or_slide(arm, k, "after", way))


def base_compliance(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """The pedestal gives."""
    for way in ("x", "y", "z", "rz") if arm.foot else ("x", "y", "z", "rx", "ry", "rz"):
        yield Effect(f"base_compliance[{way}]", _turn_or_slide(arm, 0, "foot", way))


def flange_compliance(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """The tool gives on its flange."""
    for way in ("x", "y", "z", "rx", "ry", "rz"):
        yield Effect(f"flange_compliance[{way}]", _turn_or_slide(arm, len(arm.links) - 1, "after", way))


def link_bending(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """A link bends along its length: eight hinges."""
    for k in range(len(arm.links) - 1):
        line = np.array(arm.links[k + 1].origin, dtype=np.float64)
        if np.linalg.norm(line) <= _SHORT:
            continue
        first = np.cross(line, np.eye(3)[int(np.argmin(np.abs(line)))])
        for name, across in (("u", first), ("v", np.cross(line, first))):
            axis = np.asarray(across / np.linalg.norm(across), dtype=np.float64)
            yield Effect(f"link_bending[l{k + 1}/{name}]", _hinges(k, line, axis, _soft(arm)))


def _hinges(k: int, line: Array, axis: Array, soft: float) -> Callable[[float], Hidden]:
    at = [(i + 0.5) / 8.0 * line for i in range(8)]

    def make(t: float) -> Hidden:
        way = (float(axis[0]), float(axis[1]), float(axis[2]))
        springs = (Spring(k, "after", way, t * soft / 8.0, at=(float(p[0]), float(p[1]), float(p[2]))) for p in at)
        return Hidden(springs=tuple(springs))

    return make


def base_lift(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """A pedestal that gives lifts off the floor beyond a moment, on one side."""
    for i in (0, 1) if arm.foot else ():
        held, side = arm.torque * rng.uniform(0.8, 1.2), float(rng.choice([-1.0, 1.0]))

        def make(t: float, i: int = i, held: float = held, side: float = side) -> Hidden:
            def law(own: Array, still: Rest) -> Array:
                return side * t * arm.foot * np.maximum(side * own - held, 0.0)

            return Hidden(springs=(Spring(0, "foot", _axis(i), law=law),))

        yield Effect(f"base_lift[r{'xyz'[i]}]", make)


# ---------------------------------------------------------------- gears


def joint_hardening(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """A gear gives by the cube of its torque, more or less."""
    for k, c in enumerate(arm.compliance):
        yield Effect(
            f"joint_hardening[j{k + 1}]",
            _either(rng, _gear(arm, k, lambda T, still, k=k, c=c: 0.1 * c * T**3 / _full(arm, k) ** 2)),
        )


def _full(arm: Arm, k: int) -> float:
    """N m of the payload about joint k of the stretched arm."""
    reach = [float(np.linalg.norm(link.origin)) for link in arm.links[k + 1 :]]
    return 9.81 * arm.payload * (sum(reach) + float(np.linalg.norm(arm.tool)))


def joint_backlash(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """A gear lies at one side of its play or at the other."""
    for k in range(len(arm.links)):
        width = 2e-3 * arm.torque
        yield Effect(
            f"joint_backlash[j{k + 1}]",
            _gear(arm, k, lambda T, still, width=width: 1e-4 * T / np.sqrt(T**2 + width**2)),
        )


def gear_flank(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """A gear whose flanks are not alike."""
    for k, c in enumerate(arm.compliance):
        yield Effect(
            f"gear_flank[j{k + 1}]", _either(rng, _gear(arm, k, lambda T, still, c=c: 0.1 * c * np.maximum(T, 0.0)))
        )


def gear_waves(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """A gear that is softer at some angles, once per turn."""
    for k, c in enumerate(arm.compliance):
        phase = rng.uniform(0.0, 2.0 * np.pi)
        yield Effect(
            f"gear_waves[j{k + 1}]",
            _gear(arm, k, lambda T, still, k=k, c=c, phase=phase: 0.1 * c * T * np.sin(still.angles[:, k] + phase)),
        )


def gear_friction(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """A gear stops short on the side from which it came, until its load slips it."""
    for k in range(len(arm.links)):

        def law(T: Array, still: Rest) -> Array:
            share = still.visits.loaded * T**2 / (T**2 + (0.1 * arm.torque) ** 2)
            return -1e-4 * ((1.0 - share) * still.visits.side + share * np.sign(T))

        yield Effect(f"gear_friction[j{k + 1}]", _gear(arm, k, law))


# ---------------------------------------------------------------- loads and masses


def load_direction(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """The load pulls aslant."""
    way = rng.standard_normal(2)
    way = 0.01 * np.array([*way / np.linalg.norm(way), 0.0])
    yield Effect(
        "load_direction", lambda t: Hidden(loads=(lambda f, m, R: (f @ turn(t * way).T, m @ turn(t * way).T),))
    )


def load_point_offset(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """The load acts beside its point."""
    way = rng.standard_normal(3)
    way *= 0.01 / np.linalg.norm(way)
    yield Effect("load_point_offset", lambda t: Hidden(loads=(lambda f, m, R: (f, m + np.cross(R @ (t * way), f)),)))


def load_scale(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """The load is larger than it was thought."""
    yield Effect("load_scale", _either(rng, lambda t: Hidden(loads=(lambda f, m, R: (f * (1 + 0.02 * t), m),))))


def link_mass(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """Something heavy was bolted to a link, near its centre."""
    for k, link in enumerate(arm.links[1:], 1):
        at = np.array(link.centre) + 0.1 * rng.standard_normal(3)

        def make(t: float, k: int = k, at: Array = at) -> Hidden:
            more = 0.03 * t * arm.payload
            first = more * at
            return Hidden(masses=((k, more, (float(first[0]), float(first[1]), float(first[2]))),))

        yield Effect(f"link_mass[l{k + 1}]", make)


def hose(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """A hose from above pulls the flange, always taut."""
    reach = arm.torque / (9.81 * arm.payload)
    size = 0.01 * 9.81 * arm.payload / reach
    yield Effect(
        f"hose[l{len(arm.links)}]",
        lambda t: Hidden(ropes=(Rope((0.0, 0.0, 1.5 * reach), lambda length: t * size * length),)),
    )


# ---------------------------------------------------------------- geometry


def joint_offset(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """An encoder's zero."""
    for k in range(len(arm.links)):
        one = 1e-4 * np.eye(len(arm.links))[k]
        yield Effect(
            f"joint_offset[j{k + 1}]", _either(rng, lambda t, one=one: Hidden(angles=(lambda q, v: t * one + 0.0 * q,)))
        )


def joint_placement(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """A joint is not where the drawing says."""
    n = len(arm.links)
    for k in range(n):
        shift, tilt = 2e-4 * rng.standard_normal(3), 2e-4 * rng.standard_normal(3)

        def make(t: float, k: int = k, shift: Array = shift, tilt: Array = tilt) -> Hidden:
            moved = t * np.eye(n)[k][:, None] * shift
            way = (float(t * tilt[0]), float(t * tilt[1]), float(t * tilt[2]))
            return Hidden(shifts=(lambda v: np.broadcast_to(moved, (len(v.force), n, 3)),), tilts=((k, way),))

        yield Effect(f"joint_placement[j{k + 1}]", make)


def encoder_eccentricity(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """A disc off its centre."""
    for k in range(len(arm.links)):
        one, phase = 5e-5 * np.eye(len(arm.links))[k], rng.uniform(0.0, 2.0 * np.pi)

        def make(t: float, k: int = k, one: Array = one, phase: float = phase) -> Hidden:
            return Hidden(angles=(lambda q, v: t * np.sin(q[:, k] + phase)[:, None] * one,))

        yield Effect(f"encoder_eccentricity[j{k + 1}]", make)


def gear_ratio(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """A joint turns by a share more."""
    for k in range(len(arm.links)):
        one = 2e-4 * np.eye(len(arm.links))[k]
        yield Effect(
            f"gear_ratio[j{k + 1}]", _either(rng, lambda t, one=one: Hidden(angles=(lambda q, v: t * q * one,)))
        )


def link_growth(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """A link is longer while the load is on: its drive has warmed up."""
    n = len(arm.links)
    for k in range(n - 1):
        line = np.array(arm.links[k + 1].origin, dtype=np.float64)
        if np.linalg.norm(line) <= _SHORT:
            continue
        way = 3e-5 * line / np.linalg.norm(line)

        def make(t: float, k: int = k, way: Array = way) -> Hidden:
            return Hidden(shifts=(lambda v: t * v.loaded[:, None, None] * np.eye(n)[k + 1][:, None] * way,))

        yield Effect(f"link_growth[l{k + 1}]", make)


def thermal_expansion(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """The whole arm grows with the temperature that was recorded."""
    origins = 1.2e-5 * np.array([link.origin for link in arm.links])
    yield Effect("thermal_expansion", lambda t: Hidden(shifts=(lambda v: t * v.warmth[:, None, None] * origins,)))


# ---------------------------------------------------------------- readings


def marker_offset_loaded(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """A reflector moves on its link while the load is on."""
    yield from _marker(arm, rng, "marker_offset_loaded[m{}]", lambda still: still.visits.loaded)


def marker_offset_after(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """A reflector was touched after half of the readings."""
    yield from _marker(
        arm, rng, "marker_offset_after[m{}/50]", lambda still: (still.visits.order >= 0.5).astype(np.float64)
    )


def _marker(arm: Arm, rng: np.random.Generator, name: str, when: Callable[[Rest], Array]) -> Iterator[Effect]:
    for m in range(len(arm.markers)):
        way = rng.standard_normal(3)
        way *= 1e-4 / np.linalg.norm(way)

        def make(t: float, m: int = m, way: Array = way) -> Hidden:
            def read(p: Array, still: Rest) -> Array:
                out = p.copy()
                out[:, m] += t * when(still)[:, None] * (still.turned[:, -1] @ way)
                return out

            return Hidden(readings=(read,))

        yield Effect(name.format(m + 1), make)


def tracker_frame(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """The axes of the displacements are not quite those of the base."""
    way = 5e-3 * rng.standard_normal(3)
    yield Effect("tracker_frame", lambda t: Hidden(readings=(lambda p, still: p @ turn(t * way).T,)))


def tracker_scale(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """All readings are larger."""
    yield Effect("tracker_scale", _either(rng, lambda t: Hidden(readings=(lambda p, still: p * (1 + 1e-4 * t),))))


def tracker_drift(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """The tracker moves evenly in time, which was recorded."""
    way = 2e-8 * rng.standard_normal(3)
    yield Effect(
        "tracker_drift", lambda t: Hidden(readings=(lambda p, still: p + t * still.visits.time[:, None, None] * way,))
    )


def reading_drift(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """All readings move evenly from the first to the last."""
    way = 1e-4 * rng.standard_normal(3)
    yield Effect(
        "reading_drift", lambda t: Hidden(readings=(lambda p, still: p + t * still.visits.order[:, None, None] * way,))
    )


def tracker_move(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """The tracker was pushed after half of the readings."""
    shift, tilt = 1e-4 * rng.standard_normal(3), 5e-5 * rng.standard_normal(3)

    def make(t: float) -> Hidden:
        def read(p: Array, still: Rest) -> Array:
            after = (still.visits.order >= 0.5)[:, None, None]
            return np.where(after, p @ turn(t * tilt).T + t * shift, p)

        return Hidden(readings=(read,))

    yield Effect("tracker_move[50]", make)


# ---------------------------------------------------------------- balancers and loops


def balancer_off(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """A balancer's spring or pressure is some per cent off its data sheet."""
    if arm.balancer is not None:
        name = "gravity_compensator[j2]" if isinstance(arm.balancer, Coil) else "gas_balancer[j2]"
        yield Effect(name, _either(rng, lambda t: Hidden(charge=0.02 * t)))


def long_bar(arm: Arm, rng: np.random.Generator) -> Iterator[Effect]:
    """The bar of a parallelogram is too long or too short."""
    if arm.lever:
        yield Effect("parallelogram[j3]", _either(rng, lambda t: Hidden(bar=1e-4 * t)))


# ---------------------------------------------------------------- which readings show which


GIVES: tuple[Places, ...] = (
    offaxis_compliance,
    link_compliance,
    base_compliance,
    flange_compliance,
    link_bending,
    joint_hardening,
    joint_backlash,
    gear_flank,
    gear_waves,
)
SHOWN: dict[str, tuple[Places, ...]] = {
    "displacements": (
        *GIVES,
        base_lift,
        load_direction,
        load_point_offset,
        link_growth,
        marker_offset_loaded,
        tracker_frame,
    ),
    "recorded displacements": (gear_friction, tracker_drift, thermal_expansion),
    "positions": (
        *GIVES,
        load_scale,
        hose,
        encoder_eccentricity,
        gear_ratio,
        marker_offset_after,
        tracker_move,
        long_bar,
    ),
    "recorded positions": (gear_friction,),
    "positions, springs fitted": (joint_offset, joint_placement, link_mass, tracker_scale, reading_drift, balancer_off),
    "mixed": (*GIVES, encoder_eccentricity),
}
"""Effects by the campaign that is made for them; of positions the geometry is fitted too where nothing is said."""


def campaign_for(words: str, arm: Arm, poses: int, seed: int, noise: str) -> Setting:
    """The campaign that a key of SHOWN means."""
    kind = next(k for k in ("displacements", "positions", "mixed") if k in words)
    fit = "springs" if "springs" in words else "geometry"
    loads = ("two", "many")[seed % 2]
    return Setting(arm, poses, seed, kind, noise, fit, loads, "recorded" in words)


def hide(campaign: Campaign, places: Places, wanted: float, rng: np.random.Generator) -> tuple[Effect, float]:
    """An effect at the first of its places, in random order, that shows as much, and its size; else Unreachable."""
    found = list(places(campaign.setting.arm, rng))
    for i in map(int, rng.permutation(len(found))):
        try:
            return found[i], campaign.sized(found[i].make, wanted, 1.0, _LIMIT)
        except Unreachable:
            continue
    raise Unreachable


# ---------------------------------------------------------------- structures


@dataclass(frozen=True)
class Structure:
    """An arm, another one that its files describe, and what a right answer calls the difference."""

    name: str
    arm: Arm
    told: Arm
    kind: str = "displacements"


def structures() -> tuple[Structure, ...]:
    """Loops, balancers and angles that the files have and the arm has not, or the reverse."""
    absent, present, angle = (
        "loop absent: parallelogram[j3]",
        "loop present: parallelogram[j3]",
        "controller_coupling[j3]",
    )
    serial = replace(LOOP, lever=0.0)
    coil = replace(HEAVY, balancer=Coil(0.25, 1.0, 1.5e5, 0.55))
    return (
        *(Structure(absent, serial, LOOP, kind) for kind in READINGS),
        *(Structure(present, replace(arm, lever=0.5), arm, kind) for arm in (HEAVY, SMALL) for kind in READINGS),
        *(Structure(angle, replace(arm, absolute=True), arm) for arm in (HEAVY, COILED)),
        *(Structure(angle, LOOP, replace(LOOP, absolute=False), kind) for kind in ("displacements", "positions")),
        *(Structure(angle, replace(LOOP, absolute=False), LOOP, kind) for kind in ("displacements", "mixed")),
        *(
            Structure(f"balancer absent: {name}[j2]", replace(arm, balancer=None), arm, kind)
            for name, arm in (("gravity_compensator", COILED), ("gravity_compensator", coil), ("gas_balancer", GASSED))
            for kind in ("displacements", "positions")
        ),
    )
