"""Do the arm's solids run into each other or into the floor? Many poses at once.

Most pairs of solids are far apart or deep inside each other, which capsules around and inside them
tell in numpy; only the doubtful ones go to coal.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from qsframework.plugin.facts import Array, Indices
from qsframework.robot.kinematics import Frames, joint_frames
from qsframework.robot.mesh import Hull
from qsframework.robot.robot import Robot, Shape

Flags = npt.NDArray[np.bool_]
_BLOCK = 4096
_SAMPLES = 400
_NEARLY_ALL = 0.95
_ROOM = 0.7
"""Radius of the capsule inside a hull over that of the ball there."""


@dataclass(frozen=True)
class LeftOut:
    """A pair of solids (positions in the list of shapes) that is not checked, and why."""

    first: int
    second: int
    reason: str


@dataclass(frozen=True, eq=False)
class Collider:
    """The pairs of solids (P, 2) to keep apart by `clearance` m, and the pairs left out."""

    shapes: tuple[Shape, ...]
    pairs: Indices
    clearance: float
    left_out: tuple[LeftOut, ...]

    def collides(self, placed: Frames) -> Flags:
        """Which of N placed poses have a pair of solids closer than the clearance, (N,)."""
        count = placed.positions.shape[-1]
        hit = np.zeros(count, dtype=bool)
        doubtful: list[Indices] = []
        bounds = [_capsule(shape, placed) for shape in self.shapes]
        for i, j in ((int(a), int(b)) for a, b in self.pairs):
            near, sure = _judge(bounds[i], bounds[j], self.clearance)
            hit[sure] = True
            doubtful.append(np.stack([np.full(len(near), i), np.full(len(near), j), near], axis=1))
        if doubtful:
            rest = np.concatenate(doubtful)
            rest = rest[~hit[rest[:, 2]]]
            _ask_coal(self.shapes, self.clearance, placed, rest, hit)
        return hit

    def matrix(self, placed: Frames) -> Flags:
        """Which pairs (P, N) are closer than the clearance, each pair asked on its own."""
        return np.stack([Collider(self.shapes, p[None], self.clearance, ()).collides(placed) for p in self.pairs])


def make_collider(robot: Robot, clearance: float = 0.0, more: Sequence[Shape] = ()) -> Collider:
    """The pairs of a robot's solids, with `more` fixed to its links, that can run into each other.

    Left out are pairs on one link or on neighbours, and pairs that overlap by construction: at the
    zero pose of the pendant, or in nearly all of a fixed sample of poses.
    """
    shapes = (*robot.shapes, *more)
    pairs: list[tuple[int, int]] = []
    left_out: list[LeftOut] = []
    for i, j in combinations(range(len(shapes)), 2):
        apart = abs(shapes[i].link - shapes[j].link)
        if apart > 1:
            pairs.append((i, j))
        elif apart == 1:
            left_out.append(LeftOut(i, j, "on neighbouring links"))
    every = Collider(shapes, np.array(pairs, dtype=np.intp).reshape(-1, 2), clearance, ())
    if not pairs:
        return Collider(shapes, every.pairs, clearance, tuple(left_out))
    share, at_zero = _overlaps(robot, every)
    keep = np.ones(len(pairs), dtype=bool)
    for k, (i, j) in enumerate(pairs):
        if share[k] >= _NEARLY_ALL:
            left_out.append(LeftOut(i, j, f"overlap in {100 * share[k]:.0f} % of the sampled poses"))
        elif at_zero[k]:
            left_out.append(LeftOut(i, j, "overlap at the zero pose"))
        else:
            continue
        keep[k] = False
    return Collider(shapes, every.pairs[keep], clearance, tuple(left_out))


def _overlaps(robot: Robot, every: Collider) -> tuple[Array, Flags]:
    """Share (P,) of sampled poses at which each pair overlaps, and whether it does at zero (P,)."""
    controller = robot.controller
    rng = np.random.default_rng(0)
    sample = rng.uniform(controller.lower, controller.upper, (_SAMPLES, controller.axes))
    pendant = np.concatenate([np.zeros((1, controller.axes)), sample])
    hit = every.matrix(joint_frames(robot.facts, controller.to_joints(pendant)))
    reachable = not controller.outside(pendant[:1]).any()
    return hit[:, 1:].mean(axis=1), hit[:, 0] & reachable


def lowest_point(shape: Shape, placed: Frames) -> Array:
    """Height (N,) m of a solid's lowest point, base frame."""
    height = placed.point(shape.link, shape.placement[:3, 3])[2]
    if shape.hull is not None:
        up = np.stack([_axis(shape, placed, k)[2] for k in range(3)])
        lowest = np.full(len(height), np.inf)
        for corner in shape.hull.corners:
            lowest = np.minimum(lowest, corner @ up)
        return height + lowest
    if shape.kind == "sphere":
        return height - shape.size[0]
    up = [_axis(shape, placed, k)[2] for k in range(3)]
    if shape.kind == "box":
        return height - sum(np.abs(u) * side / 2.0 for u, side in zip(up, shape.size, strict=True))
    radius, length = shape.size
    return height - np.abs(up[2]) * length / 2.0 - radius * np.hypot(up[0], up[1])


