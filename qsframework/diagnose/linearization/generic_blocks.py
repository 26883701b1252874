"""Generic blocks: what a law that nobody has written could do to the readings, by place and by variable.

At every drive and every link a small extra motion may be a smooth function of the torque there, or that torque times a
smooth function of an angle, of the readings' order, of what was recorded; readings and markers may move by themselves.
A law acts in both states of a displacement: what it does is f(loaded) - f(unloaded), with gravity and compensators in
both torques.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from qsframework.diagnose.law import Law, Part, Variable
from qsframework.elastostatics import Model, make_model
from qsframework.elastostatics.evaluation import evaluate_stages
from qsframework.elastostatics.structure import chunks
from qsframework.experiment import Frame
from qsframework.experiment.observations import Rows
from qsframework.plugin import (
    Actuator,
    Array,
    Coordinate,
    Indices,
    Parameter,
    RobotFacts,
    Spring,
    VirtualJoint,
    by_torque,
    circular,
)

_AXES = ("x", "y", "z")
_PARALLEL = 1e-6


@dataclass(frozen=True)
class Probe(Spring):
    """Rigid coordinates at every drive and every link: they say how each place would move the markers."""

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"{self.name}[{i}]", "", lower=0.0) for i in range(len(self.virtual_joints(robot))))

    def virtual_joints(self, robot: RobotFacts) -> tuple[Coordinate, ...]:
        turns = [VirtualJoint(link, axis, "rotation") for link in robot.links for axis in _AXES]
        ends = [VirtualJoint(link, axis, "translation") for link in (robot.base, robot.flange) for axis in _AXES]
        return (*(Actuator(joint) for joint in robot.joints), *turns, *ends)


@dataclass(frozen=True)
class Place:
    """Coordinates of the probe that move together: a drive, the three rotations of a link, or a shift of an end.

    joint: that of a drive, else None
    """

    part: Part
    name: str
    coordinates: tuple[int, ...]
    joint: int | None = None


@dataclass(frozen=True, eq=False)
class Block:
    """Columns (3 R, k) m of what a law could do to the readings."""

    law: Law
    columns: Array


@dataclass(frozen=True, eq=False)
class _Ends:
    """Of one end of R rows: columns (R, 3, ne) m per unit of each coordinate, torque (R, ne), angles q (R, n)."""

    columns: Array
    torque: Array
    q: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Motions:
    """What an extra motion at each place does to rows, at both their ends, and what it may depend on, per row.

    minus: of the state that is taken off, its columns zero where none is; order, step, recorded: of the other one
    """

    places: tuple[Place, ...]
    plus: _Ends
    minus: _Ends
    order: Array
    step: Array
    recorded: tuple[tuple[Variable, Array], ...]
    marker: Indices
    marker_names: tuple[str, ...]
    angles: tuple[tuple[tuple[str, ...], tuple[float, ...]], ...]
    """Angles that a law may depend on, by their joints: of each, and of what parallel joints turn together."""
    drives: int
    sliding: tuple[bool, ...]
    """Which drives slide."""

    def scale(self, at: Sequence[int]) -> float:
        """Largest torque on the coordinates of a place, 1 where there is none."""
        both = np.abs(np.concatenate([self.plus.torque[:, at], self.minus.torque[:, at]])).max()
        return float(both) or 1.0

    @cached_property
    def size(self) -> Array:
        """Largest torque (ne,) on each coordinate."""
        both = np.abs(np.concatenate([self.plus.torque, self.minus.torque])).max(axis=0)
        return np.where(both > 0.0, both, np.inf)


def motions(model: Model, rows: Rows, x: Array, frames: Sequence[Frame]) -> Motions:
    """What an extra motion at each place would do to the rows, at the states that they are of."""
    effects = (*model.effects, Probe())
    markers = list(zip(model.marker_names, model.markers, strict=True))
    probe = make_model(model.facts, effects, model.parameters, model.tip, markers, model.gravity)
    value = dict(zip(model.names, x, strict=True))
    values = np.array([value.get(p.name, 0.0) for p in probe.parameters])
    readings, taken = rows.readings, np.flatnonzero(rows.minus >= 0)
    nothing = np.full_like(readings.minus, -1)
    plus = _end(probe, replace(rows, readings=replace(readings, minus=nothing)), values, frames)
    minus = _Ends(*(np.zeros_like(v) for v in (plus.columns, plus.torque, plus.q)))
    if len(taken):
        before = replace(rows.take(taken), readings=replace(readings, plus=readings.minus, minus=nothing))
        known = dict(zip(rows.estimated, frames, strict=True))
        found = _end(probe, before, values, [known[f] for f in before.estimated])
        minus.columns[taken], minus.torque[taken], minus.q[taken] = found.columns, found.torque, found.q
    used, n = np.unique(rows.plus, return_inverse=True)
    came = np.diff(readings.poses.q[used], axis=0, prepend=readings.poses.q[used[:1]])
    return Motions(
        places=_places(model.facts),
        plus=plus,
        minus=minus,
        order=np.linspace(-1.0, 1.0, len(used))[n],
        step=came[n],
        recorded=tuple((name, _spread(value)) for name, value in _conditions(rows)),
        marker=rows.marker,
        marker_names=model.marker_names,
        angles=_angles(model.facts),
        drives=model.facts.n,
        sliding=model.facts.sliding,
    )


def _end(probe: Model, rows: Rows, values: Array, frames: Sequence[Frame]) -> _Ends:
    """Of rows that are of one state each."""
    own = [probe.compliance_rows.index(i) for i in probe.index([p.name for p in Probe().parameters(probe.facts)])]
    count = len(np.unique(rows.plus))
    slope = np.empty((count, len(probe.markers), 3, len(own)))
    torque = np.empty((count, len(own)))
    for loaded, which, poses in rows.split():
        first = 0
        for _, part in chunks(poses):
            at = which[first : first + len(part)]
            first += len(part)
            stages = evaluate_stages(probe, part, values, preload=True, loaded=loaded)
            assert stages.preload is not None
            slope[at] = np.stack([m.linear[own] for m in stages.state.markers]).transpose(3, 0, 2, 1)
            torque[at] = (stages.tau[own] + stages.preload[own]).T
    positions = np.zeros(slope.shape[:3])
    if (rows.readings.to[rows.keep] >= 0).any():
        positions = rows.positions(probe, values, True)
    _, state = np.unique(rows.plus, return_inverse=True)
    columns = rows.padded(rows.seen_along(positions, slope, frames))
    return _Ends(columns, torque[state], rows.readings.poses.q[rows.plus])


def _conditions(rows: Rows) -> Iterator[tuple[Variable, Array]]:
    names: tuple[Variable, ...] = ("time", "temperature", "approach")
    for name in names:
        value = getattr(rows.readings.poses.loaded, name)
        if value is not None and np.isfinite(value[rows.plus]).all() and np.ptp(value[rows.plus]) > 0.0:
            yield name, value[rows.plus]


def _spread(value: Array) -> Array:
    middle = 0.5 * (value.max() + value.min())
    return (value - middle) / max(float(np.abs(value - middle).max()), 1e-300)


def _angles(facts: RobotFacts) -> tuple[tuple[tuple[str, ...], tuple[float, ...]], ...]:
    """Joints and coefficients (n,) of the angles: each joint's that turns, and the sum of two such neighbours with
    parallel axes."""
    n = facts.n
    out: list[tuple[tuple[str, ...], tuple[float, ...]]] = [
        ((joint,), tuple(float(i == k) for i in range(n)))
        for k, joint in enumerate(facts.joints)
        if not facts.sliding[k]
    ]
    for k in range(n - 1):
        turned = facts.placements[k + 1][:3, :3] @ facts.axes[k + 1]
        along = float(turned @ facts.axes[k])
        if abs(abs(along) - 1.0) < _PARALLEL and not any(facts.sliding[k : k + 2]):
            sign = 1.0 if along > 0.0 else -1.0
            both = tuple(1.0 if i == k else sign if i == k + 1 else 0.0 for i in range(n))
            out.append((facts.joints[k : k + 2], both))
    return tuple(out)


def _places(facts: RobotFacts) -> tuple[Place, ...]:
    n = facts.n
    drives = [Place("drive", joint, (k,), k) for k, joint in enumerate(facts.joints)]
    links = [Place("link", link, tuple(n + 3 * i + a for a in range(3))) for i, link in enumerate(facts.links)]
    last = n + 3 * len(facts.links)
    ends = [
        Place("shift", facts.base, tuple(range(last, last + 3))),
        Place("shift", facts.flange, tuple(range(last + 3, last + 6))),
    ]
    return (*drives, *links, *ends)


def generic_blocks(moved: Motions) -> Iterator[Block]:
    """Every block, place by place."""
    plus, minus = moved.plus, moved.minus
    for place in moved.places:
        at = list(place.coordinates)
        ends = [(end.columns[..., at], end.torque[:, at] / moved.scale(at), end.q) for end in (plus, minus)]
        (D, t, q), (_, before, q0) = ends
        ones = np.ones((len(D), len(at), 1))
        if np.any(t) or np.any(before):
            yield _block(Law(place.part, place.name, "torque"), ends, by_torque(t), by_torque(before))
            for joints, coefficients in moved.angles:
                bends = [u[..., None] * circular(a @ coefficients)[:, None] for u, a in ((t, q), (before, q0))]
                yield _block(Law(place.part, place.name, "angle", joints), ends, *bends)
            others = [i for i in (range(moved.drives) if len(at) == 1 else at) if i not in at[: len(at) == 1]]
            turned = [(end.torque[:, others] / moved.size[others])[:, None, :] * ones for end in (plus, minus)]
            yield _block(Law(place.part, place.name, "others"), ends, *turned)
        yield _block(Law(place.part, place.name, "order"), ends, *_with_torque(moved.order, t, before))
        if place.joint is not None:
            came = moved.step[:, place.joint, None, None]
            turned = [] if moved.sliding[place.joint] else [np.sin(came), np.cos(came)]
            sides = np.concatenate([np.sign(came), *turned], axis=2)
            yield _block(Law(place.part, place.name, "step"), ends, sides)
        yield _block(Law(place.part, place.name, "constant"), ends, ones)
        for name, value in moved.recorded:
            yield _block(Law(place.part, place.name, name), ends, *_with_torque(value, t, before))
    yield from _readings(moved)
    yield from _markers(moved)


def _block(law: Law, ends: Sequence[tuple[Array, Array, Array]], f: Array, before: Array | None = None) -> Block:
    """Each coordinate's columns (R, 3, c) times functions f (R, c, k) of the state, less `before` of the other one."""
    (D, _, _), (D0, _, _) = ends
    columns = D[..., None] * f[:, None]
    if before is not None:
        columns = columns - D0[..., None] * before[:, None]
    return Block(law, columns.reshape(3 * len(D), -1))


