"""The points of a programme as targets of `compensate`, and the corrected ones back into the programme's text.

A Cartesian point is the tool's pose in a user frame. What the controller holds of both is not in the programme, so both
must be stated: the tool in the flange's frame, the user frame in the base's. Then flange = frame point tool^-1.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from qsframework.applications.compensate import Compensation
from qsframework.applications.controller_names import MOST, axis_names
from qsframework.applications.inverse import TipPose, find_joints, rigid_tip
from qsframework.applications.programme_points import (
    POSES,
    ProgrammePoint,
    Source,
    incomplete,
    parse_source,
    read_source,
    replaced,
    skeleton,
)
from qsframework.applications.targets import Targets
from qsframework.errors import InputError, Problem, nearest
from qsframework.experiment import Experiment
from qsframework.plugin import Array
from qsframework.plugin.facts import frozen

_ANGLES = {"fanuc": ("J", 9), "kuka": ("A", MOST)}
_EULER = {"fanuc": "xyz", "kuka": "ZYX"}
_SEED = 0
_AGREES = 1e-4
"""mm or deg by which a number that was written may differ from the one that was meant."""
Tell = Callable[[str, int, int], None]


@dataclass(frozen=True, kw_only=True)
class ProgrammeWish:
    """What a programme does not say. loads: (6,) N and N m of each point, "" for all others; keep: points to leave as
    they are; tools, frames: (6,) as the controller shows them, mm and deg, by number; start (m,) rad or nothing: where
    the search for the joint angles of Cartesian points begins."""

    loads: Mapping[str, Array]
    keep: tuple[str, ...] = ()
    tools: Mapping[str, Array]
    frames: Mapping[str, Array]
    start: Array | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class ProgrammeTargets:
    """A programme with its points as targets, in the same order; `points` are those that are corrected."""

    source: Source
    points: tuple[ProgrammePoint, ...]
    targets: Targets
    wish: ProgrammeWish


def read_programme(
    path: Path, experiment: Experiment, wish: ProgrammeWish, tell: Tell | None = None
) -> ProgrammeTargets:
    """Read a programme and make targets of its points.

    InputError with every problem: what is malformed, points beyond the joint limits or out of reach, loads above the
    payload, and tools, frames or loads that are not stated, each with its line.
    """
    source = read_source(path)
    problems = [*_unknown(source, wish)]
    points = tuple(p for p in source.points if p.name not in wish.keep)
    if not points:
        raise InputError(Problem("every point is to be kept: nothing is left to correct", str(path)))
    names = _names(experiment, source)
    if any(experiment.robot.facts.sliding):
        message = "programmes are corrected of arms whose joints all turn only so far"
        raise InputError(
            Problem(message, file=str(path), hint="Give the targets as a table, q1_mm of a joint that slides.")
        )
    for point in points:
        problems += _point_problems(point, source, names, experiment, wish)
    if problems:
        raise InputError(problems)
    wrench = np.stack([wish.loads.get(p.name, wish.loads.get("", np.zeros(6))) for p in points])
    problems += [problem for i, p in enumerate(points) if (problem := _heavy(p, wrench[i], experiment)) is not None]
    pendant, wanted = _stand(
        experiment, source, points, names, wish, tell or (lambda label, done, total: None), problems
    )
    if problems:
        raise InputError(problems)
    targets = Targets(
        name=tuple(p.name for p in points),
        pendant=frozen(pendant),
        wanted=wanted,
        wrench=frozen(wrench),
        cartesian=any(p.cartesian for p in points),
        path=path,
        rows=tuple(p.line for p in points),
    )
    return ProgrammeTargets(source=source, points=points, targets=targets, wish=wish)


def corrected_texts(made: ProgrammeTargets, result: Compensation, experiment: Experiment) -> dict[Path, str]:
    """The programme's files with corrected points; joint points as joint angles, Cartesian ones as poses.

    They are read back: InputError if a point or anything else in them is not what was meant.
    """
    names, values = _names(experiment, made.source), dict[str, Mapping[str, float]]()
    flange = _flange(experiment, result.command)
    for i, point in enumerate(made.points):
        if point.cartesian:
            new = _shown(made.source.maker, _place(point, made.wish, made.source.maker, flange[i]), point)
        else:
            new = dict(zip(names, np.rad2deg(result.pendant[i]).tolist(), strict=True))
        values[point.name] = new
    texts = replaced(made.source, values)
    _proof(made.source, texts, values)
    return texts


def _proof(source: Source, texts: Mapping[Path, str], values: Mapping[str, Mapping[str, float]]) -> None:
    """InputError unless the texts hold these values, and everything else as the source has it."""
    back = parse_source(source.maker, texts)
    old, new = ({p.name: p for p in s.points} for s in (source, back))
    same = old.keys() == new.keys() and skeleton(back) == skeleton(source)
    for name, point in new.items() if same else ():
        meant = {**{k: c.value for k, c in old[name].cells.items()}, **values.get(name, {})}
        same = same and all(abs(cell.value - meant[k]) <= _AGREES for k, cell in point.cells.items())
    if not same:
        raise InputError("the corrected programme does not say what was meant, so it was not written")


def _unknown(source: Source, wish: ProgrammeWish) -> list[Problem]:
    """Names that the programme does not have, and loads that nobody stated."""
    names, path = [p.name for p in source.points], str(next(iter(source.texts)))
    problems = [
        Problem(f"the programme has no point {name!r}", path, allowed=", ".join(names[:20]), hint=nearest(name, names))
        for name in dict.fromkeys([*(n for n in wish.loads if n), *wish.keep])
        if name not in names
    ]
    if "" not in wish.loads and any(p.name not in wish.loads and p.name not in wish.keep for p in source.points):
        message = "a programme does not say what pulls at its points"
        hint = "State the force for all of them, or for each; 0,0,0 where nothing does."
        problems.append(Problem(message, path, hint=hint, argument=("load", "fx,fy,fz")))
    return problems


def _names(experiment: Experiment, source: Source) -> tuple[str, ...]:
    """The controller's names of the pendant's angles."""
    letter, most = _ANGLES[source.maker]
    controller = experiment.robot.controller
    return axis_names(controller.axes, controller.external, letter, most)


def _point_problems(
    point: ProgrammePoint, source: Source, names: Sequence[str], experiment: Experiment, wish: ProgrammeWish
) -> list[Problem]:
    here, controller = (str(point.path), point.line), experiment.robot.controller
    lacking = incomplete(point, POSES[source.maker] if point.cartesian else names)
    if lacking is not None:
        return [lacking]
    if not all(abs(cell.value) < 1e6 for cell in point.cells.values()):
        return [Problem(f"{point.name}: a number is out of all bounds", *here, allowed="up to 1e6 mm or deg")]
    beside = any(name[0] == "E" and cell.value != 0.0 for name, cell in point.cells.items())
    if point.cartesian and (controller.external or beside):
        return [
            Problem(f"{point.name}: a pose beside external axes is not corrected", *here, hint="State joint angles.")
        ]
    if point.cartesian:
        asked = (("tool", point.tool, wish.tools), ("frame", point.frame, wish.frames))
        return [
            Problem(
                f"{point.name} is a pose, and nobody states {what} {number or '(the point names no number)'}",
                *here,
                hint=f"As the controller shows it: {', '.join(POSES[source.maker])} in mm and deg.",
                argument=(what, f"{number or 'N'}=X,Y,Z,..."),
            )
            for what, number, stated in asked
            if _stated(number, stated) is None
        ]
    extra = [k for k in point.cells if k not in names and (k[0] != "E" or point.cells[k].value != 0.0)]
    pendant = np.deg2rad([point.cells[name].value for name in names])
    out = [Problem(f"{point.name}: the robot has no axis {k}", *here, allowed=", ".join(names)) for k in extra]
    for k in map(int, np.flatnonzero(controller.outside(pendant[None])[0])):
        low, high = np.rad2deg([controller.lower[k], controller.upper[k]])
        message, found = f"{point.name}: {names[k]} is outside its limits", f"{np.rad2deg(pendant[k]):g} deg"
        out.append(Problem(message, *here, found=found, allowed=f"{low:g} to {high:g} deg"))
    return out


def _stated(number: str, stated: Mapping[str, Array]) -> Array | None:
    """The tool or frame of a number; of a point without a number the only one that is stated."""
    if number:
        return stated.get(number)
    return next(iter(stated.values())) if len(stated) == 1 else None


def _heavy(point: ProgrammePoint, wrench: Array, experiment: Experiment) -> Problem | None:
    robot = experiment.robot
    if robot.payload is None or not experiment.constraints.load_capacity:
        return None
    force, most = float(np.linalg.norm(wrench[:3])), robot.payload * float(np.linalg.norm(robot.gravity))
    if force <= most:
        return None
    message, found = f"{point.name}: the force is more than the robot's payload", f"{force:.0f} N"
    return Problem(message, str(point.path), point.line, found=found, allowed=f"{robot.payload:g} kg, {most:.0f} N")


def _stand(
    experiment: Experiment,
    source: Source,
    points: Sequence[ProgrammePoint],
    names: Sequence[str],
    wish: ProgrammeWish,
    tell: Tell,
    problems: list[Problem],
) -> tuple[Array, TipPose]:
    """Pendant angles (N, m) of the points, and where the controller's kinematics put the load point there."""
    robot, site, rng = experiment.robot, experiment.load_site, np.random.default_rng(_SEED)
    lower, upper = robot.controller.once_around()
    last = 0.5 * (lower + upper) if wish.start is None else wish.start
    pendant, places, turns = list[Array](), list[Array](), list[Array]()
    for i, point in enumerate(points):
        tell("joint angles", i, len(points))
        if point.cartesian:
            wanted = _wanted(experiment, _from_file(source.maker, point, wish))
            found = find_joints(robot, site, wanted, last, rng)
            if not found.reached:
                near = f"{found.away * 1e3:.1f} mm and {np.rad2deg(found.turned):.2f} deg away at the nearest"
                message = f"{point.name}: no joint angles within the limits put the tool there"
                hint = "Look at the tool and the frame that were stated."
                problems.append(Problem(message, str(point.path), point.line, found=near, hint=hint))
            last = found.pendant if found.reached else last
        else:
            last = np.deg2rad([point.cells[name].value for name in names])
            wanted = rigid_tip(robot, site, robot.controller.to_joints(last[None]))
        pendant.append(last)
        places.append(wanted.position[0])
        turns.append(wanted.rotation[0])
    tell("joint angles", len(points), len(points))
    return np.stack(pendant), TipPose(np.stack(places), np.stack(turns))