def above_floor(shapes: Sequence[Shape], placed: Frames, floor: float) -> Flags:
    """Which poses (N,) keep every solid of the moving links above the floor."""
    good = np.ones(placed.positions.shape[-1], dtype=bool)
    for shape in shapes:
        if shape.link > 0:  # the base stands on the floor
            good &= lowest_point(shape, placed) >= floor
    return good


def _axis(shape: Shape, placed: Frames, k: int) -> Array:
    """The k-th axis (3, N) of a solid, base frame."""
    return np.einsum("j,jcn->cn", shape.placement[:3, k], placed.rotations[shape.link])


@dataclass(frozen=True, eq=False)
class _Capsule:
    """Centres and axes (3, N), and half length and radius of the capsules around and inside a solid."""

    centre: Array
    axis: Array
    outer: tuple[float, float]
    inner: tuple[float, float]


def _capsule(shape: Shape, placed: Frames) -> _Capsule:
    centre = placed.point(shape.link, shape.placement[:3, 3])
    if shape.kind == "sphere":
        return _Capsule(centre, _axis(shape, placed, 2), (0.0, shape.size[0]), (0.0, shape.size[0]))
    if shape.kind == "cylinder":
        radius, half = shape.size[0], shape.size[1] / 2.0
        inside = min(radius, half)
        return _Capsule(centre, _axis(shape, placed, 2), (half, radius), (half - inside, inside))
    if shape.hull is not None:
        return _around_hull(shape.hull, shape, placed)
    halves = np.array(shape.size) / 2.0
    main = int(np.argmax(halves))
    others = np.delete(halves, main)
    inside = float(others.min())
    around = (float(halves[main]), float(np.linalg.norm(others)))
    return _Capsule(centre, _axis(shape, placed, main), around, (float(halves[main]) - inside, inside))


def _around_hull(hull: Hull, shape: Shape, placed: Frames) -> _Capsule:
    """Along the direction in which the corners spread most, about their mean, which is inside."""
    middle = hull.corners.mean(axis=0)
    spread = hull.corners - middle
    way = np.linalg.svd(spread, full_matrices=False)[2][0]
    along = spread @ way
    outer = float(np.abs(along).max()), float(np.linalg.norm(spread - np.outer(along, way), axis=1).max())
    deep = hull.offsets - hull.normals @ middle
    radius = _ROOM * max(0.0, float(deep.min()))
    half = float(((deep - radius) / np.maximum(np.abs(hull.normals @ way), 1e-12)).min())
    centre = placed.point(shape.link, shape.placement[:3, :3] @ middle + shape.placement[:3, 3])
    axis = np.einsum("j,jcn->cn", shape.placement[:3, :3] @ way, placed.rotations[shape.link])
    return _Capsule(centre, axis, outer, (max(0.0, half), radius))


