"""readings.csv: what a file of displacements, of states or of gauges holds, and readings written as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from qsframework.arguments import checked
from qsframework.errors import InputError, Problem
from qsframework.experiment.columns import (
    WRENCH_NAMES,
    XYZ,
    Column,
    force_columns,
    joint_cells,
    number,
    one_of,
    recorded,
    table_lines,
    write_table,
)
from qsframework.experiment.frames import PLANE, POINT
from qsframework.experiment.plan import joint_columns
from qsframework.experiment.readings import Readings
from qsframework.experiment.setup import Experiment
from qsframework.plausible import RANGES
from qsframework.plugin import Array
from qsframework.plugin.facts import frozen

STATES = ("unloaded", "loaded")
HALF_LOAD = "half of "
"""Before the name of a load of which half is hung."""
MOVED, ALONG = ("dx", "dy", "dz"), ("ux", "uy", "uz")
_LARGEST_DISPLACEMENT = 0.1
_FARTHEST = RANGES["m"].most
"""m from the tracker's origin."""


def state_columns(experiment: Experiment) -> list[Column]:
    """What a file of states may hold."""
    return columns_of((), experiment, True)


def displacement_columns(experiment: Experiment) -> list[Column]:
    """What a file of displacements may hold."""
    return columns_of((), experiment, False)


def columns_of(header: Sequence[str], experiment: Experiment, states: bool | None = None) -> list[Column]:
    """What a file with this header may hold; states: of states, else of displacements, as the header says if None.

    With the column of a gauge or of touched points it may be without vectors.
    """
    states = of_states(header) if states is None else states
    bare = any(name.startswith("gauge_") or name == "point" for name in header)
    marker = one_of(experiment.marker_names, "the experiment has no such marker")
    state = one_of(STATES, "no such state", "unloaded or loaded")
    size = _near if states else _elastic
    names = ("load_id", "point" if states else "reference")
    times = ("time",) if states else ("time", "time_unloaded")
    temperatures = ("temperature",) if states else ("temperature", "temperature_unloaded")
    return [
        Column("pose", "text", required=True),
        *joint_columns(experiment),
        *force_columns(required=not states, blank=states),
        Column("marker", "text", required=True, check=marker),
        *([Column("state", "text", required=True, check=state)] if states else []),
        *(Column(d, "number", "m", required=not bare, blank=True, check=size) for d in (XYZ if states else MOVED)),
        Column("gauge", "number", "m", blank=True, check=None if states else _small),
        *(Column(u, "number", blank=True) for u in ALONG),
        Column("to_marker", "text", check=marker),
        *(Column(name, "text") for name in (*names, "series")),
        *(Column(count, "count") for count in ("repeat", "visit", "read", "cycle")),
        Column("sigma", "number", "m", blank=True, check=_positive),
        *(Column(time, "number", "s") for time in times),
        *(Column(temperature, "number", "K") for temperature in temperatures),
        Column("approach", "side"),
        Column("drive_state", "text"),
        Column("use", "flag"),
    ]


def _positive(value: float, name: str) -> Problem | None:
    return None if value > 0.0 else Problem("must be positive", found=f"{value:g} m")


def _near(value: float, name: str) -> Problem | None:
    """What is wrong with a coordinate that no tracker reads."""
    if abs(value) <= _FARTHEST:
        return None
    hint = f"If the column is in mm, call it {name}m." if name.endswith("_m") else None
    return Problem("no tracker reads this far", found=f"{value:g} m", allowed=f"up to {_FARTHEST:g} m", hint=hint)


def _elastic(value: float, name: str) -> Problem | None:
    """What is wrong with a displacement that no load makes."""
    question, hint = "is it a position?", "A displacement is the loaded minus the unloaded position."
    if name.endswith("_m"):
        question, hint = "is the column in mm?", f"Then call it {name}m."
    return _too_large(value, f"a displacement this large is not elastic; {question}", hint)


def _small(value: float, name: str) -> Problem | None:
    """What is wrong with the displacement along a gauge."""
    return _too_large(value, "a gauge moves less under a load; is the column in mm?", "Then call it gauge_mm.")


