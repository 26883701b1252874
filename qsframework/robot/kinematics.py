"""Kinematics of a serial chain for a batch of poses.

Arrays are struct-of-arrays: the batch is the last axis, so that every operation runs over
contiguous memory. The chain is made of elements: the arm's joints and, between them, virtual
joints. Constants come from the `pin.Model`; each robot that is loaded holds this kernel to Pinocchio
(`robot/agreement.py`), tests do at 1e-12.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from qsframework.plugin.facts import Array, RobotFacts
from qsframework.plugin.rotations import cos_sin, homogeneous

Terms = tuple[tuple[int, float], ...]
"""The weights of a sum of columns that are not 0; constants of arms are mostly 0 and +-1, which cost nothing."""


def _terms(weights: Array) -> Terms:
    return tuple((i, weight) for i, weight in enumerate(weights.tolist()) if weight != 0.0)


FLOOR = -1
"""The link of a point beside the robot, which nothing moves."""


@dataclass(frozen=True, eq=False)
class Element:
    """One joint of the chain: `placement` (4, 4) is its frame in the previous element's frame."""

    placement: Array
    axis: Array
    rotation: bool

    @cached_property
    def offset(self) -> Terms:
        """Its origin in the previous element's frame."""
        return _terms(self.placement[:3, 3])

    @cached_property
    def attitude(self) -> tuple[Terms, ...]:
        """The columns of its rotation in the previous element's frame; none where that is not turned."""
        turn = self.placement[:3, :3]
        return () if np.array_equal(turn, np.eye(3)) else _columns(turn)

    @cached_property
    def along(self) -> Terms:
        """Its axis in its own frame."""
        return _terms(self.axis)

    @cached_property
    def main(self) -> tuple[int, float] | None:
        """The axis of its frame about which it turns, and +-1; None where it turns about another."""
        main = int(np.argmax(np.abs(self.axis)))
        sign = float(self.axis[main])
        # 1 and 1e-9 beside it have the length 1.0 in float64
        return (main, sign) if np.count_nonzero(self.axis) == 1 and abs(sign) == 1.0 else None

    @cached_property
    def aligning(self) -> tuple[tuple[Terms, ...], tuple[Terms, ...]]:
        """A rotation whose z column is the axis, and the one back."""
        align = _aligning(self.axis)
        return _columns(align), _columns(align.T)


@dataclass(frozen=True, eq=False)
class Chain:
    """Elements base to flange, then one for each branch; `stops[l]` is the number of elements that move link l.

    limbs: the link on which each branch hangs; the branches' links follow those of the arm
    """

    elements: tuple[Element, ...]
    stops: tuple[int, ...]
    limbs: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.elements)

    @property
    def arm(self) -> int:
        """The number of elements between base and flange."""
        return self.stops[-1]

    def reach(self, link: int) -> tuple[int, list[int]]:
        """How many elements, from the base on, may move a link; and those among them that do not."""
        if link < len(self.stops):
            return 0 if link == FLOOR else self.stops[link], []
        path: set[int] = set()
        here = link
        while here >= len(self.stops):
            path.add(self.arm + here - len(self.stops))
            here = self.limbs[here - len(self.stops)]
        end = self.arm + link - len(self.stops) + 1
        return end, [e for e in range(self.stops[here], end) if e not in path]


def joint_chain(facts: RobotFacts, whole: bool = False) -> Chain:
    """The chain of the joints alone, undeflected: one element per joint, if `whole` those of the branches too."""
    beside = facts.branches if whole else ()
    own = zip(facts.placements, facts.axes, facts.sliding, strict=True)
    elements = [Element(placement, axis, not slides) for placement, axis, slides in own]
    elements += [Element(branch.placement, branch.axis, True) for branch in beside]
    return Chain(tuple(elements), tuple(range(facts.n + 1)), tuple(facts.body_index(b.parent) for b in beside))


def joint_frames(facts: RobotFacts, q: Array) -> Frames:
    """The links at joint values (N, n), undeflected; at (N, n + b), with those of the branches, all bodies."""
    return frames(joint_chain(facts, q.shape[1] > facts.n), list(np.ascontiguousarray(q.T)), len(q))


