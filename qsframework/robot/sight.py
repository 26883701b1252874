"""Is the straight way from a point to another free of the arm's solids? Exact, many poses at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from qsframework.plugin.facts import Array
from qsframework.robot.kinematics import Frames
from qsframework.robot.mesh import Hull
from qsframework.robot.robot import Shape

Flags = npt.NDArray[np.bool_]
_FLAT = 1e-15


def visible(
    shapes: Sequence[Shape], placed: Frames, station: Array, link: int, xyz: Array, clearance: float = 0.0
) -> Flags:
    """Which of N poses show the point `xyz` of a link to the station (3,) m, base frame.

    The last `clearance` m of the line at the point are not looked at, so that a reflector may stand
    on a solid; a solid of the same link that holds the point deeper than that is taken as its holder.
    """
    target = placed.point(link, xyz)
    way = target - station[:, None]
    length = np.linalg.norm(way, axis=0)
    end = station[:, None] + way * np.maximum(0.0, 1.0 - clearance / np.maximum(length, _FLAT))
    free = np.ones(target.shape[1], dtype=bool)
    for shape in shapes:
        if shape.link == link and depth(shape, xyz) > clearance:
            continue
        free &= ~crosses(shape, _local(shape, placed, station[:, None]), _local(shape, placed, end))
    return free


def incidence(placed: Frames, station: Array, link: int, xyz: Array, normal: Array) -> Array:
    """Angle (N,) rad between the unit normal at a point of a link and the way from there to the station."""
    way = station[:, None] - placed.point(link, xyz)
    facing = placed.turned(link, normal)
    along = np.einsum("cn,cn->n", way, facing)
    aside = np.linalg.norm(way - along * facing, axis=0)
    return np.asarray(np.arctan2(aside, along), dtype=np.float64)


def depth(shape: Shape, xyz: Array) -> float:
    """How deep (m) a point of the solid's own link lies inside the solid; negative outside."""
    local = shape.placement[:3, :3].T @ (xyz - shape.placement[:3, 3])
    if shape.hull is not None:
        return float((shape.hull.offsets - shape.hull.normals @ local).min())
    if shape.kind == "sphere":
        return float(shape.size[0] - np.linalg.norm(local))
    if shape.kind == "box":
        return float((np.array(shape.size) / 2.0 - np.abs(local)).min())
    radius, length = shape.size
    return float(min(radius - np.hypot(local[0], local[1]), length / 2.0 - abs(local[2])))


def crosses(shape: Shape, start: Array, end: Array) -> Flags:
    """Whether segments from start to end (3, N), in the solid's own frame, pass through the solid (N,)."""
    way = end - start
    if shape.hull is not None:
        inside = [_between_planes(shape.hull, start, way)]
    elif shape.kind == "sphere":
        inside = [_ball(start, way, shape.size[0])]
    elif shape.kind == "box":
        inside = [_slab(start[k], way[k], shape.size[k] / 2.0) for k in range(3)]
    else:
        inside = [_ball(start[:2], way[:2], shape.size[0]), _slab(start[2], way[2], shape.size[1] / 2.0)]
    low, high = zip(*inside, strict=True)
    return np.maximum.reduce([*low, np.zeros_like(low[0])]) < np.minimum.reduce([*high, np.ones_like(high[0])])


def _between_planes(hull: Hull, start: Array, way: Array) -> tuple[Array, Array]:
    """Where start + t way is on the inner side of every plane: an interval of t, empty where low >= high."""
    count = max(start.shape[1], way.shape[1])
    low, high = np.full(count, -np.inf), np.full(count, np.inf)
    for normal, offset in zip(hull.normals, hull.offsets, strict=True):
        room, rate = offset - normal @ start, normal @ way
        flat = np.abs(rate) < _FLAT
        t = room / np.where(flat, 1.0, rate)
        high = np.where(flat, np.where(room > 0.0, high, -np.inf), np.where(rate > 0.0, np.minimum(high, t), high))
        low = np.where(~flat & (rate < 0.0), np.maximum(low, t), low)
    return low, high


def _slab(start: Array, way: Array, half: float) -> tuple[Array, Array]:
    """Where |start + t way| < half: an interval of t, empty as (inf, -inf)."""
    flat = np.abs(way) < _FLAT
    step = np.where(flat, 1.0, way)
    a, b = (-half - start) / step, (half - start) / step
    inside = np.abs(start) < half
    low = np.where(flat, np.where(inside, -np.inf, np.inf), np.minimum(a, b))
    high = np.where(flat, np.where(inside, np.inf, -np.inf), np.maximum(a, b))
    return low, high


def _ball(start: Array, way: Array, radius: float) -> tuple[Array, Array]:
    """Where |start + t way| < radius, in two dimensions or three."""
    a = np.einsum("cn,cn->n", way, way)
    b = np.einsum("cn,cn->n", start, way)
    c: Array = np.einsum("cn,cn->n", start, start) - radius * radius
    flat: Flags = a < _FLAT * _FLAT
    root: Array = b * b - a * c
    wide = np.sqrt(np.maximum(root, 0.0))
    step = np.where(flat, 1.0, a)
    missed = np.where(flat, c >= 0.0, root <= 0.0)
    low = np.where(flat, -np.inf, (-b - wide) / step)
    high = np.where(flat, np.inf, (-b + wide) / step)
    return np.where(missed, np.inf, low), np.where(missed, -np.inf, high)


def _local(shape: Shape, placed: Frames, points: Array) -> Array:
    """Base-frame points (3, N) or (3, 1) in the frame of a solid."""
    rotation = placed.rotations[shape.link]
    in_link = np.einsum("jcn,cn->jn", rotation, points - placed.positions[shape.link])
    return shape.placement[:3, :3].T @ (in_link - shape.placement[:3, 3:])
