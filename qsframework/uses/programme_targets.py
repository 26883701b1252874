"""The points of a programme as targets of `compensate`, and the corrected ones back into the programme's text.

A Cartesian point is the tool's pose in a user frame. Where the programme does not state both in numbers they must be
stated: the tool in the flange's frame, the user frame in the base's. Then flange = frame point tool^-1.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from qsframework.errors import InputError, Problem, nearest, refuse, some_of
from qsframework.experiment import Experiment
from qsframework.plugin import Array
from qsframework.plugin.facts import frozen
from qsframework.plugin.language import axis_names, languages, maker_of, read_source, source_of
from qsframework.plugin.poses import Orientation, matrix, numbers_of
from qsframework.plugin.rotations import homogeneous
from qsframework.plugin.source import AMBIGUOUS, ProgrammeMotion, ProgrammePoint, Source, replaced, skeleton
from qsframework.uses.compensate import Compensation
from qsframework.uses.inverse import TipPose, find_joints, rigid_tip
from qsframework.uses.options import ProgrammeOptions
from qsframework.uses.targets import Targets

REFUSED = "refused"
"""The name that keeps every motion which the programme itself does not let correct."""
_SEED = 0
_LISTED = 20
"""Names in a sentence."""
Tell = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class _Case:
    """A programme, the experiment of its robot, and what is stated beside it."""

    source: Source
    experiment: Experiment
    options: ProgrammeOptions

    @cached_property
    def convention(self) -> Orientation:
        return languages()[self.source.language].pose

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The controller's names of the pendant's angles."""
        controller, convention = self.experiment.robot.controller, self.convention
        return axis_names(controller.axes, controller.external, convention.letter, convention.most)

    @cached_property
    def held(self) -> dict[str, dict[str, Array]]:
        """Matrices (4, 4) m of "tool" and "frame" by their names in small letters: as stated, else the programme's."""
        out: dict[str, dict[str, Array]] = {}
        own = (("tool", self.source.tools, self.options.tools), ("frame", self.source.frames, self.options.frames))
        for what, inside, beside in own:
            out[what] = {name.lower(): place for name, place in inside.items()}
            out[what] |= {name.lower(): matrix(self.convention, values) for name, values in beside.items()}
        return out

    def stated(self, point: ProgrammePoint) -> dict[str, Array | None]:
        """The tool and the frame of a point: those stated for the point, else those that it names."""
        named = {"tool": point.tool, "frame": point.frame}
        own, ambiguous = point.name.lower(), ("", AMBIGUOUS)
        return {
            what: self.held[what].get(own, None if name in ambiguous else self.held[what].get(name.lower()))
            for what, name in named.items()
        }

    def tool_and_frame(self, point: ProgrammePoint) -> tuple[Array, Array]:
        """The same where both are stated."""
        tool, frame = self.stated(point).values()
        assert tool is not None
        assert frame is not None
        return tool, frame

    def angles(self, point: ProgrammePoint) -> Array:
        """Pendant angles (m,) rad of a point of joint angles."""
        return np.array([point.cells[name].value for name in self.names]) * self.convention.angle


@dataclass(frozen=True, eq=False, kw_only=True)
class ProgrammeTargets:
    """A programme with its points as targets, in the same order; `points` are those that are corrected, `kept` the
    motions that stay as they are, `shared` those of them that only go to a point of another."""

    case: _Case
    points: tuple[ProgrammePoint, ...]
    kept: tuple[ProgrammeMotion, ...]
    shared: tuple[ProgrammeMotion, ...]
    targets: Targets

    @property
    def source(self) -> Source:
        return self.case.source

    @property
    def counts(self) -> dict[str, int]:
        """Motions that are corrected, kept and refused: of a programme that can be written none is refused."""
        return {"corrected": len(self.source.motions) - len(self.kept), "kept": len(self.kept), "refused": 0}

    @property
    def notes(self) -> tuple[str, ...]:
        """What of the programme is not corrected."""
        out, points = list[str](), {p.name for p in self.points}
        if self.kept:
            out.append(f"{len(self.kept)} motions are kept as they are: {_listed(self.kept)}")
        if self.shared:
            out.append(f"kept too, for they go to a point of one that is kept: {_listed(self.shared)}")
        moved = {name for motion in self.source.motions for name in motion.points}
        if unmoved := [p.name for p in self.source.points if p.name not in moved]:
            out.append(f"no motion of the programme goes to {some_of(unmoved, _LISTED)}: kept")
        if taken := sorted({n for p in self.points if p.cartesian for n in self._from_programme(p)}):
            listed = some_of(taken, _LISTED)
            out.append(f"as the programme itself states it, a frame in the URDF's base frame: {listed}")
        if used := _used(self.source, points):
            lines = some_of([str(line) for line in used], _LISTED)
            out.append(f"lines {lines} use corrected points by their names: what they compute is shifted with them")
        return tuple(out)

    def _from_programme(self, point: ProgrammePoint) -> set[str]:
        """Which of a point's tool and frame are those of the programme's own numbers."""
        names, owners = (point.tool, point.frame), (self.source.tools, self.source.frames)
        used = self.case.tool_and_frame(point)
        return {name for name, own, one in zip(names, owners, used, strict=True) if own.get(name) is one}


