"""Scenes of robots one at a time: what a model misses at the markers, a task where each deflects most, zero angles,
targets before and after a correction.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsframework.experiment import Experiment, Readings
from qsframework.plugin import Array, Indices
from qsframework.robot import Robot
from qsframework.viz.deflection import draw_ellipsoid
from qsframework.viz.glow import Suspects, draw_suspects, spots
from qsframework.viz.meshes import Meshes
from qsframework.viz.robot_shapes import draw_robot, draw_way, flange_of, link_frames, reach
from qsframework.viz.scene import Colour, Facts, Scene, placed_at
from qsframework.viz.show_scene import place_poses
from qsframework.viz.subject import largest_residuals, one_pose, robot_alone

BEFORE: Colour = (0.85, 0.2, 0.1, 1.0)
AFTER: Colour = (0.1, 0.6, 0.25, 1.0)
_MARKER = (0.1, 0.3, 0.9, 1.0)
_LONGEST = 0.4
"""Length, m, at which the largest residual is drawn."""
MOST = 24
"""Poses drawn: those with the largest residuals."""
_POINT: Colour = (0.1, 0.3, 0.9, 1.0)
_WORST: Colour = (0.8, 0.1, 0.1, 1.0)
_TOOL: Colour = (0.4, 0.42, 0.46, 1.0)
_LEFT: Colour = (0.1, 0.3, 0.9, 0.4)
_LARGEST = 0.12
"""Half axis, m, at which a target's largest expected error is drawn."""
_COVERAGE = 2.0
_FACTOR = 100.0
"""Of arrows at targets."""


def residual_scene(
    experiment: Experiment,
    readings: Readings,
    kept: Indices,
    before: Array,
    after: Array,
    suspects: Suspects | None = None,
) -> tuple[Scene, float]:
    """The poses with the largest residuals as steps of the slider, and by how much the arrows are enlarged.

    kept (R,): rows of the readings; before, after (R, 3) m: their residuals, measured minus predicted; suspects: of a
    diagnosis, which glow where they are
    """
    measurement = readings.plus[kept]
    states, worst = largest_residuals(readings, measurement, before)
    order: list[int] = states[:MOST].tolist()
    factor = _LONGEST / max(float(worst.max()), 1e-12)
    scene = Scene(title=f"{experiment.robot.title}: residuals", first=1)
    state = place_poses(experiment, readings.poses.q[order])
    meshes = Meshes(experiment.robot)
    scene.notes += meshes.notes
    for i, m in enumerate(order):
        path = f"poses/{i}"
        links, q = link_frames(state.placed, i), readings.poses.q[m]
        draw_robot(scene, path, experiment.robot, links, q, 0.5, meshes=meshes)
        for row in np.flatnonzero(measurement == m).tolist():
            k = int(readings.marker[kept[row]])
            start = state.markers[k].position[:, i]
            where = f"{path}/row_{row}"
            scene.sphere(f"{where}/marker", 0.02, placed_at(start), _MARKER)
            scene.arrow(f"{where}/before", start, factor * before[row], 0.012, BEFORE)
            scene.arrow(f"{where}/after", start, factor * after[row], 0.016, AFTER)
        seen = {m.name: state.markers[k].position[:, i] for k, m in enumerate(experiment.markers)}
        known = spots(experiment.robot.facts, links, seen)
        draw_suspects(scene, f"{path}/suspect", suspects or {}, known, reach(experiment.robot.facts))
        name = readings.states.pose[m]
        scene.step(path, f"{readings.states.pose[m]}: up to {1e3 * worst[m]:.3f} mm", facts=Facts(name=name))
    return scene, factor


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
            scene.rod(f"{path}/tool", flange_of(robot, links)[:3, 3], held, 0.02, _TOOL)
        scene.step(path, label)
    for k, point in enumerate(points):
        scene.sphere(f"path/{k}", 0.025, placed_at(point), _POINT)
    draw_way(scene, "path/way", points)
    scene.layer("path", "path")
    return scene


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
        scene.axes(f"robots/{i}/flange", flange_of(robot, links), 0.2)
        scene.step(f"robots/{i}", robot.title)
    return scene


def draw_targets(scene: Scene, points: Array, before: Array, moved: Array, covariance: Array) -> float:
    """Arrows at targets (N, 3) m along their error before and along the command's move (N, 3) m, enlarged 100 times;
    ellipsoids (k = 2) of the error after, covariance (N, 3, 3) m^2. By how much these are enlarged."""
    size, axes = np.linalg.eigh(covariance)
    half = axes * _COVERAGE * np.sqrt(np.maximum(size, 0.0))[:, None, :]
    enlarged = _LARGEST / max(float(np.linalg.norm(half, axis=1).max(initial=0.0)), 1e-12)
    for i, point in enumerate(points):
        scene.arrow(f"targets/{i}/before", point, _FACTOR * before[i], 0.012, BEFORE)
        scene.arrow(f"targets/{i}/command", point, _FACTOR * moved[i], 0.012, AFTER)
        draw_ellipsoid(scene, f"targets/{i}/left", point, half[i], enlarged, _LEFT)
    scene.layer("targets", "targets")
    return enlarged
