"""Figure 6 and section 5.3 of the source paper: where the wrist may be, and which wrist angles tell the most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np
import paper_table5 as table5

from qsframework.plans import CRITERIA
from qsframework.plans.candidates import reference_point
from qsframework.plugin import Array, Poses

Z_MIN, AXIS_1_MIN = 0.5, 1.0
"""The paper's limits of its experiment, m."""
FLAT = 15.0
"""Least angle of the shipped robot's parallelogram, deg."""
RULE = ((-135.0, -45.0, 45.0, 135.0), (-30.0, 30.0), (-135.0, -45.0, 45.0, 135.0))
"""q4, q5 and q6 that occur in Table 5, deg: joints 4 and 6 half way between the axes, joint 5 by 30 to either side."""


def wrist_centre(q2: Array, q3: Array) -> tuple[Array, Array]:
    """Distance from axis 1 and height, m, of the M-900iB's wrist centre at elevations of link 2 and forearm, rad."""
    x = 0.41 + 1.12 * np.cos(q2) + 1.285 * np.cos(q3) - 0.25 * np.sin(q3)
    z = 0.94 + 1.12 * np.sin(q2) + 1.285 * np.sin(q3) + 0.25 * np.cos(q3)
    return x, z


@dataclass(frozen=True)
class RowLimits:
    """A row of Table 5: height of the wrist centre and its distance from axis 1, m; angle of the parallelogram, deg."""

    height: float
    distance: float
    flat: float


def row_limits(pendant_deg: Array) -> list[RowLimits]:
    """What the limits say of poses (n, 6), from the model's own kinematics."""
    experiment = table5.vertical()
    pendant = np.deg2rad(pendant_deg)
    q = experiment.robot.controller.to_joints(pendant)
    model = experiment.model()
    at = reference_point(experiment, model, q)
    flat = FLAT + np.rad2deg(model.transmission_margin(Poses(pendant, q, np.zeros((len(q), 6)))))
    return [RowLimits(float(p[2]), float(np.hypot(*p[:2])), float(f)) for p, f in zip(at, flat, strict=True)]


@dataclass(frozen=True, eq=False)
class Wrist:
    """Poses (n, 6), pendant deg, and D of the compliances of joints 2 to 6 as shares of nominal."""

    pendant_deg: Array
    d: float


def best_wrist(pendant_deg: Array, choices: Sequence[Sequence[float]], rounds: int = 20) -> Wrist:
    """The least D with these arms and any of the wrist angles: row by row exchange, begun at each row's best trace."""
    wrists = np.array(list(product(*choices)))
    tried = np.repeat(pendant_deg[:, None, :], len(wrists), axis=1)
    tried[:, :, 3:] = wrists
    each = _information(tried.reshape(-1, 6)).reshape(len(pendant_deg), len(wrists), 5, 5)
    chosen = np.trace(each, axis1=2, axis2=3).argmax(axis=1)
    rows = np.arange(len(pendant_deg))
    total = each[rows, chosen].sum(axis=0)
    for _ in range(rounds):
        before = chosen.copy()
        for i in rows:
            rest = total - each[i, chosen[i]]
            chosen[i] = CRITERIA["D"].value(rest + each[i]).argmin()
            total = rest + each[i, chosen[i]]
        if np.array_equal(before, chosen):
            break
    return Wrist(tried[rows, chosen], float(CRITERIA["D"].value(total)))


def _information(pendant_deg: Array) -> Array:
    """`table5.each_information`, some thousand poses at a time."""
    parts = [table5.each_information(pendant_deg[k : k + 4096]) for k in range(0, len(pendant_deg), 4096)]
    return np.concatenate(parts)


@cache
def by_the_rule() -> Wrist:
    """Table 5's arms, the wrist at the best of the angles that occur in it."""
    return best_wrist(table5.table_5(), RULE)


@cache
def free(step: float = 15.0) -> Wrist:
    """Table 5's arms, the wrist anywhere on a grid inside joint 5's limits."""
    turn = tuple(np.arange(-180.0, 180.0, step))
    return best_wrist(table5.table_5(), (turn, tuple(np.arange(-120.0, 120.1, step)), turn))
