"""The fitted rigid kinematics in the terms of other programs and of the controller.

Every file is read back and held to the fitted kinematics at random poses: what it differs by is part of the result. No
such file can hold what bends, or what changes with the pose; its parameters are named.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from qsframework.errors import InputError, Problem
from qsframework.experiment import Experiment
from qsframework.experiment.account import Account
from qsframework.files import read_yaml, sha256, write_text
from qsframework.files.plain import is_list, is_mapping
from qsframework.fits import FitRecord
from qsframework.fits.io import constant_geometry, refuse_through_loops, write_urdf
from qsframework.fits.soundness import check_fit
from qsframework.plugin import Array, Geometry
from qsframework.plugin.facts import frozen
from qsframework.plugin.rotations import homogeneous, turns
from qsframework.robot.corrected import moves, read_placements
from qsframework.robot.denavit import Denavit, Serial, denavit

CONVENTIONS = {"dh": "standard", "mdh": "modified (Craig)", "hayati": "standard with Hayati's beta"}
TOLD = 0.9
"""Share of a single number's variance that readings must have removed for it to go to a controller alone."""
_POSES = 200
_STEP = 1e-3
_FAR = 10.0
"""m: a d beyond it comes from axes that are nearly parallel."""
_UR_LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_UR_ALPHA = np.array([0.5, 0.0, 0.0, 0.5, -0.5]) * np.pi
_UR_POSE = ("x", "y", "z", "roll", "pitch", "yaw")
_UR_CLOSE = 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class Fitted:
    """A robot with its nominal and its fitted rigid kinematics.

    offsets (m,) rad: what is to be added to each angle on the pendant, their sds (m,), NaN where none is quoted, and
    the share (m,) of their variance before the readings that these removed, 1 where nothing was known; own (n,) rad:
    the part of each placement that turns its joint about its own axis, which does the same as an offset
    held: the estimated parameters in it; missing: the others, which bend the arm, change with the pose, or are of the
    campaign; x (p,): all values of the model; account: that of the fit
    """

    experiment: Experiment
    nominal: Serial
    serial: Serial
    offsets: Array
    offset_sd: Array
    offset_share: Array
    own: Array
    held: tuple[str, ...]
    missing: tuple[str, ...]
    x: Array
    account: Account
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Written:
    """A file, how far its kinematics are from the fitted ones at most, m and rad, and the joints with a far d."""

    path: Path
    away: float
    turned: float
    far: tuple[str, ...] = ()


def fitted(experiment: Experiment, fit: FitRecord, *, anyway: bool = False) -> Fitted:
    """The kinematics that a fit found. InputError for the fit of another robot or model, one that is not to be trusted
    unless `anyway`, or of an arm that slides."""
    notes = check_fit(fit, experiment.robot, experiment, anyway=anyway)
    sliding = [joint for joint in experiment.robot.facts.joints if experiment.robot.facts.slides(joint)]
    if sliding:
        message = f"{', '.join(sliding)} slides: corrected kinematics are written of joints that turn only so far"
        raise InputError(Problem(message, file=str(experiment.path)))
    robot, model, x = experiment.robot, experiment.model(), fit.x_of(experiment.model())
    angles, twists, varying = constant_geometry(model, x)
    names = {
        e.name: model.names[p] for e, p in zip(model.effects, model.slices, strict=True) if isinstance(e, Geometry)
    }
    held = {n for name, own in names.items() if name not in varying for n in own}
    facts, rows = robot.facts, list(robot.controller.driven)
    to_pendant = np.linalg.inv(robot.controller.matrix[rows])
    slope = np.zeros((facts.n, len(fit.names)))
    for k, name in enumerate(fit.names):
        if name in held and np.isfinite(fit.sd[k]):
            step = np.zeros(len(x))
            step[model.index([name])[0]] = _STEP
            slope[:, k] = (constant_geometry(model, x + step)[0] - angles) / _STEP
    slope = to_pendant @ slope[rows]
    sd = np.sqrt(np.einsum("ik,kl,il->i", slope, fit.whole_covariance + fit.held_covariance, slope))
    known = np.array([0.0 if e.prior_sd is None or e.share is None else e.prior_sd for e in fit.estimates])
    before = np.sqrt(np.square(slope * known).sum(axis=1))
    share = np.where(before > 0.0, 1.0 - np.square(sd / np.where(before > 0.0, before, 1.0)), 1.0)
    tool = robot.flange.placement
    placements = facts.placements @ moves(robot, twists, angles)
    return Fitted(
        experiment=experiment,
        nominal=Serial(facts.placements, facts.axes, tool),
        serial=Serial(frozen(placements), facts.axes, tool),
        offsets=frozen(to_pendant @ angles[rows]),
        offset_sd=frozen(np.where(slope.any(axis=1), sd, np.nan)),
        offset_share=frozen(np.clip(share, 0.0, 1.0)),
        own=frozen(np.einsum("kc,kc->k", twists[:, 3:], facts.axes)),
        missing=tuple(n for n in fit.names if n not in held),
        x=frozen(x),
        account=fit.account,
        held=tuple(n for n in fit.names if n in held),
        notes=notes,
    )


