"""plan.csv and plan.json: which poses to measure under which load, and the proof of the choice.

Joint values outside the limits are one problem for all rows of a column, with the convention that fits.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from qsframework.arguments import checked
from qsframework.errors import InputError, Problem, nearest, refuse
from qsframework.experiment.columns import (
    WRENCH,
    WRENCH_NAMES,
    Column,
    Table,
    WholeCheck,
    force_columns,
    joint_cells,
    joint_stems,
    number,
    numbered,
    read_table,
    strength_problems,
    write_table,
)
from qsframework.experiment.description import changed_parts, description
from qsframework.experiment.setup import Experiment
from qsframework.files import FileRecord, as_file, read_yaml, sha256, validate, write_text
from qsframework.files.formats import FORMAT, check_format
from qsframework.plugin import Array, Conditions, Indices, Poses
from qsframework.plugin.facts import came_from, frozen
from qsframework.robot import Controller
from qsframework.units import JointUnits
from qsframework.viewed import Viewed

_ENOUGH = 3
"""Different values of a column that lets a convention be seen."""


@dataclass(frozen=True, kw_only=True)
class PlanCertificate(FileRecord):
    """How far a plan is from the best: criterion values and certified efficiencies.

    value is the criterion of the plan, relaxed_value that of the relaxed design with as many poses;
    relaxed_efficiency bounds the relaxed design, efficiency the plan, against the best design over the
    candidates; polished_from is the plan's efficiency before its angles left the candidates (it may then
    pass 1); of criterion I, value_in_base is that of the tip in the base frame, where value is of that after the best
    frame and tool, and value_before the criterion before the plan; notes are what the user should know about it
    """

    criterion: str
    value: float
    relaxed_value: float
    relaxed_efficiency: float
    efficiency: float
    candidates: int
    poses: int
    parameters: tuple[str, ...]
    solver: str = ""
    polished_from: float | None = None
    value_in_base: float | None = None
    value_before: float | None = None
    notes: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        return as_file(self)


@dataclass(frozen=True, kw_only=True)
class _Proof(FileRecord):
    """plan.json, the proof beside a plan."""

    criterion: str
    certificate: PlanCertificate | None
    seed: int | None
    plan_sha256: str
    description: dict[str, str] | None = None


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Plan(Viewed):
    """n poses to measure: pendant and URDF angles (n, joints) rad, wrenches (n, 6), repeats (n,)."""

    pose: tuple[str, ...]
    pendant: Array
    q: Array
    wrench: Array
    load: tuple[str, ...]
    repeats: tuple[int, ...]
    criterion: str
    certificate: PlanCertificate | None
    seed: int | None
    units: JointUnits | None = None
    """Of the joints; None: all of them turn."""
    station: tuple[str, ...] = ()
    """Of each pose, where the experiment names stations."""
    robot: str = ""
    """The arm's name; "": nobody says."""

    @property
    def stations(self) -> tuple[str, ...]:
        """The station (n,) of each pose, "" where none is named."""
        return self.station or ("",) * len(self.pose)

    @property
    def of_positions(self) -> npt.NDArray[np.bool_]:
        """At which poses (n,) positions are read without a load; at the others displacements under one."""
        return ~np.any(self.wrench, axis=1)

    @property
    def poses(self) -> Poses:
        """Each planned pose once."""
        return Poses(self.pendant, self.q, self.wrench)

    def take(self, rows: Indices) -> Plan:
        """Some of the poses."""
        texts = {name: getattr(self, name) for name in ("pose", "load", "repeats", "station")}
        each: dict[str, Any] = {name: tuple(own[i] for i in rows) for name, own in texts.items() if own}
        return replace(self, **each, **{name: getattr(self, name)[rows] for name in ("pendant", "q", "wrench")})

    def repeated(self) -> Poses:
        """Each planned pose as often as it is to be measured, in the plan's order."""
        poses = self.poses.take(np.repeat(np.arange(len(self.pose)), self.repeats))
        before, after = (frozen((2.0 * np.arange(len(poses)) + k) / (2 * len(poses))) for k in (0.0, 1.0))
        came = frozen(came_from(poses.q, before))
        return replace(poses, unloaded=Conditions(order=before, came=came), loaded=Conditions(order=after, came=came))