def _listed(motions: Sequence[ProgrammeMotion]) -> str:
    return some_of([f"line {m.line} {m.statement}" for m in motions], _LISTED, "; ")


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
    case = _Case(source, experiment, options)
    kept, shared, refused = _sorted_out(case)
    goes = {name for motion in _others(source.motions, kept) for name in motion.points}
    points = tuple(p for p in source.points if p.name in goes)
    refuse([*refused, *_unknown(source, options, points)])
    if not points:
        raise InputError(Problem("every point is to be kept: nothing is left to correct", str(path)))
    wrench = np.stack([options.loads.get(p.name, options.loads.get("", np.zeros(6))) for p in points])
    refuse([problem for i, p in enumerate(points) if (problem := _heavy(p, wrench[i], experiment)) is not None])
    pendant, wanted = _stand(case, points, tell or (lambda label, done, total: None))
    targets = Targets(
        name=tuple(p.name for p in points),
        pendant=frozen(pendant),
        wanted=wanted,
        wrench=frozen(wrench),
        cartesian=any(p.cartesian for p in points),
        path=path,
        rows=tuple(p.line for p in points),
        robot=experiment.robot.name,
    )
    return ProgrammeTargets(case=case, points=points, kept=tuple(kept), shared=tuple(shared), targets=targets)


def corrected_texts(made: ProgrammeTargets, result: Compensation, experiment: Experiment) -> dict[Path, str]:
    """The programme's files with corrected points; joint points as joint angles, Cartesian ones as poses.

    They are read back: InputError if a point or anything else in them is not what was meant.
    """
    values, convention = dict[str, Mapping[str, float]](), made.case.convention
    command = result.command
    flange = homogeneous(command.rotation, command.position - command.rotation @ experiment.load_point)
    for i, point in enumerate(made.points):
        if point.cartesian:
            tool, frame = made.case.tool_and_frame(point)
            place = np.linalg.inv(frame) @ flange[i] @ tool
            values[point.name] = numbers_of(convention, place, {k: c.value for k, c in point.cells.items()})
        else:
            angles = (result.pendant[i] / convention.angle).tolist()
            values[point.name] = dict(zip(made.case.names, angles, strict=True))
    texts = replaced(made.source, values, convention.decimals)
    _proof(made.source, texts, values)
    return texts


def _proof(source: Source, texts: Mapping[Path, str], values: Mapping[str, Mapping[str, float]]) -> None:
    """InputError unless the texts hold these values, and everything else as the source has it."""
    language = languages()[source.language]
    back, decimals = source_of(source.language, language, texts, source.encodings), language.pose.decimals
    old, new = ({p.name: p for p in s.points} for s in (source, back))
    same = old.keys() == new.keys() and skeleton(back) == skeleton(source)
    for name, point in new.items() if same else ():
        meant = {**{k: c.value for k, c in old[name].cells.items()}, **values.get(name, {})}
        same = same and all(abs(c.value - meant[k]) <= 10.0 ** -decimals(k) for k, c in point.cells.items())
    if not same:
        raise InputError("the corrected programme does not say what was meant, so it was not written")


