"""Where the elastic coordinates of a model act: the chain with its virtual joints, and the loops."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.errors import InputError, PluginError
from qsframework.plugin import (
    Actuator,
    Array,
    Bar,
    Context,
    Effect,
    Geometry,
    Indices,
    Loop,
    RobotFacts,
    Spring,
    VirtualJoint,
    laws,
)
from qsframework.plugin.facts import frozen
from qsframework.plugin.loops import in_order, own_joints
from qsframework.plugin.rotations import homogeneous
from qsframework.robot.kinematics import Chain, Element


@dataclass(frozen=True)
class Member:
    """A loop of a place: the positions of its joints and bars among the place's, and of those that it turns."""

    loop: Loop
    joints: tuple[int, ...]
    bars: tuple[int, ...]
    own: tuple[int, ...]


@dataclass(frozen=True)
class LoopPlace:
    """Loops that build on each other, in the order in which they close, with all their joints and their bars.

    joints: indices among all that turn, branches after the arm's; bars: positions among all bars
    """

    members: tuple[Member, ...]
    joints: tuple[int, ...]
    bars: tuple[int, ...]

    def input(self, kind: str, index: int) -> int | None:
        """Position of an actuator or a bar among the inputs u = (actuators, bars); None of all others."""
        inputs = [*(("actuator", joint) for joint in self.joints), *(("bar", bar) for bar in self.bars)]
        return inputs.index((kind, index)) if (kind, index) in inputs else None

    def of(self, member: Member) -> list[int]:
        """The joints of one of its loops, among all that turn."""
        return [self.joints[j] for j in member.joints]


@dataclass(frozen=True)
class CoordinatePart:
    """One term of an elastic coordinate: it moves an actuator, a bar or an element by `factor`."""

    kind: str
    index: int
    factor: Array | float


@dataclass(frozen=True, eq=False, kw_only=True)
class Layout:
    """The chain of one model.

    joint_elements (n + b,) element of each joint, of the arm's and the branches'; placement_elements (n, 6)
    elements of each joint's placement error, or None; loop_bars: of each loop, in the effects' order, the positions
    of its bars among all bars; coordinates: the parts of each elastic coordinate, in the order of the springs'
    parameters
    """

    facts: RobotFacts
    chain: Chain
    joint_elements: tuple[int, ...]
    placement_elements: Indices | None
    loops: tuple[LoopPlace, ...]
    bars: int
    loop_bars: tuple[tuple[int, ...], ...]
    coordinates: tuple[tuple[CoordinatePart, ...], ...]


def make_layout(facts: RobotFacts, effects: Sequence[Effect]) -> Layout:
    """Lay out the chain for a robot's effects. InputError where two loops share a joint."""
    builder = _Builder(facts, any(isinstance(e, Geometry) and e.moves_placements for e in effects))
    loops, bars = _place_loops(facts, [e for e in effects if isinstance(e, Loop)])
    springs = [e for e in effects if isinstance(e, Spring)]
    virtual = {v: None for s in springs for v in s.virtual_joints(facts) if isinstance(v, VirtualJoint)}
    builder.build(list(virtual))
    coordinates: list[tuple[CoordinatePart, ...]] = []
    for spring in springs:
        parts = tuple(CoordinatePart(*builder.part(v, loops), 1.0) for v in spring.virtual_joints(facts))
        one_to_one = [(part,) for part in parts]  # else each moves all, until `mixed` knows the shares
        coordinates += [parts] * len(spring.compliances(facts)) if mixes(spring) else one_to_one
    limbs = tuple(facts.body_index(branch.parent) for branch in facts.branches)
    return Layout(
        facts=facts,
        chain=Chain(tuple(builder.elements), tuple(builder.stops), limbs),
        joint_elements=tuple(builder.joint_elements),
        placement_elements=np.array(builder.placement_elements) if builder.perturbed else None,
        loops=loops,
        bars=sum(map(len, bars)),
        loop_bars=bars,
        coordinates=tuple(coordinates),
    )


def mixes(spring: Spring) -> bool:
    """Whether an elastic coordinate of a spring may move several virtual joints, or one by a share."""
    return type(spring).mixing is not Spring.mixing


def mixed(layout: Layout, springs: Sequence[tuple[Spring, Array]], context: Context) -> Layout:
    """The layout with the shares by which coordinates move their virtual joints, at the springs' parameters."""
    if not any(mixes(spring) for spring, _ in springs):
        return layout
    out: list[tuple[CoordinatePart, ...]] = []
    for spring, x in springs:
        first, count = len(out), len(spring.compliances(layout.facts))
        own = layout.coordinates[first : first + count]
        if mixes(spring):
            shares = laws.mixing(spring, x, context)
            own = [shared(parts, shares[..., i]) for i, parts in enumerate(own)]
        out += own
    return replace(layout, coordinates=tuple(out))


def shared(parts: tuple[CoordinatePart, ...], shares: Array) -> tuple[CoordinatePart, ...]:
    """The parts of a coordinate with their shares (parts,) or (N, parts); those that move nothing drop out."""
    factors = [shares[..., v] if shares.ndim == 2 else float(shares[v]) for v in range(len(parts))]
    return tuple(replace(p, factor=f) for p, f in zip(parts, factors, strict=True) if np.any(f))


