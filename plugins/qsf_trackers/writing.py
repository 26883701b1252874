"""The rows of a table of readings, as our own reader takes them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from qsf_trackers.campaign import Campaign
from qsf_trackers.layout import Sheet
from qsf_trackers.matching import TrackerPoint
from qsf_trackers.sheets import NUMBER
from qsframework import units
from qsframework.experiment import (
    STATES,
    WRENCH_NAMES,
    Experiment,
    displacement_columns,
    joint_cells,
    number,
    state_columns,
)
from qsframework.experiment.columns import recorded
from qsframework.plugin import Array
from qsframework.units import JointUnits

_ZERO_CELSIUS = 273.15


def readings_rows(
    points: Sequence[TrackerPoint], pendant: Array, joints: JointUnits, campaign: Campaign
) -> tuple[list[str], list[list[str]]]:
    """Header and rows: positions in the tracker's frame, one row for each point, in the order of the files."""
    forces = WRENCH_NAMES if any(p.taken.loaded for p in points) else ()
    more = _more(points, campaign)
    header = ["pose", *joints.names(), *forces, "marker", "state", "x_mm", "y_mm", "z_mm", *more]
    rows: list[list[str]] = []
    for i, point in enumerate(points):
        slot = point.taken
        row = [slot.pose, *joint_cells(pendant[i], joints)]
        if forces:
            row += map(number, campaign.loads[slot.pose][slot.load_id].tolist()) if slot.loaded else [""] * 6
        row += [slot.marker, STATES[slot.loaded], *(number(1e3 * v) for v in point.xyz.tolist())]
        rows.append(row + [cells[i] for cells in more.values()])
    return header, rows


def _more(points: Sequence[TrackerPoint], campaign: Campaign) -> dict[str, list[str]]:
    """Columns that not every import has: those that say something."""
    slots = [p.taken for p in points]
    columns = {
        "load_id": [s.load_id for s in slots],
        "series": [p.series for p in points],
        "repeat": [str(s.repeat) for s in slots],
        "cycle": [str(s.cycle) for s in slots],
        "time_s": _measured(points, "time", _seconds(points)),
        "temperature_degC": _measured(points, "temperature", lambda v: number(v - _ZERO_CELSIUS)),
        "sigma_mm": _measured(points, "sigma", lambda v: number(1e3 * v)),
        "drive_state": [(campaign.drive or {}).get(s, "") for s in slots],
    }
    idle = {"repeat": "1", "cycle": "1"}
    return {name: cells for name, cells in columns.items() if any(c != idle.get(name, "") for c in cells)}


def _seconds(points: Sequence[TrackerPoint]) -> Callable[[float], str]:
    """Times of a clock with a date are counted from the first point."""
    dated = [p.listing.numbers["time"][p.row] for p in points if p.listing.clock == "date"]
    first = float(min(dated)) if dated else 0.0
    return lambda v: recorded(round(v - first, 6))


def _measured(points: Sequence[TrackerPoint], role: str, cell: Callable[[float], str]) -> list[str]:
    """Cells of a role; empty for all where a file does not have it, or where a number is missing.

    A state has one time and one temperature, the mean of those of its markers, which are read one after the other.
    """
    values = [float(p.listing.numbers[role][p.row]) if role in p.listing.numbers else np.nan for p in points]
    if not np.isfinite(values).all():
        return [""] * len(points)
    if role == "sigma":
        return [cell(v) for v in values]
    of_state: dict[object, list[float]] = {}
    keys = [(p.series, replace(p.taken, marker="")) for p in points]
    for key, value in zip(keys, values, strict=True):
        of_state.setdefault(key, []).append(value)
    return [cell(own[0] + float(np.mean(np.subtract(own, own[0])))) for own in (of_state[key] for key in keys)]


def own_rows(sheet: Sheet, experiment: Experiment) -> tuple[tuple[str, ...], ...] | None:
    """The rows of one of our own tables with decimal points, words as they are; None of what is none."""
    columns = state_columns(experiment) if "state" in sheet.header else displacement_columns(experiment)
    plain, measured = {c.stem: c for c in columns if not c.unit}, [c.stem for c in columns if c.unit]
    known = all(name in plain or units.split(name, measured) for name in sheet.header)
    if not known or not {"pose", "marker"} <= set(sheet.header):
        return None
    words = [name in plain and plain[name].kind in ("text", "flag") for name in sheet.header]
    comma = sheet.decimal == ","
    return tuple(
        tuple(
            cell.replace(",", ".") if comma and not word and NUMBER.fullmatch(cell) else cell
            for cell, word in zip(row.cells, words, strict=True)
        )
        for row in sheet.rows
    )
