"""How each place could move the readings, whatever law it follows: freely at each visit, or smoothly with a variable.

The laws here make a closed table: every place, moved once a load hangs, always, with its torque or by a curve of it,
with every variable. A variable has the leading directions of a kernel exp(-d^2 / 2) over the states for its functions,
d the distance in its own length.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.experiment.observations import ReadingRows
from qsframework.hypotheses.catalogue.generic_laws import BlockPlace, Motions, across, over_states
from qsframework.hypotheses.catalogue.law import Law
from qsframework.plugin import Array, Indices

_ANGLE = 0.7
"""rad: length of an angle."""
_ORDER = 0.3
_TURN = 0.8
"""Length of a direction in space."""
_LARGEST = 0.35
"""Length of a torque or force, of the largest."""
_DIRECTIONS = 6
"""Of a kernel, at most."""
_MARKS = 48
"""States that a kernel is spanned by at most."""


@dataclass(frozen=True, eq=False)
class Place:
    """Motions (R, 3, c) m per unit in the later and the earlier state of each row.

    law: without factors; axes: names of the c motions; torque: (R, c) in both states, None where no torque counts
    """

    law: Law
    axes: tuple[str, ...]
    plus: Array
    minus: Array
    torque: tuple[Array, Array] | None = None

    def subsets(self) -> Iterator[tuple[str, list[int]]]:
        """All axes together, and each one alone."""
        yield "", list(range(len(self.axes)))
        yield from ((axis, [i]) for i, axis in enumerate(self.axes) if len(self.axes) > 1)


@dataclass(frozen=True, eq=False)
class VisitGroups:
    """Rows by what is whitened together: at (G, w) rows of each group, -1 beyond its last; turn (R,): the place of a
    row's visit among those of its group."""

    at: Indices
    turn: Indices

    @property
    def together(self) -> int:
        """VisitGroups of a group at most."""
        return int(self.turn.max(initial=0)) + 1

    def apart(self, motion: Array) -> Array:
        """Motions (R, 3, c) as columns (3 R, together c): of the first visit of each group, of the second, ..."""
        flat = motion.reshape(3 * len(motion), -1)
        turn = np.repeat(self.turn, 3)[:, None]
        return np.concatenate([np.where(turn == t, flat, 0.0) for t in range(self.together)], axis=1)

    def split(self, columns: Array) -> Array:
        """Columns (3 R, p) group by group (G, 3 w, p)."""
        rows = columns.reshape(-1, 3, columns.shape[1])
        return np.where(self.at[..., None, None] >= 0, rows[self.at], 0.0).reshape(len(self.at), -1, columns.shape[1])


def by_group(label: Indices) -> Indices:
    """Places (G, w) of what bears each label (n,), in the order of the labels, -1 beyond the last of a group."""
    group = np.unique(label, return_inverse=True)[1]
    order, counts = np.argsort(group, kind="stable"), np.bincount(group)
    first = np.cumsum(counts) - counts
    at = np.full((len(counts), counts.max()), -1, dtype=np.intp)
    at[group[order], np.arange(len(order)) - first[group[order]]] = order
    return at


def visits_of(rows: ReadingRows) -> VisitGroups:
    """The visits of rows, by what their noise shares."""
    group = np.full(len(rows.keep), -1, dtype=np.intp)
    group[rows.row] = rows.together
    at = by_group(group)
    turn = np.zeros(len(rows.keep), dtype=np.intp)
    for own in at:
        used = own[own >= 0]
        turn[used] = np.unique(rows.plus[used], return_inverse=True)[1]
    return VisitGroups(at, turn)


