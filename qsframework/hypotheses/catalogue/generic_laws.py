"""Generic blocks: what a law that nobody has written could do to the readings, by place and by what it depends on.

Each is an effect that the library learns with, at one place: a drive, a bearing, a link, an end of the arm, a marker,
all readings, the load. Its functions say how the place moves in every state; what that does to the readings is taken
from the arm where it settles. A law acts in both states of a displacement: what it does is f(loaded) - f(unloaded),
with gravity and compensators in both torques.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from typing import Any, cast

import numpy as np

from qsframework.elastostatics import Model, make_model
from qsframework.elastostatics.loads import wrench_torque
from qsframework.elastostatics.settled import SettledState, one_state
from qsframework.elastostatics.structure import chunks
from qsframework.errors import InputError
from qsframework.experiment import Frame
from qsframework.experiment.observations import ReadingRows
from qsframework.hypotheses.catalogue.law import Law, Part
from qsframework.plugin import (
    Actuator,
    Array,
    Context,
    Coordinate,
    Effect,
    Indices,
    Loads,
    Parameter,
    Reading,
    RobotFacts,
    Spring,
    VirtualJoint,
    registry,
)

_AXES = ("x", "y", "z")
_PARALLEL = 1e-6
_RECORDED = ("time", "temperature", "approach")


@dataclass(frozen=True)
class Probe(Spring):
    """Rigid coordinates at every drive, bearing and link: they say how each place would move the markers."""

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"{self.name}[{i}]", "", lower=0.0) for i in range(len(self.virtual_joints(robot))))

    def virtual_joints(self, robot: RobotFacts) -> tuple[Coordinate, ...]:
        turns = [VirtualJoint(link, axis, "rotation") for link in _links(robot) for axis in _AXES]
        shifts = [VirtualJoint(link, axis, "translation") for link in _links(robot) for axis in _AXES]
        tilts = [
            VirtualJoint(robot.link_of(j), a, "rotation", "before") for j in robot.joints for a in across(robot, j)
        ]
        return (*(Actuator(joint) for joint in robot.joints), *turns, *shifts, *tilts)


def _links(robot: RobotFacts) -> tuple[str, ...]:
    """(n + 1,) the links, base to flange."""
    return (*robot.links[:-1], robot.flange)


def across(robot: RobotFacts, joint: str) -> list[Any]:
    """The axes about which a bearing tilts; none of a joint that slides."""
    if robot.slides(joint):
        return []
    axis = robot.axes[robot.joint_index(joint)]
    return [a for i, a in enumerate(_AXES) if abs(axis[i]) < 0.5]


@dataclass(frozen=True)
class BlockPlace:
    """Coordinates of the probe that move together, and after them those whose torques may count as the others.

    own: the joint whose angle is the place's own
    """

    part: Part
    name: str
    coordinates: tuple[int, ...]
    own: str | None = None
    others: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Block:
    """What a law could do to the readings; effect: what it would be; made: what makes its columns, which of many
    readings are too many to be kept for all laws."""

    law: Law
    effect: Effect
    made: Callable[[], Array]

    @property
    def columns(self) -> Array:
        """Columns (3 R, k) m."""
        return self.made()


@dataclass(frozen=True, eq=False)
class End:
    """Of one end of R rows: columns (R, 3, ne) m per unit of each coordinate, torque (R, ne), angles q (R, n); state
    (R,): its place among the states, -1 where the row has no such end."""

    columns: Array
    torque: Array
    q: Array
    state: Indices


@dataclass(frozen=True, eq=False)
class Stand:
    """Some of the states, all loaded or none: which (s,), how they stand, and what the instrument sees of the markers.

    torque (s, ne); rotation (s, 3, 3) of the flange; give (s, K, 3, 6) m/N, m/(N m): how the markers follow a wrench
    at the load point
    """

    which: Indices
    context: Context
    torque: Array
    reading: Reading
    rotation: Array
    give: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Motions:
    """What an extra motion at each place does to rows, at both their ends, and what it may depend on.

    minus: of the state that is taken off, its columns zero where none is; stands: of all S states that rows need;
    angles: that a law may depend on, by their joints: of each, and of what parallel joints turn together
    """

    rows: ReadingRows
    frames: tuple[Frame, ...]
    facts: RobotFacts
    marker_names: tuple[str, ...]
    places: tuple[BlockPlace, ...]
    stands: tuple[Stand, ...]
    plus: End
    minus: End
    recorded: tuple[str, ...]
    angles: tuple[tuple[tuple[str, ...], tuple[float, ...]], ...]

    @cached_property
    def alone(self) -> bool:
        """Whether some rows are of one state alone, so that what acts always is seen."""
        return bool((self.minus.state < 0).any())

    def scale(self, at: Sequence[int]) -> float:
        """Largest torque on the coordinates of a place, 1 where there is none."""
        return max(float(np.abs(s.torque[:, list(at)]).max(initial=0.0)) for s in self.stands) or 1.0

    def spring_columns(self, place: BlockPlace, effect: Any) -> Array:
        """Columns (3 R, c m) of a law of springs: of each coordinate's functions."""
        at = list(place.coordinates)
        used = [*at, *place.others][: len(effect.springs(self.facts))]
        f = over_states(self.stands, [effect.shapes(s.torque[:, used], s.context) for s in self.stands])
        later, earlier = (end.columns[..., at, None] * f[end.state][:, None] for end in (self.plus, self.minus))
        return (later - earlier).reshape(3 * len(later), -1)

    def seen_columns(self, moved: Sequence[Array]) -> Array:
        """Columns (3 R, p) of motions (s, K, 3, p) m of the markers in each of the stands."""
        positions = over_states(self.stands, [s.reading.position for s in self.stands])
        columns = self.rows.padded(self.rows.seen_along(positions, over_states(self.stands, moved), self.frames))
        return columns.reshape(3 * len(columns), -1)

    def angle_range(self, factor: str) -> tuple[float, float]:
        """Of an angle over all states, rad."""
        weights = np.array(next(c for joints, c in self.angles if "+".join(joints) == factor))
        angle = np.concatenate([s.context.poses.q for s in self.stands]) @ weights
        return float(angle.min()), float(angle.max())


