"""What filled-in state readings say before any fit: repeatability, closure, linearity, the floor, the drives.

The tracker's frame does not matter: all is said of differences of positions of one marker at one pose.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from qsframework.errors import InputError, refuse
from qsframework.estimation.tails import chi2_sf
from qsframework.experiment import Experiment, Readings, differences, read_readings
from qsframework.experiment.columns import XYZ, Column, read_table
from qsframework.experiment.differences import has_pairs
from qsframework.experiment.finding import Finding
from qsframework.experiment.readings_file import suggested
from qsframework.experiment.readings_table import floor_file
from qsframework.plugin import Array

LEVEL = 1e-3
_PARALLEL = 1e-6
_LEAST_RATIO = 0.9
"""Two sizes of a load closer than this tell nothing of linearity."""
_WORTH = 0.01
"""Shares of the deflection below this are not worth a word of warning, however sure they are."""


@dataclass(frozen=True)
class ClosureCheck:
    """One thing looked at: its kind, whether it is as it should be (None: not measured), what was found, and what to do
    where it is not."""

    kind: str
    good: bool | None
    words: str
    numbers: dict[str, float]
    mend: str = ""

    @property
    def finding(self) -> Finding:
        """The same as a fit keeps it: a note, which stops nothing."""
        return Finding(self.kind.replace(" ", "_"), self.words, self.mend, stops=False)

    @property
    def said(self) -> str:
        """What was found, and what to do."""
        return f"{self.words}. {self.mend}" if self.good is False else self.words


def state_findings(experiment: Experiment, readings: Readings) -> tuple[Finding, ...]:
    """What the states of these readings are not as they should be in; those that were read as differences are read
    again. Nothing where they are no pairs of states."""
    if readings.sources and readings.alignments:
        readings = read_readings(readings.sources, experiment, "positions")
    try:
        checks = check_states(experiment, readings)
    except InputError:  # loaded states without an unloaded one, or in another drive state: they are not differences
        return ()
    return tuple(check.finding for check in checks if check.good is False)


def check_states(experiment: Experiment, states: Readings) -> tuple[ClosureCheck, ...]:
    """All checks of a file of states with loads; one with no loaded state has nothing to check, nor have positions none
    of which was read without its load too.

    InputError where states are read as differences and a loaded row has no unloaded one, or was read in another drive
    state than it.
    """
    if not np.any(states.use & states.is_position & states.states.loaded[states.plus]):
        return ()
    if (experiment.states or suggested(experiment, states)) == "differences":
        differences(states, experiment)
    elif not has_pairs(states):
        return ()
    table = _Positions(states)
    hysteresis = [_hysteresis(table, "first cycle", later=False), _hysteresis(table, "later cycles", later=True)]
    checks = [_repeatability(table), _closure(table), *filter(None, hysteresis), _linearity(table), _drives(states)]
    return (*checks, *([] if states.source is None else [_floor(experiment, floor_file(states.source), table.sigma)]))


_Visit = tuple[str, str, int, int]
"""Pose, series, repeat and cycle."""
_Load = tuple[str, str, int, int, str]
"""The same, and the load."""


class _Positions:
    """Positions by (pose, series, repeat, cycle, load) and marker, in the order of the file; masked rows left out."""

    def __init__(self, readings: Readings) -> None:
        sigma, states = readings.sigma[readings.use], readings.states
        stated = readings.stated or len(np.unique(sigma)) > 1
        self.sigma = float(np.sqrt(np.mean(sigma**2))) if stated else None
        self.unloaded: dict[_Visit, dict[int, Array]] = {}
        self.loaded: dict[_Load, dict[int, Array]] = {}
        self.wrench: dict[_Load, Array] = {}
        for i in np.flatnonzero(readings.use & readings.is_position).tolist():
            m, marker = int(readings.plus[i]), int(readings.marker[i])
            key = (states.pose[m], states.series[m], int(states.repeat[m]), int(states.cycle[m]))
            if states.loaded[m]:
                self.loaded.setdefault((*key, states.load_id[m]), {})[marker] = readings.value[i]
                self.wrench[*key, states.load_id[m]] = states.poses.wrench[m]
            elif not states.load_id[m]:
                self.unloaded.setdefault(key, {})[marker] = readings.value[i]

    def displacements(self) -> Iterable[tuple[_Load, int, Array]]:
        """Displacement of every marker that was read in both states of a cycle."""
        for key, markers in self.loaded.items():
            before = self.unloaded.get(key[:4], {})
            for marker, place in markers.items():
                if marker in before:
                    yield key, marker, place - before[marker]

    def expected(self, variances: float) -> str:
        """The stated noise of a difference that holds so many variances of one position, in words."""
        if self.sigma is None:
            return "no noise is stated"
        return f"the noise alone gives {_mm(np.sqrt(variances) * self.sigma)}"


def _mm(value: float) -> str:
    return f"{value * 1e3:.4f} mm"


def _larger(squares: float, count: int, sigma: float | None, variances: float = 1.0) -> bool:
    """Whether a sum of squares is larger than chance allows, with `count` degrees of freedom of so many variances."""
    return sigma is not None and count > 0 and float(chi2_sf(squares / (variances * sigma**2), count)) < LEVEL


def _spread(values: dict[Any, list[Array]]) -> tuple[float, int]:
    """Sum of squares about the groups' means, and its degrees of freedom."""
    squares, count = 0.0, 0
    for group in values.values():
        stack = np.array(group)
        squares += float(np.sum((stack - stack.mean(axis=0)) ** 2))
        count += 3 * (len(stack) - 1)
    return squares, count


