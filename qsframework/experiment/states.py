"""State readings: where markers are in one state, unloaded or loaded, one row per state and marker."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from qsframework.elastostatics import make_model
from qsframework.errors import InputError, Problem, nearest
from qsframework.experiment.columns import (
    MOST_PROBLEMS,
    Column,
    Table,
    degrees,
    number,
    read_table,
    recorded,
    table_lines,
    write_table,
)
from qsframework.experiment.grouping import at, counts, group, marker_index, no_load, read_sigma
from qsframework.experiment.plan import limit_problems
from qsframework.experiment.setup import Experiment
from qsframework.plugin import Array, Conditions, Indices, Poses
from qsframework.plugin.facts import frozen

STATES = ("unloaded", "loaded")
_FORCE, _MOMENT, _XYZ = ("fx", "fy", "fz"), ("mx", "my", "mz"), ("x", "y", "z")
_RECORDED = ("time", "temperature", "approach")
_FARTHEST = 100.0
"""m from the tracker's origin."""
_UNIT_SLIP = 100.0
"""Measured positions spread this many times wider or narrower than the arm's own are in a wrong unit."""


@dataclass(frozen=True, eq=False)
class StateReadings:
    """R rows over N measured states; a state is one pose, load, repeat, cycle and series with its markers.

    poses: the N states, the conditions of each both in `unloaded` and in `loaded`; loaded (N,): whether
    the wrench acts, which is 0 where it does not; pose, load_id, series: names, "" where not given;
    measurement, marker (R,): indices; position (R, 3) m in the frame of the row's series, which no file
    knows; sigma (R,) m, NaN where not stated; use (R,) False where a row is masked; rows (R,) line
    numbers in `source`. An unloaded state without a load_id is the reference of every load on its pose.
    """

    poses: Poses
    loaded: npt.NDArray[np.bool_]
    pose: tuple[str, ...]
    load_id: tuple[str, ...]
    series: tuple[str, ...]
    repeat: Indices
    cycle: Indices
    measurement: Indices
    marker: Indices
    position: Array
    sigma: Array
    use: npt.NDArray[np.bool_]
    rows: Indices
    drive_state: tuple[str, ...] | None
    source: Path | None


def _columns(experiment: Experiment) -> list[Column]:
    return [
        Column("pose", "text", required=True),
        *(Column(f"q{k + 1}", "number", "rad", required=True) for k in range(experiment.robot.facts.n)),
        *(Column(f, "number", "N", blank=True) for f in _FORCE),
        *(Column(m, "number", "N m", blank=True) for m in _MOMENT),
        Column("marker", "text", required=True), Column("state", "text", required=True),
        *(Column(d, "number", "m", required=True) for d in _XYZ),
        Column("load_id", "text"), Column("series", "text"),
        Column("repeat", "count"), Column("cycle", "count"),
        Column("sigma", "number", "m", blank=True),
        Column("time", "number", "s"), Column("temperature", "number", "K"), Column("approach", "side"),
        Column("drive_state", "text"), Column("use", "flag"),
    ]  # fmt: skip


def is_states(path: str | Path) -> bool:
    """Whether a file holds state readings: its header has a column `state` or a position."""
    lines = (line.strip() for line in table_lines(Path(path)))
    header = next((line for line in lines if line and not line.startswith("#")), "")
    names = [name.strip() for name in header.split(",")]
    return "state" in names or any(name.startswith(("x_", "y_", "z_")) for name in names)