def over_states(stands: Sequence[Stand], parts: Sequence[Array]) -> Array:
    """Of all states (S, ...), from those of each stand."""
    return np.concatenate(parts)[np.argsort(np.concatenate([s.which for s in stands]))]


def motions(model: Model, rows: ReadingRows, x: Array, frames: Sequence[Frame]) -> Motions:
    """What an extra motion at each place would do to the rows, at the states that they are of."""
    effects = (*model.effects, Probe())
    markers = list(zip(model.marker_names, model.markers, strict=True))
    probe = make_model(model.facts, effects, model.parameters, model.tip, markers, model.gravity)
    value = dict(zip(model.names, x, strict=True))
    values = np.array([value.get(p.name, 0.0) for p in probe.parameters])
    own = [probe.compliance_rows.index(i) for i in probe.index([p.name for p in Probe().parameters(probe.facts)])]
    stands, slope = _stands(probe, rows, values, own)
    recorded = tuple(n for n in _RECORDED if _recorded(rows, n))
    return Motions(
        rows=rows,
        frames=tuple(frames),
        facts=model.facts,
        marker_names=model.marker_names,
        places=_places(model.facts),
        stands=stands,
        plus=_end(rows, rows.plus, stands, slope, frames),
        minus=_end(rows, rows.minus, stands, slope, frames),
        recorded=recorded,
        angles=_angles(model.facts),
    )