def _repeatability(table: _Positions) -> ClosureCheck:
    """Displacements of the same pose and load: between cycles of a visit, and between visits."""
    cycles: dict[Any, list[Array]] = {}
    for (pose, series, repeat, _, load), marker, d in table.displacements():
        cycles.setdefault((pose, series, load, marker, repeat), []).append(d)
    between: dict[Any, list[Array]] = {}
    for key, group in cycles.items():
        between.setdefault(key[:4], []).append(np.mean(group, axis=0))
    each = int(np.median([len(group) for group in cycles.values()])) if cycles else 1
    within, visits = _spread(cycles), _spread(between)
    if not within[1] and not visits[1]:
        return ClosureCheck("repeatability", None, "no displacement was measured twice; plan 20 % repeats", {})
    good = True
    numbers: dict[str, float] = {}
    parts: list[str] = []
    for name, (squares, count), share in (("cycles of a visit", within, 1.0), ("visits", visits, 1.0 / each)):
        if not count:
            parts.append(f"between {name}: not measured")
            continue
        sd = float(np.sqrt(squares / count))
        numbers[f"sd_mm between {name}"] = sd * 1e3
        parts.append(f"between {name} {_mm(sd)} per axis ({count} degrees of freedom; {table.expected(2.0 * share)})")
        good &= not _larger(squares, count, table.sigma, 2.0 * share)
    mend = "More than the noise: settle longer, check reflectors and mounts, or state a larger noise."
    return ClosureCheck("repeatability", good, "displacements differ " + ", ".join(parts), numbers, mend)


def _returns(table: _Positions) -> list[tuple[tuple[str, str, int, int], int, Array, list[Array]]]:
    """For each unloaded state with one in the cycle after it: how far each marker came back to another place, and the
    displacements of the loads in between."""
    out: list[tuple[_Visit, int, Array, list[Array]]] = []
    for key, before in table.unloaded.items():
        after = table.unloaded.get((*key[:3], key[3] + 1))
        if after is None:
            continue
        loads = [m for k, m in table.loaded.items() if k[:4] == key]
        for marker in before.keys() & after.keys():
            moved = [m[marker] - before[marker] for m in loads if marker in m]
            out.append((key, marker, after[marker] - before[marker], moved))
    return out