def _check_robot(path: Path, source: Source, experiment: Experiment) -> None:
    """InputError for a programme of another maker's controller, and for an arm with a joint that slides."""
    maker, own = maker_of(experiment.robot.title), languages()[source.language].maker
    if maker not in (None, own):
        message = f"is a programme for controllers by {own}"
        hint = "Name the experiment of the robot that it runs on."
        raise InputError(Problem(message, str(path), found=experiment.robot.title, hint=hint))
    if any(experiment.robot.facts.sliding):
        message = "programmes are corrected of arms whose joints all turn only so far"
        hint = "Give the targets as a table, q1_mm of a joint that slides."
        raise InputError(Problem(message, str(path), hint=hint))


def _sorted_out(case: _Case) -> tuple[list[ProgrammeMotion], list[ProgrammeMotion], list[Problem]]:
    """The motions that are kept, those of them for a point that they share, and the problems of those that are refused,
    with the count of all before them."""
    source, keep = case.source, set(case.options.keep)
    inherent = {p.name: problem for p in source.points if (problem := _lacking(case, p)) is not None}
    asked = {p.name: list(_outside(case, p)) for p in source.points if p.name not in inherent}
    if REFUSED in keep:
        keep |= {f"line {m.line}" for m in source.motions if m.problem or inherent.keys() & set(m.points)}
    kept, shared = _kept(source.motions, keep)
    left = _others(source.motions, kept)
    refused = [m for m in left if m.problem or any(n in inherent or asked[n] for n in m.points)]
    problems = [m.problem for m in refused if m.problem]
    lines = dict[str, list[str]]()
    for motion, name in ((m, n) for m in refused if not m.problem for n in m.points):
        lines.setdefault(name, []).append(str(motion.line))
    for name, own in lines.items():
        where = some_of(own, _LISTED)
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
    return kept, shared, problems


def _others(motions: Sequence[ProgrammeMotion], kept: Sequence[ProgrammeMotion]) -> list[ProgrammeMotion]:
    held = set(map(id, kept))
    return [motion for motion in motions if id(motion) not in held]


def _kept(motions: Sequence[ProgrammeMotion], keep: set[str]) -> tuple[list[ProgrammeMotion], list[ProgrammeMotion]]:
    """Motions that are named, by their lines or their points, that go where the arm stands, or that share a point; and
    the last alone."""
    asked = [m.stands or bool({m.keep, f"line {m.line}", *m.points} & keep) for m in motions]
    kept, count = asked, -1
    while count != sum(kept):
        count = sum(kept)
        held = {name for motion, own in zip(motions, kept, strict=True) if own for name in motion.points}
        kept = [own or bool(held & set(motion.points)) for motion, own in zip(motions, kept, strict=True)]
    own = [(motion, named) for motion, named, held in zip(motions, asked, kept, strict=True) if held]
    return [motion for motion, _ in own], [motion for motion, named in own if not named]


def _unknown(source: Source, options: ProgrammeOptions, points: Sequence[ProgrammePoint]) -> list[Problem]:
    """Names that the programme does not have, and loads that nobody stated."""
    path, names = str(next(iter(source.texts))), [p.name for p in source.points]
    lines = [name for m in source.motions for name in (f"line {m.line}", m.keep)]
    problems = [
        Problem(f"no motion stands in {name} of the file", path, allowed=some_of(lines[::2], _LISTED))
        if name.startswith("line ")
        else Problem(
            f"the programme has no point {name!r}", path, allowed=some_of(names, _LISTED), hint=nearest(name, names)
        )
        for name in dict.fromkeys([*(n for n in options.loads if n), *options.keep])
        if name not in {*names, *((*lines, REFUSED) if name in options.keep else ())}
    ]
    if "" not in options.loads and any(p.name not in options.loads for p in points):
        message = "a programme does not say what pulls at its points"
        hint = "State the force for all of them, or for each; 0,0,0 where nothing does."
        problems.append(Problem(message, path, hint=hint, argument=("load", "fx,fy,fz")))
    return problems


def _lacking(case: _Case, point: ProgrammePoint) -> Problem | None:
    """Why a point cannot be corrected, whatever is stated beside the programme."""
    here, pose = (str(point.path), point.line), not point.cells.keys().isdisjoint(case.convention.axes)
    needed = case.convention.axes if pose else case.names
    missing = [name for name in needed if name not in point.cells]
    extra = [k for k in point.cells if k not in needed and (k[0] != "E" or point.cells[k].value != 0.0)]
    if point.problem is not None:
        return point.problem
    if missing:
        said = f"{point.name} lacks {', '.join(missing)}"
        said += f": {case.convention.left_out}" if case.convention.left_out else ""
        return Problem(said, *here, found=", ".join(point.cells) or "nothing")
    if not all(abs(cell.value) < 1e6 for cell in point.cells.values()):
        return Problem(f"{point.name}: a number is out of all bounds", *here, allowed="up to 1e6 mm or deg")
    if point.cartesian and (case.experiment.robot.controller.external or extra):
        return Problem(f"{point.name}: a pose beside external axes is not corrected", *here)
    if extra:
        return Problem(f"{point.name}: the robot has no axis {extra[0]}", *here, allowed=", ".join(case.names))
    return None