def _place_loops(facts: RobotFacts, loops: Sequence[Loop]) -> tuple[tuple[LoopPlace, ...], tuple[tuple[int, ...], ...]]:
    """The loops by those that are tied to each other; and the bars of each loop."""
    counts: list[int] = np.cumsum([0, *(len(loop.parameters(facts)) for loop in loops)]).tolist()
    bars = tuple(tuple(range(a, b)) for a, b in itertools.pairwise(counts))
    groups: list[list[Loop]] = []
    for loop in in_order(loops, facts):
        joints = set(loop.joints(facts))
        tied = [g for g in groups if any(joints & set(other.joints(facts)) for other in g)]
        groups = [g for g in groups if g not in tied] + [[*(other for g in tied for other in g), loop]]
    return tuple(_place(facts, group, [bars[loops.index(loop)] for loop in group]) for group in groups), bars


def _place(facts: RobotFacts, loops: Sequence[Loop], bars: Sequence[tuple[int, ...]]) -> LoopPlace:
    names = list(dict.fromkeys(joint for loop in loops for joint in loop.joints(facts)))
    every = [bar for own in bars for bar in own]
    members = tuple(
        Member(
            loop,
            tuple(names.index(joint) for joint in loop.joints(facts)),
            tuple(every.index(bar) for bar in own),
            tuple(names.index(joint) for joint in own_joints(loop, facts)),
        )
        for loop, own in zip(loops, bars, strict=True)
    )
    return LoopPlace(members, tuple(facts.turning_index(joint) for joint in names), tuple(every))


class _Builder:
    """Strings placement errors, virtual joints and joints together, base to flange."""

    def __init__(self, facts: RobotFacts, perturbed: bool):
        self.facts, self.perturbed = facts, perturbed
        self.elements: list[Element] = []
        self.stops: list[int] = []
        self.joint_elements: list[int] = []
        self.placement_elements: list[list[int]] = []
        self.virtual: dict[VirtualJoint, int] = {}

    def build(self, virtual: Sequence[VirtualJoint]) -> None:
        here = self._add_virtual([v for v in virtual if self.facts.link_index(v.link) == 0], np.eye(4))
        self.stops.append(len(self.elements))
        for k in range(self.facts.n):
            here = here @ self.facts.placements[k]
            if self.perturbed:
                here = self._add_placement(here)
            mine = [v for v in virtual if self.facts.link_index(v.link) == k + 1]
            on_link = [v for v in mine if v.link in self.facts.links]
            along = (self.facts.bearings[k] or 0.0) * self.facts.axes[k]  # where its bearing tilts
            before = [v for v in on_link if v.side == "before"]
            here = self._add_virtual(before, here @ homogeneous(np.eye(3), along)) @ homogeneous(np.eye(3), -along)
            self.joint_elements.append(self._add(here, self.facts.axes[k], not self.facts.sliding[k]))
            here = self._add_virtual([v for v in on_link if v.side == "after"], np.eye(4))
            self._add_on_flange([v for v in mine if v.link not in self.facts.links])
            self.stops.append(len(self.elements))
        for branch in self.facts.branches:
            self.joint_elements.append(self._add(branch.placement, branch.axis, True))

    def _add(self, placement: Array, axis: Array, rotation: bool) -> int:
        self.elements.append(Element(placement, np.asarray(axis, dtype=float), rotation))
        return len(self.elements) - 1

    def _add_virtual(self, virtual: Sequence[VirtualJoint], placement: Array) -> Array:
        """Virtual joints, the first at a placement; the placement of what follows them."""
        for v in virtual:
            axis = np.eye(3)["xyz".index(v.axis)] if isinstance(v.axis, str) else np.asarray(v.axis, dtype=float)
            self.virtual[v] = self._add(placement, axis / np.linalg.norm(axis), v.kind == "rotation")
            placement = np.eye(4)
        return placement

    def _add_on_flange(self, virtual: Sequence[VirtualJoint]) -> None:
        """Virtual joints at a flange apart from the last link's frame; behind them an element that stays leads back."""
        self._add_virtual(virtual, self.facts.flange_placement)
        if virtual:
            self._add(frozen(np.linalg.inv(self.facts.flange_placement)), np.eye(3)[2], False)

    def _add_placement(self, placement: Array) -> Array:
        indices: list[int] = []
        for i in range(6):
            indices.append(self._add(placement, np.eye(3)[i % 3], i >= 3))
            placement = np.eye(4)
        self.placement_elements.append(indices)
        return placement

    def part(self, v: object, loops: Sequence[LoopPlace]) -> tuple[str, int]:
        if isinstance(v, Actuator):
            return "actuator", self.facts.joint_index(v.joint)
        if isinstance(v, VirtualJoint):
            return "element", self.virtual[v]
        if isinstance(v, Bar):
            named = {m.loop.name: [place.bars[b] for b in m.bars] for place in loops for m in place.members}
            if v.loop not in named:
                raise InputError(f"no loop {v.loop!r}; loops: {', '.join(named) or 'none'}")
            bars = named[v.loop]
            if not 0 <= v.index < len(bars):
                raise InputError(f"loop {v.loop!r} has {len(bars)} bars, counted from 0: no bar {v.index}")
            return "bar", bars[v.index]
        raise PluginError(f"{v!r} is not an Actuator, Bar or VirtualJoint")