def _closure(table: _Positions) -> ClosureCheck:
    """Unloaded after a cycle against unloaded before it."""
    returns = _returns(table)
    if not returns:
        words = "no unloaded state was read after a load; end each visit unloaded, with the number of the next cycle"
        return ClosureCheck("closure", None, words, {})
    shifts = np.array([r[2] for r in returns])
    rms = float(np.sqrt(np.mean(shifts**2)))
    stands: dict[Any, list[Array]] = {}  # about their mean, for neighbouring shifts share a reading
    for key, markers in table.unloaded.items():
        for marker, place in markers.items():
            stands.setdefault((*key[:3], marker), []).append(place)
    worst = int(np.argmax(np.linalg.norm(shifts, axis=1)))
    (pose, _, repeat, cycle), largest = returns[worst][0], float(np.linalg.norm(shifts[worst]))
    good = not _larger(*_spread(stands), table.sigma)
    words = (
        f"after unloading the markers stand {_mm(rms)} per axis (RMS) from where they stood before "
        f"({table.expected(2.0)}); most, {_mm(largest)}, at pose {pose}, repeat {repeat}, cycle {cycle}"
    )
    mend = "More than the noise: the tracker or the base drifts, or friction holds the arm. Wait longer."
    return ClosureCheck("closure", good, words, {"rms_mm": rms * 1e3, "largest_mm": largest * 1e3}, mend)


def _hysteresis(table: _Positions, name: str, later: bool) -> ClosureCheck | None:
    """The part of the deflection that stays after unloading, for the first cycle or the later ones."""
    pairs: list[tuple[float, float]] = []
    for (_, _, _, cycle), _, shift, deflections in _returns(table):
        if (cycle > 1) is later and deflections:
            d = max(deflections, key=lambda m: float(np.linalg.norm(m)))
            length = float(np.linalg.norm(d))
            pairs.append((length, float(shift @ d) / length))
    d, s = np.array(pairs).reshape(-1, 2).T
    if len(d) < 2 or not np.any(d):
        return None
    share = float(s @ d / (d @ d))
    spread = float(np.sum((s - share * d) ** 2) / (len(d) - 1))
    stated = 0.0 if table.sigma is None else 2.0 * table.sigma**2
    sd = float(np.sqrt(max(spread, stated) / (d @ d)))
    good = not (abs(share) > 3.3 * sd and abs(share) > _WORTH)
    words = f"{name}: {100 * share:.2f} ± {100 * sd:.2f} % of the deflection stays after unloading"
    mend = "Preload once more before reading; friction or play that stays is a cause for `qsf diagnose`."
    return ClosureCheck("hysteresis", good, words, {"share": share, "sd": sd}, mend)


