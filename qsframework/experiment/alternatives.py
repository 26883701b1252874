"""A campaign on a robot of another structure: what it then simulates and fits, and its readings there."""

from __future__ import annotations

from dataclasses import replace

from qsframework.errors import InputError
from qsframework.experiment.readings import Readings
from qsframework.experiment.setup import Experiment, expand_name
from qsframework.robot import Robot
from qsframework.robot.alternatives import stands


def on_robot(experiment: Experiment, robot: Robot) -> Experiment:
    """The same campaign on another robot, such as one of `alternatives`.

    Effects of the campaign, and entries of `fit`, that this robot cannot have are left out.
    """
    every = (*robot.effects, *experiment.effects)
    names = {e.name for e in robot.effects}
    effects = tuple(e for e in experiment.effects if e.name not in names and stands(e, every, robot.facts))
    own = {p.name for e in effects for p in e.parameters(robot.facts)}
    parameters = tuple(p for p in experiment.parameters if p.name in own)
    other = replace(experiment, robot=robot, effects=effects, parameters=parameters)
    if experiment.fit is None:
        return other
    return other.with_(fit=tuple(entry for entry in experiment.fit if _has(other, entry)))


def _has(experiment: Experiment, entry: str) -> bool:
    try:
        return bool(expand_name(entry, experiment.model()))
    except InputError:
        return False


def as_shown(readings: Readings, experiment: Experiment) -> Readings:
    """Readings at the joint angles that the experiment's controller makes of what the pendant showed."""
    poses = readings.states.poses
    return readings.with_poses(replace(poses, q=experiment.robot.controller.to_joints(poses.pendant)))
