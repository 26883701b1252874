"""The points of a programme as targets of `compensate`, and the corrected ones back into the programme's text.

A Cartesian point is the tool's pose in a user frame. Where the programme does not state both in numbers they must be
stated: the tool in the flange's frame, the user frame in the base's. Then flange = frame point tool^-1.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from qsframework.applications.compensate import Compensation
from qsframework.applications.controller_names import axis_names, maker_of
from qsframework.applications.inverse import TipPose, find_joints, rigid_tip
from qsframework.applications.programmes.names import AMBIGUOUS
from qsframework.applications.programmes.poses import POSES, Convention, matrix, numbers_of
from qsframework.applications.programmes.reading import parse_source, read_source
from qsframework.applications.programmes.source import Motion, ProgrammePoint, Source, replaced, skeleton
from qsframework.applications.targets import Targets
from qsframework.errors import InputError, Problem, nearest
from qsframework.experiment import Experiment
from qsframework.plugin import Array
from qsframework.plugin.facts import frozen

_TITLES = {"fanuc": "FANUC", "kuka": "KUKA", "abb": "ABB", "ur": "UNIVERSAL ROBOTS"}
REFUSED = "refused"
"""The name that keeps every motion which the programme itself does not let correct."""
_SEED = 0
_LISTED, _MOST = 20, 1000
"""Names in a sentence, and problems that are said at once."""
Held = Mapping[str, Mapping[str, Array]]
Tell = Callable[[str, int, int], None]


@dataclass(frozen=True, kw_only=True)
class ProgrammeOptions:
    """What a programme does not say. loads: (6,) N and N m of each point, "" for all others; keep: points and motions
    to leave as they are; tools, frames: (6,) as the controller shows them, by their names or by a point's; start (m,)
    rad or nothing: where the search for the joint angles of Cartesian points begins."""

    loads: Mapping[str, Array]
    keep: tuple[str, ...] = ()
    tools: Mapping[str, Array] = field(default_factory=dict[str, Array])
    frames: Mapping[str, Array] = field(default_factory=dict[str, Array])
    start: Array | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class ProgrammeTargets:
    """A programme with its points as targets, in the same order; `points` are those that are corrected, `kept` the
    motions that stay as they are; held: the matrices (4, 4) m of "tool" and "frame" by their names."""

    source: Source
    points: tuple[ProgrammePoint, ...]
    kept: tuple[Motion, ...]
    targets: Targets
    held: Held

    @property
    def counts(self) -> dict[str, int]:
        """Motions that are corrected, kept and refused: of a programme that can be written none is refused."""
        return {"corrected": len(self.source.motions) - len(self.kept), "kept": len(self.kept), "refused": 0}

    @property
    def notes(self) -> tuple[str, ...]:
        """What of the programme is not corrected."""
        out, points = list[str](), {p.name for p in self.points}
        if self.kept:
            listed = "; ".join(f"line {m.line} {m.statement}" for m in self.kept[:_LISTED])
            out.append(f"{len(self.kept)} motions are kept as they are: {_more(listed, self.kept)}")
        moved = {name for motion in self.source.motions for name in motion.points}
        if unmoved := [p.name for p in self.source.points if p.name not in moved]:
            out.append(f"no motion of the programme goes to {_more(', '.join(unmoved[:_LISTED]), unmoved)}: kept")
        if taken := sorted({n for p in self.points if p.cartesian for n in self._from_programme(p)}):
            listed = _more(", ".join(taken[:_LISTED]), taken)
            out.append(f"as the programme itself states it, a frame in the URDF's base frame: {listed}")
        if used := _used(self.source, points):
            lines = _more(", ".join(map(str, used[:_LISTED])), used)
            out.append(f"lines {lines} use corrected points by their names: what they compute is shifted with them")
        return tuple(out)

    def _from_programme(self, point: ProgrammePoint) -> set[str]:
        """Which of a point's tool and frame are those of the programme's own numbers."""
        names, owners = (point.tool, point.frame), (self.source.tools, self.source.frames)
        used = _tool_and_frame(point, self.held)
        return {name for name, own, one in zip(names, owners, used, strict=True) if own.get(name) is one}


def _more(listed: str, what: Sequence[object]) -> str:
    return listed + (f" and {len(what) - _LISTED} more" if len(what) > _LISTED else "")


def _used(source: Source, points: set[str]) -> list[int]:
    """Lines beside definitions and corrected motions that name a corrected point."""
    plain = {(m.statement.path, t.start) for m in source.motions if m.problem is None for t in m.statement.tokens}
    out = dict[int, None]()
    for line in source.lines:
        for token, following in itertools.pairwise([*line.tokens, line.tokens[-1]]):
            use = token.kind == "word" and following.text not in ("=", ":=") and (line.path, token.start) not in plain
            if use and {token.text, token.text.upper()} & points:
                out[token.line] = None
    return list(out)


def read_programme(
    path: Path, experiment: Experiment, options: ProgrammeOptions, tell: Tell | None = None
) -> ProgrammeTargets:
    """Read a programme and make targets of its points.

    InputError with every problem: what is malformed, motions that cannot be corrected and are not kept, points beyond
    the joint limits or out of reach, loads above the payload, and tools, frames or loads that are not stated.
    """
    source = read_source(path)
    _check_robot(path, source, experiment)
    names = _names(experiment, source)
    held = {what: _matrices(source, options, what) for what in ("tool", "frame")}
    kept, refused = _sorted_out(source, names, experiment, options, held)
    goes = {name for motion in _others(source.motions, kept) for name in motion.points}
    points = tuple(p for p in source.points if p.name in goes)
    problems = [*refused, *_unknown(source, options, points)]
    if problems:
        raise InputError(problems[:_MOST])
    if not points:
        raise InputError(Problem("every point is to be kept: nothing is left to correct", str(path)))
    wrench = np.stack([options.loads.get(p.name, options.loads.get("", np.zeros(6))) for p in points])
    problems += [problem for i, p in enumerate(points) if (problem := _heavy(p, wrench[i], experiment)) is not None]
    if problems:
        raise InputError(problems)
    start = options.start
    pendant, wanted = _stand(experiment, source, points, names, held, start, tell or (lambda label, done, total: None))
    targets = Targets(
        name=tuple(p.name for p in points),
        pendant=frozen(pendant),
        wanted=wanted,
        wrench=frozen(wrench),
        cartesian=any(p.cartesian for p in points),
        path=path,
        rows=tuple(p.line for p in points),
    )
    return ProgrammeTargets(source=source, points=points, kept=tuple(kept), targets=targets, held=held)


def corrected_texts(made: ProgrammeTargets, result: Compensation, experiment: Experiment) -> dict[Path, str]:
    """The programme's files with corrected points; joint points as joint angles, Cartesian ones as poses.

    They are read back: InputError if a point or anything else in them is not what was meant.
    """
    names, values = _names(experiment, made.source), dict[str, Mapping[str, float]]()
    convention, flange = POSES[made.source.maker], _flange(experiment, result.command)
    for i, point in enumerate(made.points):
        if point.cartesian:
            tool, frame = _tool_and_frame(point, made.held)
            place = np.linalg.inv(frame) @ flange[i] @ tool
            values[point.name] = numbers_of(convention, place, {k: c.value for k, c in point.cells.items()})
        else:
            angles = (result.pendant[i] / convention.angle).tolist()
            values[point.name] = dict(zip(names, angles, strict=True))
    texts = replaced(made.source, values, convention.decimals)
    _proof(made.source, texts, values)
    return texts


def _proof(source: Source, texts: Mapping[Path, str], values: Mapping[str, Mapping[str, float]]) -> None:
    """InputError unless the texts hold these values, and everything else as the source has it."""
    back, decimals = parse_source(source.maker, texts, source.encodings), POSES[source.maker].decimals
    old, new = ({p.name: p for p in s.points} for s in (source, back))
    same = old.keys() == new.keys() and skeleton(back) == skeleton(source)
    for name, point in new.items() if same else ():
        meant = {**{k: c.value for k, c in old[name].cells.items()}, **values.get(name, {})}
        same = same and all(abs(c.value - meant[k]) <= 10.0 ** -decimals(k) for k, c in point.cells.items())
    if not same:
        raise InputError("the corrected programme does not say what was meant, so it was not written")


def _check_robot(path: Path, source: Source, experiment: Experiment) -> None:
    """InputError for a programme of another maker's controller, and for an arm with a joint that slides."""
    maker, own = maker_of(experiment.robot.title), _TITLES[source.maker]
    if maker not in (None, own):
        message, hint = f"is a programme for controllers by {own}", "Name the experiment of the robot that it runs on."
        raise InputError(Problem(message, str(path), found=experiment.robot.title, hint=hint))
    if any(experiment.robot.facts.sliding):
        message = "programmes are corrected of arms whose joints all turn only so far"
        hint = "Give the targets as a table, q1_mm of a joint that slides."
        raise InputError(Problem(message, str(path), hint=hint))