def _stands(probe: Model, rows: ReadingRows, values: Array, own: Sequence[int]) -> tuple[tuple[Stand, ...], Array]:
    """The states that rows need, in parts, and how their markers follow the probe's coordinates (S, K, 3, ne)."""
    out: list[Stand] = []
    slopes: list[Array] = []
    for loaded, which, poses in rows.split():
        for at, part in chunks(poses):
            there = one_state(probe, part, values, loaded)
            state, follows = there.settled.at.state, there.followed()
            rotation = np.stack([m.rotation for m in state.markers], axis=1)
            torque = there.settled.at.T[own].T
            reading = Reading(there.reading, rotation, probe.marker_names)
            context, give = Context(probe.facts, part, loaded), _give(there, follows)
            out.append(Stand(which[at], context, torque, reading, state.tip.rotation, give))
            slopes.append(follows[:, own].transpose(3, 0, 2, 1))
    return tuple(out), over_states(out, slopes)


def _give(there: SettledState, follows: Array) -> Array:
    """How the markers follow a wrench at the load point (N, K, 3, 6) m/N, m/(N m), through the springs."""
    at = there.settled.at
    units = np.broadcast_to(np.eye(6)[..., None], (6, 6, len(there.poses)))
    bent = np.stack([at.slope * wrench_torque(at.state.tip, unit) for unit in units])
    return np.einsum("kexn,wen->nkxw", follows, bent)


def _end(rows: ReadingRows, of: Indices, stands: Sequence[Stand], slope: Array, frames: Sequence[Frame]) -> End:
    """The end of each row at a state of the readings, -1: none."""
    readings, taken = rows.readings, np.flatnonzero(of >= 0)
    used = np.unique(np.concatenate([rows.plus, rows.minus[rows.minus >= 0]]))
    place = np.full(len(of), -1, dtype=np.intp)
    place[taken] = np.searchsorted(used, of[taken])
    torque = over_states(stands, [s.torque for s in stands])
    positions = over_states(stands, [s.reading.position for s in stands])
    columns = np.zeros((len(of), 3, slope.shape[-1]))
    if len(taken):
        some, plus = rows.take(taken), readings.plus.copy()
        plus[some.keep] = of[taken]
        alone = replace(some, readings=replace(readings, plus=plus, minus=np.full_like(readings.minus, -1)))
        at = np.searchsorted(used, np.unique(alone.plus))
        known = dict(zip(rows.estimated, frames, strict=True))
        found = alone.seen_along(positions[at], slope[at], [known[f] for f in alone.estimated])
        columns[taken] = alone.padded(found)
    none = place[:, None] < 0
    q = np.where(none, 0.0, readings.poses.q[np.maximum(of, 0)])
    return End(columns, np.where(none, 0.0, torque[np.maximum(place, 0)]), q, place)


def _recorded(rows: ReadingRows, name: str) -> bool:
    """Whether a column was recorded of every state that rows need, and changes."""
    for loaded, _, poses in rows.split():
        if getattr(poses.loaded if loaded else poses.unloaded, name) is None:
            return False
    value = getattr(rows.readings.poses.loaded, name)
    return value is not None and np.ptp(value[rows.plus]) > 0.0


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


def _places(facts: RobotFacts) -> tuple[BlockPlace, ...]:
    n, out = facts.n, list[BlockPlace]()
    for k, joint in enumerate(facts.joints):
        others = tuple(facts.joint_index(j) for j in facts.driven if j != joint)
        out.append(BlockPlace("drive", joint, (k,), joint, others))
    own = (None, *facts.joints)
    turns = [(at, at + 1, at + 2) for at in range(n, 4 * n + 1, 3)]
    out += [BlockPlace("link", link, at, o) for link, at, o in zip(_links(facts), turns, own, strict=True)]
    shifts = [(at, at + 1, at + 2) for at in range(4 * n + 3, 7 * n + 4, 3)]
    for link, at, o, moments in zip(_links(facts), shifts, own, turns, strict=True):
        out.append(BlockPlace("shift", link, at, o, moments))
    first = 7 * n + 6
    for joint in facts.joints:
        count = len(across(facts, joint))
        if count:
            out.append(BlockPlace("bearing", joint, tuple(range(first, first + count)), joint))
        first += count
    return tuple(out)