def make_plan(
    poses: Poses,
    load: Sequence[str],
    repeats: Sequence[int] | None = None,
    criterion: str = "",
    certificate: PlanCertificate | None = None,
    seed: int | None = None,
    names: Sequence[str] | None = None,
    units: JointUnits | None = None,
    station: Sequence[str] = (),
    robot: str = "",
) -> Plan:
    """A plan from poses, named p01, p02, ... unless said."""
    count = len(poses)
    return Plan(
        pose=tuple(names or (f"p{i + 1:02d}" for i in range(count))),
        pendant=frozen(poses.pendant),
        q=frozen(poses.q),
        wrench=frozen(poses.wrench),
        load=tuple(load),
        repeats=tuple(int(r) for r in (repeats if repeats is not None else np.ones(count))),
        criterion=criterion,
        certificate=certificate,
        seed=seed,
        units=units,
        station=tuple(station) if any(station) else (),
        robot=robot,
    )


def joint_columns(experiment: Experiment, required: bool = True) -> list[Column]:
    """The columns q1, q2, ... of what the pendant shows, within the limits of the joints."""
    joints = experiment.robot.controller.units
    return [
        Column(f"q{k + 1}", "number", joints[k].si, required=required, whole=within_limits(experiment, k))
        for k in range(len(joints))
    ]


def _columns(experiment: Experiment) -> list[Column]:
    return [
        Column("pose", "text", required=True),
        *joint_columns(experiment),
        *force_columns(required=True),
        Column("load", "text"),
        Column("station", "text"),
        Column("repeats", "count"),
    ]


@checked
def write_plan(path: str | Path, plan: Plan, experiment: Experiment) -> None:
    """Write plan.csv, and beside it plan.json with criterion, certificate, seed and hashes.

    Args:
        path: the file.
        plan: the plan.
        experiment: its campaign.

    Raises:
        InputError: where it cannot be written.
    """
    path = Path(path)
    if path.suffix == ".json":
        raise InputError(Problem("a plan is a table with its proof beside it in .json; name it .csv", file=str(path)))
    joints = experiment.robot.controller.units
    header = ["pose", *joints.names(), *WRENCH_NAMES, "load", *(["station"] if plan.station else []), "repeats"]
    rows = [
        [
            plan.pose[i],
            *joint_cells(plan.pendant[i], joints),
            *map(number, plan.wrench[i].tolist()),
            plan.load[i],
            *plan.station[i : i + 1],
            str(plan.repeats[i]),
        ]
        for i in range(len(plan.pose))
    ]
    write_table(path, header, rows, [f"robot: {experiment.robot.name}"])
    beside = {
        "format": FORMAT,
        "criterion": plan.criterion,
        "certificate": plan.certificate.as_json() if plan.certificate else None,
        "seed": plan.seed,
        "robot": experiment.robot.name,
        "plan_sha256": sha256(path),
        "description": description(experiment.robot, experiment),
    }
    write_text(path.with_suffix(".json"), json.dumps(beside, indent=2, sort_keys=True) + "\n")