def _outside(case: _Case, point: ProgrammePoint) -> Iterator[Problem]:
    """What has to be stated for a point, or is stated wrongly: its tool and frame, angles beyond the joint limits."""
    here, controller = (str(point.path), point.line), case.experiment.robot.controller
    if point.cartesian:
        hint = f"As the controller shows it: {case.convention.stated}."
        differs = "(it is not the same on every way there; where motions differ in it, each needs a point of its own)"
        why = {"": "(the point names no number)", AMBIGUOUS: differs}
        for (what, stated), name in zip(case.stated(point).items(), (point.tool, point.frame), strict=True):
            if stated is None:
                message = f"{point.name} is a pose, and nobody states {what} {why.get(name, name)}"
                argument = (what, f"'{point.name if name in why else name}=X,Y,Z,...'")
                yield Problem(message, *here, hint=hint, argument=argument)
        return
    pendant, argument = case.angles(point), ("keep", f"'{point.name}'")
    for k in map(int, np.flatnonzero(controller.outside(pendant[None])[0])):
        low, high = np.rad2deg([controller.lower[k], controller.upper[k]])
        message = f"{point.name}: {case.names[k]} is outside its limits"
        found = f"{np.rad2deg(pendant[k]):g} deg"
        yield Problem(message, *here, found=found, allowed=f"{low:g} to {high:g} deg", argument=argument)


def _heavy(point: ProgrammePoint, wrench: Array, experiment: Experiment) -> Problem | None:
    robot = experiment.robot
    if robot.payload is None or not experiment.constraints.load_capacity:
        return None
    force, most = float(np.linalg.norm(wrench[:3])), robot.payload * float(np.linalg.norm(robot.gravity))
    if force <= most:
        return None
    message = f"{point.name}: the force is more than the robot's payload"
    found = f"{force:.0f} N"
    return Problem(message, str(point.path), point.line, found=found, allowed=f"{robot.payload:g} kg, {most:.0f} N")


def _stand(case: _Case, points: Sequence[ProgrammePoint], tell: Tell) -> tuple[Array, TipPose]:
    """Pendant angles (N, m) of the points, and where the controller's kinematics put the load point there."""
    robot, site, rng = case.experiment.robot, case.experiment.load_site, np.random.default_rng(_SEED)
    last = np.mean(robot.controller.once_around(), axis=0) if case.options.start is None else case.options.start
    pendant, stands, problems = list[Array](), list[TipPose](), list[Problem]()
    for i, point in enumerate(points):
        tell("joint angles", i, len(points))
        if point.cartesian:
            tool, frame = case.tool_and_frame(point)
            values = np.array([point.cells[name].value for name in case.convention.axes])
            flange = np.asarray(frame @ matrix(case.convention, values) @ np.linalg.inv(tool), dtype=np.float64)
            load_point = flange[:3, 3] + flange[:3, :3] @ case.experiment.load_point
            target = TipPose(load_point[None], flange[None, :3, :3])
            solution = find_joints(robot, site, target, last, rng)
            if not solution.reached:
                message = f"{point.name}: no joint angles within the limits put the tool there"
                hint = "Look at the tool and the frame that were stated, or keep the point."
                here, argument = (str(point.path), point.line), ("keep", f"'{point.name}'")
                problems.append(Problem(message, *here, found=solution.near, hint=hint, argument=argument))
            last = solution.pendant if solution.reached else last
        else:
            last = case.angles(point)
            target = rigid_tip(robot, site, robot.controller.to_joints(last[None]))
        pendant.append(last)
        stands.append(target)
    tell("joint angles", len(points), len(points))
    refuse(problems)
    position, rotation = np.concatenate([s.position for s in stands]), np.concatenate([s.rotation for s in stands])
    return np.stack(pendant), TipPose(position, rotation)
