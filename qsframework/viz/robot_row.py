"""Robots one at a time, each at zero angles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsframework.robot import Robot
from qsframework.viz.meshes import Meshes
from qsframework.viz.robot_shapes import draw_robot, link_frames, reach
from qsframework.viz.scene import Scene
from qsframework.viz.show_scene import place_poses
from qsframework.viz.subject import one_pose, robot_alone


def robot_row(robots: Sequence[Robot]) -> Scene:
    """Every robot as a step of the slider, at zero pendant angles or the nearest allowed ones."""
    scene = Scene(title="robots", first=1, size=0.75 * max((reach(r.facts) for r in robots), default=3.0))
    for i, robot in enumerate(robots):
        experiment = robot_alone(robot, np.zeros(3))
        q = one_pose(experiment, None, None).q
        links = link_frames(place_poses(experiment, q).placed, 0)
        meshes = Meshes(robot)
        scene.notes += meshes.notes
        draw_robot(scene, f"robots/{i}", robot, links, q[0], meshes=meshes)
        scene.axes(f"robots/{i}/flange", links[robot.flange.link] @ robot.flange.placement, 0.2)
        scene.step(f"robots/{i}", robot.title)
    return scene