def places_of(moved: Motions) -> Iterator[Place]:
    """Every place: drives, bearings, links with their shifts, all readings, each marker, the load and its point."""
    yield from (_of_arm(moved, place) for place in moved.places)
    rows, markers = len(moved.rows.keep), len(moved.marker_names)
    every = np.broadcast_to(np.eye(3), (markers, 3, 3))
    yield _of_markers(moved, Law("readings", "", ()), every)
    for m, name in enumerate(moved.marker_names if markers > 1 else ()):
        yield _of_markers(moved, Law("marker", name, ()), np.where(np.arange(markers)[:, None, None] == m, every, 0.0))
    forces = [s.context.poses.wrench[:, :3] * float(s.context.loaded) for s in moved.stands]
    if not any(np.any(f) for f in forces):
        return
    none = np.zeros((rows, 3, 3))
    pull = [s.give[..., :3] * float(s.context.loaded) for s in moved.stands]
    yield Place(Law("load", "tool", ()), ("tx", "ty", "tz"), moved.seen_columns(pull).reshape(rows, 3, 3), none)
    turn = [np.cross(np.eye(3), f[:, None]).transpose(0, 2, 1) for f in forces]
    point = [s.give[..., 3:] @ t[:, None] for s, t in zip(moved.stands, turn, strict=True)]
    yield Place(Law("point", "tool", ()), ("tx", "ty", "tz"), moved.seen_columns(point).reshape(rows, 3, 3), none)


def _of_arm(moved: Motions, place: BlockPlace) -> Place:
    at = list(place.coordinates)
    if len(at) == 1:
        axes: tuple[str, ...] = ("",)
    elif place.part == "bearing":
        axes = tuple(f"r{a}" for a in across(moved.facts, place.name))
    else:
        axes = tuple(f"{'t' if place.part == 'shift' else 'r'}{a}" for a in "xyz")
    torque = moved.plus.torque[:, at], moved.minus.torque[:, at]
    law = Law(place.part, place.name, ())
    return Place(law, axes, moved.plus.columns[..., at], moved.minus.columns[..., at], torque)


def _of_markers(moved: Motions, law: Law, motion: Array) -> Place:
    """Of motions (K, 3, c) of the markers: in the loaded state of a displacement, in any state of a position."""
    rows, c = len(moved.rows.keep), motion.shape[2]
    whole = [np.broadcast_to(motion, (len(s.which), *motion.shape)) for s in moved.stands]
    under = [m * float(s.context.loaded) for m, s in zip(whole, moved.stands, strict=True)]
    loaded, always = (moved.seen_columns(x).reshape(rows, 3, c) for x in (under, whole))
    both = np.where((moved.minus.state < 0)[:, None, None], always, loaded)
    return Place(law, ("tx", "ty", "tz"), both, both)


@dataclass(frozen=True, eq=False)
class Variable:
    """name: as a factor of a law, "" for none; features (S, k) over the states, of mean square 1 in total."""

    name: str
    features: Array


def variables(moved: Motions) -> tuple[Variable, ...]:
    """Every variable that changes over the states, and a constant."""
    facts, stands = moved.facts, moved.stands
    order = over_states(stands, [s.context.order[:, None] for s in stands])
    out = [Variable("", np.ones_like(order))]

    def add(name: str, values: Array, length: float) -> None:
        features = smooth(values, length)
        if features is not None:
            out.append(Variable(name, features))

    q = over_states(stands, [s.context.poses.q for s in stands])
    for joints, weights in moved.angles:
        angle = q @ np.array(weights)
        add("+".join(joints), np.column_stack([np.cos(angle), np.sin(angle)]), _ANGLE)
    torque = over_states(moved.stands, [s.torque[:, : facts.n] for s in stands])
    came = over_states(moved.stands, [s.context.came for s in stands])
    for joint, slides in zip(facts.joints, facts.sliding, strict=True):
        travel = q[:, [facts.joint_index(joint)]]
        if slides:
            add(f"travel {joint}", travel / (np.ptp(travel) or 1.0), _LARGEST)
    for joint in facts.driven:
        k = facts.joint_index(joint)
        add(f"torque {joint}", torque[:, [k]] / (np.abs(torque[:, k]).max() or 1.0), _LARGEST)
        add(f"came {joint}", np.tanh(came[:, [k]] / _ANGLE), _ANGLE)
    add("order", order, _ORDER)
    add("attitude", over_states(moved.stands, [s.rotation[:, 2] for s in stands]), _TURN)
    force = over_states(moved.stands, [s.context.poses.wrench[:, :3] * float(s.context.loaded) for s in stands])
    size: Array = np.linalg.norm(force, axis=1)
    add("force", size[:, None] / (size.max() or 1.0), _LARGEST)
    add("direction", force / np.where(size > 0.0, size, 1.0)[:, None], _TURN)
    add("before", _hung_before(force, order[:, 0]) / (size.max() or 1.0), _LARGEST)
    return tuple(out)