@checked
def read_plan(path: str | Path, experiment: Experiment) -> Plan:
    """Read a plan.csv and, if its hash matches, the certificate beside it.

    Args:
        path: the file.
        experiment: the campaign.

    Returns:
        The plan: pendant angles, rad, and wrenches, N and N m.

    Raises:
        InputError: with all problems, each with row and column.
    """
    path = Path(path)
    table = read_table(path, _columns(experiment), experiment.robot.name)
    pendant = table.columns(joint_stems(experiment.robot.controller.axes))
    names, station = table.text("pose"), table.text("station")
    wrench = table.columns(WRENCH, 0.0)
    problems = list(table.problems)
    problems += strength_problems(table, wrench, experiment.robot.payload, experiment.robot.gravity)
    problems += _repeated_poses(table, np.hstack([pendant, wrench]), station)
    problems += _station_problems(table, station, experiment)
    if not problems and not np.any(wrench) and not experiment.plans_positions:
        problems.append(nothing_bends(str(path)))
    refuse(problems)
    proof = _proof(path)
    poses = Poses(pendant, experiment.robot.controller.to_joints(pendant), wrench)
    load, repeats = table.text("load"), table.counts("repeats")
    units, robot = experiment.robot.controller.units, experiment.robot.name
    return make_plan(poses, load, repeats, proof.criterion, proof.certificate, proof.seed, names, units, station, robot)


def nothing_bends(file: str | None = None) -> Problem:
    """What is wrong with poses of which none has a load."""
    hint = "`positions: {}` in the experiment plans positions without a load."
    return Problem("every force is zero; nothing bends the arm", file, hint=hint)


def read_poses(path: str | Path, experiment: Experiment) -> Poses:
    """Read a list of poses, without loads: columns q1_deg, ...; InputError with all its problems."""
    path = Path(path)
    columns = [replace(c, required=c.required and c.stem.startswith("q")) for c in _columns(experiment)]
    table = read_table(path, columns, experiment.robot.name)
    refuse(table.problems)
    pendant = table.columns(joint_stems(experiment.robot.controller.axes))
    return Poses(pendant, experiment.robot.controller.to_joints(pendant), np.zeros((len(pendant), 6)))


def _station_problems(table: Table, station: Sequence[str], experiment: Experiment) -> list[Problem]:
    """Stations that the experiment does not have."""
    known = [s.name for s in experiment.stations]
    allowed = ", ".join(known) or "none: the experiment names no `stations`"
    return [
        table.problem(i, "station", f"no station {name!r}", allowed=allowed, hint=nearest(name, known))
        for i, name in enumerate(station)
        if name and name not in known
    ]


def _repeated_poses(table: Table, constant: Array, station: Sequence[str]) -> list[Problem]:
    """Names, and poses with the same angles, load and station, that stand in a plan more than once."""
    states = [(row.tobytes(), name) for row, name in zip(constant + 0.0, station, strict=True)]
    names = table.text("pose")
    first, same = (rows[group].tolist() for group, rows in map(numbered, (names, states)))
    problems: list[Problem] = []
    for i, name in enumerate(names):
        if first[i] != i:
            message = f"pose {name!r} stands here twice; first in line {table.rows[first[i]]}"
            problems.append(table.problem(i, "pose", message))
        elif same[i] != i and np.isfinite(constant[i]).all():
            message = f"pose {name!r} has the angles and the load of line {table.rows[same[i]]}; use the column repeats"
            problems.append(table.problem(i, "pose", message))
    return problems


def changed_since(path: Path, experiment: Experiment) -> tuple[str, ...]:
    """What of arm and campaign is described otherwise than when a plan was made, by the proof beside it."""
    proof = _proof(path)
    return tuple(changed_parts(proof.description, experiment.robot, experiment)) if proof.description else ()


def _proof(path: Path) -> _Proof:
    """The proof beside a plan; without its certificate where it is of another plan, empty where there is none."""
    beside = path.with_suffix(".json")
    if not beside.is_file():
        return _Proof(criterion="", certificate=None, seed=None, plan_sha256="")
    try:
        document = read_yaml(beside)
        check_format(document)
        proof = validate(document, _Proof)
    except InputError as error:
        told = (replace(p, message=f"is not the proof of a plan: {p.message}") for p in error.problems)
        raise InputError(told) from error
    return proof if proof.plan_sha256 == sha256(path) else replace(proof, certificate=None)