def _too_large(value: float, message: str, hint: str) -> Problem | None:
    if abs(value) <= _LARGEST_DISPLACEMENT:
        return None
    return Problem(message, found=f"{value:g} m", allowed=f"up to {_LARGEST_DISPLACEMENT} m", hint=hint)


def of_states(header: Sequence[str]) -> bool:
    """Whether a header is that of a file of states."""
    return "state" in header or any(name.startswith(("x_", "y_", "z_")) for name in header)


def holds_readings(path: str | Path) -> bool:
    """Whether a table is of readings and not a plan: its header has a column `marker`."""
    try:
        return "marker" in header_of(Path(path))
    except InputError:  # no text: its reader says what it is
        return False


def header_of(path: Path) -> list[str]:
    """Names of the columns of a table, as the file spells them."""
    lines = (line.strip() for line in table_lines(path))
    header = next((line for line in lines if line and not line.startswith("#")), "")
    return [name.strip() for name in header.split(",")]


@checked
def write_readings(path: str | Path, readings: Readings, experiment: Experiment) -> None:
    """Write a file that `read_readings` reads back to the digits that matter (1e-9 relative).

    Args:
        path: the file.
        readings: the readings.
        experiment: their campaign.

    Raises:
        InputError: where it cannot be written.
    """
    write_table(path, *readings_table(readings, experiment), [f"robot: {experiment.robot.name}"])


def readings_table(readings: Readings, experiment: Experiment) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a readings file: of displacements where all rows are differences, else of states.

    Displacements in a frame that was found are turned to the base: a file has no place for it.

    InputError where rows are of both kinds: these are two files.
    """
    readings = _in_base(readings, experiment)
    if len(set(readings.is_position.tolist())) > 1:
        raise InputError("positions and displacements are two files; write them one by one")
    states = bool(readings.is_position.any())
    table = _state_cells(readings, experiment, states)
    table |= _measured_cells(readings, experiment.marker_names, XYZ if states else MOVED)
    table |= _name_cells(readings, states)
    table["use"] = [str(int(use)) for use in readings.use]
    table |= _recorded_cells(readings, states)
    if readings.stated or len(np.unique(readings.sigma)) > 1:
        table["sigma_mm"] = [number(1e3 * float(np.nanmax(sigma))) for sigma in readings.sigma]
    if readings.drive_state:
        table["drive_state"] = list(readings.drive_state)
    return list(table), [list(row) for row in zip(*table.values(), strict=True)]


Cells = dict[str, list[str]]
"""Cells of columns, a row for each reading, by the columns' names."""


def _state_cells(readings: Readings, experiment: Experiment, of_states: bool) -> Cells:
    """Where the arm stood, under which load, and the marker that was read."""
    states, rows, joints = readings.states, list(map(int, readings.plus)), experiment.robot.controller.units
    angles = [joint_cells(q, joints) for q in states.poses.pendant]
    out = {"pose": [states.pose[s] for s in rows]}
    out |= {name: [angles[s][k] for s in rows] for k, name in enumerate(joints.names())}
    if states.loaded.any() or not of_states:
        wrench = states.poses.wrench[readings.plus].T.tolist()
        out |= {name: [number(v) for v in own] for name, own in zip(WRENCH_NAMES, wrench, strict=True)}
    out["marker"] = [experiment.markers[int(m)].name for m in readings.marker]
    return out | ({"state": [STATES[int(states.loaded[s])] for s in rows]} if of_states else {})


def _measured_cells(readings: Readings, names: Sequence[str], axes: Sequence[str]) -> Cells:
    """Vectors, and what gauges read and where along; of a plate that was touched the normal."""
    along: list[Array | None] = [_normal_of(readings, f) for f in readings.frame.tolist()]
    if readings.axes is not None:
        along = [readings.axes[i, 0] if gauge else along[i] for i, gauge in enumerate(readings.is_gauge.tolist())]
    to = [names[m] if m >= 0 else "" for m in map(int, readings.to)]
    first = [_cell(v) for v in readings.value[:, 0].tolist()]
    out: Cells = {}
    if any(u is None for u in along):
        for a, values in zip(axes, readings.value.T.tolist(), strict=True):
            out[f"{a}_mm"] = [_cell(v) if u is None else "" for v, u in zip(values, along, strict=True)]
    if any(u is not None for u in along):
        out["gauge_mm"] = [v if u is not None else "" for v, u in zip(first, along, strict=True)]
        for k, axis in enumerate(ALONG):
            of_gauge = ["" if u is None else number(float(u[k]), 15) for u in along]
            out[axis] = ["" if other else cell for cell, other in zip(of_gauge, to, strict=True)]
        out["to_marker"] = to
    return out


