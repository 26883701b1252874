"""readings.csv: displacements of markers, one row per pose, repeat, cycle and marker."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from qsframework.errors import InputError, Problem
from qsframework.experiment.columns import (
    MOST_PROBLEMS,
    Column,
    Table,
    degrees,
    number,
    read_table,
    recorded,
    write_table,
)
from qsframework.experiment.grouping import at, counts, group, marker_index, no_load, read_sigma
from qsframework.experiment.plan import limit_problems
from qsframework.experiment.setup import Experiment
from qsframework.plugin import Array, Conditions, Indices, Poses
from qsframework.plugin.facts import frozen

_LARGEST_DISPLACEMENT = 0.1
_RECORDED = ("time", "time_unloaded", "temperature", "temperature_unloaded", "approach")


@dataclass(frozen=True, eq=False)
class Readings:
    """R rows over N measurements; a measurement is one pose, repeat and cycle with its markers.

    poses: the N measurements; pose, repeat, cycle: their names; measurement, marker (R,): indices;
    displacement (R, 3) m, loaded minus unloaded, base frame; sigma (R,) m, NaN where not stated;
    use (R,) False where a row is masked; rows (R,) line numbers in `source`, which is None for a simulation;
    reference (R,): name of the unloaded reading behind each row, "" for one of its own: rows of one marker and
    reference share its error; None where no row says so
    reference_share (R,): part of a displacement's variance that is the unloaded reading's; None where nobody says
    """

    poses: Poses
    pose: tuple[str, ...]
    repeat: Indices
    cycle: Indices
    measurement: Indices
    marker: Indices
    displacement: Array
    sigma: Array
    use: npt.NDArray[np.bool_]
    rows: Indices
    drive_state: tuple[str, ...] | None
    source: Path | None
    reference: tuple[str, ...] | None = None
    reference_share: Array | None = None


def _columns(experiment: Experiment) -> list[Column]:
    return [
        Column("pose", "text", required=True),
        *(Column(f"q{k + 1}", "number", "rad", required=True) for k in range(experiment.robot.facts.n)),
        *(Column(f, "number", "N", required=True) for f in ("fx", "fy", "fz")),
        *(Column(m, "number", "N m") for m in ("mx", "my", "mz")),
        Column("marker", "text", required=True),
        *(Column(d, "number", "m", required=True) for d in ("dx", "dy", "dz")),
        Column("repeat", "count"), Column("cycle", "count"),
        Column("sigma", "number", "m", blank=True),
        Column("time", "number", "s"), Column("time_unloaded", "number", "s"),
        Column("temperature", "number", "K"), Column("temperature_unloaded", "number", "K"),
        Column("approach", "side"), Column("drive_state", "text"), Column("use", "flag"),
        Column("reference", "text"),
    ]  # fmt: skip


def read_readings(path: str | Path, experiment: Experiment) -> Readings:
    """Read and check a readings file. InputError with all its problems, each with row and column."""
    table = read_table(path, _columns(experiment), experiment.robot.name)
    no_load(table, experiment)
    count = len(table.rows)
    n = experiment.robot.facts.n
    pendant = np.stack([table.numbers[f"q{k + 1}"] for k in range(n)], axis=1)
    zero = np.zeros(count)
    wrench = np.stack([table.numbers.get(c, zero) for c in ("fx", "fy", "fz", "mx", "my", "mz")], axis=1)
    displacement = np.stack([table.numbers[c] for c in ("dx", "dy", "dz")], axis=1)
    problems = list(table.problems)
    problems += limit_problems(table, pendant, experiment)
    use = table.numbers.get("use", np.ones(count)) != 0
    problems += _displacement_problems(table, np.where(use[:, None], displacement, 0.0))
    marker = marker_index(table, experiment, problems)
    sigma = read_sigma(table, use, problems)
    keys = list(zip(table.texts["pose"], counts(table, "repeat"), counts(table, "cycle"), strict=True))
    labels = [f"pose {pose!r}, repeat {repeat}, cycle {cycle}" for pose, repeat, cycle in keys]
    recorded = [table.numbers[c][:, None] for c in _RECORDED if c in table.numbers]
    constant = np.hstack([pendant, wrench, *recorded])
    first, measurement = group(table, keys, labels, marker, constant, problems)
    if not problems and not np.any(wrench):
        problems.append(Problem("every force is zero; a displacement under no load tells nothing", str(table.path)))
    problems += _unloaded_problems(table, wrench, use) if not problems else []
    if problems:
        raise InputError(problems)
    poses = Poses(
        frozen(pendant[first]), frozen(experiment.robot.controller.to_joints(pendant[first])), frozen(wrench[first]),
        _conditions(table, "_unloaded", first), _conditions(table, "", first),
    )  # fmt: skip
    names = [keys[int(i)] for i in first]
    return Readings(
        poses, tuple(k[0] for k in names), np.array([k[1] for k in names]), np.array([k[2] for k in names]),
        measurement, marker, frozen(displacement), frozen(sigma),
        use, np.array(table.rows),
        tuple(table.texts["drive_state"]) if "drive_state" in table.texts else None, table.path,
        tuple(table.texts["reference"]) if "reference" in table.texts else None,
    )  # fmt: skip


def _unloaded_problems(table: Table, wrench: Array, use: npt.NDArray[np.bool_]) -> list[Problem]:
    """Rows in use that have no load: a displacement from nothing."""
    hint = "Give the row its load, or mask it with use = 0."
    return [
        at(table, int(i), "fx", "no force and no moment: a displacement under no load tells nothing", hint=hint)
        for i in np.flatnonzero(use & ~np.any(wrench, axis=1))[:MOST_PROBLEMS]
    ]


def _displacement_problems(table: Table, displacement: Array) -> list[Problem]:
    out: list[Problem] = []
    for i, k in np.argwhere(np.abs(displacement) > _LARGEST_DISPLACEMENT)[:MOST_PROBLEMS]:
        stem = ("dx", "dy", "dz")[int(k)]
        name = table.names[stem]
        if name == f"{stem}_m":
            question, hint = "is the column in mm?", f"Then call it {stem}_mm."
        else:
            question, hint = "is it a position?", "A displacement is the loaded minus the unloaded position."
        message = f"a displacement this large is not elastic; {question}"
        found, allowed = f"{displacement[i, k]:g} m", f"up to {_LARGEST_DISPLACEMENT} m"
        out.append(Problem(message, str(table.path), table.rows[int(i)], name, found, allowed, hint))
    return out


def _conditions(table: Table, suffix: str, first: Indices) -> Conditions:
    def get(stem: str) -> Array | None:
        values = table.numbers.get(stem)
        return None if values is None else frozen(values[first])

    return Conditions(get(f"time{suffix}"), get(f"temperature{suffix}"), get("approach"))


def write_readings(path: str | Path, readings: Readings, experiment: Experiment) -> None:
    """Write a readings file that `read_readings` reads back to the digits that matter (1e-9 relative)."""
    write_table(path, *readings_table(readings, experiment), [f"robot: {experiment.robot.name}"])


def readings_table(readings: Readings, experiment: Experiment) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a readings file."""
    poses = readings.poses
    n = poses.q.shape[1]
    header = ["pose", *(f"q{k + 1}_deg" for k in range(n)), "fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"]
    columns = [[*degrees(q), *map(number, w)] for q, w in zip(poses.pendant, poses.wrench.tolist(), strict=True)]
    conditions = {
        "time_s": poses.loaded.time, "time_unloaded_s": poses.unloaded.time,
        "temperature_K": poses.loaded.temperature, "temperature_unloaded_K": poses.unloaded.temperature,
        "approach": poses.loaded.approach,
    }  # fmt: skip
    present = {name: values.tolist() for name, values in conditions.items() if values is not None}
    stated = bool(np.isfinite(readings.sigma).any())
    states, reference = readings.drive_state, readings.reference
    header += ["marker", "dx_mm", "dy_mm", "dz_mm", "repeat", "cycle", "use", *present]
    header += (["sigma_mm"] if stated else []) + (["drive_state"] if states else [])
    header += ["reference"] if reference else []
    rows: list[list[str]] = []
    for i, m in enumerate(int(m) for m in readings.measurement):
        row = [readings.pose[m], *columns[m]]
        row += [
            experiment.markers[int(readings.marker[i])].name,
            *map(number, (readings.displacement[i] * 1e3).tolist()),
        ]
        row += [str(readings.repeat[m]), str(readings.cycle[m]), str(int(readings.use[i]))]
        row += [recorded(values[m]) for values in present.values()]
        row += [number(float(readings.sigma[i] * 1e3)) if np.isfinite(readings.sigma[i]) else ""] if stated else []
        rows.append(row + ([states[i]] if states else []) + ([reference[i]] if reference else []))
    return header, rows
