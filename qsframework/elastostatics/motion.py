"""Stages 0 and 1: from commanded angles to the coordinates of every element of the chain.

The controller commands joint angles q by its nominal closure; the actuators stand at
phi = closure^-1(q) + angle errors, and the real loops turn phi into joint angles q(phi, bars)
with G = dq/dphi.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from qsframework.elastostatics.layout import Layout, LoopPlace, shared
from qsframework.plugin import Array, Context, LoopTerm, Poses, laws
from qsframework.plugin.facts import frozen
from qsframework.plugin.loops import follow

KNOWN = 8
"""Batches that are known again: a fit asks for its few at every step."""
Coefficients = tuple[tuple[tuple[int, Array | float], ...], ...]
"""For each elastic coordinate the elements that it moves, with the rate (N,) or constant of each."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion:
    """Actuators phi (n + b, N), bars and joint angles q (n + b, N), arm and branches, the loops' terms, and the
    rates of the coordinates.

    context: the commanded poses in the state that is looked at
    """

    layout: Layout
    context: Context
    phi: Array
    bars: Array
    q: Array
    loops: tuple[LoopTerm, ...]
    coefficients: Coefficients
    placements: Array | None

    @property
    def used(self) -> tuple[int, ...]:
        """The elements that elastic coordinates move."""
        return tuple(sorted({e for terms in self.coefficients for e, _ in terms}))

    def element_values(self, virtual: dict[int, Array] | None = None) -> list[Array | None]:
        """The coordinate (N,) of every element of the chain, None where it is zero."""
        values: list[Array | None] = [None] * len(self.layout.chain)
        for e, q in zip(self.layout.joint_elements, self.q, strict=True):
            values[e] = q
        if self.layout.placement_elements is not None and self.placements is not None:
            for k, elements in enumerate(self.layout.placement_elements):
                for i, e in enumerate(elements):
                    values[e] = self.placements[k, i]
        for e, value in (virtual or {}).items():
            values[e] = value
        return values


def nominal_actuators(layout: Layout, q: Array) -> Array:
    """Actuator angles phi (n + b, N) that the controller commands for the arm's joint angles q (n, N)."""
    facts, phi = layout.facts, np.concatenate([q, np.zeros((len(layout.facts.branches), q.shape[1]))])
    if facts.branches:
        q = follow([m.loop for place in layout.loops for m in place.members], q.T, facts).T
    for place in layout.loops:
        for member in place.members:
            actuators = member.loop.actuators(q[place.of(member)].T, facts)
            for own in (o for o in member.own if place.joints[o] < facts.n):
                phi[place.joints[own]] = actuators[:, member.joints.index(own)]
    return phi


@lru_cache(maxsize=KNOWN)
def commanded_actuators(layout: Layout, poses: Poses) -> Array:
    """`nominal_actuators` of a batch, read-only: no parameter moves them, and every step of a fit asks for them."""
    return frozen(nominal_actuators(layout, np.ascontiguousarray(poses.q.T)))


def move(layout: Layout, context: Context, phi: Array, bars: Array, placements: Array | None = None) -> Motion:
    """Close the loops at actuators phi (n + b, N) and bar errors (bars, N)."""
    q = phi.copy()
    terms: list[LoopTerm] = []
    for place in layout.loops:
        term = _close(place, phi[list(place.joints)].T, bars[list(place.bars)].T, context)
        q[list(place.joints)] = term.q.T
        terms.append(term)
    coefficients = tuple(
        _merge([term for part in parts for term in _rates(layout, terms, part.kind, part.index, part.factor)])
        for parts in layout.coordinates
    )
    return Motion(
        layout=layout,
        context=context,
        phi=phi,
        bars=bars,
        q=q,
        loops=tuple(terms),
        coefficients=coefficients,
        placements=placements,
    )


def _close(place: LoopPlace, phi: Array, bars: Array, context: Context) -> LoopTerm:
    """One term over all actuators (N, k) and bars (N, m) of a place: each loop turns its own joints by the angles
    that those before it have left."""
    if len(place.members) == 1:
        return laws.closure(place.members[0].loop, phi, bars, context)
    q, terms = phi.copy(), list[LoopTerm]()
    for member in place.members:
        tied, own = list(member.joints), list(member.own)
        terms.append(laws.closure(member.loop, q[:, tied], bars[:, list(member.bars)], context))
        q[:, own] = terms[-1].q[:, [tied.index(j) for j in own]]
    count = bars.shape[1]
    return LoopTerm(q, lambda: _chained(place, terms, count)[0], lambda: _chained(place, terms, count, True)[1])


def _chained(place: LoopPlace, terms: Sequence[LoopTerm], m: int, bent: bool = False) -> tuple[Array, Array]:
    """q_u and, where they are asked for, q_uu of loops that turn one after the other, over k joints and m bars."""
    batch, k = len(terms[0].q), len(place.joints)
    lengths = np.broadcast_to(np.eye(k + m)[k:], (batch, m, k + m))
    first, second = np.zeros((batch, k, k + m)), np.zeros((batch, k, k + m, k + m) if bent else 0)
    first[:, range(k), range(k)] = 1.0
    for member, term in zip(place.members, terms, strict=True):
        tied, own = list(member.joints), list(member.own)
        rows = [tied.index(j) for j in own]
        u = np.concatenate([first[:, tied], lengths[:, list(member.bars)]], axis=1)
        if bent:
            before = np.einsum("niu,nuab->niab", term.q_u[:, rows, : len(tied)], second[:, tied])
            second[:, own] = before + np.einsum("niuv,nua,nvb->niab", term.q_uu[:, rows], u, u, optimize=True)
        first[:, own] = term.q_u[:, rows] @ u
    return first, second