def read_states(path: str | Path, experiment: Experiment) -> StateReadings:
    """Read and check a file of state readings. InputError with all its problems, each with row and column."""
    table = read_table(path, _columns(experiment), experiment.robot.name)
    count = len(table.rows)
    pendant = np.stack([table.numbers[f"q{k + 1}"] for k in range(experiment.robot.facts.n)], axis=1)
    position = np.stack([table.numbers[c] for c in _XYZ], axis=1)
    problems = [*table.problems, *limit_problems(table, pendant, experiment)]
    use = table.numbers.get("use", np.ones(count)) != 0
    loaded, wrench = _loads(table, problems)
    if loaded.any():
        no_load(table, experiment)
    problems += _position_problems(table, np.where(use[:, None], position, 0.0))
    marker = marker_index(table, experiment, problems)
    sigma = read_sigma(table, use, problems)
    texts = [table.texts.get(c, [""] * count) for c in ("load_id", "series")]
    keys = list(zip(table.texts["pose"], *texts, counts(table, "repeat"), counts(table, "cycle"), loaded.tolist(),
                    strict=True))  # fmt: skip
    recorded = [table.numbers[c][:, None] for c in _RECORDED if c in table.numbers]
    constant = np.hstack([pendant, wrench, *recorded])
    first, measurement = group(table, keys, _labels(keys), marker, constant, problems)
    if problems:
        raise InputError(problems)
    names = [keys[int(i)] for i in first]
    conditions = Conditions(*(frozen(table.numbers[c][first]) if c in table.numbers else None for c in _RECORDED))
    joints = experiment.robot.controller.to_joints(pendant[first])
    poses = Poses(frozen(pendant[first]), frozen(joints), frozen(wrench[first]), conditions, conditions)
    series = tuple(k[2] for k in names)
    _check_units(table, experiment, poses, series, measurement, marker, np.where(use[:, None], position, np.nan))
    return StateReadings(
        poses, loaded[first], tuple(k[0] for k in names), tuple(k[1] for k in names), series,
        np.array([k[3] for k in names]), np.array([k[4] for k in names]), measurement, marker,
        frozen(position), frozen(sigma), use, np.array(table.rows),
        tuple(table.texts["drive_state"]) if "drive_state" in table.texts else None, table.path,
    )  # fmt: skip


def _labels(keys: list[tuple[str, str, str, int, int, bool]]) -> list[str]:
    out: list[str] = []
    for pose, load, series, repeat, cycle, loaded in keys:
        more = (f", load {load!r}" if load else "") + (f", series {series!r}" if series else "")
        out.append(f"pose {pose!r}, {STATES[loaded]}{more}, repeat {repeat}, cycle {cycle}")
    return out


def _loads(table: Table, problems: list[Problem]) -> tuple[npt.NDArray[np.bool_], Array]:
    """Whether each row is loaded, and its wrench (R, 6): only a loaded state has one."""
    for i, state in enumerate(table.texts["state"]):
        if state and state not in STATES and len(problems) <= MOST_PROBLEMS:
            hint = nearest(state, STATES)
            problems.append(at(table, i, "state", "no such state", repr(state), "unloaded or loaded", hint))
    loaded = np.array([state == "loaded" for state in table.texts["state"]])
    missing = [f for f in _FORCE if f not in table.numbers]
    if missing and (loaded.any() or len(missing) < 3):
        problems.append(Problem("a loaded state needs its force", str(table.path), column=f"{missing[0]}_N",
                                allowed="the columns fx_N, fy_N, fz_N"))  # fmt: skip
    stems = [*_FORCE, *_MOMENT]
    wrench = np.stack([table.numbers.get(c, np.zeros(len(loaded))) for c in stems], axis=1)
    unclear = {(p.line, p.column) for p in table.problems}
    for i, k in np.argwhere(np.isnan(wrench) & loaded[:, None])[:MOST_PROBLEMS]:
        stem = stems[int(k)]
        if (table.rows[int(i)], table.names[stem]) not in unclear:
            problems.append(at(table, int(i), stem, "is empty, but the state is loaded", "''", "a finite number"))
    known = np.isfinite(wrench).all(axis=1)
    wrench = np.nan_to_num(wrench, nan=0.0)
    acts = np.any(wrench != 0.0, axis=1)
    for i in np.flatnonzero(loaded & known & ~acts & (not missing))[:MOST_PROBLEMS]:
        problems.append(at(table, int(i), "fx", "the state is loaded, but every force is zero"))
    for i in np.flatnonzero(~loaded & acts)[:MOST_PROBLEMS]:
        if table.texts["state"][i] == "unloaded":
            k = int(np.flatnonzero(wrench[i])[0])
            hint = "Leave its force empty or 0, or call the state loaded."
            problems.append(at(table, int(i), stems[k], "an unloaded state has no force", f"{wrench[i, k]:g}",
                               "0 or nothing", hint))  # fmt: skip
    return loaded, wrench


