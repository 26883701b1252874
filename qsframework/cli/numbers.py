"""Numbers that are typed as an option's text: `--load 0,0,-1500`."""

from __future__ import annotations

import numpy as np

from qsframework.errors import InputError, Problem
from qsframework.experiment import Experiment
from qsframework.files.models import GREATEST
from qsframework.plausible import RANGES, too_strong
from qsframework.plugin import Array
from qsframework.robot import Robot


def numbers(option: str, text: str, counts: tuple[int, ...], most: float = GREATEST) -> Array:
    """The numbers of an option, with commas between them; InputError unless there are as many as asked, none larger
    than `most`."""
    try:
        if not text.isascii():
            raise ValueError("digits of another script")
        values = np.array([float(part) for part in text.split(",")])
    except ValueError as error:
        raise InputError(f"{option}: found {text!r}, allowed: numbers with commas between them") from error
    if len(values) not in counts or not np.isfinite(values).all():
        allowed = " or ".join(map(str, counts))
        raise InputError(f"{option}: found {len(values)} numbers in {text!r}, allowed: {allowed} finite numbers")
    if np.abs(values).max(initial=0.0) > most:
        raise InputError(f"{option}: found {text!r}, allowed: numbers of up to {most:g}")
    return values


def point_of(option: str, text: str) -> Array:
    """A point (3,) m from an option in mm. InputError where it is none, or none of a robot cell."""
    return numbers(option, text, (3,), 1e3 * RANGES["m"].most) * 1e-3


def wrench_of(option: str, text: str, robot: Robot) -> Array:
    """A wrench (6,) N, N m from an option of three or six numbers. InputError where no test of the robot applies it."""
    given = numbers(option, text, (3, 6), RANGES["N"].most)
    gravity = float(np.linalg.norm(robot.gravity))
    if (far := too_strong(given.tolist(), robot.payload, gravity)) is not None:
        raise InputError(f"{option}: found {far.found}, allowed: {far.allowed} of {robot.name}")
    return np.concatenate([given, np.zeros(6 - len(given))])


def home_pose(experiment: Experiment, text: str, option: str = "--home") -> Array:
    """Pendant angles (n,) rad of an option."""
    robot = experiment.robot
    units = robot.controller.units
    pendant = units.si(numbers(option, text, (robot.controller.axes,)))
    outside = np.flatnonzero(robot.controller.outside(pendant[None])[0])
    if len(outside):
        k = int(outside[0])
        allowed = units[k].between(*robot.controller.range_of(k))
        message = f"{option}: {robot.facts.driven[k]} is outside its limits"
        raise InputError(Problem(message, found=units[k].text(pendant[k]), allowed=allowed))
    return pendant
