"""A plan's poses in 3D: the robot at every pose, with the load and the markers."""

from __future__ import annotations

import numpy as np

from qsframework.elastostatics.motion import move, nominal_actuators
from qsframework.elastostatics.state import State, place
from qsframework.experiment import Experiment, Plan
from qsframework.plugin import Array
from qsframework.robot import Robot
from qsframework.viz.scene import Scene

_LOAD = (0.8, 0.1, 0.1, 1.0)
_MARKER = (0.1, 0.3, 0.9, 1.0)
_METRES_PER_NEWTON = 1e-4


def plan_scene(experiment: Experiment, plan: Plan) -> Scene:
    """Every pose of the plan as a step of the slider."""
    scene = Scene(f"{experiment.robot.title}: {len(plan.pose)} poses")
    state = place_poses(experiment, plan.q)
    for i, pose in enumerate(plan.pose):
        path = f"poses/{i}"
        opacity = 1.0 if i == 0 else 0.35
        draw_robot(scene, path, experiment.robot, state, i, opacity)
        force = plan.wrench[i, :3] * _METRES_PER_NEWTON
        scene.arrow(f"{path}/load", state.tip.position[:, i], force, 0.02, _LOAD)
        for k, marker in enumerate(state.markers):
            scene.sphere(f"{path}/marker_{k}", 0.03, placed_at(marker.position[:, i]), _MARKER)
        scene.step(path, f"{pose} ({plan.load[i]})")
    return scene


def place_poses(experiment: Experiment, q: Array) -> State:
    """Forward kinematics of the model at joint angles (N, n), undeflected."""
    model = experiment.model()
    layout = model.layout
    motion = move(layout, nominal_actuators(layout, np.ascontiguousarray(q.T)), np.zeros((layout.bars, len(q))))
    return place(motion, model.tip, model.markers)


def placed_at(position: Array) -> Array:
    """A placement (4, 4) at a position (3,), not turned."""
    out = np.eye(4)
    out[:3, 3] = position
    return out


def draw_robot(scene: Scene, path: str, robot: Robot, state: State, i: int, opacity: float) -> None:
    """The robot's solids at pose i of the state."""
    for k, shape in enumerate(robot.shapes):
        link = np.eye(4)
        link[:3, :3] = state.placed.rotations[shape.link][:, :, i].T
        link[:3, 3] = state.placed.positions[shape.link][:, i]
        placement = link @ shape.placement
        colour = (*shape.rgba[:3], shape.rgba[3] * opacity)
        where = f"{path}/shape_{k}"
        if shape.kind == "box":
            scene.box(where, shape.size, placement, colour)
        elif shape.kind == "cylinder":
            scene.cylinder(where, shape.size[0], shape.size[1], placement, colour)
        else:
            scene.sphere(where, shape.size[0], placement, colour)