def _serial(one: Fitted) -> Serial:
    """The fitted kinematics of the chain. InputError where an offset passes through a loop."""
    model = one.experiment.model()
    refuse_through_loops(model, one.x, constant_geometry(model, one.x)[0])
    return one.serial


def write_fitted_urdf(one: Fitted, path: Path) -> Written:
    """The robot's URDF with corrected joint origins, read back by Pinocchio."""
    robot = one.experiment.robot
    write_urdf(robot, one.experiment.model(), one.x, path)
    return _compared(one, Serial(read_placements(robot, path), robot.facts.axes, one.serial.tool), path)


def write_table(one: Fitted, convention: str, path: Path) -> Written:
    """The table of Denavit and Hartenberg in one of the CONVENTIONS, as YAML, mm and deg."""
    table = denavit(_serial(one), convention == "hayati")
    before = denavit(one.nominal, convention == "hayati")
    joints = one.experiment.robot.facts.joints
    parts = {
        "dh": "Rz(theta + q) Tz(d) Tx(a) Rx(alpha)",
        "mdh": "Rx(alpha) Tx(a) Rz(theta + q) Tz(d)",
        "hayati": "Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Ry(beta)",
    }
    lines = [
        f"# base * product over the joints of [{parts[convention]}] * tool, q the URDF's joint angles",
        "# base and tool: a place, and the rotation as a quaternion; theta, alpha and beta turn right-handed",
        f"robot: {one.experiment.robot.name}",
        f"convention: {convention}",
        f"base: {_mapping(_pose(table.base))}",
        "joints:",
        *(f"  - {_mapping({'joint': joints[k], **_row(table, convention, k)})}" for k in range(len(joints))),
        f"tool: {_mapping(_pose(table.tool))}",
        "nominal:",
        *(f"  - {_mapping({'joint': joints[k], **_row(before, convention, k)})}" for k in range(len(joints))),
    ]
    write_text(path, "\n".join(lines) + "\n")
    far = tuple(joints[k] for k in np.flatnonzero(np.abs(table.d) > _FAR))
    return _compared(one, read_table(path).serial(), path, far)


def _row(table: Denavit, convention: str, k: int) -> dict[str, float]:
    """The four or five numbers of a joint: those to the next axis, of the modified table those from the one before."""
    n = len(table.theta)
    i = k - 1 if convention == "mdh" else k
    between = (table.a[i], table.alpha[i], table.beta[i]) if 0 <= i < n - 1 else (0.0, 0.0, 0.0)
    row = {"theta_deg": np.rad2deg(table.theta[k]), "d_mm": 1e3 * table.d[k]}
    row |= {"a_mm": 1e3 * between[0], "alpha_deg": np.rad2deg(between[1])}
    return row | ({"beta_deg": np.rad2deg(between[2])} if convention == "hayati" else {})


def _pose(matrix: Array) -> dict[str, float]:
    from scipy.spatial.transform import Rotation

    wxyz = np.roll(Rotation.from_matrix(matrix[:3, :3]).as_quat(), 1)
    first = next(v for v in wxyz if abs(v) > _HALF_TURN)  # at half a turn rounding decides on the sign of w
    values = np.concatenate([1e3 * matrix[:3, 3], np.copysign(1.0, first) * wxyz])
    return dict(zip(_POSE, values.tolist(), strict=True))


def _mapping(values: Mapping[str, Any]) -> str:
    cells = (f"{k}: {v if isinstance(v, str) else repr(float(v) + 0.0)}" for k, v in values.items())
    return "{" + ", ".join(cells) + "}"