def within_limits(experiment: Experiment, k: int) -> WholeCheck:
    """The check of the column of joint k."""
    controller, joint = experiment.robot.controller, experiment.robot.facts.driven[k]
    unit, (lower, upper) = controller.units[k], controller.range_of(k)

    def outside(values: Array) -> npt.NDArray[np.bool_]:
        return ~((values >= lower - controller.tolerance) & (values <= upper + controller.tolerance))

    def check(numbers: Mapping[str, Array], name: str) -> tuple[int, Problem] | None:
        values = numbers[f"q{k + 1}"]
        rows = np.flatnonzero(np.isfinite(values) & outside(values))
        if not len(rows):
            return None
        first, known = float(values[rows[0]]), np.isfinite(values)
        slip = abs(first) > 2.0 * np.pi and not outside(values[rows[:1]] * unit.factor).any()
        hint = _units_hint(name) if slip else None
        fits = [words for words, other in joint_conventions(controller, numbers, k) if not outside(other[known]).any()]
        if hint is None and fits and len(set(values.tolist())) >= _ENOUGH:
            hint = f"All rows are inside with {', or with '.join(fits)}. Compare a pose with what the pendant shows."
        many = f" in {len(rows)} of {len(values)} rows, of which this is the first" if len(rows) > 1 else ""
        message = f"{joint} is outside its limits{many}"
        found, allowed = unit.text(first, 4), unit.between(lower, upper)
        return int(rows[0]), Problem(message, found=found, allowed=allowed, hint=hint)

    return check


def joint_conventions(controller: Controller, numbers: Mapping[str, Array], k: int) -> Iterator[tuple[str, Array]]:
    """Values (R,) of joint k under other conventions of the table, each with its words."""
    own, sliding = numbers[f"q{k + 1}"], controller.units.sliding
    yield f"the sign of q{k + 1} reversed", -own
    for j in (k - 1, k + 1):
        other = numbers.get(f"q{j + 1}")
        if other is not None and not sliding[k] and not sliding[j]:
            for sign, values in (("-", own - other), ("+", own + other)):
                yield f"q{k + 1} {sign} q{j + 1} in place of q{k + 1} (the axes are coupled)", values
    if sliding[k]:
        return
    for zero in (90, -90, 180, -180):
        yield f"q{k + 1} {'+' if zero > 0 else '-'} {abs(zero)} deg (another zero)", own + np.deg2rad(zero)
    yield f"q{k + 1} counted from -180 to 180 deg", (own + np.pi) % (2.0 * np.pi) - np.pi


def other_angles(controller: Controller, pendant: Array) -> Iterator[tuple[str, Array]]:
    """Pendant values (N, n) under other conventions of the log, each with its words."""
    count = pendant.shape[1]
    turning = ~np.array(controller.units.sliding)
    yield "with angles in rad, not in deg", np.where(turning, np.rad2deg(pendant), pendant)
    yield "with angles in deg, not in rad", np.where(turning, np.deg2rad(pendant), pendant)
    numbers = {f"q{k + 1}": pendant[:, k] for k in range(count)}
    for k in range(count):
        for words, column in joint_conventions(controller, numbers, k):
            changed = pendant.copy()
            changed[:, k] = column
            yield f"with {words}", changed
    for a, b in combinations(range(count), 2):
        order = np.arange(count, dtype=np.intp)
        order[[a, b]] = b, a
        yield f"with the columns q{a + 1} and q{b + 1} exchanged", pendant[:, order]


def _units_hint(name: str) -> str | None:
    """Of a column whose numbers would be allowed in deg, or mm."""
    stem, _, unit = name.partition("_")
    words = {"rad": ("degrees", "deg"), "m": ("millimetres", "mm")}.get(unit)
    return f"The number looks like {words[0]}: call the column {stem}_{words[1]}." if words else None