def _name_cells(readings: Readings, of_states: bool) -> Cells:
    """Names of loads, series, points and unloaded states, where there are some; repeats and cycles."""
    states, rows = readings.states, list(map(int, readings.plus))
    frames = [readings.frames[f] if f >= 0 else "" for f in map(int, readings.frame)]
    named = {
        "load_id": [states.load_id[s] for s in rows],
        "series": [states.series[s] for s in rows] if of_states else frames,  # of gauges too
        "point": [name.partition(":")[2] if name.startswith((POINT, PLANE)) else "" for name in frames],
        "reference": [] if of_states else _named_references(readings),
    }
    counts = {"repeat": states.repeat[rows], "cycle": states.cycle[rows]}
    counted = {name: [str(n) for n in values] for name, values in counts.items()}
    return {name: cells for name, cells in named.items() if any(cells)} | counted


def _named_references(readings: Readings) -> list[str]:
    """Name of the unloaded state behind each row that others share, "" for one of its own."""
    own: dict[int, set[int]] = {}
    for s, m in zip(readings.plus.tolist(), readings.minus.tolist(), strict=True):
        own.setdefault(m, set()).add(s)
    shared = {m for m, loaded in own.items() if m >= 0 and len(loaded) > 1}
    states = readings.states
    return [(states.load_id[m] or f"{states.pose[m]}/{m}") if m in shared else "" for m in readings.minus.tolist()]


def _recorded_cells(readings: Readings, of_states: bool) -> Cells:
    """What was recorded of all the states."""
    c = readings.poses.loaded
    found: dict[str, Array] = {}
    for name, values in (("time_s", c.time), ("temperature_K", c.temperature), ("approach", c.approach)):
        if values is None:
            continue
        found[name] = values[readings.plus]
        if not of_states and name != "approach":
            stem, _, unit = name.partition("_")
            found[f"{stem}_unloaded_{unit}"] = values[readings.minus]
    whole = {name: values for name, values in found.items() if np.isfinite(values).all()}
    return {name: [recorded(v) for v in values.tolist()] for name, values in whole.items()}


def _normal_of(readings: Readings, f: int) -> Array | None:
    """The normal (3,) of the plate that stands for a frame by its place; None for another."""
    known = readings.known[f] if f >= 0 else None
    return known.rotation[0] if known is not None and known.series.startswith(PLANE) else None


def _in_base(readings: Readings, experiment: Experiment) -> Readings:
    """Displacements of series whose frames are known, but not stated by the experiment, in the axes of the base."""
    stated = {f.series for f in experiment.frames}
    value, frame = np.array(readings.value), np.array(readings.frame)
    for f, known in enumerate(readings.known):
        rows = np.flatnonzero((readings.frame == f) & ~readings.is_position)
        if known is None or known.series in stated or not len(rows):
            continue
        measured = np.isfinite(value[rows])
        if (measured.any(axis=1) & ~measured.all(axis=1)).any():
            raise InputError(
                f"{readings.where}: series {known.series!r} is turned to the base, and displacements along some of its "
                "axes only cannot be written in those of the base; state its frame (frames: in the experiment)"
            )
        value[rows] = value[rows] @ known.rotation
        frame[rows] = -1
    return replace(readings, value=frozen(value), frame=frame)


def _cell(value: float) -> str:
    return number(value * 1e3) if np.isfinite(value) else ""


def floor_file(readings: Path) -> Path:
    """The table of the floor's reflectors that belongs to a file of readings."""
    return readings.with_name(f"{readings.stem}_floor.csv")