def _pose(maker: str, values: Array) -> Array:
    """Matrix (4, 4) m of six numbers as the controller shows them, mm and deg."""
    from scipy.spatial.transform import Rotation

    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler(_EULER[maker], np.deg2rad(values[3:])).as_matrix()
    out[:3, 3] = values[:3] * 1e-3
    return out


def _tool_and_frame(point: ProgrammePoint, wish: ProgrammeWish, maker: str) -> tuple[Array, Array]:
    tool, frame = _stated(point.tool, wish.tools), _stated(point.frame, wish.frames)
    assert tool is not None
    assert frame is not None
    return _pose(maker, tool), _pose(maker, frame)


def _from_file(maker: str, point: ProgrammePoint, wish: ProgrammeWish) -> Array:
    """The flange (4, 4) in the base frame at a Cartesian point."""
    tool, frame = _tool_and_frame(point, wish, maker)
    values = np.array([point.cells[name].value for name in POSES[maker]])
    return np.asarray(frame @ _pose(maker, values) @ np.linalg.inv(tool), dtype=np.float64)


def _place(point: ProgrammePoint, wish: ProgrammeWish, maker: str, flange: Array) -> Array:
    """The tool (4, 4) in its user frame where the flange is at (4, 4)."""
    tool, frame = _tool_and_frame(point, wish, maker)
    return np.asarray(np.linalg.inv(frame) @ flange @ tool, dtype=np.float64)


