"""readings.csv: files of displacements, of states, and of gauges, read to one kind of reading and written again."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from qsframework.arguments import checked
from qsframework.elastostatics import make_model
from qsframework.errors import InputError, Problem
from qsframework.experiment.columns import (
    IMPORT,
    MOST_PROBLEMS,
    Column,
    Table,
    check_ours,
    joint_cells,
    make_table,
    number,
    one_of,
    read_table,
    recorded,
    strength_problems,
    table_lines,
    write_table,
)
from qsframework.experiment.differences import differences, has_pairs
from qsframework.experiment.frames import PLANE, POINT, Frame
from qsframework.experiment.kinds import Part, check_kinds, which_sigma
from qsframework.experiment.options import ReadAs
from qsframework.experiment.plan import joint_columns
from qsframework.experiment.readings import UNSTATED, Made, Readings, States, axes_along, joined
from qsframework.experiment.reads import Reads, averaged
from qsframework.experiment.setup import GEOMETRY, Experiment
from qsframework.files import read_yaml, sha256
from qsframework.option import check_choice
from qsframework.plausible import RANGES
from qsframework.plugin import Array, Conditions, Geometry, Indices, Poses, Sensor
from qsframework.plugin.facts import came_from, frozen

STATES = ("unloaded", "loaded")
_FORCE, _MOMENT = ("fx", "fy", "fz"), ("mx", "my", "mz")
_XYZ, _MOVED, _ALONG = ("x", "y", "z"), ("dx", "dy", "dz"), ("ux", "uy", "uz")
_RECORDED = ("time", "temperature", "approach")
_LARGEST_DISPLACEMENT = 0.1
_FARTHEST = RANGES["m"].most
"""m from the tracker's origin."""
_TOUCHED = 0.1
"""m that a rigid nominal arm may put a marker from the point that it touched."""
_UNIT_SLIP = 100.0
"""Measured positions spread this many times wider or narrower than the arm's own are in a wrong unit."""


