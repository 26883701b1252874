"""What a planned pose must keep: the floor, obstacles, the cylinder about axis 1, the box, the tracker's station."""

from __future__ import annotations

import numpy as np

from qsframework.experiment import Experiment
from qsframework.plugin import Array
from qsframework.viz.robot_shapes import draw_solid, reach
from qsframework.viz.scene import Colour, Scene, placed_at

_FORBIDDEN: Colour = (0.85, 0.35, 0.2, 0.12)
_WALL: Colour = (0.2, 0.45, 0.75, 0.07)
_STATION: Colour = (0.1, 0.6, 0.25, 1.0)
_FENCE: Colour = (0.55, 0.45, 0.25, 0.15)
_SHEET = 0.004


def draw_obstacles(scene: Scene, path: str, experiment: Experiment) -> None:
    """What stands around the arm; a plane as a sheet of the arm's size."""
    size = 0.8 * reach(experiment.robot.facts)
    for k, shape in enumerate(experiment.constraints.obstacles):
        where = f"{path}/{k}"
        if shape.kind == "plane":
            middle = shape.placement.copy()
            normal, point = middle[:3, 2], middle[:3, 3]
            middle[:3, 3] = (normal @ point) * normal  # as near to the base as the plane comes
            middle[2, 3] += 0.5 * size * float(abs(normal[2]) < 0.5)
            scene.box(where, (2.0 * size, 2.0 * size, _SHEET), middle, _FENCE)
        else:
            draw_solid(scene, where, shape, shape.rgba)
    names = [shape.name for shape in experiment.constraints.obstacles]
    if names:
        scene.notes.append(f"Brown: what stands around the arm: {', '.join(names)}.")


def draw_limits(scene: Scene, path: str, experiment: Experiment) -> None:
    """All limits of the experiment that are places; the scene gets a note on each."""
    limits = experiment.constraints
    size = 1.2 * reach(experiment.robot.facts)
    if limits.floor is not None:
        place = placed_at(np.array([0.0, 0.0, limits.floor - 0.5 * _SHEET]))
        scene.box(f"{path}/floor", (2.0 * size, 2.0 * size, _SHEET), place, _FORBIDDEN)
        scene.notes.append(f"Floor: no solid of the moving links below {limits.floor:g} m.")
    if limits.axis1_distance_min is not None and not experiment.robot.facts.sliding[0]:
        radius = limits.axis1_distance_min
        scene.cylinder(f"{path}/axis_1", radius, 2.0 * size, placed_at(np.array([0.0, 0.0, size])), _FORBIDDEN)
        scene.notes.append(f"Cylinder: {_words(limits.of)} stays {radius:g} m or more from axis 1.")
    _draw_box(scene, path, experiment, size)
    if limits.sight is not None:
        scene.sphere(f"{path}/station", 0.08, placed_at(limits.sight.station), _STATION)
        scene.notes.append("Green ball: the tracker.")


def _draw_box(scene: Scene, path: str, experiment: Experiment, size: float) -> None:
    """A wall at each side of the box that is given; the others are open."""
    limits = experiment.constraints
    low = np.array([-size if v is None else v for v in (limits.x_min, limits.y_min, limits.z_min)])
    high = np.array([size if v is None else v for v in (limits.x_max, limits.y_max, limits.z_max)])
    given: list[str] = []
    for k, axis in enumerate("xyz"):
        for side, values in (("min", low), ("max", high)):
            value = getattr(limits, f"{axis}_{side}")
            if value is None:
                continue
            middle, lengths = 0.5 * (low + high), high - low
            middle[k], lengths[k] = values[k], _SHEET
            scene.box(f"{path}/{axis}_{side}", tuple(lengths.tolist()), placed_at(middle), _WALL)
            given.append(f"{axis} {'>=' if side == 'min' else '<='} {value:g} m")
    if given:
        scene.notes.append(f"Walls: {_words(limits.of)} stays at {', '.join(given)}.")


def draw_sight(scene: Scene, path: str, station: Array, marker: Array) -> None:
    """The line of sight from the tracker's station (3,) to a marker (3,)."""
    scene.rod(path, station, marker, 0.004, (*_STATION[:3], 0.6))


def _words(point: str) -> str:
    return "the " + point.replace("_", " ")