def _shown(maker: str, place: Array, point: ProgrammePoint) -> dict[str, float]:
    """Six numbers of a pose as the controller shows them, angles on the turn of the point's own."""
    from scipy.spatial.transform import Rotation

    names = POSES[maker]
    with warnings.catch_warnings():  # where two of the three axes coincide, one angle is as good as another
        warnings.simplefilter("ignore", UserWarning)
        euler = np.rad2deg(Rotation.from_matrix(place[:3, :3]).as_euler(_EULER[maker]))
    own = np.array([point.cells[name].value for name in names[3:]])
    other = np.array([euler[0] + 180.0, 180.0 - euler[1], euler[2] + 180.0])
    turns = [angles + 360.0 * np.round((own - angles) / 360.0) for angles in (euler, other)]
    best = min(turns, key=lambda angles: float(np.abs(angles - own).max()))
    return dict(zip(names, [*(place[:3, 3] * 1e3).tolist(), *best.tolist()], strict=True))


def _wanted(experiment: Experiment, flange: Array) -> TipPose:
    """The pose of the load point with the flange at (4, 4)."""
    return TipPose((flange[:3, 3] + flange[:3, :3] @ experiment.load_point)[None], flange[None, :3, :3])


def _flange(experiment: Experiment, pose: TipPose) -> Array:
    """The flange (N, 4, 4) in the base frame of poses of the load point."""
    flange = np.tile(np.eye(4), (len(pose), 1, 1))
    flange[:, :3, :3] = pose.rotation
    flange[:, :3, 3] = pose.position - pose.rotation @ experiment.load_point
    return flange