def _sorted_out(
    source: Source,
    names: Sequence[str],
    experiment: Experiment,
    options: ProgrammeOptions,
    held: Held,
) -> tuple[list[Motion], list[Problem]]:
    """The motions that are kept, and the problems of those that are refused, with the count of all before them."""
    points, keep = {p.name: p for p in source.points}, set(options.keep)
    inherent, asked = dict[str, Problem](), dict[str, list[Problem]]()
    for point in points.values():
        if (problem := _lacking(point, source, names, experiment)) is not None:
            inherent[point.name] = problem
        else:
            asked[point.name] = list(_outside(point, source, names, experiment, held))
    if REFUSED in keep:
        keep |= {f"line {m.line}" for m in source.motions if m.problem or inherent.keys() & set(m.points)}
    kept = _kept(source.motions, keep)
    left = _others(source.motions, kept)
    refused = [m for m in left if m.problem or any(n in inherent or asked[n] for n in m.points)]
    problems = [m.problem for m in refused if m.problem]
    lines = dict[str, list[str]]()
    for motion, name in ((m, n) for m in refused if not m.problem for n in m.points):
        lines.setdefault(name, []).append(str(motion.line))
    for name, own in lines.items():
        where = _more(", ".join(own[:_LISTED]), own)
        hint = f"Mend it, or keep {name!r} as it is, where the motions of line {where} go."
        lacking = [replace(inherent[name], hint=hint, argument=("keep", f"'{name}'"))] if name in inherent else []
        problems += lacking or asked[name]
    if problems:
        message = f"{len(source.motions)} motions: {len(left) - len(refused)} can be corrected, {len(kept)} are kept, "
        message += f"{len(refused)} are refused, so nothing is written"
        hint = "All that the programme does not let correct may be kept as it is, together."
        argument = ("keep", REFUSED) if any(m.problem or inherent.keys() & set(m.points) for m in refused) else None
        hint = hint if argument else None
        problems.insert(0, Problem(message, str(next(iter(source.texts))), hint=hint, argument=argument))
    return kept, problems