def _hung_before(force: Array, order: Array) -> Array:
    """The load (S, 3) N that hung last before each state, 0 before the first."""
    rows = np.argsort(order, kind="stable")
    hung = np.where(np.any(force[rows] != 0.0, axis=1), np.arange(len(rows)), -1)
    last = np.concatenate([[-1], np.maximum.accumulate(hung)[:-1]])
    out = np.zeros_like(force)
    out[rows] = np.where(last[:, None] >= 0, force[rows][last], 0.0)
    return out


def law_columns(
    place: Place, at: Sequence[int], moved: Motions, by: Sequence[Variable]
) -> Iterator[tuple[tuple[str, ...], Array]]:
    """The laws of some axes of a place: their factors, and columns (R, 3, p) m."""
    axes, plus, minus = list(at), moved.plus.state, moved.minus.state
    there = (minus >= 0)[:, None, None]
    hangs = over_states(moved.stands, [np.full(len(s.which), float(s.context.loaded)) for s in moved.stands])

    def columns(later: Array, earlier: Array) -> Array:
        """Of functions (R, c or 1, k) in both states."""
        out = place.plus[..., axes, None] * later[:, None]
        out = out - place.minus[..., axes, None] * np.where(there, earlier, 0.0)[:, None]
        return out.reshape(*out.shape[:2], -1)

    for variable in by:
        later, earlier = variable.features[plus][:, None], variable.features[minus][:, None]
        words = (variable.name,) if variable.name else ()
        if hangs.any():
            yield ("loaded", *words), columns(later * hangs[plus, None, None], earlier * hangs[minus, None, None])
        if moved.alone:
            yield ("always", *words), columns(later, earlier)
        if place.torque is not None and variable.name:
            own = [t[:, axes, None] for t in place.torque]
            yield words, columns(own[0] * later, own[1] * earlier)
    curve = None if place.torque is None else _of_torque(*(t[:, axes] for t in place.torque))
    if curve is not None:
        yield ("torque",), columns(*curve)


def _of_torque(later: Array, earlier: Array) -> tuple[Array, Array] | None:
    """Functions (R, c, k) of each motion's own torques (R, c) in both states; None where there is none."""
    both = np.concatenate([later, earlier])
    largest = float(np.abs(both).max(initial=0.0))
    curves = [smooth(t[:, None] / (largest or 1.0), _LARGEST) for t in both.T]
    known = {i: f for i, f in enumerate(curves) if f is not None}
    if not known:
        return None
    out = np.zeros((len(both), both.shape[1], max(f.shape[1] for f in known.values())))
    for i, f in known.items():
        out[:, i, : f.shape[1]] = f
    return out[: len(later)], out[len(later) :]


def smooth(values: Array, length: float) -> Array | None:
    """Leading directions (S, k) of the kernel over points (S, d); None where all are one point."""
    marks = np.unique(np.round(values / length, 3), axis=0)
    if len(marks) < 2:
        return None
    marks = marks[np.unique(np.linspace(0, len(marks) - 1, _MARKS).astype(int))]
    size, vectors = np.linalg.eigh(_kernel(marks, marks))
    seen = size > 1e-8 * size[-1]
    U, s, _ = np.linalg.svd(
        _kernel(values / length, marks) @ (vectors[:, seen] / np.sqrt(size[seen])), full_matrices=False
    )
    out = (U * s)[:, :_DIRECTIONS]
    return out / np.sqrt(np.square(out).sum() / len(out))


def _kernel(a: Array, b: Array) -> Array:
    return np.exp(-0.5 * np.square(a[:, None] - b[None]).sum(axis=2))
