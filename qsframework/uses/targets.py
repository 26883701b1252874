"""targets.csv: where the loaded tool is wanted, as joint angles or as poses of the load point, and the wrench there.

Joint targets: q1_deg, q2_deg, ... as the pendant shows them (q1_mm
of a joint that slides). Cartesian targets: x_mm, y_mm, z_mm of the load point in
the base frame and the flange's rotation, as rx_deg, ry_deg, rz_deg (turns about the fixed base axes x, then y, then z:
what FANUC calls W, P, R and KUKA C, B, A) or as a quaternion quat_w, quat_x, quat_y, quat_z. Joint angles in a
Cartesian file are where the search for the joint angles starts. An experiment without a load needs no forces.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from qsframework.arguments import checked
from qsframework.errors import InputError, Problem, refuse
from qsframework.experiment import Experiment
from qsframework.experiment.columns import (
    WRENCH,
    XYZ,
    Column,
    Table,
    force_columns,
    joint_stems,
    numbered,
    read_table,
    strength_problems,
)
from qsframework.experiment.plan import joint_columns
from qsframework.experiment.plausible_readings import no_load
from qsframework.files.documents import nearest_file
from qsframework.plugin import Array
from qsframework.plugin.facts import frozen
from qsframework.uses.inverse import TipPose, find_joints, rigid_tip
from qsframework.uses.stiffness import check_asked
from qsframework.viewed import Viewed

_TURNS = ("rx", "ry", "rz")
_QUATERNION = ("quat_w", "quat_x", "quat_y", "quat_z")
_TABLE = "Targets are joint angles q1_deg, ... or x_mm, y_mm, z_mm with rx_deg, ry_deg, rz_deg; and fx_N, fy_N, fz_N."
Tell = Callable[[str, int, int], None]
_SEED = 0
"""Random starts of the search are the same at every run."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Targets(Viewed):
    """N targets: names, pendant angles (N, n) rad that the controller would go to, wanted poses, wrenches (N, 6).

    robot: the arm's name
    path and rows (N,): where each stands in its file; `cartesian`: whether the file gave poses of the load point
    """

    name: tuple[str, ...]
    pendant: Array
    wanted: TipPose
    wrench: Array
    cartesian: bool
    path: Path | None
    rows: tuple[int, ...]
    robot: str = ""

    def __len__(self) -> int:
        return len(self.name)

    def problem(self, i: int, message: str, **more: Any) -> Problem:
        """A problem of target i, with its file and line."""
        return Problem(
            f"target {self.name[i]!r}: {message}", None if self.path is None else str(self.path), self.rows[i], **more
        )


@checked
def joint_targets(experiment: Experiment, pendant: Array, wrench: Array) -> Targets:
    """Targets at pendant angles under wrenches, named t01, t02, ...

    Args:
        experiment: the campaign.
        pendant: (N, n) what the pendant shows, rad, or m where a joint slides; (n,) of one target.
        wrench: (N, 6) force, N, and moment, N m, base frame; (6,) of one target.

    Returns:
        N targets.

    Raises:
        InputError: where an argument has another shape, a target is outside the limits or a force beyond the arm.
    """
    robot = experiment.robot
    pendant, wrench = np.atleast_2d(pendant), np.atleast_2d(wrench)
    axes = robot.controller.axes
    if pendant.shape[1:] != (axes,) or wrench.shape != (len(pendant), 6) or not np.isfinite(wrench).all():
        allowed = f"finite pendant (N, {axes}) and wrench (N, 6), a row of each per target"
        found = f"{pendant.shape} and {wrench.shape}"
        raise InputError(Problem("pendant and wrench: of other shapes, or not finite", found=found, allowed=allowed))
    check_asked(robot, pendant, wrench)
    wanted = rigid_tip(robot, experiment.load_site, robot.controller.to_joints(pendant))
    count = len(pendant)
    names = tuple(f"t{i + 1:02d}" for i in range(count))
    return Targets(
        name=names,
        pendant=frozen(pendant),
        wanted=wanted,
        wrench=frozen(wrench),
        cartesian=False,
        path=None,
        rows=tuple(range(1, count + 1)),
        robot=robot.name,
    )


@checked
def read_targets(path: str | Path, experiment: Experiment, tell: Tell | None = None) -> Targets:
    """Read and check a file of targets, and find joint angles of Cartesian ones.

    Args:
        path: the file.
        experiment: the campaign.
        tell: called with each step, its number and how many there are.

    Returns:
        N targets: joint values, rad or m, poses, m, and wrenches, N and N m.

    Raises:
        InputError: with all its problems, each with row and column.
    """
    path, robot = Path(path), experiment.robot
    if not path.exists():
        raise InputError(Problem("no such file", file=str(path), hint=f"{nearest_file(path) or ''} {_TABLE}".strip()))
    table = read_table(path, _columns(experiment), robot.name)
    wrench = table.columns(WRENCH, 0.0)
    if wrench.any():
        no_load(table, experiment)
    problems = list(table.problems)
    cartesian = any(stem in table.numbers for stem in (*XYZ, *_TURNS, *_QUATERNION))
    joints = joint_stems(robot.controller.axes)
    _complete(table, joints, cartesian)
    pendant = table.columns(joints) if joints[0] in table.numbers else None
    problems += _capacity(table, wrench, experiment)
    names = table.texts.get("target", [f"t{i + 1:02d}" for i in range(len(table.rows))])
    group, rows = numbered([name or i for i, name in enumerate(names)])
    problems += [
        table.problem(i, "target", f"target {names[i]!r} stands here twice; first in line {table.rows[first]}")
        for i, first in enumerate(rows[group])
        if first != i
    ]
    wanted = _poses(table, problems) if cartesian else None
    refuse(problems)
    if wanted is None:
        assert pendant is not None
        made = joint_targets(experiment, pendant, wrench)
        return replace(made, name=tuple(names), path=path, rows=tuple(table.rows))
    found = _joints(experiment, table, names, wanted, pendant, tell or (lambda label, done, total: None))
    return Targets(
        name=tuple(names),
        pendant=frozen(found),
        wanted=wanted,
        wrench=frozen(wrench),
        cartesian=True,
        path=path,
        rows=tuple(table.rows),
        robot=experiment.robot.name,
    )


