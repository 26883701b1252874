"""From files of readings to one kind of reading: which rows are of one state, and what each is measured against."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from qsframework.arguments import checked
from qsframework.errors import InputError, Problem, all_of, refuse
from qsframework.experiment.columns import IMPORT, Table, check_ours, make_table, numbered, read_table
from qsframework.experiment.differences import differences, has_pairs
from qsframework.experiment.frames import PLANE, POINT, Frame
from qsframework.experiment.kinds import Part, check_kinds, row_noise, unstated
from qsframework.experiment.options import ReadAs
from qsframework.experiment.plausible_readings import check_places, idle_problems, load_problems, no_load
from qsframework.experiment.reading_rows import MeasuredRows, measured_rows
from qsframework.experiment.readings import Made, Readings, States, joined
from qsframework.experiment.readings_table import STATES, columns_of, header_of
from qsframework.experiment.setup import GEOMETRY, Experiment
from qsframework.files import read_yaml, sha256
from qsframework.option import check_choice
from qsframework.plugin import Array, Conditions, Geometry, Indices, Poses, Sensor
from qsframework.plugin.facts import came_from, frozen


@checked
def read_readings(path: str | Path | Sequence[str | Path], experiment: Experiment, states: ReadAs = None) -> Readings:
    """Read and check one or more files of a campaign.

    Args:
        path: the file or files.
        experiment: the campaign.
        states: how files of states are read, "differences" or "positions"; as the experiment says if None. If it does
            not: differences where poses hold both states and the fit names no geometry, frame or marker.

    Returns:
        R readings, m, with their sds, poses and loads.

    Raises:
        InputError: with all their problems, each with row and column.
    """
    paths = [Path(p) for p in ([path] if isinstance(path, str | Path) else path)]
    states = states or experiment.states
    check_choice("states", ReadAs, states)
    if not paths:
        raise InputError(
            Problem("no files of readings to read", hint=f"Name one, or add `data:` to {experiment.path}.")
        )
    parts = all_of(partial(_read, one, experiment, states) for one in paths)
    whole = joined([p.readings for p in parts])
    check_kinds(parts, whole, experiment)
    return whole


def readings_of(
    path: Path, header: Sequence[str], rows: Sequence[Sequence[str]], experiment: Experiment, states: ReadAs = None
) -> Readings:
    """The readings of cells that stand in no file yet: as `read_readings` would read them, row k in line k + 2."""
    table = make_table(path, list(enumerate([header, *rows], start=1)), columns_of(header, experiment))
    part = _part(table, experiment, states)
    check_kinds([part], part.readings, experiment)
    return part.readings


def _read(path: Path, experiment: Experiment, states: str | None) -> Part:
    check_ours(path, f"pose, {experiment.robot.controller.units.names()[0]}, ..., marker, ...")
    columns = columns_of(header_of(path), experiment)
    made = _part(read_table(path, columns, experiment.robot.name, IMPORT), experiment, states)
    return replace(made, readings=replace(made.readings, made=_made(path)))


def _made(path: Path) -> Made | None:
    """What the .json beside a table says of the model that made it; None where it is of other readings, or measured."""
    beside = path.with_suffix(".json")
    try:
        told = read_yaml(beside).data if beside.is_file() else {}
    except InputError:
        return None
    if told.get("readings_sha256") != sha256(path) or told.get("model") not in ("equilibrium", "linear"):
        return None
    seed = told.get("seed")
    return Made(str(told["model"]), seed if isinstance(seed, int) else None)


def _part(table: Table, experiment: Experiment, states: str | None) -> Part:
    rows = measured_rows(table, experiment, "state" in table.names or "x" in table.names)
    found = _readings(rows, experiment)
    if rows.of_states:
        check_places(rows.table, experiment, found)
    stated = not unstated(rows, experiment).any()
    if rows.of_states and (states or suggested(experiment, found)) == "differences":
        if any(rows.points):
            hint = "Say states: positions, or leave states: out."
            raise InputError(Problem("touched points are positions, not differences", str(table.path), hint=hint))
        found = differences(found, experiment)
    return Part(found, own=bool(np.isfinite(rows.sigma[rows.use]).all()), stated=stated)


def suggested(experiment: Experiment, states: Readings) -> str:
    """How states are read where nobody says: "differences" or "positions"."""
    if not has_pairs(states) or any(name.startswith((POINT, PLANE)) for name in states.frames):
        return "positions"
    names = set(experiment.fit_names())
    model = experiment.model()
    of_place = {
        n
        for e, part in zip(model.effects, model.slices, strict=True)
        if isinstance(e, Geometry | Sensor)
        for n in model.names[part]
    }
    return "positions" if names & of_place or GEOMETRY in (experiment.fit or ()) else "differences"


class _StateKey(NamedTuple):
    """What rows of one state have in common; of a displacement, the loaded one."""

    pose: str
    load_id: str
    series: str
    repeat: int
    cycle: int
    loaded: bool


def _readings(rows: MeasuredRows, experiment: Experiment) -> Readings:
    """What the rows measured at which states: positions each at one, displacements each loaded minus unloaded."""
    table, keys = rows.table, _keys(rows)
    if any(key.loaded for key in keys):
        no_load(table, experiment)
    plus, first = numbered(keys)
    refuse([*rows.problems, *load_problems(rows), *_state_problems(rows, keys, plus, first)] or idle_problems(rows))
    own = [keys[int(i)] for i in first]
    if rows.of_states:
        states = _states(rows, first, own, experiment)
        return _over(states, plus, np.full(len(plus), -1), rows, experiment)
    names = table.text("reference")  # rows of one have one unloaded state, others one for each loaded state
    minus, before = numbered([("", name) if name else (p, "") for name, p in zip(names, plus.tolist(), strict=True)])
    moved = np.flatnonzero(np.any(rows.pendant != rows.pendant[before[minus]], axis=1)).tolist()
    hint = "An unloaded reading is of one pose: name the others differently."
    message = "the reference {!r} is of another pose"
    refuse([table.problem(i, "reference", message.format(names[i]), hint=hint) for i in moved])
    own += [keys[i]._replace(load_id=names[i], loaded=False) for i in map(int, before)]
    states = _states(rows, np.concatenate([first, before]), own, experiment)
    return _over(states, plus, minus + len(first), rows, experiment)


def _keys(rows: MeasuredRows) -> list[_StateKey]:
    """The state of each row."""
    table = rows.table
    loads, series = table.text("load_id"), [""] * len(rows.use)
    loaded = [True] * len(rows.use)
    if rows.of_states:
        series = table.text("series")
        loaded = [state == "loaded" for state in table.text("state")]
    counted = (table.counts("repeat"), table.counts("cycle"))
    return [_StateKey(*key) for key in zip(table.text("pose"), loads, series, *counted, loaded, strict=True)]


def _state_problems(rows: MeasuredRows, keys: Sequence[_StateKey], state: Indices, first: Indices) -> list[Problem]:
    """Rows that were read before, or that have other angles, times or another load than the first of their state."""
    table = rows.table
    recorded = table.columns([f"{c}{end}" for c in ("time", "temperature", "approach") for end in ("", "_unloaded")])
    constant = np.hstack([rows.pendant, rows.wrench, recorded])
    there = constant[first][state]
    differs = ~((constant == there) | (np.isnan(constant) & np.isnan(there))).all(axis=1)
    read, once = numbered(list(zip(state.tolist(), rows.who, strict=True)))
    hint = (
        "Delete the row if it is a copy. If the arm was brought there again, number the visits in the column "
        "repeat; if it was read again without moving, number the reads in the column read."
    )
    out: list[Problem] = []
    for i in np.flatnonzero(differs | (once[read] != np.arange(len(read)))).tolist():
        before, line = once[read[i]], table.rows[first[state[i]]]
        if before != i:
            message = f"{_label(keys[i], rows.of_states)}, marker {table.text('marker')[i]!r} stands here twice"
            out.append(table.problem(i, "pose", f"{message}; first in line {table.rows[before]}", hint=hint))
        if differs[i]:
            message = f"pose {keys[i].pose!r} has other angles, times or another load than in line {line}"
            out.append(table.problem(i, "pose", f"{message}; give it another pose name, repeat or cycle"))
    return out


def _label(key: _StateKey, of_states: bool) -> str:
    state = f", {STATES[key.loaded]}" if of_states else ""
    load = f", load {key.load_id!r}" if key.load_id else ""
    series = f", series {key.series!r}" if key.series else ""
    return f"pose {key.pose!r}{state}{load}{series}, repeat {key.repeat}, cycle {key.cycle}"


def _states(rows: MeasuredRows, at: Indices, keys: Sequence[_StateKey], experiment: Experiment) -> States:
    """States by a row (N,) of each."""
    loaded = np.array([key.loaded for key in keys])
    pendant = frozen(rows.pendant[at])
    joints = frozen(experiment.robot.controller.to_joints(pendant))
    order = _order(rows.table, at)
    later = 0.0 if rows.of_states else 0.5 * loaded / len(np.unique(at))  # of a row, the unloaded state comes first
    conditions = Conditions(
        time=_recorded(rows, "time", at, loaded),
        temperature=_recorded(rows, "temperature", at, loaded),
        approach=_recorded(rows, "approach", at, loaded),
        order=frozen(order + later),
        came=frozen(came_from(joints, order)),
    )
    wrench = frozen(np.where(loaded[:, None], rows.wrench[at], 0.0))
    return States(
        poses=Poses(pendant, joints, wrench, conditions, conditions),
        loaded=loaded,
        pose=tuple(key.pose for key in keys),
        load_id=tuple(key.load_id for key in keys),
        series=tuple(key.series for key in keys),
        repeat=np.array([key.repeat for key in keys]),
        cycle=np.array([key.cycle for key in keys]),
    )


def _recorded(rows: MeasuredRows, stem: str, at: Indices, loaded: npt.NDArray[np.bool_]) -> Array | None:
    """What was recorded of each state, NaN of those of which it was not; None where of none.

    The times and temperatures of the unloaded states of displacements have columns of their own.
    """
    before = stem if rows.of_states or stem == "approach" else f"{stem}_unloaded"
    if not {stem, before} & rows.table.numbers.keys():
        return None
    return frozen(np.where(loaded, rows.table.column(stem)[at], rows.table.column(before)[at]))


def _order(table: Table, rows: Indices) -> Array:
    """Which share of the readings had been taken at each state: by its row, in its own pace where it has a time."""
    count, visit = np.unique(rows, return_inverse=True)
    time = table.column("time")[rows]
    if np.isfinite(time).all() and np.ptp(time) > 0.0:
        return (time - time.min()) / np.ptp(time) * (1.0 - 1.0 / len(count))
    return visit / len(count)


def _over(states: States, plus: Indices, minus: Indices, rows: MeasuredRows, experiment: Experiment) -> Readings:
    """The rows as readings over these states."""
    table, count = rows.table, len(plus)
    series = table.text("series")
    named = [point or name for name, point in zip(series, rows.points, strict=True)]
    # a gauge measures along the axes of the base, and so does a displacement that names no series
    given = ~rows.gauge & (rows.of_states | (np.array(series) != ""))
    frames = tuple(dict.fromkeys(name for name, own in zip(named, given, strict=True) if own))
    if rows.of_states and "" in frames and not all(n == "" or n in rows.points for n in frames):
        i = next(i for i, n in enumerate(named) if n == "" and given[i])
        hint = "Each tracker frame is a series of its own: name one in every row, or in none."
        raise InputError(table.problem(i, "series", "names no series, others do", "''", ", ".join(frames[1:]), hint))
    known = {f.series: f for f in experiment.frames}
    known |= {name: Frame(name, turn, np.zeros(3)) for name, turn in rows.normals.items()}
    noise = row_noise(rows, experiment)
    return Readings(
        states=states,
        plus=plus,
        minus=minus,
        marker=rows.marker,
        frame=np.array([frames.index(n) if g else -1 for n, g in zip(named, given, strict=True)], dtype=np.intp),
        frames=frames,
        known=tuple(known.get(name) for name in frames),
        value=frozen(rows.value),
        sigma=frozen(noise.sigma),
        minus_sigma=frozen(np.full((count, 3), np.nan)),
        stated=noise.stated,
        use=rows.use,
        line=np.array(table.rows),
        file=np.zeros(count, dtype=np.intp),
        to=rows.to,
        directed=noise.directed,
        axes=rows.axes,
        reads=rows.reads.count,
        unnumbered=rows.reads.unnumbered,
        sources=(table.path,),
        drive_state=tuple(table.texts["drive_state"]) if "drive_state" in table.texts else None,
        repeatability=experiment.noise.repeatability,
        robot=experiment.robot.name,
    )