def _others(motions: Sequence[Motion], kept: Sequence[Motion]) -> list[Motion]:
    held = set(map(id, kept))
    return [motion for motion in motions if id(motion) not in held]


def _kept(motions: Sequence[Motion], keep: set[str]) -> list[Motion]:
    """Motions that are named, by their lines or their points, that go where the arm stands, or that share a point."""
    kept = [m.stands or bool({m.keep, f"line {m.line}", *m.points} & keep) for m in motions]
    count = -1
    while count != sum(kept):
        count = sum(kept)
        held = {name for motion, own in zip(motions, kept, strict=True) if own for name in motion.points}
        kept = [own or bool(held & set(motion.points)) for motion, own in zip(motions, kept, strict=True)]
    return [motion for motion, own in zip(motions, kept, strict=True) if own]


def _unknown(source: Source, options: ProgrammeOptions, points: Sequence[ProgrammePoint]) -> list[Problem]:
    """Names that the programme does not have, and loads that nobody stated."""
    path, names = str(next(iter(source.texts))), [p.name for p in source.points]
    lines = [name for m in source.motions for name in (f"line {m.line}", m.keep)]
    problems = [
        Problem(
            f"the programme has no point {name!r}", path, allowed=", ".join(names[:_LISTED]), hint=nearest(name, names)
        )
        for name in dict.fromkeys([*(n for n in options.loads if n), *options.keep])
        if name not in {*names, *((*lines, REFUSED) if name in options.keep else ())}
    ]
    if "" not in options.loads and any(p.name not in options.loads for p in points):
        message = "a programme does not say what pulls at its points"
        hint = "State the force for all of them, or for each; 0,0,0 where nothing does."
        problems.append(Problem(message, path, hint=hint, argument=("load", "fx,fy,fz")))
    return problems


