"""Do the arm's solids run into each other, into the floor or into what stands around? Many poses at once.

Most pairs of solids are far apart or deep inside each other, which capsules around and inside them tell in numpy; only
the doubtful ones go to coal. There a mesh that is not convex counts as its hull first, and where hulls touch as it is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from qsframework.plugin.facts import Array, Indices, RobotFacts
from qsframework.plugin.rotations import homogeneous
from qsframework.robot.kinematics import Frames, joint_frames
from qsframework.robot.mesh import Hull
from qsframework.robot.robot import NamedShape, Robot, Shape

Flags = npt.NDArray[np.bool_]
_PAIRS = 200_000
"""Pairs of solids at a pose that are judged at once."""
_SAMPLES = 400
_NEARLY_ALL = 0.95
_CORNERS = 100
"""Of a hull that are placed at once."""
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
        hit = np.zeros(placed.positions.shape[-1], dtype=bool)
        for sure, doubtful in self._judged(placed):
            hit[sure[:, 1]] = True
            doubtful = doubtful[~hit[doubtful[:, 1]]]
            for _, pose in self._touching(placed, doubtful, once=True):
                hit[pose] = True
        return hit

    def matrix(self, placed: Frames) -> Flags:
        """Which pairs (P, N) are closer than the clearance, each pair asked on its own."""
        out = np.zeros((len(self.pairs), placed.positions.shape[-1]), dtype=bool)
        for sure, doubtful in self._judged(placed):
            out[sure[:, 0], sure[:, 1]] = True
            for pair, pose in self._touching(placed, doubtful, once=False):
                out[pair, pose] = True
        return out

    def named(self, placed: Frames, facts: RobotFacts) -> tuple[str, ...]:
        """Of each of N poses the pairs that are closer than the clearance, such as `link_2 and link_5`; "" for none."""
        touching = self.matrix(placed)
        names = [self.pair(k, facts) for k in range(len(self.pairs))]
        return tuple(", ".join(dict.fromkeys(names[k] for k in np.flatnonzero(column))) for column in touching.T)

    def pair(self, pair: int, facts: RobotFacts) -> str:
        """A pair in words: two links, or a link and an obstacle."""
        one, other = (self.shapes[int(k)] for k in self.pairs[pair].tolist())
        first, second = (s.name if isinstance(s, NamedShape) else facts.links[s.link] for s in (one, other))
        return f"{first} and {second}"

    def _judged(self, placed: Frames) -> Iterator[tuple[Indices, Indices]]:
        """Rows (pair, pose) that surely touch, and those in doubt, block by block."""
        if not len(self.pairs):
            return
        capsules, step = _capsules(self.shapes, placed), max(1, _PAIRS // max(placed.positions.shape[-1], 1))
        for start in range(0, len(self.pairs), step):
            sure, doubtful = _judge(*capsules, self.pairs[start : start + step], self.clearance)
            shift = np.array([start, 0])
            yield sure + shift, doubtful + shift

    def _touching(self, placed: Frames, rows: Indices, once: bool) -> Iterator[tuple[int, int]]:
        """Those of the doubtful rows (pair, pose) that touch; once: no more of a pose of which one does."""
        if not len(rows):
            return
        library = _coal()
        request = library.CollisionRequest()
        request.security_margin = self.clearance
        order = rows[np.argsort(rows[:, 1], kind="stable")]
        count = placed.positions.shape[-1]
        both = self.pairs[order[:, 0]] * count + order[:, 1:]
        stands, at = np.unique(both, return_inverse=True)
        solids = stands // count
        turned, placed_at = _stand(self.shapes, placed, solids, stands % count)
        where: list[Any] = [None] * len(stands)
        done = -1
        for (pair, pose), ends in zip(order.tolist(), at.reshape(both.shape).tolist(), strict=True):
            if once and pose == done:
                continue
            for i in ends:
                where[i] = where[i] or library.Transform3s(turned[i], placed_at[i])
            if _touch(library, request, [(self.shapes[int(solids[i])], where[i]) for i in ends]):
                yield pair, pose
                done = pose


def _coal() -> Any:
    import coal

    return coal  # has no types


def _touch(library: Any, request: Any, ends: Sequence[tuple[Shape, Any]]) -> bool:
    """Whether two placed solids are closer than the request's margin: by their hulls, then as they are."""
    (one, there), (other, here) = ends

    def meet(first: Any, second: Any) -> bool:
        return bool(library.collide(first, there, second, here, request, library.CollisionResult()) > 0)

    if "plane" in (one.kind, other.kind) or not (one.surface or other.surface):
        return meet(_solid(one), _solid(other))
    if not meet(_solid(one), _solid(other)):
        return False
    if meet(_surface(one), _surface(other)):
        return True
    return _inside(one, there, other, here) or _inside(other, here, one, there)