@dataclass(frozen=True, eq=False)
class Frames:
    """World axes and origins of m elements, and the frames of the links, for N poses.

    axes (m, 3, N), origins (m, 3, N); rotations (links, 3, 3, N) with columns first
    (`rotations[l, j]` is the j-th axis of link l), positions (links, 3, N); branches after the arm
    """

    chain: Chain
    axes: Array
    origins: Array
    rotations: Array
    positions: Array

    def point(self, link: int, xyz: Array) -> Array:
        """World position (3, N) of a point fixed to a link."""
        if link == FLOOR:
            return self.turned(link, xyz)
        r = self.rotations[link]
        return self.positions[link] + xyz[0] * r[0] + xyz[1] * r[1] + xyz[2] * r[2]

    def turned(self, link: int, way: Array) -> Array:
        """A direction (3,) in the frame of a link, in the world's (3, N)."""
        if link == FLOOR:
            return np.repeat(way[:, None], self.positions.shape[-1], axis=1)
        return np.asarray(np.einsum("j,jcn->cn", way, self.rotations[link]))

    def matrix(self, link: int) -> Array:
        """Rotation (N, 3, 3) of a link."""
        if link == FLOOR:
            return np.repeat(np.eye(3)[None], self.positions.shape[-1], axis=0)
        return np.ascontiguousarray(self.rotations[link].transpose(2, 1, 0))

    def placement(self, link: int) -> Array:
        """Placement (N, 4, 4) of a link."""
        return homogeneous(self.matrix(link), self.positions[link].T)


_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
SMALL = 8192
"""Numbers up to which few calls count for more than memory that is read in one piece."""


def cross(a: Array, b: Array) -> Array:
    """Cross product over the second last axis, batch last: (..., 3, N)."""
    if a.size + b.size <= SMALL:
        return a[..., _NEXT, :] * b[..., _LAST, :] - a[..., _LAST, :] * b[..., _NEXT, :]
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(a[..., j, :], b[..., k, :], out=out[..., i, :])
        out[..., i, :] -= a[..., k, :] * b[..., j, :]
    return out


def frames(chain: Chain, coordinates: Sequence[Array | None], batch: int) -> Frames:
    """Place the chain. `coordinates[e]` (N,) is the angle or travel of element e, None for zero."""
    count, links = len(chain), len(chain.stops) + len(chain.limbs)
    axes, origins = np.empty((count, 3, batch)), np.empty((count, 3, batch))
    rotations, positions = np.empty((links, 3, 3, batch)), np.empty((links, 3, batch))
    placed = Frames(chain, axes, origins, rotations, positions)
    columns = [np.eye(3)[:, j : j + 1] for j in range(3)]
    origin = np.zeros((3, 1))
    moves = _moves(chain, coordinates)
    for e in range(chain.arm + 1):
        for link in (i for i, stop in enumerate(chain.stops) if stop == e):
            rotations[link, 0], rotations[link, 1], rotations[link, 2] = columns
            positions[link] = origin
        if e < chain.arm:
            columns, origin = _pass(placed, e, columns, origin, moves[e])
    for i, parent in enumerate(chain.limbs):
        e, link = chain.arm + i, len(chain.stops) + i
        turned, at = _pass(placed, e, list(rotations[parent]), positions[parent], moves[e])
        rotations[link, 0], rotations[link, 1], rotations[link, 2] = turned
        positions[link] = at
    return placed


Move = tuple[Array, ...]
"""Cosine and sine of an element's angle, each (N,), or its travel (N,)."""


def _moves(chain: Chain, coordinates: Sequence[Array | None]) -> list[Move | None]:
    """The moves of the elements, None of those that stay."""
    out: list[Move | None] = [None if value is None else (value,) for value in coordinates]
    turned = [e for e, value in enumerate(coordinates) if value is not None and chain.elements[e].rotation]
    if turned:
        for e, cos, sin in zip(turned, *cos_sin(np.array([coordinates[e] for e in turned])), strict=True):
            out[e] = cos, sin
    return out


