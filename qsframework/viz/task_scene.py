"""Robots at a task, one at a time: the path, and the arm at the point of it where it gives most."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsframework.plugin import Array
from qsframework.robot import Robot
from qsframework.viz.ghosts import draw_way
from qsframework.viz.meshes import Meshes
from qsframework.viz.robot_shapes import draw_robot, link_frames, reach
from qsframework.viz.scene import Colour, Scene, placed_at
from qsframework.viz.show_scene import place_poses
from qsframework.viz.subject import robot_alone

_POINT: Colour = (0.1, 0.3, 0.9, 1.0)
_WORST: Colour = (0.8, 0.1, 0.1, 1.0)
_TOOL: Colour = (0.4, 0.42, 0.46, 1.0)


def task_scene(robots: Sequence[Robot], pendant: Sequence[Array], moved: Sequence[Array], points: Array) -> Scene:
    """Each robot as a step: pendant (P, n) rad and moved (P,) m along the path of points (P, 3) m; NaN: not reached."""
    scene = Scene(title="task", first=1, size=0.75 * max(reach(r.facts) for r in robots))
    for i, (robot, angles, way) in enumerate(zip(robots, pendant, moved, strict=True)):
        path, there = f"robots/{i}", np.isfinite(way)
        label = f"{robot.title}: the path is not reached"
        pose, held = np.clip(np.zeros(robot.controller.axes), robot.controller.lower, robot.controller.upper), None
        if there.any():
            worst = int(np.nanargmax(way))
            pose = angles[worst]
            scene.sphere(f"{path}/worst", 0.04, placed_at(points[worst]), _WORST)
            held = points[worst]
            label = f"{robot.title}: point {worst + 1}, moves {1e3 * way[worst]:.3f} mm"
        q = robot.controller.to_joints(pose[None])
        links = link_frames(place_poses(robot_alone(robot, np.zeros(3)), q).placed, 0)
        draw_robot(scene, path, robot, links, q[0], meshes=Meshes(robot))
        if held is not None:  # the tool, of which only the point is known
            scene.rod(f"{path}/tool", (links[robot.flange.link] @ robot.flange.placement)[:3, 3], held, 0.02, _TOOL)
        scene.step(path, label)
    for k, point in enumerate(points):
        scene.sphere(f"path/{k}", 0.025, placed_at(point), _POINT)
    draw_way(scene, "path/way", points)
    scene.layer("path", "path")
    return scene