def _inside(shape: Shape, at: Any, around: Shape, there: Any) -> bool:
    """Whether a solid that touches no surface of a mesh is inside it."""
    if around.surface is None or around.hull is None:
        return False
    placed = np.linalg.inv(_matrix(there)) @ _matrix(at)
    points = (shape.hull.corners if shape.hull is not None else np.zeros((1, 3))) @ placed[:3, :3].T + placed[:3, 3]
    deep = np.all(points @ around.hull.normals.T <= around.hull.offsets + 1e-9, axis=1)
    return bool(deep.all()) and around.surface.holds(points[0])


def _matrix(transform: Any) -> Array:
    return homogeneous(transform.getRotation(), transform.getTranslation())


def make_collider(robot: Robot, clearance: float = 0.0, more: Sequence[Shape] = ()) -> Collider:
    """The pairs of a robot's solids, with `more` fixed to its links, that can run into each other.

    Left out are pairs on one link or on neighbours, and pairs that overlap by construction: at the
    zero pose of the pendant, or in nearly all of a fixed sample of poses.
    """
    shapes = (*robot.shapes, *more)
    apart = {(i, j): abs(shapes[i].link - shapes[j].link) for i, j in combinations(range(len(shapes)), 2)}
    pairs = [pair for pair, links in apart.items() if links > 1]
    left_out = [LeftOut(*pair, "on neighbouring links") for pair, links in apart.items() if links == 1]
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


def obstacle_collider(
    robot: Robot, obstacles: Sequence[Shape], clearance: float = 0.0, more: Sequence[Shape] = ()
) -> Collider:
    """The pairs of obstacles, which stand still, and of the solids that move, with `more` fixed to links."""
    moving = [shape for shape in (*robot.shapes, *more) if shape.link > 0]
    pairs = [(i, len(moving) + j) for i in range(len(moving)) for j in range(len(obstacles))]
    return Collider((*moving, *obstacles), np.array(pairs, dtype=np.intp).reshape(-1, 2), clearance, ())


def lowest_point(shape: Shape, placed: Frames) -> Array:
    """Height (N,) m of a solid's lowest point, base frame."""
    height = placed.point(shape.link, shape.placement[:3, 3])[2]
    up = np.stack([_axis(shape, placed, k)[2] for k in range(3)])
    if shape.hull is not None:
        lowest = np.full(len(height), np.inf)
        for start in range(0, len(shape.hull.whole), _CORNERS):
            lowest = np.minimum(lowest, (shape.hull.whole[start : start + _CORNERS] @ up).min(axis=0))
        return height + lowest
    if shape.kind == "sphere":
        return height - shape.size[0]
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


Ends = tuple[float, float]
_NO_INSIDE = (0.0, -np.inf)


@lru_cache(maxsize=1024)
def _capsule(shape: Shape) -> tuple[Array, Array, Ends, Ends]:
    """In a solid's link: centre and axis (3,), half length and radius of the capsules around and inside it.

    A radius inside below zero is that of a solid of which no inside is known; a plane is around everything.
    """
    centre, turn = shape.placement[:3, 3], shape.placement[:3, :3]
    if shape.kind == "plane":
        return centre, turn[:, 2], (0.0, np.inf), _NO_INSIDE
    if shape.kind == "sphere":
        return centre, turn[:, 2], (0.0, shape.size[0]), (0.0, shape.size[0])
    if shape.kind == "cylinder":
        radius, half = shape.size[0], shape.size[1] / 2.0
        inside = min(radius, half)
        return centre, turn[:, 2], (half, radius), (half - inside, inside)
    if shape.hull is not None:
        return _around_hull(shape.hull, shape)
    halves = np.array(shape.size) / 2.0
    main = int(np.argmax(halves))
    others = np.delete(halves, main)
    inside = float(others.min())
    around = (float(halves[main]), float(np.linalg.norm(others)))
    return centre, turn[:, main], around, (float(halves[main]) - inside, inside)