def _with_torque(value: Array, t: Array, before: Array) -> tuple[Array, Array]:
    """A variable (R,) of the later state by itself, and times the torques (R, c) of both states."""
    v = value[:, None]
    return np.stack([v * np.ones_like(t), v * t], axis=2), np.stack([np.zeros_like(t), v * before], axis=2)


def _readings(moved: Motions) -> Iterator[Block]:
    """All readings move alike, along the axes of the base."""
    seen = np.broadcast_to(np.eye(3), (len(moved.marker), 3, 3))
    for joints, coefficients in moved.angles:
        bends = circular(moved.plus.q @ coefficients)[:, None, None, 1:]
        yield Block(Law("readings", "", "angle", joints), (seen[..., None] * bends).reshape(3 * len(seen), -1))
    yield Block(Law("readings", "", "order"), (seen * moved.order[:, None, None]).reshape(-1, 3))


def _markers(moved: Motions) -> Iterator[Block]:
    """One marker moves in its mount while the others stay."""
    if len(moved.marker_names) < 2:
        return
    for k, name in enumerate(moved.marker_names):
        own = (moved.marker == k).astype(float)[:, None, None] * np.eye(3)
        drift = own * moved.order[:, None, None]
        yield Block(Law("marker", name, "order"), np.concatenate([own, drift], axis=2).reshape(-1, 6))
