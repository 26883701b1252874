"""The robot: its solids, the bars of its loops and its balancers, all from the spec; its ghosts and its way."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from qsframework.plugin import Array, Loop, ParallelSpring, RobotFacts
from qsframework.plugin.loops import follow
from qsframework.plugin.rotations import homogeneous
from qsframework.robot import Robot, Shape
from qsframework.robot.kinematics import Frames
from qsframework.robot.mesh import coarser
from qsframework.viz.meshes import Meshes, draw_meshes
from qsframework.viz.scene import Colour, Scene, placed_at

_BAR: Colour = (0.3, 0.5, 0.8, 1.0)
_SPRING: Colour = (0.05, 0.6, 0.6, 1.0)
_BONE: Colour = (0.55, 0.57, 0.6, 1.0)
_DEFLECTED: tuple[tuple[Colour, str], ...] = (((0.2, 0.75, 0.2, 1.0), "#0b5c1a"), ((0.85, 0.1, 0.65, 1.0), "#8f0066"))
"""What the deflected arm may be drawn in, and the ink of its words."""
_DRAWN = 3000
"""Most triangles of a mesh."""
_THIN = 0.018
"""Radius, as a part of the arm's reach, of bars, springs, and of the bones of an arm without solids."""
MOST = 30
"""Poses of which a ghost is drawn; more would hide each other, and slow the page."""
_PALE: Colour = (0.55, 0.6, 0.7, 1.0)
_OPACITY = 0.10


def link_frames(placed: Frames, i: int) -> Array:
    """The frames (links, 4, 4) of the moving links at pose i."""
    return homogeneous(placed.rotations[:, :, :, i].transpose(0, 2, 1), placed.positions[:, :, i])


def reach(facts: RobotFacts) -> float:
    """Length (m) of the stretched arm: the distances of its joints added up."""
    return float(np.linalg.norm(facts.placements[1:, :3, 3], axis=1).sum()) or 1.0


def flange_of(robot: Robot, links: Array) -> Array:
    """The flange's frame (4, 4), its links at (links, 4, 4)."""
    return links[robot.flange.link] @ robot.flange.placement


def deflected_look(robot: Robot) -> tuple[Colour, str]:
    """The colour of the deflected arm that is farthest from all colours of the robot, and the ink of its words."""
    own = np.array([s.rgba[:3] for s in (*robot.shapes, *robot.branch_shapes, *robot.meshes)] or [_BONE[:3]])
    return max(_DEFLECTED, key=lambda look: float(np.linalg.norm(own - look[0][:3], axis=1).min()))


def draw_robot(
    scene: Scene,
    path: str,
    robot: Robot,
    links: Array,
    q: Array,
    opacity: float = 1.0,
    tint: Colour | None = None,
    without: frozenset[int] = frozenset(),
    meshes: Meshes | None = None,
) -> None:
    """The robot with its links at (links, 4, 4) and its joints at q (n,) rad; `tint` replaces the solids' colours.

    without: links whose solids are left out; meshes: those of the URDF that are drawn besides
    """
    for link, placement in enumerate(links):
        scene.transform(f"{path}/link_{link}", placement)
    for k, shape in enumerate((*robot.shapes, *robot.branch_shapes)):
        if shape.link in without or (meshes is not None and shape.link in meshes.links):
            continue
        colour = (*(tint or shape.rgba)[:3], shape.rgba[3] * opacity)
        where = f"{path}/link_{shape.link}/shape_{k}"
        draw_solid(scene, where, shape, colour)
    if meshes is not None:
        draw_meshes(scene, path, meshes, opacity, tint, without)
    draw_bones(scene, path, robot, opacity, tint, frozenset() if meshes is None else meshes.links)
    draw_loops(scene, path, robot, links, q, opacity, tint)
    draw_balancers(scene, path, robot, links, opacity, tint)


def draw_solid(scene: Scene, where: str, shape: Shape, colour: Colour) -> None:
    """A solid of a link; of a mesh the mesh itself, where it is not convex."""
    if shape.surface is not None:
        scene.mesh(where, *coarser(shape.surface.vertices, shape.surface.faces, _DRAWN), shape.placement, colour)
    elif shape.hull is not None:
        scene.mesh(where, shape.hull.corners, shape.hull.faces, shape.placement, colour)
    elif shape.kind == "box":
        scene.box(where, shape.size, shape.placement, colour)
    elif shape.kind == "cylinder":
        scene.cylinder(where, shape.size[0], shape.size[1], shape.placement, colour)
    else:
        scene.sphere(where, shape.size[0], shape.placement, colour)