_ROLE = "learned"
"""Of the effects that laws are; each says of which parts."""
_KEPT = 200
"""Rows up to which the columns of all laws are kept, some 70 MB: they are asked for several times."""


def generic_blocks(moved: Motions) -> Iterator[Block]:
    """Every block, place by place."""
    keep = cache if len(moved.rows.keep) <= _KEPT else _anew
    for place in moved.places:
        for by in _of_springs(moved, place):
            law = Law(place.part, place.name, by)
            effect = _learned(moved, law, moved.scale(place.coordinates), place)
            if effect is not None:
                yield Block(law, effect, keep(partial(moved.spring_columns, place, effect)))
    # N, of the load in any state.
    loaded = [s.context.poses.wrench[:, :3] for s in moved.stands if s.context.loaded]
    force = max((float(np.linalg.norm(f, axis=1).max(initial=0.0)) for f in loaded), default=0.0)
    laws = [(law, force, _seen) for law in _of_readings(moved, force)]
    if force > 0.0:
        laws += [(Law("load", "tool", (by,)), force, _pulled) for by in ("force", "direction", "order")]
        laws += [(Law("point", "tool", (by,)), 0.0, _pulled) for by in ("attitude", "order")]
    for law, scale, columns in laws:
        effect = _learned(moved, law, scale)
        if effect is not None:
            yield Block(law, effect, keep(partial(columns, moved, effect)))


def _anew(made: Callable[[], Array]) -> Callable[[], Array]:
    """Nothing is kept."""
    return made


def single_axes(block: Block, facts: RobotFacts) -> Iterator[Block]:
    """A law of a place that moves about several axes, about each of them alone."""
    effect: Any = block.effect
    if block.law.part not in ("link", "bearing", "shift") or effect.moves:
        return
    names = effect.axes(facts)
    if len(names) > 1:
        own = np.split(block.columns, len(names), axis=1)
        for axis, columns in zip(names, own, strict=True):
            yield Block(replace(block.law, axis=axis), replace(effect, moves=axis), lambda columns=columns: columns)


def _seen(moved: Motions, effect: Any) -> Array:
    """Columns (3 R, p) m of a law of the readings."""
    return moved.seen_columns([effect.shapes(s.reading, s.context) for s in moved.stands])


def _pulled(moved: Motions, effect: Any) -> Array:
    """Columns (3 R, p) m of a law of the load."""
    hung = [s.context.poses.wrench * float(s.context.loaded) for s in moved.stands]
    loads = [Loads(w, s.rotation, moved.facts.moments) for w, s in zip(hung, moved.stands, strict=True)]
    shapes = [effect.shapes(load, s.context) for load, s in zip(loads, moved.stands, strict=True)]
    return moved.seen_columns(
        [np.einsum("nkij,njp->nkip", s.give, f) for s, f in zip(moved.stands, shapes, strict=True)]
    )


def _of_springs(moved: Motions, place: BlockPlace) -> Iterator[tuple[str, ...]]:
    """On what an extra motion at a place may depend."""
    own = ["+".join(joints) for joints, _ in moved.angles if place.own in joints]
    on = ["loaded", *(["always"] if moved.alone else [])]
    comes = [("came",)] if _comes(moved, place) else []
    acts = any(np.any(s.torque[:, list(place.coordinates)]) for s in moved.stands)
    if place.part == "shift" and place.name not in (moved.facts.base, moved.facts.flange):
        yield from [("torque",), *comes] if acts else []
        for state in on:
            yield from [(state,), (state, "order"), *((state, *c) for c in comes)]
        return
    if acts:
        yield ("torque",)
        yield from (("+".join(joints),) for joints, _ in moved.angles)
        yield from (("torque", angle) for angle in own)
        yield from ((place.own or "", angle) for angle in _beside(moved, place))
        yield ("moment",) if place.part == "shift" else ("others",)
        if place.part != "shift" and (place.others or place.part != "drive"):
            yield "torque", "others"
        yield from comes
        if place.name != moved.facts.base:
            yield ("attitude",)
        yield from ((name,) for name in ("order", *moved.recorded))
    with_state = ["order", *moved.recorded, *(own if place.part == "drive" else ()), *(c for (c,) in comes)]
    for state in on:
        yield from [(state,), *((state, f) for f in with_state)]