def _judge(a: _Capsule, b: _Capsule, clearance: float) -> tuple[Indices, Indices]:
    """Poses at which the solids may be closer than the clearance, and those at which they surely are."""
    reach = sum(a.outer) + sum(b.outer) + clearance
    apart = a.centre - b.centre
    near = np.flatnonzero(np.einsum("cn,cn->n", apart, apart) <= reach * reach)
    if len(near) == 0:
        return near, near
    apart, first, second = apart[:, near], a.axis[:, near], b.axis[:, near]
    outside = _segment_distance(apart, first, second, a.outer[0], b.outer[0])
    inside = _segment_distance(apart, first, second, a.inner[0], b.inner[0])
    sure = inside < a.inner[1] + b.inner[1] + clearance - 1e-9
    doubtful = ~sure & (outside <= a.outer[1] + b.outer[1] + clearance + 1e-9)
    return near[doubtful], near[sure]


def _segment_distance(apart: Array, first: Array, second: Array, half: float, other: float) -> Array:
    """Distance (N,) of two segments given by the way from the second's middle to the first's, axes, half lengths."""
    b = np.einsum("cn,cn->n", first, second)
    c, f = np.einsum("cn,cn->n", first, apart), np.einsum("cn,cn->n", second, apart)
    denominator = 1.0 - b * b
    parallel = denominator < 1e-12
    s = np.where(parallel, 0.0, (b * f - c) / np.where(parallel, 1.0, denominator))
    s = np.clip(s, -half, half)
    t = np.clip(b * s + f, -other, other)
    s = np.clip(b * t - c, -half, half)
    way = apart + first * s - second * t
    return np.sqrt(np.einsum("cn,cn->n", way, way))


def _ask_coal(shapes: Sequence[Shape], clearance: float, placed: Frames, doubtful: Indices, hit: Flags) -> None:
    """Mark in `hit` the poses where coal finds one of the doubtful (first, second, pose) closer than the clearance."""
    if not len(doubtful):
        return
    import coal

    library: Any = coal  # has no types
    request = library.CollisionRequest()
    request.security_margin = clearance
    asked = sorted({int(k) for k in doubtful[:, :2].ravel()})
    solids = {k: _solid(library, shapes[k]) for k in asked}
    order = np.argsort(doubtful[:, 2], kind="stable")
    for pose, rows in _by_pose(doubtful[order]):
        known: dict[int, Any] = {}
        for i, j in rows:
            for k in (i, j):
                if k not in known:
                    known[k] = _transform(library, shapes[k], placed, pose)
            if library.collide(solids[i], known[i], solids[j], known[j], request, library.CollisionResult()) > 0:
                hit[pose] = True
                break


def _by_pose(doubtful: Indices) -> Iterator[tuple[int, list[list[int]]]]:
    starts = np.flatnonzero(np.diff(doubtful[:, 2], prepend=-1))
    for start, stop in zip(starts, [*starts[1:], len(doubtful)], strict=True):
        yield int(doubtful[start, 2]), doubtful[start:stop, :2].tolist()


def _solid(coal: Any, shape: Shape) -> Any:
    if shape.hull is not None:
        corners = coal.StdVec_Vec3s()
        for corner in shape.hull.corners:
            corners.append(corner)
        return coal.Convex.convexHull(corners, True, "Qt")
    kinds = {"box": coal.Box, "cylinder": coal.Cylinder, "sphere": coal.Sphere}
    return kinds[shape.kind](*(float(v) for v in shape.size))


def _transform(coal: Any, shape: Shape, placed: Frames, pose: int) -> Any:
    rotation = placed.rotations[shape.link, :, :, pose].T
    position = placed.positions[shape.link, :, pose] + rotation @ shape.placement[:3, 3]
    return coal.Transform3s(rotation @ shape.placement[:3, :3], position)