def _columns(experiment: Experiment) -> list[Column]:
    """What a table of targets holds; where a load acts somewhere it says the forces."""
    return [
        Column("target", "text"),
        *joint_columns(experiment, required=False),
        *(Column(c, "number", "m") for c in XYZ),
        *(Column(c, "number", "rad") for c in _TURNS),
        *(Column(c, "number") for c in _QUATERNION),
        *force_columns(required=experiment.has_load),
    ]


def _complete(table: Table, joints: list[str], cartesian: bool) -> None:
    """InputError where a joint or a part of the pose is missing."""
    given = table.numbers
    groups = [(joints, not cartesian), (XYZ, cartesian)]
    groups += [(_QUATERNION, False)] if not any(s in given for s in _TURNS) else [(_TURNS, True)]
    missing = [
        s for stems, needed in groups if needed or any(t in given for t in stems) for s in stems if s not in given
    ]
    if cartesian and not any(s in given for s in (*_TURNS, *_QUATERNION)):
        missing += ["rx_deg, ry_deg, rz_deg or quat_w, quat_x, quat_y, quat_z"]
    if any(s in given for s in _TURNS) and any(s in given for s in _QUATERNION):
        raise InputError(Problem("the rotation is given twice", str(table.path), allowed="angles or a quaternion"))
    if missing:
        raise InputError(Problem(f"missing: {', '.join(missing)}", str(table.path), hint=_TABLE))


def _poses(table: Table, problems: list[Problem]) -> TipPose:
    """The wanted poses."""
    from scipy.spatial.transform import Rotation

    position = table.columns(XYZ)
    if _QUATERNION[0] in table.numbers:
        w, x, y, z = (table.numbers[c] for c in _QUATERNION)
        size = np.sqrt(w**2 + x**2 + y**2 + z**2)
        for i in map(int, np.flatnonzero(~(np.abs(size - 1.0) < 1e-3))):
            problems.append(table.problem(i, "quat_w", "a quaternion of a rotation has length 1", f"{size[i]:.4g}"))
        quaternion = np.stack([x, y, z, np.where(np.isfinite(w), w, 1.0)], axis=1)
        quaternion = np.where((size > 0)[:, None], np.nan_to_num(quaternion), [0.0, 0.0, 0.0, 1.0])
        turn = Rotation.from_quat(quaternion).as_matrix()
    else:
        angles = np.nan_to_num(table.columns(_TURNS))
        turn = Rotation.from_euler("xyz", angles).as_matrix()
    return TipPose(position, turn)


def _capacity(table: Table, wrench: Array, experiment: Experiment) -> list[Problem]:
    robot = experiment.robot
    refuse(strength_problems(table, wrench, robot.payload, robot.gravity))
    if robot.payload is None or not experiment.constraints.load_capacity:
        return []
    force, most = np.linalg.norm(wrench[:, :3], axis=1), robot.payload * float(np.linalg.norm(robot.gravity))
    hint = "A load meant to be heavier needs constraints: {load_capacity: false} in the experiment."
    message = "the force is more than the robot's payload"
    allowed = f"{robot.payload:g} kg, {most:.0f} N"
    rows = np.flatnonzero(force > most)
    return [table.problem(i, "fx", message, f"{force[i]:.0f} N", allowed, hint) for i in map(int, rows)]


def _joints(
    experiment: Experiment, table: Table, names: list[str], wanted: TipPose, starts: Array | None, tell: Tell
) -> Array:
    """Pendant angles (N, n) of Cartesian targets, each search begun at its own start or at the row before."""
    robot, rng = experiment.robot, np.random.default_rng(_SEED)
    lower, upper = robot.controller.once_around()
    last = 0.5 * (lower + upper)
    out: list[Array] = []
    problems: list[Problem] = []
    for i in range(len(wanted)):
        tell("joint angles", i, len(wanted))
        start = last if starts is None else starts[i]
        solution = find_joints(robot, experiment.load_site, wanted.take([i]), start, rng)
        if not solution.reached:
            message = f"target {names[i]!r}: no joint angles within the limits put the load point there"
            there = rigid_tip(robot, experiment.load_site, robot.controller.to_joints(solution.pendant[None]))
            turns = ", ".join(f"{angle:.2f}" for angle in np.rad2deg(flange_pose(there)[1][0]) + 0.0)
            hint = f"There rx_deg, ry_deg, rz_deg are {turns}. "
            hint += "Move the target closer, turn the tool, or give joint angles to start from."
            problems.append(Problem(message, str(table.path), table.rows[i], found=solution.near, hint=hint))
        else:
            last = solution.pendant
        out.append(solution.pendant)
    tell("joint angles", len(wanted), len(wanted))
    refuse(problems)
    return np.stack(out)


def flange_pose(pose: TipPose) -> tuple[Array, Array]:
    """The load point (N, 3) m and the flange's turns (N, 3) rad about the fixed axes x, y, z."""
    from scipy.spatial.transform import Rotation

    return pose.position, Rotation.from_matrix(pose.rotation).as_euler("xyz")