def _names(experiment: Experiment, source: Source) -> tuple[str, ...]:
    """The controller's names of the pendant's angles."""
    convention, controller = POSES[source.maker], experiment.robot.controller
    return axis_names(controller.axes, controller.external, convention.letter, convention.most)


def _lacking(point: ProgrammePoint, source: Source, names: Sequence[str], experiment: Experiment) -> Problem | None:
    """Why a point cannot be corrected, whatever is stated beside the programme."""
    here, needed = (str(point.path), point.line), POSES[source.maker].axes if point.cartesian else names
    missing = [name for name in needed if name not in point.cells]
    extra = [k for k in point.cells if k not in needed and (k[0] != "E" or point.cells[k].value != 0.0)]
    if point.problem is not None:
        return point.problem
    if missing:
        return Problem(f"{point.name} lacks {', '.join(missing)}", *here, found=", ".join(point.cells) or "nothing")
    if not all(abs(cell.value) < 1e6 for cell in point.cells.values()):
        return Problem(f"{point.name}: a number is out of all bounds", *here, allowed="up to 1e6 mm or deg")
    if point.cartesian and (experiment.robot.controller.external or extra):
        return Problem(f"{point.name}: a pose beside external axes is not corrected", *here)
    if extra:
        return Problem(f"{point.name}: the robot has no axis {extra[0]}", *here, allowed=", ".join(names))
    return None


def _outside(
    point: ProgrammePoint,
    source: Source,
    names: Sequence[str],
    experiment: Experiment,
    held: Held,
) -> Iterator[Problem]:
    """What has to be stated for a point, or is stated wrongly: its tool and frame, angles beyond the joint limits."""
    here, controller, convention = (str(point.path), point.line), experiment.robot.controller, POSES[source.maker]
    if point.cartesian:
        for what, name in (("tool", point.tool), ("frame", point.frame)):
            if _stated(point, name, held[what]) is None:
                said = {"": "(the point names no number)", AMBIGUOUS: "(it is not the same on every way there)"}
                message = f"{point.name} is a pose, and nobody states {what} {said.get(name, name)}"
                key = point.name if name in said else name
                argument = (what, f"'{key}=X,Y,Z,...'")
                yield Problem(
                    message, *here, hint=f"As the controller shows it: {convention.stated}.", argument=argument
                )
        return
    pendant = np.array([point.cells[name].value for name in names]) * convention.angle
    for k in map(int, np.flatnonzero(controller.outside(pendant[None])[0])):
        low, high = np.rad2deg([controller.lower[k], controller.upper[k]])
        message, found = f"{point.name}: {names[k]} is outside its limits", f"{np.rad2deg(pendant[k]):g} deg"
        argument = ("keep", f"'{point.name}'")
        yield Problem(message, *here, found=found, allowed=f"{low:g} to {high:g} deg", argument=argument)


