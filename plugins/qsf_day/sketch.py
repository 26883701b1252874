"""Small pictures of poses as SVG, for paper: the arm's simple solids seen from one side, its load as an arrow.

Each solid is the convex outline of its projection, painted from the farthest to the nearest. A link without a solid is
a rod. All pictures of a sheet have one scale and size, so that they can be compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics import Site
from qsframework.plugin import Array
from qsframework.robot import Robot, Shape
from qsframework.robot.kinematics import joint_frames
from qsframework.viz.robot_shapes import flange_of, link_frames, reach

_AZIMUTH, _ELEVATION = np.deg2rad(-55.0), np.deg2rad(18.0)
"""Where one looks from: x of the base to the right and towards the reader."""
_ROUND = np.linspace(0.0, 2.0 * np.pi, 20, endpoint=False)
_WIDTH = 200.0
"""Units of a picture's longer side."""
_ARROW = 0.28
"""Length of the largest load's arrow, as a part of the reach."""


@dataclass(frozen=True)
class _Drawn:
    """A polygon or a line: points (N, 2) m in the picture's plane, how near it is, and how it is painted."""

    points: Array
    near: float
    style: str
    closed: bool


def sketches(robot: Robot, site: Site, pendant: Array, force: Array) -> list[str]:
    """Pictures of N poses: pendant (N, m) rad, force (N, 3) N at the site, base frame."""
    q = robot.controller.to_joints(pendant)
    placed = joint_frames(robot.facts, q)
    points = placed.point(site.link, site.xyz).T
    most = float(np.linalg.norm(force, axis=1).max()) or 1.0
    view = _view()
    drawn = [
        [
            *_ground(robot, view),
            *_arm(robot, link_frames(placed, i), view),
            *_load(robot, site, link_frames(placed, i), points[i], force[i] / most, view),
        ]
        for i in range(len(q))
    ]
    corners = [np.concatenate([d.points for d in one]) for one in drawn]
    ends = [(points.min(axis=0), points.max(axis=0)) for points in corners]
    size = np.max([high - low for low, high in ends], axis=0)
    return [_svg(one, 0.5 * (low + high) - 0.5 * size, size) for one, (low, high) in zip(drawn, ends, strict=True)]


def _view() -> Array:
    """Rows (3, 3): to the right, up, and towards the reader."""
    c, s = np.cos(_AZIMUTH), np.sin(_AZIMUTH)
    towards = np.array([np.cos(_ELEVATION) * c, np.cos(_ELEVATION) * s, np.sin(_ELEVATION)])
    right = np.array([-s, c, 0.0])
    return np.stack([right, np.cross(towards, right), towards])


def _arm(robot: Robot, links: Array, view: Array) -> list[_Drawn]:
    out = [_solid(shape, links[shape.link], view) for shape in robot.shapes if shape.link < len(links)]
    solid = {shape.link for shape in robot.shapes}
    for link in range(len(links)):
        if link not in solid:
            last = link == robot.facts.n
            end = robot.flange.placement[:3, 3] if last else robot.facts.placements[link][:3, 3]
            ends = links[link] @ np.array([[0.0, 0.0, 0.0, 1.0], [*end, 1.0]]).T
            seen = (view @ ends[:3]).T
            style = "stroke:#667;stroke-width:5;stroke-linecap:round;fill:none"
            out.append(_Drawn(seen[:, :2], float(seen[:, 2].mean()), style, False))
    return sorted(out, key=lambda d: d.near)


