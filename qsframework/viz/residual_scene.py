"""Residuals on the robot in 3D: what the model misses at every marker, before and after; named causes glow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsframework.experiment import Experiment, Readings
from qsframework.plugin import Array, Indices
from qsframework.viz.glow import draw_cause, spots
from qsframework.viz.meshes import Meshes
from qsframework.viz.robot_shapes import draw_robot, link_frames, reach
from qsframework.viz.scene import Colour, Facts, Scene, placed_at
from qsframework.viz.show_scene import place_poses

BEFORE: Colour = (0.85, 0.2, 0.1, 1.0)
AFTER: Colour = (0.1, 0.6, 0.25, 1.0)
_MARKER = (0.1, 0.3, 0.9, 1.0)
_LONGEST = 0.4
"""Length, m, at which the largest residual is drawn."""
MOST = 24
"""Poses drawn: those with the largest residuals."""


def residual_scene(
    experiment: Experiment,
    readings: Readings,
    kept: Indices,
    before: Array,
    after: Array,
    causes: Sequence[str] = (),
) -> tuple[Scene, float]:
    """The poses with the largest residuals as steps of the slider, and by how much the arrows are enlarged.

    kept (R,): rows of the readings; before, after (R, 3) m: their residuals, measured minus predicted; causes:
    `effect[where]` of a diagnosis, which glow where they act
    """
    measurement = readings.plus[kept]
    worst = np.zeros(len(readings.poses))
    np.maximum.at(worst, measurement, np.linalg.norm(before, axis=1))
    there = np.unique(measurement)
    chosen = there[np.argsort(-worst[there], kind="stable")][:MOST]
    factor = _LONGEST / max(float(worst.max()), 1e-12)
    scene = Scene(title=f"{experiment.robot.title}: residuals", first=1)
    state = place_poses(experiment, readings.poses.q[chosen])
    meshes = Meshes(experiment.robot)
    scene.notes += meshes.notes
    order: list[int] = chosen.tolist()
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
        for cause in causes:
            draw_cause(scene, f"{path}/cause/{cause.replace('/', ' ')}", cause, known, reach(experiment.robot.facts))
        name = readings.states.pose[m]
        scene.step(path, f"{readings.states.pose[m]}: up to {1e3 * worst[m]:.3f} mm", facts=Facts(name=name))
    return scene, factor