def _comes(moved: Motions, place: BlockPlace) -> bool:
    """Whether a joint turned to bring a place to its poses."""
    joint = moved.facts.joint_index(moved.facts.joint_of(place.name))
    return not moved.facts.sliding[joint] and any(np.any(s.context.came[:, joint]) for s in moved.stands)


def _beside(moved: Motions, place: BlockPlace) -> Iterator[str]:
    """The joints before and after a place's own."""
    turning = [joints[0] for joints, _ in moved.angles if len(joints) == 1]
    if place.own is None or place.part == "shift" or place.own not in turning:
        return
    k = moved.facts.joint_index(place.own)
    for other in (k - 1, k + 1):
        if 0 <= other < moved.facts.n and moved.facts.joints[other] in turning:
            yield moved.facts.joints[other]


def _of_readings(moved: Motions, force: float) -> Iterator[Law]:
    """Laws of all readings, and of one marker while the others stay."""
    on = ["loaded", *(["always"] if moved.alone else [])]
    angles = ["+".join(joints) for joints, _ in moved.angles]
    alone = [("force",)] if force > 0.0 else []
    for by in (*((state, f) for state in on for f in (*angles, "order")), *alone):
        yield Law("readings", "", by)
    for marker in moved.marker_names if len(moved.marker_names) > 1 else ():
        for by in (*((state, f) for state in on for f in ("order", "attitude", *angles)), ("loaded",), *alone):
            yield Law("marker", marker, by)


def _learned(moved: Motions, law: Law, scale: float, place: BlockPlace | None = None) -> Any:
    """The effect that a law is, with the range that the readings have of what it depends on; None where none can be."""
    settings: dict[str, Any] = {} if scale <= 0.0 else {"scale": scale}
    if law.part == "link":
        settings |= {"part": "link"}
    if place is not None and "torque" in law.by:
        torque = np.concatenate([s.torque[:, list(place.coordinates)] for s in moved.stands])
        settings |= {"lowest": float(torque.min()), "highest": float(torque.max())}
    if law.part == "load" and "force" in law.by:
        size = [np.linalg.norm(s.context.poses.wrench[:, :3], axis=1) for s in moved.stands if s.context.loaded]
        settings |= {"lowest": float(np.concatenate(size).min()), "highest": scale}
    for k, factor in enumerate(law.angles):
        low, high = moved.angle_range(factor)
        settings |= {f"{'other' if k else 'angle'}_from": low, f"{'other' if k else 'angle'}_to": high}
        weights = next(c for joints, c in moved.angles if "+".join(joints) == factor)
        if k == 0 and factor == law.place and law.part in ("drive", "bearing"):
            settings |= {"waves": 3}
        if k == 0 and "+" in factor:
            settings |= {"signs": "".join("+" if w > 0.0 else "-" for w in weights if w != 0.0)}
    if "order" in law.by:
        settings |= {"first": 0.0, "last": 1.0}
    for name in _RECORDED:
        if name in law.by:
            value = getattr(moved.rows.readings.poses.loaded, name)[moved.rows.plus]
            settings |= {"first": float(value.min()), "last": float(value.max())}
    kind = next((k for k in registry().values() if k.role == _ROLE and law.part in getattr(k, "parts", ())), None)
    if kind is None:
        return None
    effect: Any = cast("Any", kind)(at=law.place or "all", by="*".join(law.by), **settings)
    try:
        effect.require_fit(moved.facts)
    except InputError:
        return None
    return effect