def _rates(
    layout: Layout, terms: Sequence[LoopTerm], kind: str, index: int, factor: Array | float
) -> list[tuple[int, Array | float]]:
    """The elements that one actuator, bar or element moves."""
    if kind == "element":
        return [(index, factor)]
    for place, term in zip(layout.loops, terms, strict=True):
        column = place.input(kind, index)
        if column is not None:
            slopes = [(layout.joint_elements[j], term.q_u[:, i, column]) for i, j in enumerate(place.joints)]
            return [(e, _times(slope, factor)) for e, slope in slopes if np.any(slope)]
    return [(layout.joint_elements[index], factor)]


def _merge(terms: list[tuple[int, Array | float]]) -> tuple[tuple[int, Array | float], ...]:
    total: dict[int, Array | float] = {}
    for e, rate in terms:
        total[e] = total[e] + rate if e in total else rate
    return tuple(sorted(total.items()))


@dataclass(frozen=True, eq=False)
class MotionRate:
    """Derivative of a Motion along one parameter: element rates (m, N) and rates of the coefficients."""

    elements: Array
    coefficients: Coefficients


def motion_along(motion: Motion, phi: Array, bars: Array, placements: Array | None) -> MotionRate:
    """Move along d phi (n, N) of the arm's actuators, d bars (bars, N) and d placements (n, 6, N)."""
    layout = motion.layout
    rates = np.zeros((len(layout.chain), phi.shape[-1]))
    phi = np.concatenate([phi, np.zeros((len(layout.joint_elements) - len(phi), phi.shape[-1]))])
    dq = phi.copy()
    slopes: list[LoopTerm] = []
    for place, term in zip(layout.loops, motion.loops, strict=True):
        du = np.concatenate([phi[list(place.joints)], bars[list(place.bars)]]).T
        dq[list(place.joints)] = np.einsum("niu,nu->in", term.q_u, du)
        slopes.append(LoopTerm(term.q, np.einsum("niuv,nv->niu", term.q_uu, du)))
    rates[list(layout.joint_elements)] = dq
    if layout.placement_elements is not None and placements is not None:
        rates[layout.placement_elements] = placements
    coefficients = tuple(
        _merge(
            [t for p in parts if p.kind != "element" for t in _loop_rates(layout, slopes, p.kind, p.index, p.factor)]
        )
        for parts in layout.coordinates
    )
    return MotionRate(rates, coefficients)


def mixed_along(motion: Motion, whole: Layout, first: int, slope: Array, eps: Array | None = None) -> MotionRate:
    """Move along a change of the shares (v, k) or (N, v, k) of a spring whose coordinates begin at `first`.

    whole: the layout with every part of every coordinate; eps (ne, N): the deflection of the motion, which moves along
    """
    rates: list[tuple[tuple[int, Array | float], ...]] = [()] * len(whole.coordinates)
    moved: dict[str, Array] = {
        kind: np.zeros((count, motion.q.shape[-1]))
        for kind, count in (("actuator", len(motion.phi)), ("bar", whole.bars), ("element", len(whole.chain)))
    }
    for i in range(slope.shape[-1]):
        parts = shared(whole.coordinates[first + i], slope[..., i])
        rates[first + i] = _merge([t for p in parts for t in _rates(whole, motion.loops, p.kind, p.index, p.factor)])
        if eps is not None:
            for part in parts:
                moved[part.kind][part.index] += part.factor * eps[first + i]
    if eps is None:
        return MotionRate(moved["element"], tuple(rates))
    along = motion_along(motion, moved["actuator"], moved["bar"], None)
    both = zip(rates, along.coefficients, strict=True)
    return MotionRate(along.elements + moved["element"], tuple(_merge([*own, *bent]) for own, bent in both))


def _loop_rates(
    layout: Layout, slopes: Sequence[LoopTerm], kind: str, index: int, factor: Array | float
) -> list[tuple[int, Array | float]]:
    """Like `_rates` for the loops' slopes: an actuator outside every loop has a constant rate."""
    tied = any(place.input(kind, index) is not None for place in layout.loops)
    return _rates(layout, slopes, kind, index, factor) if tied else []


def combine(coefficients: Coefficients, columns: Array) -> Array:
    """Columns of the elastic coordinates (ne, ..., N) from those of the elements (u, ..., N).

    Elements that are not upstream of the point (index >= u) move nothing.
    """
    upstream = len(columns)
    out = np.zeros((len(coefficients), *columns.shape[1:]))
    for row, terms in zip(out, coefficients, strict=True):
        for e, rate in terms:
            if e < upstream:
                row += _times(columns[e], rate)
    return out


def _times(values: Array, factor: Array | float) -> Array:
    """values factor; the values themselves where it is the number 1, as of most springs."""
    return values if isinstance(factor, float) and factor == 1.0 else values * factor