def _matrices(source: Source, options: ProgrammeOptions, what: str) -> dict[str, Array]:
    """The tools, or the frames, by their names in small letters: as they are stated, else as the programme has them."""
    own, stated = (source.tools, options.tools) if what == "tool" else (source.frames, options.frames)
    return {name.lower(): place for name, place in own.items()} | {
        name.lower(): matrix(POSES[source.maker], values) for name, values in stated.items()
    }


def _stated(point: ProgrammePoint, name: str, matrices: Mapping[str, Array]) -> Array | None:
    """The tool or frame of a point: the one that is stated for the point, else the one that it names."""
    return matrices.get(point.name.lower(), matrices.get(name.lower()) if name not in ("", AMBIGUOUS) else None)


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
    held: Held,
    start: Array | None,
    tell: Tell,
) -> tuple[Array, TipPose]:
    """Pendant angles (N, m) of the points, and where the controller's kinematics put the load point there."""
    robot, site, rng = experiment.robot, experiment.load_site, np.random.default_rng(_SEED)
    convention = POSES[source.maker]
    lower, upper = robot.controller.once_around()
    last = 0.5 * (lower + upper) if start is None else start
    pendant, stands, problems = list[Array](), list[TipPose](), list[Problem]()
    for i, point in enumerate(points):
        tell("joint angles", i, len(points))
        if point.cartesian:
            wanted = _wanted(experiment, _from_file(convention, point, held))
            found = find_joints(robot, site, wanted, last, rng)
            if not found.reached:
                near = f"{found.away * 1e3:.1f} mm and {np.rad2deg(found.turned):.2f} deg away at the nearest"
                message = f"{point.name}: no joint angles within the limits put the tool there"
                hint = "Look at the tool and the frame that were stated, or keep the point."
                here, argument = (str(point.path), point.line), ("keep", f"'{point.name}'")
                problems.append(Problem(message, *here, found=near, hint=hint, argument=argument))
            last = found.pendant if found.reached else last
        else:
            last = np.array([point.cells[name].value for name in names]) * convention.angle
            wanted = rigid_tip(robot, site, robot.controller.to_joints(last[None]))
        pendant.append(last)
        stands.append(wanted)
    tell("joint angles", len(points), len(points))
    if problems:
        raise InputError(problems)
    position, rotation = np.concatenate([s.position for s in stands]), np.concatenate([s.rotation for s in stands])
    return np.stack(pendant), TipPose(position, rotation)


def _tool_and_frame(point: ProgrammePoint, held: Held) -> tuple[Array, Array]:
    tool, frame = _stated(point, point.tool, held["tool"]), _stated(point, point.frame, held["frame"])
    assert tool is not None
    assert frame is not None
    return tool, frame


def _from_file(convention: Convention, point: ProgrammePoint, held: Held) -> Array:
    """The flange (4, 4) in the base frame at a Cartesian point."""
    tool, frame = _tool_and_frame(point, held)
    values = np.array([point.cells[name].value for name in convention.axes])
    return np.asarray(frame @ matrix(convention, values) @ np.linalg.inv(tool), dtype=np.float64)


def _wanted(experiment: Experiment, flange: Array) -> TipPose:
    """The pose of the load point with the flange at (4, 4)."""
    return TipPose((flange[:3, 3] + flange[:3, :3] @ experiment.load_point)[None], flange[None, :3, :3])


def _flange(experiment: Experiment, pose: TipPose) -> Array:
    """The flange (N, 4, 4) in the base frame of poses of the load point."""
    flange = np.tile(np.eye(4), (len(pose), 1, 1))
    flange[:, :3, :3] = pose.rotation
    flange[:, :3, 3] = pose.position - pose.rotation @ experiment.load_point
    return flange