def _position_problems(table: Table, position: Array) -> list[Problem]:
    out: list[Problem] = []
    for i, k in np.argwhere(np.abs(position) > _FARTHEST)[:MOST_PROBLEMS]:
        stem = _XYZ[int(k)]
        slip = table.names[stem] == f"{stem}_m"
        hint = f"If the column is in mm, call it {stem}_mm." if slip else None
        message, found = "no tracker reads this far", f"{position[i, k]:g} m"
        out.append(at(table, int(i), stem, message, found, f"up to {_FARTHEST:g} m", hint))
    return out


def _check_units(
    table: Table, experiment: Experiment, poses: Poses, series: tuple[str, ...], measurement: Indices,
    marker: Indices, position: Array,
) -> None:  # fmt: skip
    """Within a series positions spread as far as the arm's own, in whatever frame; a wrong unit shows."""
    robot = experiment.robot
    sites = [(m.name, experiment.site(m.link, m.xyz)) for m in experiment.markers]
    rigid = make_model(robot.facts, [], [], experiment.load_site, sites, robot.gravity)
    there = rigid.positions(poses)[measurement, marker]
    names = np.array(series)[measurement]
    for name in dict.fromkeys(series):
        rows = (names == name) & np.isfinite(position).all(axis=1)
        spread = [float(np.sqrt(p[rows].var(axis=0).sum())) if rows.any() else 0.0 for p in (position, there)]
        if spread[1] < 1e-3 or spread[0] == 0.0:
            continue
        if not 1.0 / _UNIT_SLIP < spread[0] / spread[1] < _UNIT_SLIP:
            where = f" of series {name!r}" if name else ""
            found, allowed = f"a spread of {spread[0]:.3g} m", f"about the arm's own, {spread[1]:.3g} m"
            message = f"the positions{where} do not fit the poses; is their unit right?"
            raise InputError(Problem(message, str(table.path), column=table.names["x"], found=found, allowed=allowed))


def write_states(path: str | Path, readings: StateReadings, experiment: Experiment) -> None:
    """Write a file that `read_states` reads back to the digits that matter (1e-9 relative)."""
    poses, n = readings.poses, readings.poses.q.shape[1]
    forces = ["fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"] if readings.loaded.any() else []
    acting = poses.wrench[:, : len(forces)].tolist()
    columns = [[*degrees(q), *map(number, w)] for q, w in zip(poses.pendant, acting, strict=True)]
    conditions = {
        "time_s": poses.loaded.time, "temperature_K": poses.loaded.temperature, "approach": poses.loaded.approach,
    }  # fmt: skip
    present = {name: values.tolist() for name, values in conditions.items() if values is not None}
    named = {k: v for k, v in {"load_id": readings.load_id, "series": readings.series}.items() if any(v)}
    stated = bool(np.isfinite(readings.sigma).any())
    drive = readings.drive_state
    header = ["pose", *(f"q{k + 1}_deg" for k in range(n)), *forces, "marker", "state", "x_mm", "y_mm", "z_mm"]
    header += [*named, "repeat", "cycle", "use", *present, *(["sigma_mm"] if stated else [])]
    header += ["drive_state"] if drive else []
    rows: list[list[str]] = []
    for i, m in enumerate(int(m) for m in readings.measurement):
        row = [readings.pose[m], *columns[m], experiment.markers[int(readings.marker[i])].name]
        row += [STATES[int(readings.loaded[m])], *map(number, (readings.position[i] * 1e3).tolist())]
        row += [*(values[m] for values in named.values()), str(readings.repeat[m]), str(readings.cycle[m])]
        row += [str(int(readings.use[i])), *(recorded(values[m]) for values in present.values())]
        row += [number(float(readings.sigma[i] * 1e3)) if np.isfinite(readings.sigma[i]) else ""] if stated else []
        rows.append(row + ([drive[i]] if drive else []))
    write_table(path, header, rows, [f"robot: {experiment.robot.name}"])