def read_table(path: Path) -> Denavit:
    """Read back a table that `write_table` wrote. InputError with the line where it has been spoilt since."""
    document = read_yaml(path)
    data = document.data
    convention, rows = data.get("convention"), data.get("joints")
    if not isinstance(convention, str) or convention not in CONVENTIONS or not is_list(rows) or not rows:
        raise InputError(Problem("is no table of Denavit and Hartenberg", str(path), document.line("convention")))
    names = ["theta_deg", "d_mm", "a_mm", "alpha_deg", *(["beta_deg"] if convention == "hayati" else [])]
    cells = np.array([_numbers(path, document.line("joints", k), row, names) for k, row in enumerate(rows)])
    base, tool = (_matrix(path, document.line(key), data.get(key)) for key in ("base", "tool"))
    between = cells[1:] if convention == "mdh" else cells[:-1]
    beta = np.deg2rad(between[:, 4]) if convention == "hayati" else np.zeros(len(rows) - 1)
    return Denavit(
        theta=np.deg2rad(cells[:, 0]),
        d=cells[:, 1] * 1e-3,
        a=between[:, 2] * 1e-3,
        alpha=np.deg2rad(between[:, 3]),
        beta=beta,
        base=base,
        tool=tool,
    )


_HALF_TURN = 1e-12
"""Scalar part of a quaternion below which its rotation is a half turn."""
_POSE = ("x_mm", "y_mm", "z_mm", "quat_w", "quat_x", "quat_y", "quat_z")


def _numbers(path: Path, line: int | None, row: Any, names: Sequence[str]) -> list[float]:
    values = [row.get(name) if is_mapping(row) else None for name in names]
    good = [isinstance(v, int | float) and not isinstance(v, bool) and np.isfinite(v) for v in values]
    if not all(good):
        lacking = ", ".join(n for n, fine in zip(names, good, strict=True) if not fine)
        raise InputError(Problem(f"no finite number for {lacking}", str(path), line, allowed=", ".join(names)))
    return [float(v) for v in values if v is not None]


def _matrix(path: Path, line: int | None, row: Any) -> Array:
    """The pose (4, 4) of a row of the file."""
    from scipy.spatial.transform import Rotation

    values = np.array(_numbers(path, line, row, _POSE))
    if abs(float(np.linalg.norm(values[3:])) - 1.0) > 1e-6:
        raise InputError(Problem("a quaternion of a rotation has length 1", str(path), line))
    return homogeneous(Rotation.from_quat(values[[4, 5, 6, 3]]).as_matrix(), 1e-3 * values[:3])


def write_ur(one: Fitted, path: Path) -> Written:
    """The kinematics of a Universal Robots arm as its ROS driver reads them. InputError for an arm of another build."""
    from scipy.spatial.transform import Rotation

    serial = _serial(one)
    mounts, conventional = _ur_frames(one)
    steps = [mounts, *conventional]
    lines = ["kinematics:"]
    for k, link in enumerate(_UR_LINKS):
        origin = np.linalg.inv(steps[k]) @ serial.placements[k] @ steps[k + 1]
        values = [*origin[:3, 3], *Rotation.from_matrix(origin[:3, :3]).as_euler("xyz")]
        lines += [f"  {link}:", *(f"    {name}: {float(v) + 0.0!r}" for name, v in zip(_UR_POSE, values, strict=True))]
    write_text(path, "\n".join([*lines, "  hash: calib_qsf"]) + "\n")
    write_text(path, "\n".join([*lines, f"  hash: calib_{sha256(path)[:20]}"]) + "\n")
    tool = np.linalg.inv(conventional[-1]) @ serial.tool
    return _compared(one, read_ur(path, mounts, tool), path)


def read_ur(path: Path, mount: Array, tool: Array) -> Serial:
    """Read back a file that `write_ur` wrote, on a mount (4, 4) and with a tool (4, 4)."""
    from scipy.spatial.transform import Rotation

    document = read_yaml(path)
    found = document.data.get("kinematics")
    placements: list[Array] = []
    for link in _UR_LINKS:
        row = found.get(link) if is_mapping(found) else None
        values = np.array(_numbers(path, document.line("kinematics", link), row, _UR_POSE))
        placements.append(homogeneous(Rotation.from_euler("xyz", values[3:]).as_matrix(), values[:3]))
    placements[0] = mount @ placements[0]
    return Serial(np.stack(placements), np.tile([0.0, 0.0, 1.0], (len(_UR_LINKS), 1)), tool)


