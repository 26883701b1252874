"""Reflectors on the floor: where they are at the start of every visit tells whether the tracker still stands.

They are read beside the plan; nothing is fitted to them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from qsframework.applications.day.day import Day, store_floor
from qsframework.applications.day.judge import LEVEL
from qsframework.applications.day.record import Slot
from qsframework.errors import InputError, Problem
from qsframework.estimation.tails import chi2_isf
from qsframework.experiment.frames import procrustes
from qsframework.plugin import Array

_WANDER = 3e-5
"""m: what a reflector on a floor may drift beside the noise."""


@dataclass(frozen=True)
class FloorJudged:
    """What the floor says. kind: "first", "still", "tracker" where all moved as one, "reflector" where one did alone;
    off: the largest motion, m; reflector: which one"""

    kind: str
    off: float
    reflector: str = ""


def enter_floor(day: Day, readings: Mapping[str, Array], slot: Slot | None = None) -> tuple[Day, FloorJudged]:
    """The day with positions (3,) m of floor reflectors in the tracker's present frame, at the visit of `slot`, and how
    they compare with the first ones.

    InputError where one is no position, or cannot be stored.
    """
    bad = [n for n, xyz in readings.items() if np.shape(xyz) != (3,) or not np.isfinite(xyz).all()]
    if bad or not readings:
        raise InputError(Problem(f"no position of {', '.join(bad) or 'a reflector'}", allowed="x, y, z in mm"))
    day = store_floor(day, slot, readings)
    first: dict[str, Array] = {}
    for floor in (f for f in day.record.floor[:-1] if f["series"] == day.record.series):
        first = {name: np.array(xyz) for name, xyz in floor["xyz_m"].items()} | first
    names = [n for n in readings if n in first]
    if not names:
        return day, FloorJudged("first", 0.0)
    was, now = (np.array([of[n] for n in names]) for of in (first, readings))
    moved = np.linalg.norm(now - was, axis=1)
    sd = float(np.sqrt(2.0) * np.hypot(day.expected.sigma, _WANDER))
    limit = sd * _quantile(len(names))
    worst = int(np.argmax(moved))
    if moved[worst] <= limit:
        return day, FloorJudged("still", float(moved[worst]))
    if len(names) < 3 or np.linalg.norm(procrustes(was, now).apply(was) - now, axis=1).max() <= limit:
        alone = len(names) >= 2 and (moved > limit).sum() == 1
        return day, FloorJudged("reflector" if alone else "tracker", float(moved[worst]), names[worst] if alone else "")
    return day, FloorJudged("reflector", float(moved[worst]), names[worst])


def _quantile(count: int) -> float:
    """sds that the worst of some vectors exceeds with the chance LEVEL."""
    return float(np.sqrt(chi2_isf(LEVEL / count, 3)))
