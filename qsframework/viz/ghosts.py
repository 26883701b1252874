"""The other poses of a plan as ghosts, and the way from pose to pose in the order of the plan."""

from __future__ import annotations

from itertools import pairwise

from qsframework.plugin import Array
from qsframework.robot import Robot
from qsframework.viz.robot_shapes import draw_robot
from qsframework.viz.scene import Colour, Scene

MOST = 30
"""Poses of which a ghost is drawn; more would hide each other, and slow the page."""
_PALE: Colour = (0.55, 0.6, 0.7, 1.0)
_OPACITY = 0.10


def draw_ghost(scene: Scene, path: str, robot: Robot, links: Array, q: Array) -> None:
    """A pale robot with its flange's frame."""
    draw_robot(scene, path, robot, links, q, _OPACITY, _PALE, frozenset({0}))
    scene.axes(f"{path}/flange", links[robot.flange.link] @ robot.flange.placement, 0.12)


def draw_way(scene: Scene, path: str, points: Array) -> None:
    """Thin arrows between the load points (N, 3), in the plan's order; the arm itself does not move straight."""
    for i, (start, end) in enumerate(pairwise(points)):
        scene.arrow(f"{path}/{i}", start, end - start, 0.006, (*_PALE[:3], 0.6))
