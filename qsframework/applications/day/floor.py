"""Reflectors on the floor: where they are at the start of every visit tells whether the tracker still stands.

They are read beside the plan and stored in a table of their own; nothing is fitted to them.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from qsframework.applications.day.day import Day
from qsframework.applications.day.judge import LEVEL
from qsframework.applications.protocol import floor_file
from qsframework.errors import InputError, Problem
from qsframework.estimation.tails import chi2_isf
from qsframework.experiment.frames import procrustes
from qsframework.files import append_text
from qsframework.plugin import Array

_HEADER = ["visit", "pose", "repeat", "reflector", "x_mm", "y_mm", "z_mm", "series"]
_WANDER = 3e-5
"""m: what a reflector on a floor may drift beside the noise."""


@dataclass(frozen=True)
class FloorJudged:
    """What the floor says. kind: "first", "still", "tracker" where all moved as one, "reflector" where one did alone;
    off: the largest motion, m; reflector: which one"""

    kind: str
    off: float
    reflector: str = ""


def enter_floor(day: Day, readings: Mapping[str, Array]) -> FloorJudged:
    """Store positions (3,) m of floor reflectors in the tracker's present frame, and compare them with the first ones.

    InputError where one is no position, or cannot be stored.
    """
    bad = [n for n, xyz in readings.items() if np.shape(xyz) != (3,) or not np.isfinite(xyz).all()]
    if bad or not readings:
        raise InputError(Problem(f"no position of {', '.join(bad) or 'a reflector'}", allowed="x, y, z in mm"))
    path = floor_file(day.record.table)
    first = _first(path, day.record.series)
    _store(path, day, readings)
    names = [n for n in readings if n in first]
    if not names:
        return FloorJudged("first", 0.0)
    was, now = (np.array([of[n] for n in names]) for of in (first, readings))
    moved = np.linalg.norm(now - was, axis=1)
    sd = float(np.sqrt(2.0) * np.hypot(day.expected.sigma, _WANDER))
    limit = sd * _quantile(len(names))
    worst = int(np.argmax(moved))
    if moved[worst] <= limit:
        return FloorJudged("still", float(moved[worst]))
    if len(names) < 3 or np.linalg.norm(procrustes(was, now).apply(was) - now, axis=1).max() <= limit:
        alone = len(names) >= 2 and (moved > limit).sum() == 1
        return FloorJudged("reflector" if alone else "tracker", float(moved[worst]), names[worst] if alone else "")
    return FloorJudged("reflector", float(moved[worst]), names[worst])


def _quantile(count: int) -> float:
    """sds that the worst of some vectors exceeds with the chance LEVEL."""
    return float(np.sqrt(chi2_isf(LEVEL / count, 3)))


def _first(path: Path, series: str) -> dict[str, Array]:
    """The first reading of each reflector in a series."""
    out: dict[str, Array] = {}
    if path.is_file():
        with path.open(encoding="utf-8", newline="") as file:
            rows = csv.DictReader(line for line in file if not line.startswith("#"))
            for row in rows:
                try:
                    xyz = 1e-3 * np.array([float(row[f"{a}_mm"]) for a in "xyz"])
                except (KeyError, TypeError, ValueError):  # half a line, or edited by hand
                    continue
                if row.get("series", "") == series:
                    out.setdefault(str(row["reflector"]), xyz)
    return out


def _store(path: Path, day: Day, readings: Mapping[str, Array]) -> None:
    slot = day.next
    visit = day.record.protocol.visits[-1 if slot is None else slot.visit]
    rows = [] if path.is_file() else [f"# robot: {day.record.robot}", ",".join(_HEADER)]
    for name, xyz in readings.items():
        mm = (f"{1e3 * v:.4f}" for v in xyz.tolist())
        rows.append(",".join([str(visit.number), visit.pose, str(visit.repeat), name, *mm, day.record.series]))
    try:
        append_text(path, "\n".join(rows) + "\n")
    except OSError as error:
        raise InputError(Problem(f"the floor is not stored: {error.strerror}", str(path))) from error