def _ur_frames(one: Fitted) -> tuple[Array, list[Array]]:
    """Where the driver's base stands, and its frame of each link in the joint's own frame, by the nominal arm."""
    table, alike = denavit(one.nominal), len(one.nominal.placements) == len(_UR_LINKS)
    zero = [table.theta, table.d[1:3], table.a[[0, 3, 4]], table.alpha - _UR_ALPHA] if alike else []
    if not alike or np.abs(np.concatenate(zero)).max() >= _UR_CLOSE:
        hint = "The axes, and where the angles are zero, must be as the maker's Denavit-Hartenberg numbers have them."
        words = f"{one.experiment.robot.name} is not built as a Universal Robots arm"
        raise InputError(Problem(words, hint=hint, argument=("ur", "")))
    d, a, quarter = table.d, table.a, 0.5 * np.pi
    steps = [(0, 0, d[0], 0), (0, 0, 0, quarter), (a[1], 0, 0, 0), (a[2], 0, d[3], 0)]
    steps += [(0, -d[4], 0, quarter), (0, d[5], 0, -quarter)]
    here, nominal, out = table.base, np.eye(4), list[Array]()
    for k, (x, y, z, roll) in enumerate(steps):
        step = homogeneous(turns(np.eye(3)[0], roll), np.array([x, y, z]))
        here, nominal = here @ step, nominal @ one.nominal.placements[k]
        out.append(np.asarray(np.linalg.solve(nominal, here), dtype=np.float64))
    return table.base, out


def offset_rows(one: Fitted) -> list[dict[str, str]]:
    """A row for each angle on the pendant: its offset in deg, and in turns and counts of the motor where stated."""
    controller, joints = one.experiment.robot.controller, one.experiment.robot.facts.driven
    rows: list[dict[str, str]] = []
    for k, joint in enumerate(joints):
        drive = controller.drives[k] if controller.drives else None
        turns_of_joint = float(one.offsets[k]) / (2.0 * np.pi)
        ratio, counts = (None, None) if drive is None else (drive.ratio, drive.counts)
        told, sd = one.offset_share[k] >= TOLD, one.offset_sd[k]
        motor = None if ratio is None or not told else turns_of_joint * ratio
        rows.append(
            {
                "joint": joint,
                "angle": f"J{k + 1}",
                "add_deg": f"{360.0 * turns_of_joint:z.6f}" if told else "",
                "sd_deg": f"{np.rad2deg(sd):.6f}" if np.isfinite(sd) else "",
                "motor_deg": "" if motor is None else f"{360.0 * motor:z.4f}",
                "counts": "" if motor is None or counts is None else f"{motor * counts:z.1f}",
                "identified_percent": f"{100.0 * one.offset_share[k]:.1f}",
                "in_placement_deg": f"{np.rad2deg(one.own[controller.driven[k]]):z.6f}",
            }
        )
    return rows


def write_offsets(one: Fitted, path: Path) -> Path:
    """`offset_rows` as a table."""
    from qsframework.experiment.columns import write_table as write_columns

    rows = offset_rows(one)
    comments = [
        f"robot: {one.experiment.robot.name}",
        "add_deg: to the angle on the pendant, then it is where the joint stands; counts: encoder counts of the motor",
        "identified_percent: share of its variance before the readings that they removed; below 90 it is not to be",
        "added alone, for other numbers do the same: take the whole kinematics",
        "in_placement_deg: a placement's turn about the joint's own axis, as an offset could do it too; not in add_deg",
    ]
    write_columns(path, list(rows[0]), [list(row.values()) for row in rows], comments)
    return path


def _compared(one: Fitted, read: Serial, path: Path, far: tuple[str, ...] = ()) -> Written:
    """The file with how far its arm is from the fitted one at random poses."""
    limits = one.experiment.robot.facts.limits
    low, high = np.tile([[-np.pi], [np.pi]], len(one.serial.placements)) if limits is None else limits.T
    q = np.random.default_rng(0).uniform(low, high, (_POSES, len(low)))
    here, there = read.forward(q), one.serial.forward(q)
    away = float(np.linalg.norm(here[:, :3, 3] - there[:, :3, 3], axis=1).max())
    turned = float(np.abs(here[:, :3, :3] - there[:, :3, :3]).max())
    return Written(path=path, away=away, turned=turned, far=far)


WRITERS: dict[str, Callable[[Fitted, Path], Written]] = {
    "urdf": write_fitted_urdf,
    "dh": lambda one, path: write_table(one, "dh", path),
    "mdh": lambda one, path: write_table(one, "mdh", path),
    "hayati": lambda one, path: write_table(one, "hayati", path),
    "ur": write_ur,
}
"""What writes each kind of file."""