def _linearity(table: _Positions) -> ClosureCheck:
    """Two sizes of one load at the same visit: does half the load give half the deflection?"""
    rows: list[tuple[float, float, float, float, float]] = []
    by_visit: dict[Any, list[tuple[Array, Array]]] = {}
    for key, marker, d in table.displacements():
        by_visit.setdefault((*key[:4], marker), []).append((table.wrench[key], d))
    for loads in by_visit.values():
        for pair in combinations(loads, 2):
            (w, d), (v, e) = sorted(pair, key=lambda p: float(np.linalg.norm(p[0])))
            ratio = float(np.linalg.norm(w) / np.linalg.norm(v))
            if ratio > _LEAST_RATIO or np.linalg.norm(w - ratio * v) > _PARALLEL * np.linalg.norm(v):
                continue
            linear = ratio * e
            square = float(linear @ linear)
            # the unloaded state is in both: d - r e = L1 - r L2 - (1 - r) U
            weight = (1.0 + ratio**2 + (1.0 - ratio) ** 2) * square
            rows.append((ratio, float((d - linear) @ linear), square, float(np.sum((d - linear) ** 2)), weight))
    count = len(rows)
    products, total, residuals, weight = map(float, np.array(rows).reshape(-1, 5)[:, 1:].sum(axis=0))
    if not total:
        words = "not measured: no pose was read under two sizes of one load in the same cycle"
        return ClosureCheck("linearity", None, words, {})
    share = products / total
    scatter = max(residuals - share**2 * total, 0.0) / max(3 * count - 1, 1) / total
    stated = 0.0 if table.sigma is None else table.sigma**2 * weight / total**2
    sd = float(np.sqrt(max(scatter, stated)))
    good = not (abs(share) > 3.3 * sd and abs(share) > _WORTH)
    ratio = float(np.mean([row[0] for row in rows]))
    side = "more" if share > 0 else "less"
    words = (
        f"{100 * ratio:.0f} % of a load gives {abs(100 * share):.2f} ± {100 * sd:.2f} % {side} than "
        f"{100 * ratio:.0f} % of the deflection ({count} pairs)"
    )
    mend = "The springs are not linear, or there is play: look with `qsf diagnose` before trusting a linear fit."
    return ClosureCheck("linearity", good, words, {"share": share, "sd": sd, "pairs": float(count)}, mend)


def _drives(states: Readings) -> ClosureCheck:
    """Which drive states were recorded; a difference within one reading has been refused by `differences`."""
    if states.drive_state is None or not any(states.drive_state):
        words = "not recorded; a held brake and a servo give differently: write servo or brake in drive_state"
        return ClosureCheck("drive state", None, words, {})
    used = [d or "not recorded" for d, use in zip(states.drive_state, states.use, strict=True) if use]
    counts = {d: used.count(d) for d in dict.fromkeys(used)}
    good = len(counts) == 1
    words = ", ".join(f"{d}: {n} rows" for d, n in counts.items())
    mend = "Readings in different drive states are of different arms: fit them apart."
    return ClosureCheck("drive state", good, words, {d: float(n) for d, n in counts.items()}, mend)


def _floor(experiment: Experiment, path: Path, sigma: float | None) -> ClosureCheck:
    """The reflectors on the floor against where they were first read."""
    if not path.is_file():
        words = f"no {path.name} beside the readings, with the reflectors on the floor"
        return ClosureCheck("floor", None, words, {})
    columns = [
        Column("visit", "count", required=True),
        Column("pose", "text"),
        Column("repeat", "count"),
        Column("reflector", "text", required=True),
        Column("time", "number", "s", blank=True),
        *(Column(c, "number", "m", required=True, blank=True) for c in XYZ),
    ]
    table = read_table(path, columns, experiment.robot.name)
    refuse(table.problems)
    place = table.columns(XYZ)
    shifts: list[tuple[Array, str]] = []
    by_reflector: dict[str, list[Array]] = {}
    for name, visit, p in zip(table.texts["reflector"], table.numbers["visit"], place, strict=True):
        if np.isfinite(p).all():
            places = by_reflector.setdefault(name, [])
            shifts += [(p - places[0], f"{name}, visit {visit:.0f}")] if places else []
            places.append(p)
    if not shifts:
        return ClosureCheck("floor", None, "no reflector on the floor was read twice", {})
    rms = float(np.sqrt(np.mean([np.square(shift) for shift, _ in shifts])))
    largest, where = max(((float(np.linalg.norm(shift)), name) for shift, name in shifts), key=lambda s: s[0])
    good = not _larger(*_spread(by_reflector), sigma)
    words = f"reflectors on the floor moved by {_mm(rms)} per axis (RMS), most {_mm(largest)}: {where}"
    mend = "More than the noise: the tracker or its stand moved; start a new series there."
    return ClosureCheck("floor", good, words, {"rms_mm": rms * 1e3, "largest_mm": largest * 1e3}, mend)
