"""What a reading that is not as expected most likely is: the plainest mistake whose undoing makes it right.

A mistake without a free number comes before one with some: readings that an exchange of two markers makes right are
seldom of a tracker that was moved.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product

import numpy as np

from qsf_day.judge import Known, StateReading, judge
from qsf_day.record import Slot
from qsframework.plugin import Array

_RIGHT = 1e-3
"""Chance from which a mended reading is as expected."""
_UNITS = {"m": 1000.0, "cm": 10.0, "inch": 25.4, "um": 1e-3, "m, read as inch": 1000.0 / 25.4}
"""What a number in another unit must be multiplied with to be mm."""
_DECIMALS = (0.1, 10.0, 0.01, 100.0)
_SHARES = {
    0.0: "no load",
    0.1: "a tenth of the load",
    10.0: "ten times the load",
    0.5: "half the load",
    2.0: "twice the load",
}
_MOST_ORDERS = 4
"""Markers up to which all orders are tried, above it exchanges of two."""
_STEP = 1e-3
_LEAST_ANGLE = float(np.deg2rad(0.02))
_ROUNDS = 4


@dataclass(frozen=True, eq=False, kw_only=True)
class Explanation:
    """What the reading probably is. kind: one of the table in docs/day.md; what: its numbers or names for the words;
    xyz: the readings (M, 3) m as they were meant, None where only another reading tells; p: chance of what it leaves;
    or_: other mistakes of the same rank that make it right as well"""

    kind: str
    what: tuple[str, ...] = ()
    p: float = 0.0
    xyz: Array | None = None
    or_: tuple[Explanation, ...] = ()


def most_likely(known: Known, state: StateReading) -> Explanation:
    """The plainest mistake that makes the readings of a state right; kind "unknown" where none does."""
    for rank in (_typed, _placed, _part, _angle, _moved):
        likely = sorted((m for m in rank(known, state) if m.p >= _RIGHT), key=lambda m: -m.p)
        if likely:
            best = likely[0]
            rest = [m for m in likely if (m.kind, m.what) != (best.kind, best.what) and m.p > 0.01 * best.p]
            return replace(best, or_=tuple(rest[:2]))
    return Explanation(kind="unknown")


def _typed(known: Known, state: StateReading) -> Iterator[Explanation]:
    """Markers exchanged, a unit, a sign, two axes, a decimal: each with what was meant."""
    for kind, what, xyz in _retyped(known.expected.names, state):
        yield Explanation(kind=kind, what=what, p=judge(known, replace(state, xyz=xyz)).p, xyz=xyz)


def _retyped(names: Sequence[str], state: StateReading) -> Iterator[tuple[str, tuple[str, ...], Array]]:
    """Kind, names for the words, and readings (M, 3) m as they may have been meant."""
    xyz, read = state.xyz, np.flatnonzero(state.read)
    for order in _orders(len(read)):
        other = xyz.copy()
        other[read] = xyz[read[list(order)]]
        exchanged = tuple(names[int(read[i])] for i, j in enumerate(order) if i != j)
        yield "markers", exchanged, other
    yield from (("unit", (unit,), factor * xyz) for unit, factor in _UNITS.items())
    for signs in product((1.0, -1.0), repeat=3):
        if min(signs) < 0.0:
            yield "sign", tuple(a for a, s in zip("xyz", signs, strict=True) if s < 0.0), xyz * signs
    for axes in permutations(range(3)):
        if axes != (0, 1, 2):
            yield "axes", tuple("xyz"[i] for i in axes), xyz[:, list(axes)]
    for m, k in product(map(int, read), range(3)):
        for factor in (*_DECIMALS, -1.0):
            other = xyz.copy()
            other[m, k] *= factor
            kind = "sign of one" if factor < 0.0 else "decimal"
            yield kind, (names[m], "xyz"[k], f"{1e3 * other[m, k]:.3f}"), other


def _orders(count: int) -> Iterator[tuple[int, ...]]:
    """Orders of some markers other than their own."""
    same = tuple(range(count))
    if count <= _MOST_ORDERS:
        yield from (order for order in permutations(same) if order != same)
        return
    for a, b in combinations(same, 2):
        order = list(same)
        order[a], order[b] = b, a
        yield tuple(order)


def _placed(known: Known, state: StateReading) -> Iterator[Explanation]:
    """Another pose's readings, another load than the protocol's."""
    visits, slot = known.expected.protocol.visits, state.slot
    visit = visits[slot.visit]
    loaded = visit.states[slot.state].loaded
    if loaded:
        for share, what in _SHARES.items():
            kind = "no load" if share == 0.0 else "load"
            yield Explanation(kind=kind, what=(what,), p=judge(known, state, share).p)
        yield Explanation(kind="exchanged", p=judge(known, state, -1.0).p)
    else:
        for k, other in enumerate(visit.states):
            if other.loaded:
                p = judge(known, replace(state, slot=Slot(slot.visit, k))).p
                yield Explanation(kind="still loaded", what=(other.load_id,), p=p)
    for v, elsewhere in enumerate(visits):
        if elsewhere.pose == visit.pose:
            continue
        at = Slot(v, next((k for k, s in enumerate(elsewhere.states) if s.loaded == loaded), 0))
        # without the states of that visit to compare with, the place alone is asked
        apart = replace(known, states=tuple(s for s in known.states if s.slot.visit != v))
        verdict = judge(apart, replace(state, slot=at))
        if any(c.kind == "place" for c in verdict.checks):
            yield Explanation(kind="pose", what=(elsewhere.pose,), p=verdict.p)


def _part(known: Known, state: StateReading) -> Iterator[Explanation]:
    """One marker that is off alone: a reflector that does not sit in its nest, a number typed wrongly."""
    read = np.flatnonzero(state.read)
    for m in map(int, read) if len(read) >= 3 else ():
        rest = state.xyz.copy()
        rest[m] = np.nan
        yield Explanation(kind="marker", what=(known.expected.names[m],), p=judge(known, replace(state, xyz=rest)).p)


def _angle(known: Known, state: StateReading) -> Iterator[Explanation]:
    """One joint that stands elsewhere than the protocol says: Gauss-Newton on its angle, all joints at once."""
    e, placed, read = known.expected, known.placed.get(state.series), state.read
    if placed is None or not read.any():
        return
    visit = e.protocol.visits[state.slot.visit]
    n = len(visit.pendant)
    home = e.standing(visit.pendant[None])[0]
    delta = np.zeros(n)
    target = (state.xyz - placed.frame.origin) @ placed.frame.rotation  # as the base sees the readings
    place = known.place(state.slot) - home  # what load and carrier add to the nominal markers
    for _ in range(_ROUNDS):
        ends = visit.pendant + np.concatenate([np.diag(delta), np.diag(delta + _STEP)])
        there = e.standing(ends)
        slope = (there[n:] - there[:n])[:, read].reshape(n, -1) / _STEP
        left = (target - place - there[:n])[:, read].reshape(n, -1)
        delta = delta + (slope * left).sum(axis=1) / np.maximum((slope**2).sum(axis=1), 1e-12)
    shifts = e.standing(visit.pendant + np.diag(delta)) - home
    controller = e.experiment.robot.controller
    for k in range(n):
        angle = float(visit.pendant[k] + delta[k])
        if abs(delta[k]) < _LEAST_ANGLE or not controller.lower[k] - 1.0 <= angle <= controller.upper[k] + 1.0:
            continue
        p = judge(known, state, shift=shifts[k]).p
        if p >= _RIGHT:
            joint = e.experiment.robot.facts.driven[k]
            unit = controller.units[k]
            yield Explanation(kind="angle", what=(f"q{k + 1}", joint, f"{unit.per * delta[k]:+.2f} {unit.shown}"), p=p)


def _moved(known: Known, state: StateReading) -> Iterator[Explanation]:
    """All markers moved together: the tracker, its base, or the whole arm stands elsewhere."""
    if state.series in known.placed and int(state.read.sum()) >= 3:
        verdict = judge(known, replace(state, series=""))
        yield Explanation(kind="tracker", p=min((c.p for c in verdict.checks if c.kind == "shape"), default=0.0))