def draw_bones(
    scene: Scene,
    path: str,
    robot: Robot,
    opacity: float,
    tint: Colour | None = None,
    drawn: frozenset[int] = frozenset(),
) -> None:
    """A rod from joint to joint where a link has no solid and is not drawn already, so that no arm is invisible."""
    solid = {shape.link for shape in robot.shapes} | drawn
    radius = _THIN * reach(robot.facts)
    colour = (*(tint or _BONE)[:3], opacity)
    for link in range(len(robot.facts.links)):
        if link in solid:
            continue
        last = link == robot.facts.n
        end = robot.flange.placement[:3, 3] if last else robot.facts.placements[link][:3, 3]
        scene.rod(f"{path}/link_{link}/bone", np.zeros(3), end, radius, colour)
        scene.sphere(f"{path}/link_{link}/joint", 1.6 * radius, np.eye(4), colour)


def draw_loops(
    scene: Scene, path: str, robot: Robot, links: Array, q: Array, opacity: float, tint: Colour | None = None
) -> None:
    """The bars of every closed loop, where its effect says they are."""
    radius = 0.6 * _THIN * reach(robot.facts)
    colour = (*(tint or _BAR)[:3], opacity)
    loops = [e for e in robot.effects if isinstance(e, Loop)]
    every = follow(loops, q[None], robot.facts) if robot.facts.branches else q[None]
    for k, loop in enumerate(loops):
        joints = [robot.facts.turning_index(j) for j in loop.joints(robot.facts)]
        ends = loop.outline(every[:, joints], robot.facts)
        if ends is None or not np.isfinite(ends).all():  # an exaggerated loop may be open
            continue
        frame = links[joints[0]] @ robot.facts.placements[joints[0]]
        scene.transform(f"{path}/loop_{k}", frame)
        for b, (start, end) in enumerate(ends[0]):
            where = f"{path}/loop_{k}/bar_{b}"
            scene.rod(where, start, end, radius, colour)
            scene.sphere(f"{where}_pivot", 1.5 * radius, placed_at(end), colour)


def draw_balancers(
    scene: Scene, path: str, robot: Robot, links: Array, opacity: float, tint: Colour | None = None
) -> None:
    """Every spring between two points: a cylinder on the one side, its rod on the other."""
    radius = _THIN * reach(robot.facts)
    colour = (*(tint or _SPRING)[:3], opacity)
    drawn: list[Array] = []
    for effect in (e for e in robot.effects if isinstance(e, ParallelSpring)):
        pivots = effect.outline(robot.facts)
        if pivots is None:
            continue
        on = [(*robot.facts.frame_of(p.link), np.append(p.xyz, 1.0)) for p in pivots]
        start, end = (links[k] @ frame @ xyz for k, frame, xyz in on)
        ends = np.stack([start[:3], end[:3]])
        if any(np.allclose(ends, other) for other in drawn):  # two effects of one balancer
            continue
        where = f"{path}/balancer_{len(drawn)}"
        drawn.append(ends)
        middle = ends.mean(axis=0)
        scene.rod(f"{where}/cylinder", ends[0], middle, radius, colour)
        scene.rod(f"{where}/rod", middle, ends[1], 0.5 * radius, colour)
        for k in range(2):
            scene.sphere(f"{where}/pivot_{k}", 1.2 * radius, placed_at(ends[k]), colour)


def draw_ghost(scene: Scene, path: str, robot: Robot, links: Array, q: Array) -> None:
    """A pale robot with its flange's frame."""
    draw_robot(scene, path, robot, links, q, _OPACITY, _PALE, frozenset({0}))
    scene.axes(f"{path}/flange", flange_of(robot, links), 0.12)


def draw_way(scene: Scene, path: str, points: Array) -> None:
    """Thin arrows between the load points (N, 3), in the plan's order; the arm itself does not move straight."""
    for i, (start, end) in enumerate(pairwise(points)):
        scene.arrow(f"{path}/{i}", start, end - start, 0.006, (*_PALE[:3], 0.6))