def _solid(shape: Shape, link: Array, view: Array) -> _Drawn:
    corners = _corners(shape) @ shape.placement[:3, :3].T + shape.placement[:3, 3]
    seen = (corners @ link[:3, :3].T + link[:3, 3]) @ view.T
    red, green, blue = (round(255 * (0.25 + 0.75 * c)) for c in shape.rgba[:3])
    style = f"fill:rgb({red},{green},{blue});stroke:#333;stroke-width:0.8;stroke-linejoin:round"
    outline = hull(seen[:, :2])
    if shape.kind == "sphere":  # the outline of its three great circles is not round
        centre = seen.mean(axis=0)[:2]
        outline = centre + shape.size[0] * np.stack([np.cos(_ROUND), np.sin(_ROUND)], axis=1)
    return _Drawn(outline, float(seen[:, 2].mean()), style, True)


def _corners(shape: Shape) -> Array:
    """Points (N, 3) whose convex hull is the solid, in its own frame."""
    if shape.hull is not None:
        return shape.hull.corners
    if shape.kind == "box":
        signs = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
        return signs * np.array(shape.size)
    radius, half = (shape.size[0], 0.5 * shape.size[1]) if shape.kind == "cylinder" else (shape.size[0], 0.0)
    ring = np.stack([radius * np.cos(_ROUND), radius * np.sin(_ROUND), np.full(len(_ROUND), half)], axis=1)
    return np.concatenate([ring, ring * [1.0, 1.0, -1.0]])


def _ground(robot: Robot, view: Array) -> list[_Drawn]:
    """The base's x and y on the ground, x longer."""
    size = reach(robot.facts)
    out: list[_Drawn] = []
    for k, length in ((0, 0.45 * size), (1, 0.3 * size)):
        ends = np.zeros((2, 3))
        ends[1, k] = length
        out.append(_Drawn((ends @ view.T)[:, :2], -np.inf, "stroke:#999;stroke-width:1.2;fill:none", False))
    return out


def _load(robot: Robot, site: Site, links: Array, point: Array, force: Array, view: Array) -> list[_Drawn]:
    """The tool as a line from the flange, and the force as an arrow that begins at the load point."""
    flange = flange_of(robot, links)[:3, 3]
    tool = (np.stack([flange, point]) @ view.T)[:, :2]
    out = [_Drawn(tool, np.inf, "stroke:#333;stroke-width:2;fill:none", False)]
    length = float(np.linalg.norm(force))
    if length == 0.0:
        return out
    start, way = view[:2] @ point, view[:2] @ force * _ARROW * reach(robot.facts)
    side, end = np.array([-way[1], way[0]]), start + way
    head = np.stack([end, end - 0.3 * way + 0.14 * side, end - 0.3 * way - 0.14 * side])
    out.append(_Drawn(np.stack([start, end - 0.25 * way]), np.inf, "stroke:#b00;stroke-width:2.5;fill:none", False))
    return [*out, _Drawn(head, np.inf, "fill:#b00;stroke:none", True)]


def hull(points: Array) -> Array:
    """The convex outline (M, 2) of points (N, 2), counterclockwise."""
    ordered = sorted({(float(x), float(y)) for x, y in points})

    def half(sequence: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        out: list[tuple[float, float]] = []
        for x, y in sequence:
            while len(out) > 1 and _turn(out[-2], out[-1], (x, y)) <= 0.0:
                out.pop()
            out.append((x, y))
        return out[:-1]

    return np.array([*half(ordered), *half(ordered[::-1])] or ordered)


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _svg(drawn: Sequence[_Drawn], low: Array, size: Array) -> str:
    """One picture, its plane from low (2,) m on, of a size (2,) m that is the same for all."""
    scale = (_WIDTH - 12.0) / max(float(size.max()), 1e-9)
    width, height = scale * size + 12.0
    parts: list[str] = []
    for d in drawn:
        x, y = 6.0 + scale * (d.points[:, 0] - low[0]), height - 6.0 - scale * (d.points[:, 1] - low[1])
        cells = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
        parts.append(f'<{"polygon" if d.closed else "polyline"} points="{cells}" style="{d.style}"/>')
    box = f"0 0 {width:.0f} {height:.0f}"
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}" aria-hidden="true">{"".join(parts)}</svg>'