def _pass(placed: Frames, e: int, columns: list[Array], origin: Array, move: Move | None) -> tuple[list[Array], Array]:
    """Place element e, moved by its coordinate, behind a frame; the frame after it."""
    element = placed.chain.elements[e]
    if element.offset:
        origin = origin + _combine(columns, element.offset)
    if element.attitude:
        columns = _times(columns, element.attitude)
    placed.axes[e], placed.origins[e] = _combine(columns, element.along), origin
    if move is None:
        return columns, origin
    if element.rotation:
        return _rotate(columns, element, *move), origin
    return columns, origin + placed.axes[e] * move[0]


def _combine(columns: list[Array], terms: Terms) -> Array:
    """Sum of weighted columns."""
    total: Array | None = None
    for i, weight in terms:
        part = columns[i] if weight == 1.0 else columns[i] * weight
        total = part if total is None else total + part
    return np.zeros((3, 1)) if total is None else total


def _columns(matrix: Array) -> tuple[Terms, ...]:
    return tuple(_terms(column) for column in matrix.T)


def _times(columns: list[Array], matrix: tuple[Terms, ...]) -> list[Array]:
    return [_combine(columns, terms) for terms in matrix]


_CYCLE = {0: (1, 2), 1: (2, 0), 2: (0, 1)}


def _rotate(columns: list[Array], element: Element, cos: Array, sin: Array) -> list[Array]:
    """columns times the rotation about an element's axis by an angle."""
    if element.main is None:
        there, back = element.aligning
        return _times(_about(_times(columns, there), 2, cos, sin), back)
    main, sign = element.main
    return _about(columns, main, cos, sin if sign > 0.0 else -sin)


def _about(columns: list[Array], main: int, cos: Array, sin: Array) -> list[Array]:
    a, b = _CYCLE[main]
    turned = list(columns)
    turned[a], turned[b] = columns[a] * cos, columns[b] * cos
    turned[a] += columns[b] * sin
    turned[b] -= columns[a] * sin
    return turned


def _aligning(axis: Array) -> Array:
    """A rotation whose z column is the axis."""
    z = axis / np.linalg.norm(axis)
    helper = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


@dataclass(frozen=True, eq=False)
class Twists:
    """Velocity of a point on a link per unit rate of each upstream element, base axes.

    linear (u, 3, N), angular (u, 3, N) (zero for translations) for the u elements upstream
    """

    linear: Array
    angular: Array

    @property
    def upstream(self) -> int:
        return len(self.linear)


def twists(placed: Frames, link: int, point: Array, mass: float = 1.0) -> Twists:
    """The Jacobian of a point (3, N) carried by a link, element by element.

    mass: where it is not 1, `point` is a position times this mass, and the linear part is so too
    """
    stop, idle = placed.chain.reach(link)
    linear = cross(placed.axes[:stop], point - mass * placed.origins[:stop])
    angular = placed.axes[:stop]
    translations = [e for e in range(stop) if not placed.chain.elements[e].rotation]
    if translations or idle:
        angular = angular.copy()
        linear[translations] = mass * placed.axes[translations]
        angular[translations] = 0.0
        linear[idle] = angular[idle] = 0.0
    return Twists(linear, angular)


def twists_along(columns: Twists, rates: Array, rows: Sequence[int] | None = None) -> Twists:
    """Derivative of the Jacobian along element rates (u, N): the kinematic Hessian times a direction.

    For a pair of elements a <= b in chain order d linear is angular_a x linear_b; a column turns
    with all elements before it and its point moves with all elements after it. rows: the elements whose
    columns are asked for, the others stay zero; a direction mostly has few elements and few are asked for.
    """
    asked = np.arange(columns.upstream) if rows is None else np.array([r for r in rows if r < columns.upstream], int)
    linear, angular = np.zeros_like(columns.linear), np.zeros_like(columns.angular)
    moved = np.flatnonzero(np.any(rates, axis=1))
    if not len(moved) or not len(asked):
        return Twists(linear, angular)
    before = (moved <= asked[:, None]).astype(np.float64)
    turning = np.tensordot(before, columns.angular[moved] * rates[moved, None, :], axes=1)
    after = np.tensordot(1.0 - before, columns.linear[moved] * rates[moved, None, :], axes=1)
    own = columns.angular[asked]
    linear[asked] = cross(turning, columns.linear[asked]) + cross(own, after)
    angular[asked] = cross(turning, own)
    return Twists(linear, angular)
