"""An arm with three reflectors around its tool, as the text of an experiment; random poses, and readings of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from qsframework.elastostatics.model import Model
from qsframework.experiment import Experiment, Readings, States
from qsframework.experiment.readings import UNSTATED
from qsframework.plugin import Array, Conditions, Indices, Poses
from qsframework.plugin.facts import frozen
from qsframework.screening import LEVEL, Mistake, find_mistakes, masked


def arm_text(sigma: str, more: str = "", robot: str = "fanuc_m900ib", point: str = "150, 0, 200") -> str:
    """experiment.yaml; sigma in mm, the load point in mm, more: further lines."""
    return f"""
robot: {robot}
load: {{point_mm: [{point}]}}
markers:
  m1: {{xyz_mm: [150, 250, 250]}}
  m2: {{xyz_mm: [400, -150, 150]}}
  m3: {{xyz_mm: [150, -150, -250]}}
noise: {{sigma_mm: {sigma}}}
{more}"""


def random_poses(m900ib: Experiment, load: int, count: int, seed: int = 0) -> Poses:
    """Poses of the paper's robot, all under one of its loads."""
    rng = np.random.default_rng(seed)
    pendant = np.deg2rad(rng.uniform([-170, -50, -60, -150, 30, -150], [170, 80, 20, 150, 100, 150], (count, 6)))
    wrench = np.tile(m900ib.loads[load].wrench, (count, 1))
    return Poses(pendant, m900ib.robot.controller.to_joints(pendant), wrench)


def settled(model: Model, poses: Poses, loaded: npt.NDArray[np.bool_], x: Array | None = None) -> Array:
    """Positions (N, K, 3) m of the markers where the arm settles in each state, loaded (N,) or not."""
    out = np.empty((len(poses), len(model.markers), 3))
    for flag in (False, True):
        at = np.flatnonzero(loaded == flag)
        if len(at):
            out[at] = model.positions(poses.take(at), x, flag)
    return out


def position_readings(
    poses: Poses,
    loaded: npt.NDArray[np.bool_],
    value: Array,
    sigma: float | None,
    *,
    pose: Sequence[str] | None = None,
    series: Sequence[str] | None = None,
    load_id: Sequence[str] | None = None,
) -> Readings:
    """Absolute positions (N, K, 3) m of every marker in N states; sigma None: not stated. Lines start at 2."""
    count, markers = int(value.shape[0]), int(value.shape[1])
    series = ("",) * count if series is None else tuple(series)
    frames = tuple(dict.fromkeys(series))
    ones, rows = np.ones(count, dtype=np.intp), count * markers
    own = Poses(poses.pendant, poses.q, np.where(loaded[:, None], poses.wrench, 0.0), Conditions(), Conditions())
    states = States(
        poses=own,
        loaded=loaded,
        pose=tuple(pose) if pose else tuple(str(i) for i in range(count)),
        load_id=tuple(load_id) if load_id else ("",) * count,
        series=series,
        repeat=ones,
        cycle=ones,
    )
    plus = np.repeat(np.arange(count), markers)
    return Readings(
        states=states,
        plus=plus,
        minus=np.full(rows, -1),
        marker=np.tile(np.arange(markers), count),
        frame=np.array([frames.index(series[s]) for s in plus.tolist()]),
        frames=frames,
        known=(None,) * len(frames),
        value=frozen(value.reshape(-1, 3)),
        sigma=frozen(np.full((rows, 3), UNSTATED if sigma is None else sigma)),
        minus_sigma=frozen(np.full((rows, 3), np.nan)),
        stated=sigma is not None,
        use=np.ones(rows, dtype=bool),
        line=np.arange(2, 2 + rows),
        file=np.zeros(rows, dtype=np.intp),
        to=np.full(rows, -1),
    )


def with_sigma(readings: Readings, sigma: float | Array | None) -> Readings:
    """The same readings with another sigma, a number or (R,); None: not stated."""
    given = np.broadcast_to(np.atleast_1d(UNSTATED if sigma is None else sigma), (len(readings),))
    return replace(readings, sigma=frozen(np.repeat(given[:, None], 3, axis=1)), stated=sigma is not None)


def shared_unloaded(readings: Readings, number: Sequence[int] | Indices) -> Readings:
    """Displacements of N visits, each of them against the unloaded state of this number (N,)."""
    count = len(readings.states) // 2
    first = {int(k): v for v, k in reversed(list(enumerate(number)))}
    return replace(readings, minus=np.array([count + first[int(number[v])] for v in readings.plus]))


def spoilt(readings: Readings, rows: Sequence[int] | Indices, change: Array) -> Readings:
    """Values of some rows changed by so much, m."""
    value = np.array(readings.value)
    value[rows] += change
    return readings.with_values(value)


def copied(readings: Readings, to: Sequence[int], source: Sequence[int]) -> Readings:
    """Values of some rows put into others."""
    value = np.array(readings.value)
    value[to] = value[source]
    return readings.with_values(value)


def wrong_in(experiment: Experiment, readings: Readings, level: float = LEVEL) -> tuple[Mistake, ...]:
    """What is wrong beyond doubt, and rows that should not be used as they stand: what `qsf check` names."""
    found = find_mistakes(experiment, readings, level=level)
    return tuple(c for c in found if c.compelling or c.mask is not None)


def without(readings: Readings, found: Sequence[Mistake]) -> Readings:
    """The readings without the rows that should not be used as they stand."""
    return masked(readings, [c.mask for c in found])
