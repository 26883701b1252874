"""What a model is read from, as hashes by part: by them a stored result is known to be of another arm or campaign."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from qsframework.errors import InputError
from qsframework.experiment.setup import Experiment
from qsframework.files import sha256
from qsframework.files.plain import is_list, is_mapping, is_tuple
from qsframework.plugin import Effect, RobotFacts
from qsframework.plugin.entry import effect_entry
from qsframework.plugin.trusted import file_of
from qsframework.robot import Robot

_DIGITS = 9
"""Of lengths in m and masses in kg: the trigonometry of another machine may differ in the last bits."""


def description(robot: Robot, experiment: Experiment | None = None) -> dict[str, str]:
    """Hashes of everything that a model is read from, by part; of the robot alone without an experiment.

    Meshes and limits aside, and the values of parameters, which a fit holds one by one.
    """
    c = robot.controller
    out = {
        "geometry and masses": robot_hash(robot.facts),
        "joint angles (zero, sign, coupling)": _hash([c.matrix, c.offset, c.driven]),
        "effects of the robot": _hash([_described(e) for e in robot.effects]),
    }
    if experiment is not None:
        markers = [(m.name, m.link, m.xyz) for m in sorted(experiment.markers, key=lambda m: m.name)]
        load = experiment.load_uncertainty
        out |= {
            "markers": _hash(markers),
            "load point and the load's uncertainty": _hash([experiment.load_point, load.scale, load.direction]),
            "effects of the experiment": _hash([_described(e) for e in experiment.effects]),
        }
    return out


def changed_parts(then: Mapping[str, str], robot: Robot, experiment: Experiment | None = None) -> Iterator[str]:
    """The parts that are described otherwise now."""
    for part, value in description(robot, experiment).items():
        if then.get(part) != value:
            yield part


def robot_hash(facts: RobotFacts) -> str:
    """SHA-256 of an arm's constants: joints, axes, placements, flange, masses and their centres, gravity; not of
    comments, limits or nominal parameters."""
    placed = facts.sliding, facts.axes, facts.placements, facts.flange_placement
    return _hash([facts.joints, *placed, facts.masses, facts.centres, facts.gravity])


def _described(effect: Effect) -> Any:
    """An effect with its settings, and its code where that is a file."""
    code = file_of(type(effect))
    try:
        settings: Any = effect_entry(effect)
    except InputError:
        settings = repr(effect)
    return [effect.name, settings, None if code is None else sha256(code)]


def _hash(values: Sequence[Any]) -> str:
    return hashlib.sha256(json.dumps(_plain(values), sort_keys=True, default=repr).encode()).hexdigest()


def _plain(value: Any) -> Any:
    """Rounded numbers without negative zeros, in lists."""
    if is_mapping(value):
        return {key: _plain(one) for key, one in value.items()}
    if is_list(value) or is_tuple(value):
        return [_plain(one) for one in value]
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    return round(value, _DIGITS) + 0.0 if isinstance(value, float) else value