def _around_hull(hull: Hull, shape: Shape) -> tuple[Array, Array, Ends, Ends]:
    """Along the direction in which the corners spread most, about their mean, which is inside."""
    middle = hull.corners.mean(axis=0)
    spread = hull.corners - middle
    way = np.linalg.svd(spread, full_matrices=False)[2][0]
    spread = hull.whole - middle
    along = spread @ way
    outer = float(np.abs(along).max()), float(np.linalg.norm(spread - np.outer(along, way), axis=1).max())
    deep = hull.offsets - hull.normals @ middle
    radius = _ROOM * max(0.0, float(deep.min()))
    half = float(((deep - radius) / np.maximum(np.abs(hull.normals @ way), 1e-12)).min())
    inner = (max(0.0, half), radius) if shape.surface is None else _NO_INSIDE
    turn = shape.placement[:3, :3]
    return turn @ middle + shape.placement[:3, 3], turn @ way, outer, inner


def _capsules(shapes: Sequence[Shape], placed: Frames) -> tuple[Array, Array, Array, Array]:
    """Those of S solids at N poses: centres and axes (3, S, N), base frame; half lengths and radii (S, 2)."""
    centres, axes, outer, inner = map(np.array, zip(*map(_capsule, shapes), strict=True))
    links = np.array([shape.link for shape in shapes], dtype=np.intp)
    turns = placed.rotations[links]  # (S, 3 of the link, 3 of the base, N)
    centre, axis = (np.einsum("sj,sjcn->csn", own, turns) for own in (centres, axes))
    return centre + placed.positions[links].transpose(1, 0, 2), axis, outer, inner


def _judge(
    centre: Array, axis: Array, around: Array, within: Array, pairs: Indices, clearance: float
) -> tuple[Indices, Indices]:
    """Rows (pair, pose) of the solids that surely are closer than the clearance, and of those that may be."""
    a, b = pairs.T
    reach = (around[a] + around[b]).sum(axis=1) + clearance
    apart = centre[:, a] - centre[:, b]
    pair, pose = np.nonzero(np.einsum("cpn,cpn->pn", apart, apart) <= (reach * reach)[:, None])
    rows = np.stack([pair, pose], axis=1)
    if not len(rows):
        return rows, rows
    first, second, apart = a[pair], b[pair], apart[:, pair, pose]
    axes = axis[:, first, pose], axis[:, second, pose]
    outside, inside = (_segment_distance(apart, *axes, ends[first, 0], ends[second, 0]) for ends in (around, within))
    sure = inside < within[first, 1] + within[second, 1] + clearance - 1e-9
    doubtful = ~sure & (outside <= around[first, 1] + around[second, 1] + clearance + 1e-9)
    return rows[sure], rows[doubtful]


def _segment_distance(apart: Array, first: Array, second: Array, half: Array, other: Array) -> Array:
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


@lru_cache(maxsize=1024)
def _solid(shape: Shape) -> Any:
    """A solid as coal has it, of a mesh the hull."""
    library = _coal()
    if shape.kind == "plane":
        return library.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
    if shape.hull is not None:
        corners = library.StdVec_Vec3s()
        for corner in shape.hull.whole:
            corners.append(corner)
        try:
            return library.Convex.convexHull(corners, True, "Qt")
        except RuntimeError:
            # Qt makes a fan of a flat face, and coal holds 255 neighbours of a corner; QJ breaks it up
            return library.Convex.convexHull(corners, True, "QJ")
    kinds = {"box": library.Box, "cylinder": library.Cylinder, "sphere": library.Sphere}
    return kinds[shape.kind](*(float(v) for v in shape.size))


@lru_cache(maxsize=1024)
def _surface(shape: Shape) -> Any:
    """A mesh as it is; else the solid."""
    if shape.surface is None:
        return _solid(shape)
    library = _coal()
    model = library.BVHModelOBBRSS()
    model.beginModel(len(shape.surface.faces), len(shape.surface.vertices))
    model.addVertices(np.ascontiguousarray(shape.surface.vertices))
    model.addTriangles(np.ascontiguousarray(shape.surface.faces.astype(np.int64)))
    model.endModel()
    return model


def _stand(shapes: Sequence[Shape], placed: Frames, solid: Indices, pose: Indices) -> tuple[Array, Array]:
    """Rotations (k, 3, 3) and positions (k, 3) of solids, by number (k,), at poses (k,)."""
    link, own = np.array([shape.link for shape in shapes])[solid], np.array([s.placement for s in shapes])[solid]
    turned = placed.rotations[link, :, :, pose].transpose(0, 2, 1)
    return turned @ own[:, :3, :3], placed.positions[link, :, pose] + (turned @ own[:, :3, 3:])[..., 0]
