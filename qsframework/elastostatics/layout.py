"""Where the elastic coordinates of a model act: the chain with its virtual joints, and the loops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.errors import InputError, PluginError
from qsframework.plugin import Actuator, Array, Bar, Effect, Geometry, Indices, Loop, RobotFacts, Spring, VirtualJoint
from qsframework.robot.kinematics import Chain, Element


@dataclass(frozen=True)
class LoopPlace:
    """A loop, the joints it ties together and the position of its bars among all bars."""

    loop: Loop
    joints: tuple[int, ...]
    bars: tuple[int, ...]


@dataclass(frozen=True)
class Part:
    """One term of an elastic coordinate: it moves an actuator, a bar or an element by `factor`."""

    kind: str
    index: int
    factor: float


@dataclass(frozen=True, eq=False)
class Layout:
    """The chain of one model.

    joint_elements (n,) element of each joint; placement_elements (n, 6) elements of each joint's
    placement error, or None; coordinates: the parts of each elastic coordinate, in the order of
    the springs' parameters
    """

    facts: RobotFacts
    chain: Chain
    joint_elements: tuple[int, ...]
    placement_elements: Indices | None
    loops: tuple[LoopPlace, ...]
    bars: int
    coordinates: tuple[tuple[Part, ...], ...]


def make_layout(facts: RobotFacts, effects: Sequence[Effect]) -> Layout:
    """Lay out the chain for a robot's effects. InputError where two loops share a joint."""
    builder = _Builder(facts, any(isinstance(e, Geometry) and e.moves_placements for e in effects))
    loops, bars = _place_loops(facts, [e for e in effects if isinstance(e, Loop)])
    springs = [e for e in effects if isinstance(e, Spring)]
    virtual = {v: None for s in springs for v in s.virtual_joints(facts) if isinstance(v, VirtualJoint)}
    builder.build(list(virtual))
    coordinates: list[tuple[Part, ...]] = []
    for spring in springs:
        joints = [builder.part(v, loops) for v in spring.virtual_joints(facts)]
        mixing = spring.mixing(facts)
        for column in mixing.T:
            parts = zip(joints, column, strict=True)
            coordinates.append(tuple(Part(kind, index, float(f)) for (kind, index), f in parts if f != 0.0))
    return Layout(
        facts,
        Chain(tuple(builder.elements), tuple(builder.stops)),
        tuple(builder.joint_elements),
        np.array(builder.placement_elements) if builder.perturbed else None,
        loops,
        bars,
        tuple(coordinates),
    )


def _place_loops(facts: RobotFacts, loops: Sequence[Loop]) -> tuple[tuple[LoopPlace, ...], int]:
    placed: list[LoopPlace] = []
    used: set[int] = set()
    bars = 0
    for loop in loops:
        joints = tuple(facts.joint_index(j) for j in loop.joints(facts))
        if used & set(joints):
            raise InputError(f"{loop.name} shares a joint with another loop; a joint belongs to one loop only")
        used |= set(joints)
        count = len(loop.parameters(facts))
        placed.append(LoopPlace(loop, joints, tuple(range(bars, bars + count))))
        bars += count
    return tuple(placed), bars


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
        here = np.eye(4)
        for v in (v for v in virtual if self.facts.link_index(v.link) == 0):
            here = self._add_virtual(v, here)
        self.stops.append(len(self.elements))
        for k in range(self.facts.n):
            here = here @ self.facts.placements[k]
            if self.perturbed:
                here = self._add_placement(here)
            mine = [v for v in virtual if self.facts.link_index(v.link) == k + 1]
            for v in (v for v in mine if v.side == "before"):
                here = self._add_virtual(v, here)
            self.joint_elements.append(self._add(here, self.facts.axes[k], True))
            here = np.eye(4)
            for v in (v for v in mine if v.side == "after"):
                here = self._add_virtual(v, here)
            self.stops.append(len(self.elements))

    def _add(self, placement: Array, axis: Array, rotation: bool) -> int:
        self.elements.append(Element(placement, np.asarray(axis, dtype=float), rotation))
        return len(self.elements) - 1

    def _add_virtual(self, v: VirtualJoint, placement: Array) -> Array:
        axis = np.eye(3)["xyz".index(v.axis)] if isinstance(v.axis, str) else np.asarray(v.axis, dtype=float)
        self.virtual[v] = self._add(placement, axis / np.linalg.norm(axis), v.kind == "rotation")
        return np.eye(4)

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
            for place in loops:
                if place.loop.name == v.loop:
                    if not 0 <= v.index < len(place.bars):
                        raise InputError(
                            f"loop {v.loop!r} has {len(place.bars)} bars, counted from 0: no bar {v.index}"
                        )
                    return "bar", place.bars[v.index]
            raise InputError(f"no loop {v.loop!r}; loops: {', '.join(p.loop.name for p in loops) or 'none'}")
        raise PluginError(f"{v!r} is not an Actuator, Bar or VirtualJoint")