def _columns(experiment: Experiment, states: bool, bare: bool) -> list[Column]:
    """What a file may hold; `states`: of states, else of displacements; bare: whether it may be without vectors, as it
    has the column of a gauge or of touched points."""
    marker = one_of([m.name for m in experiment.markers], "the experiment has no such marker")
    state = one_of(STATES, "no such state", "unloaded or loaded")
    size = _near if states else _elastic
    return [
        Column("pose", "text", required=True),
        *joint_columns(experiment),
        *(Column(f, "number", "N", required=not states, blank=states) for f in _FORCE),
        *(Column(m, "number", "N m", blank=states) for m in _MOMENT),
        Column("marker", "text", required=True, check=marker),
        *([Column("state", "text", required=True, check=state)] if states else []),
        *(Column(d, "number", "m", required=not bare, blank=True, check=size) for d in (_XYZ if states else _MOVED)),
        Column("gauge", "number", "m", blank=True, check=None if states else _small),
        *(Column(u, "number", blank=True) for u in _ALONG),
        Column("to_marker", "text", check=marker),
        *([Column("load_id", "text"), Column("point", "text")] if states else [Column("reference", "text")]),
        Column("series", "text"),
        Column("repeat", "count"),
        Column("read", "count"),
        Column("cycle", "count"),
        Column("sigma", "number", "m", blank=True, check=_positive),
        *(
            Column(f"{c}{end}", "number", unit)
            for c, unit in (("time", "s"), ("temperature", "K"))
            for end in ("", *(() if states else ("_unloaded",)))
        ),
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
    if abs(value) <= _LARGEST_DISPLACEMENT:
        return None
    question, hint = "is it a position?", "A displacement is the loaded minus the unloaded position."
    if name.endswith("_m"):
        question, hint = "is the column in mm?", f"Then call it {name}m."
    message = f"a displacement this large is not elastic; {question}"
    return Problem(message, found=f"{value:g} m", allowed=f"up to {_LARGEST_DISPLACEMENT} m", hint=hint)


def _small(value: float, name: str) -> Problem | None:
    """What is wrong with the displacement along a gauge."""
    if abs(value) <= _LARGEST_DISPLACEMENT:
        return None
    message, allowed = "a gauge moves less under a load; is the column in mm?", f"up to {_LARGEST_DISPLACEMENT} m"
    return Problem(message, found=f"{value:g} m", allowed=allowed, hint="Then call it gauge_mm.")


def state_columns(experiment: Experiment) -> list[Column]:
    """What a file of states may hold."""
    return _columns(experiment, True, False)


def displacement_columns(experiment: Experiment) -> list[Column]:
    """What a file of displacements may hold."""
    return _columns(experiment, False, False)


def holds_states(path: str | Path) -> bool:
    """Whether a file is one of states: its header has a column `state` or a position."""
    return _of_states(_header(Path(path)))


def _of_states(header: Sequence[str]) -> bool:
    return "state" in header or any(name.startswith(("x_", "y_", "z_")) for name in header)


def holds_readings(path: str | Path) -> bool:
    """Whether a table is of readings and not a plan: its header has a column `marker`."""
    try:
        return "marker" in _header(Path(path))
    except InputError:  # no text: its reader says what it is
        return False


def _header(path: Path) -> list[str]:
    lines = (line.strip() for line in table_lines(path))
    header = next((line for line in lines if line and not line.startswith("#")), "")
    return [name.strip() for name in header.split(",")]


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
    parts: list[Part] = []
    problems: list[Problem] = []
    for one in paths:
        try:
            parts.append(_read(one, experiment, states))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    whole = joined([p.readings for p in parts])
    check_kinds(parts, whole, experiment)
    return whole


def _read(path: Path, experiment: Experiment, states: str | None) -> Part:
    check_ours(path, f"pose, {experiment.robot.controller.units.names()[0]}, ..., marker, ...")
    columns = _columns_of(_header(path), experiment)
    made = _part(read_table(path, columns, experiment.robot.name, IMPORT), experiment, states)
    return replace(made, readings=replace(made.readings, made=_made(path)))


def readings_of(
    path: Path, header: Sequence[str], rows: Sequence[Sequence[str]], experiment: Experiment, states: ReadAs = None
) -> Readings:
    """The readings of cells that stand in no file yet: as `read_readings` would read them, row k in line k + 2."""
    table = make_table(path, list(enumerate([header, *rows], start=1)), _columns_of(header, experiment))
    part = _part(table, experiment, states)
    check_kinds([part], part.readings, experiment)
    return part.readings


def _columns_of(header: Sequence[str], experiment: Experiment) -> list[Column]:
    """What a file with this header may hold."""
    bare = any(name.startswith("gauge_") or name == "point" for name in header)
    return _columns(experiment, _of_states(header), bare)


def _part(table: Table, experiment: Experiment, states: str | None) -> Part:
    of_states, path = "state" in table.names or "x" in table.names, table.path
    table, reads = averaged(table, (*(_XYZ if of_states else _MOVED), "gauge"))
    found = _Rows.of(table, reads, experiment, of_states)
    made = found.of_states(experiment) if of_states else found.of_displacements(experiment)
    stated = not _unstated(found.sigma, found.kind(of_states), found.use, experiment).any()
    if of_states and (states or suggested(experiment, made)) == "differences":
        if any(found.points):
            hint = "Say states: positions, or leave states: out."
            raise InputError(Problem("touched points are positions, not differences", str(path), hint=hint))
        made = differences(made, experiment)
    return Part(made, own=bool(np.isfinite(found.sigma[found.use]).all()), stated=stated)


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


@dataclass(frozen=True, eq=False, kw_only=True)
class _Rows:
    """The cells of a table that every kind of file has."""

    table: Table
    reads: Reads
    pendant: Array
    wrench: Array
    use: npt.NDArray[np.bool_]
    marker: Indices
    sigma: Array
    value: Array
    axes: Array | None
    to: Indices
    gauge: npt.NDArray[np.bool_]
    points: tuple[str, ...]
    normals: dict[str, Array]
    problems: list[Problem]

    @classmethod
    def of(cls, table: Table, reads: Reads, experiment: Experiment, of_states: bool) -> _Rows:
        count = len(table.rows)
        pendant = np.stack([table.numbers[f"q{k + 1}"] for k in range(experiment.robot.controller.axes)], axis=1)
        zero = np.zeros(count)
        wrench = np.stack([table.numbers.get(c, zero) for c in (*_FORCE, *_MOMENT)], axis=1)
        use = table.numbers.get("use", np.ones(count)) != 0
        robot = experiment.robot
        problems = list(table.problems)
        problems += strength_problems(table, wrench, robot.payload, robot.gravity)
        stems = _XYZ if of_states else _MOVED
        value = np.stack([table.numbers.get(c, np.full(count, np.nan)) for c in stems], axis=1)
        marker = _markers(table, "marker", experiment)
        points = table.texts.get("point", [""] * count)
        touched = np.array([name != "" for name in points])
        value, axes, to, gauge = _gauges(table, experiment, value, touched, problems)
        plates = touched & gauge & (to < 0)
        points = tuple((PLANE if on else POINT) + p if p else "" for p, on in zip(points, plates, strict=True))
        problems += _point_problems(table, points, gauge & ~plates, axes)
        flat = [] if axes is None else [(points[i], np.array(axes[i])) for i in map(int, np.flatnonzero(plates)[::-1])]
        if axes is not None:
            axes[plates] = np.eye(3)
        gauge &= ~plates
        value = np.where((touched & ~plates & ~gauge)[:, None], np.nan_to_num(value), value)
        problems += _unfilled(table, value, use, stems)
        sigma = table.numbers.get("sigma", np.full(count, np.nan))
        return cls(
            table=table,
            reads=reads,
            pendant=pendant,
            wrench=wrench,
            use=use,
            marker=marker,
            sigma=sigma,
            value=value,
            axes=axes,
            to=to,
            gauge=gauge,
            points=points,
            normals=dict(flat),
            problems=problems,
        )

    def of_displacements(self, experiment: Experiment) -> Readings:
        """Rows of displacements, each loaded minus unloaded."""
        table, problems = self.table, self.problems
        no_load(table, experiment)
        keys = list(zip(table.texts["pose"], counts(table, "repeat"), counts(table, "cycle"), strict=True))
        labels = [f"pose {pose!r}, repeat {repeat}, cycle {cycle}" for pose, repeat, cycle in keys]
        every = [f"{c}{end}" for c in _RECORDED for end in ("", "_unloaded")]
        known = [table.numbers[c][:, None] for c in every if c in table.numbers]
        constant = np.hstack([self.pendant, self.wrench, *known])
        first, measurement = _group(table, keys, labels, self._who(), constant, problems)
        if not problems and not np.any(self.wrench):
            problems.append(
                Problem("every force is zero; a displacement under no load carries no information", str(table.path))
            )
        if not problems and self.use.any() and not np.any(np.nan_to_num(self.value[self.use])):
            problems.append(Problem("every displacement is zero; nothing was measured", str(table.path)))
        problems += _unloaded_problems(table, self.wrench, self.use) if not problems else []
        if problems:
            raise InputError(problems)
        references = table.texts.get("reference", [""] * len(keys))
        minus, before = _references(references, measurement, first)
        others = np.flatnonzero(np.any(self.pendant != self.pendant[before[minus - len(first)]], axis=1))
        if len(others):
            hint = "An unloaded reading is of one pose: name the others differently."
            raise InputError(
                [
                    at(
                        table,
                        int(i),
                        "reference",
                        f"the reference {references[int(i)]!r} is of another pose",
                        hint=hint,
                    )
                    for i in others[:MOST_PROBLEMS]
                ]
            )
        rows = np.concatenate([first, before])  # a row of the file for every state
        loaded = np.arange(len(rows)) < len(first)
        names = [(*keys[int(i)], "" if on else references[int(i)]) for i, on in zip(rows, loaded, strict=True)]
        own = _conditions(table, "", rows)
        ends = _conditions(table, "_unloaded", rows)
        both = Conditions.each(lambda name: _either(getattr(own, name), getattr(ends, name), loaded))
        both = replace(both, order=_order(table, rows, loaded))
        states = self._states(experiment, rows, loaded, both, names, ["" for _ in rows])
        return self._readings(experiment, states, measurement, minus, False)

    def of_states(self, experiment: Experiment) -> Readings:
        """Rows of positions, each of one state."""
        table, problems = self.table, self.problems
        loaded = _loads(table, self.wrench, problems)
        wrench = np.nan_to_num(self.wrench, nan=0.0)
        if loaded.any():
            no_load(table, experiment)
        texts = [table.texts.get(c, [""] * len(loaded)) for c in ("load_id", "series")]
        keys = list(
            zip(
                table.texts["pose"],
                *texts,
                counts(table, "repeat"),
                counts(table, "cycle"),
                loaded.tolist(),
                strict=True,
            )
        )
        known = [table.numbers[c][:, None] for c in _RECORDED if c in table.numbers]
        constant = np.hstack([self.pendant, wrench, *known])
        first, state = _group(table, keys, _labels(keys), self._who(), constant, problems)
        if problems:
            raise InputError(problems)
        names = [(keys[int(i)][0], keys[int(i)][3], keys[int(i)][4], keys[int(i)][1]) for i in first]
        conditions = replace(_conditions(table, "", first), order=_order(table, first))
        rows = replace(self, wrench=wrench)
        states = rows._states(experiment, first, loaded[first], conditions, names, [keys[int(i)][2] for i in first])
        found = rows._readings(experiment, states, state, np.full(len(state), -1), True)
        _check_units(table, experiment, found)
        _check_touched(table, experiment, found)
        return found

    def kind(self, of_states: bool) -> npt.NDArray[np.str_]:
        """The kind (R,) of each row."""
        return np.where(self.gauge, "gauge", "position" if of_states else "displacement")

    def _who(self) -> list[Hashable]:
        """Marker, and for gauges the other marker and the direction: what one state is read of once."""
        if self.axes is None:
            return self.marker.tolist()
        ends = self.axes[:, 0].round(9).tolist()
        return [
            (int(m), int(t), tuple(u) if g else ())
            for m, t, u, g in zip(self.marker, self.to, ends, self.gauge, strict=True)
        ]

    def _states(
        self,
        experiment: Experiment,
        rows: Indices,
        loaded: npt.NDArray[np.bool_],
        conditions: Conditions,
        names: Sequence[tuple[str, int, int, str]],
        series: Sequence[str],
    ) -> States:
        """States by their row in the file; names: pose, repeat, cycle and load."""
        pendant = frozen(self.pendant[rows])
        wrench = frozen(np.where(loaded[:, None], self.wrench[rows], 0.0))
        joints = frozen(experiment.robot.controller.to_joints(pendant))
        conditions = replace(conditions, came=frozen(came_from(joints, _order(self.table, rows))))
        return States(
            poses=Poses(pendant, joints, wrench, conditions, conditions),
            loaded=loaded,
            pose=tuple(n[0] for n in names),
            load_id=tuple(n[3] for n in names),
            series=tuple(series),
            repeat=np.array([n[1] for n in names]),
            cycle=np.array([n[2] for n in names]),
        )

    def _readings(
        self, experiment: Experiment, states: States, plus: Indices, minus: Indices, of_states: bool
    ) -> Readings:
        table = self.table
        named = table.texts.get("series", [""] * len(plus))
        given = of_states | np.array([n != "" for n in named])
        given &= ~self.gauge  # a gauge measures along the axes of the base
        named = [point or n for n, point in zip(named, self.points, strict=True)]
        frames = tuple(dict.fromkeys(n for n, own in zip(named, given, strict=True) if own))
        if of_states and "" in frames and not all(n == "" or n in self.points for n in frames):
            i = next(i for i, n in enumerate(named) if n == "" and given[i])
            hint = "Each tracker frame is a series of its own: name one in every row, or in none."
            raise InputError(at(table, i, "series", "names no series, others do", "''", ", ".join(frames[1:]), hint))
        known = {f.series: f for f in experiment.frames}
        known |= {name: Frame(name, turn, np.zeros(3)) for name, turn in self.normals.items()}
        own = _far_sigma(experiment, self.sigma, self.value, self.kind(of_states))
        sigma, stated = _sigmas(table, experiment, own, self.kind(of_states), self.use)
        sigma = np.where(np.isnan(self.sigma), self.reads.sigma(sigma), sigma)
        return Readings(
            states=states,
            plus=plus,
            minus=minus,
            marker=self.marker,
            frame=np.array([frames.index(n) if g else -1 for n, g in zip(named, given, strict=True)], dtype=np.intp),
            frames=frames,
            known=tuple(known.get(n) for n in frames),
            value=frozen(self.value),
            sigma=frozen(np.repeat(sigma[:, None], 3, axis=1)),
            minus_sigma=frozen(np.full((len(plus), 3), np.nan)),
            stated=stated,
            use=self.use,
            line=np.array(table.rows),
            file=np.zeros(len(plus), dtype=np.intp),
            to=self.to,
            axes=self.axes,
            reads=self.reads.count,
            sources=(table.path,),
            drive_state=tuple(table.texts["drive_state"]) if "drive_state" in table.texts else None,
            repeatability=experiment.noise.repeatability,
            robot=experiment.robot.name,
        )


def _point_problems(
    table: Table, points: Sequence[str], gauge: npt.NDArray[np.bool_], axes: Array | None
) -> list[Problem]:
    """Rows of touched points that are of a gauge or of a series too, points that were touched once, and plates of
    several normals."""
    series = table.texts.get("series", [""] * len(points))
    count, first = Counter(points), {name: i for i, name in reversed(list(enumerate(points)))}
    out: list[Problem] = []
    for i, name in enumerate(points):
        kind, _, own = name.partition(":")
        if name and (gauge[i] or series[i]):
            stem = "gauge" if gauge[i] else "series"
            hint = "Give it a row of its own: the place of a point is in the axes of the base."
            out.append(at(table, i, stem, f"the row touches the {kind} {own!r} and is of a {stem} too", hint=hint))
        elif name and count[name] == 1:
            hint = "Touch it at two poses or more, all with ux, uy, uz or none."
            out.append(at(table, i, "point", f"the {kind} {own!r} is touched once, which says nothing", hint=hint))
        elif kind == "plane" and axes is not None and np.abs(axes[i, 0] - axes[first[name], 0]).max() > 1e-6:
            line = table.rows[first[name]]
            out.append(at(table, i, "ux", f"the plane {own!r} has another normal than in line {line}"))
        elif series[i].startswith((POINT, PLANE)):
            out.append(at(table, i, "series", f"a series does not begin with {POINT!r} or {PLANE!r}", repr(series[i])))
    return out[:MOST_PROBLEMS]


def at(
    table: Table,
    i: int,
    stem: str,
    message: str,
    found: str | None = None,
    allowed: str | None = None,
    hint: str | None = None,
) -> Problem:
    """A problem in row i of a table, in the column of this stem."""
    return Problem(
        message,
        str(table.path),
        table.rows[i],
        table.names.get(stem, stem),
        found=found or None,
        allowed=allowed,
        hint=hint,
    )


def counts(table: Table, stem: str) -> list[int]:
    """A column of whole numbers, 1 where it is missing."""
    values = table.numbers.get(stem, np.ones(len(table.rows)))
    return np.nan_to_num(values, nan=1.0).astype(int).tolist()


def no_load(table: Table, experiment: Experiment) -> None:
    """InputError where the readings are of a load but the experiment does not say where it acts."""
    if not experiment.has_load:
        message = f"holds readings under load, but {experiment.path.name} does not say where the load acts"
        raise InputError(Problem(message, str(table.path), hint="Add for example load: {point_mm: [150, 0, 200]}."))


def _markers(table: Table, stem: str, experiment: Experiment) -> Indices:
    """Place (R,) of each row's marker in the experiment; where there is none -1, of those that are measured 0."""
    places, none = {m.name: k for k, m in enumerate(experiment.markers)}, -1 if stem == "to_marker" else 0
    return np.array([places.get(name, none) for name in table.texts.get(stem, [""] * len(table.rows))], dtype=np.intp)


def _gauges(
    table: Table, experiment: Experiment, value: Array, touched: npt.NDArray[np.bool_], problems: list[Problem]
) -> tuple[Array, Array | None, Indices, npt.NDArray[np.bool_]]:
    """Values (R, 3), axes, the other marker of each row, and which rows are of a gauge; touched (R,): rows that read
    zero along their direction where they read nothing."""
    count = len(value)
    to, marker = (_markers(table, stem, experiment) for stem in ("to_marker", "marker"))
    read = table.numbers.get("gauge", np.full(count, np.nan))
    along = np.stack([table.numbers.get(c, np.full(count, np.nan)) for c in _ALONG], axis=1)
    along = np.where(np.isfinite(along).any(axis=1, keepdims=True), np.nan_to_num(along, nan=0.0), np.nan)
    size = np.linalg.norm(along, axis=1)
    read = np.where(touched & np.isnan(read) & (size > 0), 0.0, read)
    gauge = np.isfinite(read)
    stray = ~gauge & np.isfinite(value).any(axis=1) & ((to >= 0) | np.isfinite(size))
    for i in np.flatnonzero(stray)[:MOST_PROBLEMS].tolist():
        stem = "to_marker" if to[i] >= 0 else "ux"
        message = "the row is of a vector: a direction or another marker belongs to a gauge"
        problems.append(at(table, i, stem, message, hint="Fill in gauge_mm in a row of its own, or leave this empty."))
    if not gauge.any():
        return value, None, to, gauge
    for i in np.flatnonzero(gauge)[:MOST_PROBLEMS].tolist():
        pointed = np.isfinite(size[i]) and size[i] > 0.0
        hint = "Give ux, uy, uz, the direction in the base frame of any length, or to_marker."
        if np.isfinite(value[i]).any():
            hint = "Give it a row of its own: each row is of one instrument."
            problems.append(at(table, i, "gauge", "a gauge and a vector stand in one row", hint=hint))
        elif pointed == (to[i] >= 0):
            both = "has a direction and a marker to which it measures" if pointed else "has no direction"
            problems.append(at(table, i, "gauge", f"the gauge {both}", hint=hint))
        elif to[i] == marker[i]:
            problems.append(at(table, i, "to_marker", "a distance is to another marker", hint=hint))
    axes = np.tile(np.eye(3), (count, 1, 1))
    for i in np.flatnonzero(gauge & (to < 0) & np.isfinite(size) & (size > 0)).tolist():
        axes[i] = axes_along(along[i])
    value = value.copy()
    value[gauge] = np.nan
    value[gauge, 0] = read[gauge]
    return value, axes, to, gauge


def _unfilled(table: Table, value: Array, use: npt.NDArray[np.bool_], stems: Sequence[str]) -> list[Problem]:
    """One problem for all rows in which nothing was measured."""
    told = {p.line for p in table.problems if p.column in {table.names.get(s) for s in (*stems, "gauge")}}
    empty = [table.rows[i] for i in np.flatnonzero(use & ~np.isfinite(value).any(axis=1))]
    lines = [line for line in empty if line not in told]
    if not lines:
        return []
    many = f"{len(lines)} rows are not filled in, of which this is the first"
    message = many if len(lines) > 1 else "this row is not filled in"
    hint = "Fill in what was measured; put 0 in the column use of a row that was not."
    column = next((table.names[s] for s in (*stems, "gauge") if s in table.names), stems[0])
    return [Problem(message, str(table.path), lines[0], column, found="''", allowed="a number", hint=hint)]


def _group(
    table: Table,
    keys: Sequence[Hashable],
    labels: Sequence[str],
    who: Sequence[Hashable],
    constant: Array,
    problems: list[Problem],
) -> tuple[Indices, Indices]:
    """First row of each state, and the state of each row; its rows must agree in `constant`."""
    numbered: dict[Hashable, int] = {}
    first: list[int] = []
    seen: dict[Hashable, int] = {}
    state = np.zeros(len(keys), dtype=np.intp)
    for i, key in enumerate(keys):
        m = numbered.setdefault(key, len(numbered))
        if m == len(first):
            first.append(i)
        state[i] = m
        if len(problems) > MOST_PROBLEMS:
            break
        if (m, who[i]) in seen:
            other = table.rows[seen[m, who[i]]]
            what = f"{labels[i]}, marker {table.texts['marker'][i]!r}"
            hint = (
                "Delete the row if it is a copy. If the arm was brought there again, number the visits in the column "
                "repeat; if it was read again without moving, number the reads in the column read."
            )
            problems.append(at(table, i, "pose", f"{what} stands here twice; first in line {other}", hint=hint))
        seen[m, who[i]] = i
        if not np.array_equal(constant[i], constant[first[m]], equal_nan=True):
            pose, line = table.texts["pose"][i], table.rows[first[m]]
            message = f"pose {pose!r} has other angles, times or another load than in line {line}"
            problems.append(at(table, i, "pose", message + "; give it another pose name, repeat or cycle"))
    return np.array(first, dtype=np.intp), state


def _references(names: Sequence[str], measurement: Indices, first: Indices) -> tuple[Indices, Indices]:
    """The unloaded state (R,) of each row, numbered behind the loaded ones, and a row of the file for each.

    Rows of one `reference` have one unloaded state; others one for each loaded state.
    """
    number_of: dict[Hashable, int] = {}
    rows: list[int] = []
    out = np.zeros(len(names), dtype=np.intp)
    for i, name in enumerate(names):
        key: Hashable = ("reference", name) if name else int(measurement[i])
        k = number_of.setdefault(key, len(number_of))
        if k == len(rows):
            rows.append(i)
        out[i] = len(first) + k
    return out, np.array(rows, dtype=np.intp)


def _labels(keys: Sequence[tuple[str, str, str, int, int, bool]]) -> list[str]:
    out: list[str] = []
    for pose, load, series, repeat, cycle, loaded in keys:
        more = (f", load {load!r}" if load else "") + (f", series {series!r}" if series else "")
        out.append(f"pose {pose!r}, {STATES[loaded]}{more}, repeat {repeat}, cycle {cycle}")
    return out


def _loads(table: Table, wrench: Array, problems: list[Problem]) -> npt.NDArray[np.bool_]:
    """Whether each row is loaded: only a loaded state has a wrench (R, 6)."""
    loaded = np.array([state == "loaded" for state in table.texts["state"]])
    missing = [f for f in _FORCE if f not in table.numbers]
    if missing and (loaded.any() or len(missing) < 3):
        problems.append(
            Problem(
                "a loaded state needs its force",
                str(table.path),
                column=f"{missing[0]}_N",
                allowed="the columns fx_N, fy_N, fz_N",
            )
        )
    stems = [*_FORCE, *_MOMENT]
    unclear = {(p.line, p.column) for p in table.problems}
    for i, k in np.argwhere(np.isnan(wrench) & loaded[:, None])[:MOST_PROBLEMS]:
        stem = stems[int(k)]
        if (table.rows[int(i)], table.names[stem]) not in unclear:
            problems.append(at(table, int(i), stem, "is empty, but the state is loaded", "''", "a finite number"))
    known = np.isfinite(wrench).all(axis=1)
    acts = np.any(np.nan_to_num(wrench, nan=0.0) != 0.0, axis=1)
    for i in np.flatnonzero(loaded & known & ~acts & (not missing))[:MOST_PROBLEMS]:
        problems.append(at(table, int(i), "fx", "the state is loaded, but every force is zero"))
    for i in np.flatnonzero(~loaded & acts)[:MOST_PROBLEMS]:
        if table.texts["state"][i] == "unloaded":
            k = int(np.flatnonzero(np.nan_to_num(wrench[i]))[0])
            hint = "Leave its force empty or 0, or call the state loaded."
            problems.append(
                at(table, int(i), stems[k], "an unloaded state has no force", f"{wrench[i, k]:g}", "0 or nothing", hint)
            )
    return loaded


def _unloaded_problems(table: Table, wrench: Array, use: npt.NDArray[np.bool_]) -> list[Problem]:
    """Rows in use that have no load: a displacement from nothing."""
    hint = "Give the row its load, or mask it with use = 0."
    return [
        at(
            table,
            int(i),
            "fx",
            "no force and no moment: a displacement under no load carries no information",
            hint=hint,
        )
        for i in np.flatnonzero(use & ~np.any(wrench, axis=1))[:MOST_PROBLEMS]
    ]


def _known_sigma(kind: npt.NDArray[np.str_], experiment: Experiment) -> Array:
    """sd (R,) that the experiment states for each row, NaN where it states none."""
    noise = experiment.noise
    by_kind = {"displacement": noise.displacement, "position": noise.position, "gauge": noise.gauge}
    if not noise.apart:
        by_kind = dict.fromkeys(by_kind, noise.sigma)
    return np.array([np.nan if by_kind[k] is None else by_kind[k] for k in kind.tolist()], dtype=float)


def _far_sigma(experiment: Experiment, own: Array, value: Array, kind: npt.NDArray[np.str_]) -> Array:
    """sd (R,) of rows, of positions (R, 3) m in the tracker's frame with what the distance adds where none is given."""
    near, slope = experiment.noise.of_position, experiment.noise.per_distance
    if near is None or not slope:
        return own
    far = near + slope * np.linalg.norm(value, axis=1)
    return np.where(np.isnan(own) & (kind == "position") & np.isfinite(far), far, own)


def _unstated(
    own: Array, kind: npt.NDArray[np.str_], use: npt.NDArray[np.bool_], experiment: Experiment
) -> npt.NDArray[np.bool_]:
    """Rows (R,) in use of which nobody states the sd."""
    return use & np.isnan(own) & np.isnan(_known_sigma(kind, experiment))


def _sigmas(
    table: Table, experiment: Experiment, own: Array, kind: npt.NDArray[np.str_], use: npt.NDArray[np.bool_]
) -> tuple[Array, bool]:
    """sd (R,) of one coordinate of each row, and whether it is stated; UNSTATED where nobody says anything."""
    noise = experiment.noise
    here = list(dict.fromkeys(kind.tolist()))
    if noise.sigma is not None and not noise.apart and len(here) > 1 and np.isnan(own[use]).any():
        raise InputError(which_sigma(experiment, here))
    sigma = np.where(np.isnan(own), _known_sigma(kind, experiment), own)
    missing = _unstated(own, kind, use, experiment)
    if missing.any() and not missing[use].all():
        i = int(np.flatnonzero(missing)[0])
        message = f"{int(missing.sum())} readings have no sigma_mm and the experiment states no noise, others have one"
        raise InputError(at(table, i, "sigma", message, hint="Give all of them or none."))
    stated = bool(not missing.any() and (noise.sigma is not None or noise.apart))
    return np.where(np.isnan(sigma), UNSTATED, sigma), stated


def _rigid_places(experiment: Experiment, found: Readings) -> Array:
    """Where a rigid arm puts the marker of each row: (R, 3) m, base frame."""
    robot = experiment.robot
    sites = [(m.name, experiment.site(m.link, m.xyz)) for m in experiment.markers]
    rigid = make_model(robot.facts, [], [], experiment.load_site, sites, robot.gravity)
    return rigid.positions(found.poses)[found.plus, found.marker]


def _check_touched(table: Table, experiment: Experiment, found: Readings) -> None:
    """InputError for rows whose marker a rigid arm puts far from where most others put the same point."""
    places = _rigid_places(experiment, found)
    problems: list[Problem] = []
    for f, name in enumerate(found.frames):
        known, rows = found.known[f], np.flatnonzero((found.frame == f) & found.use)
        if not name.startswith((POINT, PLANE)) or not len(rows):
            continue
        there = places[rows] if known is None else places[rows] @ known.rotation[:1].T
        there = there - found.value[rows][:, : there.shape[1]]
        off = np.linalg.norm(there - np.median(there, axis=0), axis=1)
        for i, far in zip(rows.tolist(), off.tolist(), strict=True):
            if far > _TOUCHED:
                own = name.partition(":")[2]
                message = f"the marker lies {1e3 * far:.0f} mm from where the others touch {own!r}"
                hint = "Is it another point, another marker or another pose? Else put 0 in the column use."
                problems.append(at(table, i, "point", message, None, f"up to {1e3 * _TOUCHED:.0f} mm", hint))
    if problems:
        raise InputError(problems[:MOST_PROBLEMS])


def _check_units(table: Table, experiment: Experiment, found: Readings) -> None:
    """Within a series positions spread as far as the arm's own, in whatever frame; a wrong unit shows."""
    there = _rigid_places(experiment, found)
    for f, name in enumerate(found.frames):
        if name.startswith((POINT, PLANE)):
            continue
        rows = (found.frame == f) & np.isfinite(found.value).all(axis=1) & found.use
        spread = [float(np.sqrt(p[rows].var(axis=0).sum())) if rows.any() else 0.0 for p in (found.value, there)]
        if spread[1] < 1e-3 or spread[0] == 0.0:
            continue
        if not 1.0 / _UNIT_SLIP < spread[0] / spread[1] < _UNIT_SLIP:
            where = f" of series {name!r}" if name else ""
            told, allowed = f"a spread of {spread[0]:.3g} m", f"about the arm's own, {spread[1]:.3g} m"
            message = f"the positions{where} do not fit the poses; is their unit right?"
            raise InputError(Problem(message, str(table.path), column=table.names["x"], found=told, allowed=allowed))


def _either(loaded: Array | None, unloaded: Array | None, is_loaded: npt.NDArray[np.bool_]) -> Array | None:
    """What was recorded of each state, NaN of those of which it was not; None where of none."""
    if loaded is None and unloaded is None:
        return None
    nothing = np.full(len(is_loaded), np.nan)
    return frozen(np.where(is_loaded, nothing if loaded is None else loaded, nothing if unloaded is None else unloaded))


def _order(table: Table, rows: Indices, loaded: npt.NDArray[np.bool_] | None = None) -> Array:
    """Which share of the readings had been taken at each state: by its row, in its own pace where time_s is recorded.

    loaded: of displacements, whose rows are two states each, the unloaded one read first
    """
    _, visit = np.unique(rows, return_inverse=True)
    count, time = int(visit.max(initial=0)) + 1, table.numbers.get("time")
    order = visit / count
    if time is not None and np.isfinite(time[rows]).all() and np.ptp(time[rows]) > 0.0:
        order = (time[rows] - time[rows].min()) / np.ptp(time[rows]) * (1.0 - 1.0 / count)
    return frozen(order if loaded is None else order + 0.5 * loaded / count)


def _conditions(table: Table, suffix: str, rows: Indices) -> Conditions:
    def get(stem: str) -> Array | None:
        values = table.numbers.get(stem)
        return None if values is None else frozen(values[rows])

    return Conditions(get(f"time{suffix}"), get(f"temperature{suffix}"), get("approach"))


@checked
def write_readings(path: str | Path, readings: Readings, experiment: Experiment) -> None:
    """Write a file that `read_readings` reads back to the digits that matter (1e-9 relative).

    Args:
        path: the file.
        readings: the readings.
        experiment: their campaign.

    Returns:
        InputError: where the file cannot be written.

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
    position = readings.is_position
    if position.any() and not position.all():
        raise InputError("positions and displacements are two files; write them one by one")
    of_states = bool(position.any())
    states, poses, joints = readings.states, readings.poses, experiment.robot.controller.units
    forces = ["fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"] if states.loaded.any() or not of_states else []
    stems = _XYZ if of_states else _MOVED
    header = ["pose", *joints.names(), *forces, "marker", *(["state"] if of_states else [])]
    gauge = readings.is_gauge | np.array([_normal_of(readings, f) is not None for f in map(int, readings.frame)])
    measured = [] if gauge.all() else [f"{s}_mm" for s in stems]
    header += [*measured, *(["gauge_mm", *_ALONG, "to_marker"] if gauge.any() else [])]
    named = {"load_id": [states.load_id[int(s)] for s in readings.plus]} if of_states else {}
    series = [readings.frames[f] if f >= 0 else "" for f in map(int, readings.frame)]
    touched = [_touched_by(readings, f) for f in map(int, readings.frame)]
    series = [states.series[int(s)] for s in readings.plus] if of_states else series  # of gauges too
    reference = _named_references(readings)
    named |= {"series": series, "point": touched, "reference": [] if of_states else reference}
    named = {k: v for k, v in named.items() if any(v)}
    recorded_of = _recorded_columns(readings, of_states)
    given = readings.stated or len(np.unique(readings.sigma)) > 1
    drive = readings.drive_state
    header += [*named, "repeat", "cycle", "use", *recorded_of, *(["sigma_mm"] if given else [])]
    header += ["drive_state"] if drive else []
    names = [m.name for m in experiment.markers]
    angles, wrenches = [joint_cells(q, joints) for q in poses.pendant], poses.wrench[:, : len(forces)].tolist()
    rows: list[list[str]] = []
    for i, s in enumerate(map(int, readings.plus)):
        row = [states.pose[s], *angles[s], *map(number, wrenches[s]), names[int(readings.marker[i])]]
        row += [STATES[int(states.loaded[s])]] if of_states else []
        row += [_cell(v) for v in readings.value[i].tolist()] if measured and not gauge[i] else [""] * len(measured)
        row += _gauge_cells(readings, i, names) if gauge.any() else []
        row += [*(values[i] for values in named.values()), str(states.repeat[s]), str(states.cycle[s])]
        row += [str(int(readings.use[i])), *(recorded(float(values[i])) for values in recorded_of.values())]
        row += [number(float(np.nanmax(readings.sigma[i]) * 1e3))] if given else []
        rows.append(row + ([drive[i]] if drive else []))
    return header, rows


def _touched_by(readings: Readings, f: int) -> str:
    """The point that stands for a frame by its place, "" for another."""
    name = readings.frames[f] if f >= 0 else ""
    return name.partition(":")[2] if name.startswith((POINT, PLANE)) else ""


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


def _gauge_cells(readings: Readings, i: int, names: Sequence[str]) -> list[str]:
    to, normal = int(readings.to[i]), _normal_of(readings, int(readings.frame[i]))
    if normal is None and readings.axes is not None and readings.is_gauge[i]:
        normal = readings.axes[i, 0]
    if normal is None:
        return [""] * 5
    along = [""] * 3 if to >= 0 else [number(v, 15) for v in normal.tolist()]
    return [_cell(float(readings.value[i, 0])), *along, names[to] if to >= 0 else ""]


def _named_references(readings: Readings) -> list[str]:
    """Name of the unloaded state behind each row that others share, "" for one of its own."""
    own: dict[int, set[int]] = {}
    for s, m in zip(readings.plus.tolist(), readings.minus.tolist(), strict=True):
        own.setdefault(m, set()).add(s)
    shared = {m for m, loaded in own.items() if m >= 0 and len(loaded) > 1}
    states = readings.states
    return [(states.load_id[m] or f"{states.pose[m]}/{m}") if m in shared else "" for m in readings.minus.tolist()]


def _recorded_columns(readings: Readings, of_states: bool) -> dict[str, Array]:
    """What was recorded of the states, by column, a value for each row."""
    c = readings.poses.loaded
    found: dict[str, Array] = {}
    for name, values in (("time_s", c.time), ("temperature_K", c.temperature), ("approach", c.approach)):
        if values is None:
            continue
        found[name] = values[readings.plus]
        if not of_states and name != "approach":
            stem, _, unit = name.partition("_")
            found[f"{stem}_unloaded_{unit}"] = values[readings.minus]
    return {name: values for name, values in found.items() if np.isfinite(values).all()}
