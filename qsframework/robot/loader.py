"""`load_robot`: from the files of a robot to a frozen `Robot`; and which files a copy of it needs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from qsframework.arguments import checked
from qsframework.errors import InputError, Problem, nearest
from qsframework.files import Document, read_yaml, validate
from qsframework.plugin import Effect, Loop, Parameter, RobotFacts
from qsframework.plugin.facts import frozen
from qsframework.plugin.loops import own_joints, with_branches
from qsframework.plugin.trusted import trusted
from qsframework.robot.agreement import check_agreement
from qsframework.robot.checks import chain_joints, check_chain, check_structure, without_branches
from qsframework.robot.controller import Controller, joint_limits, read_actuated, read_controller
from qsframework.robot.model import build_model, read_branches, read_facts, read_frames, read_meshes, read_shapes
from qsframework.robot.packages import inside
from qsframework.robot.robot import LinkFrame, Robot
from qsframework.robot.search import ROBOT_NAME, find_robot, is_file
from qsframework.robot.spec import RobotSpec, coupling_text, read_effects, read_nominal
from qsframework.robot.urdf import Urdf, read_urdf

if TYPE_CHECKING:
    import pinocchio as pin

from collections.abc import Iterator

from qsframework.robot.expand import files_of
from qsframework.robot.mesh import mesh_file
from qsframework.robot.urdf import MeshVisual

T = TypeVar("T")


def as_robot(robot: object, beside: Path | None = None) -> Robot:
    """A robot, or the one that a name or a path means.

    Args:
        robot: a Robot, a shipped robot's name, or the path of its folder or robot.yaml.
        beside: a folder in which a relative path is looked for too.

    Returns:
        The Robot.

    Raises:
        InputError: where nothing of this name is found, its files are wrong, or the value is none of these.
    """
    if isinstance(robot, Robot):
        return robot
    if not isinstance(robot, str | Path):
        found = type(robot).__name__
        raise InputError(
            Problem("a robot is needed", found=found, allowed="a Robot, its name, or the path of its folder")
        )
    return load_robot(robot, beside)


@checked
def load_robot(name: str | Path, beside: Path | None = None, *, trust: bool | None = None) -> Robot:
    """Load a robot by name or path.

    Args:
        name: a shipped robot's name, or the path of its folder or robot.yaml.
        beside: a file beside which a relative path is looked for.
        trust: whether effects that it names by `file:` may run their code; None: as the command was given.

    Returns:
        The arm: kinematics, controller, effects and shapes.

    Raises:
        InputError: with all problems of its files, each with file and line.
    """
    document = read_yaml(find_robot(name, beside))
    reading = _Reading(document)
    spec, urdf = reading.structure()
    arm = without_branches(urdf, spec.base, spec.flange)
    model = build_model(arm, spec.base, frozen(spec.gravity))
    tree = build_model(urdf, spec.base, frozen(spec.gravity)) if len(arm.links) < len(urdf.links) else None
    facts, on_branches = _read_facts(spec, model, arm, tree, urdf)
    frames = read_frames(model)
    pendant = _Reading(document)
    actuated = pendant.attempt(read_actuated, document, spec, facts)
    if actuated is not None:
        facts = replace(facts, limits=joint_limits(actuated, facts))
    effects, problems = read_effects(document, spec.effects, facts, trust=trusted(trust))
    reading.problems += problems
    facts = with_branches(facts, effects)
    loops = [] if problems else [effect for effect in effects if isinstance(effect, Loop)]
    if not reading.follow(urdf, facts, None if problems else loops):
        reading.stop()  # what else could be said would follow from a joint that is missing
    reading.problems += pendant.problems
    controller = reading.attempt(read_controller, document, actuated, facts, loops) if actuated is not None else None
    parameters = reading.parameters(spec, effects, facts, complete=not problems)
    reading.stop()
    assert isinstance(controller, Controller)
    reading.mimics(urdf, facts, controller)
    entries = [spec.controller.get(joint) for joint in facts.joints]
    stated = [None if e is None else e.torque_limit or e.force_limit for e in entries]
    robot = Robot(
        name=spec.name,
        title=spec.title,
        folder=document.path.parent,
        model=model,
        facts=facts,
        controller=controller,
        effects=effects,
        parameters=parameters,
        frames=frames,
        shapes=read_shapes(arm, frames, document.path.parent),
        branch_shapes=read_shapes(urdf, on_branches, document.path.parent),
        meshes=read_meshes(urdf, {**frames, **on_branches}, document.path.parent),
        gravity=frozen(spec.gravity),
        payload=spec.payload,
        torque_limits=None if all(t is None for t in stated) else frozen([inf if t is None else t for t in stated]),
    )
    check_agreement(robot, document.path, tree)
    return robot


def _read_facts(
    spec: RobotSpec, model: pin.Model, arm: Urdf, tree: pin.Model | None, urdf: Urdf
) -> tuple[RobotFacts, dict[str, LinkFrame]]:
    """The arm's constants with its branches, and the links of the URDF on these."""
    facts = read_facts(spec.name, model, arm, spec.base, spec.flange, spec.payload)
    branches, frames = ((), {}) if tree is None else read_branches(tree, urdf, spec.base, facts)
    passive = tuple(joint for joint in facts.joints if joint not in spec.controller)
    bearings = tuple(spec.controller[joint].bearing if joint in spec.controller else None for joint in facts.joints)
    return replace(facts, passive=passive, branches=branches, bearings=bearings), frames


@dataclass
class _Reading:
    """One robot.yaml and the problems found so far in it and in the files that it names."""

    document: Document
    problems: list[Problem] = field(default_factory=list[Problem])

    def attempt(self, function: Callable[..., T], *arguments: Any) -> T | None:
        """The function's value; None, and its problems kept, if it raises InputError."""
        try:
            return function(*arguments)
        except InputError as error:
            self.problems += error.problems
            return None

    def stop(self) -> None:
        """Raise InputError if there are problems."""
        if self.problems:
            raise InputError(dict.fromkeys(self.problems))

    def structure(self) -> tuple[RobotSpec, Urdf]:
        """robot.yaml and its URDF, sound and matching."""
        spec = self.attempt(validate, self.document, RobotSpec)
        urdf = self.attempt(lambda: read_urdf(self.file("urdf"), self.document.path.parent))
        if urdf is not None:
            self.problems += check_structure(urdf)
        if spec is not None and urdf is not None:
            self._spec(spec, urdf)
        self.stop()
        assert spec is not None
        assert urdf is not None
        self.problems += check_chain(urdf, spec.base, spec.flange)
        self.stop()
        turning = [joint.name for joint in chain_joints(urdf, spec.base, spec.flange) or [] if joint.moves]
        for joint in spec.controller:
            if joint not in turning:
                allowed = ", ".join(turning)
                self.problem(
                    f"controller: joint {joint!r} does not move the flange", "controller", joint, allowed=allowed
                )
        self.stop()
        return spec, urdf

    def follow(self, urdf: Urdf, facts: RobotFacts, loops: Sequence[Loop] | None) -> bool:
        """Whether each joint has an angle on the pendant or follows by a loop, and a mimic follows; else problems.

        A branch always follows.

        loops: None where not all could be read
        """
        before = len(self.problems)
        turned = {joint for loop in loops or () for joint in own_joints(loop, facts)}
        for joint in (j for j in urdf.joints if j.name in facts.turning):
            driven, name = joint.name in facts.driven, joint.name
            if joint.mimic is not None:
                coupling, leader = coupling_text(name, joint.mimic), joint.mimic.joint
                if driven:
                    message = f"joint {name!r} follows {leader!r} by mimic and has no angle on the pendant"
                    hint = f"Leave {name} out of controller in robot.yaml, and add to effects: {coupling}"
                    self.problems.append(joint.place.problem(message, hint=hint))
                elif name not in turned and loops is not None:
                    message = f"joint {name!r} follows {leader!r} by mimic, and no effect in robot.yaml says so"
                    self.problems.append(joint.place.problem(message, hint=f"Add to effects: {coupling}"))
            elif name not in facts.joints and name not in turned and loops is not None:
                message = f"joint {name!r} moves beside the arm, and no effect in robot.yaml determines its angle"
                hint = (
                    'Make it type="fixed"; or name it in an effect: as lever or bar of a parallelogram, as a cylinder, '
                    f"or as the joint of a coupling, such as {{effect: coupling, joint: {name}, follows: "
                    f"{{{facts.joints[-1]}: 1}}}}."
                )
                self.problems.append(joint.place.problem(message, hint=hint))
            elif not driven and name not in turned and loops is not None:
                other = next(j for j in facts.joints if j != name) if facts.n > 1 else "JOINT"
                unit = facts.unit_of(name).shown
                hint = f"Add {name}: {{limits_{unit}: [.., ..]}}; or, where no actuator drives it, to effects "
                hint += f"{{effect: coupling, joint: {name}, follows: {{{other}: 1}}}} with the joints that it follows."
                self.problem(f"controller: no limits for {name!r}", "controller", hint=hint)
        return len(self.problems) == before

    def mimics(self, urdf: Urdf, facts: RobotFacts, controller: Controller) -> None:
        """A mimic of the chain says the same as the effect that turns the joint; InputError where it does not."""
        for joint in (j for j in urdf.joints if j.mimic is not None and j.name in facts.joints):
            assert joint.mimic is not None
            if joint.mimic.joint not in facts.joints:
                message = f"joint {joint.name!r} follows {joint.mimic.joint!r}, which does not move the flange"
                self.problems.append(joint.place.problem(message))
                continue
            own, other = facts.joint_index(joint.name), facts.joint_index(joint.mimic.joint)
            m, o = joint.mimic.multiplier, joint.mimic.offset
            rate, shift = m * controller.matrix[other], m * controller.offset[other] + o
            same = np.allclose(controller.matrix[own], rate, atol=1e-9)
            if not (same and math.isclose(controller.offset[own], shift, abs_tol=1e-9)):
                message = f"joint {joint.name!r}: mimic and the effects of robot.yaml say different things"
                hint = "The coupling in robot.yaml counts; make the two agree, or take the mimic out of the URDF."
                self.problems.append(joint.place.problem(message, found=f"{m:g} times {joint.mimic.joint}", hint=hint))
        self.stop()

    def parameters(
        self, spec: RobotSpec, effects: Sequence[Effect], facts: RobotFacts, complete: bool
    ) -> tuple[Parameter, ...]:
        """The effects' parameters with the values of nominal.yaml; complete: whether all effects could be read."""
        found = {p.name: p for effect in effects for p in effect.parameters(facts)}
        nominal = None if spec.nominal is None else self.attempt(lambda: read_yaml(self.file("nominal")))
        if nominal is not None:
            found, problems = read_nominal(nominal, found, effects, facts, complete=complete)
            self.problems += problems
        return tuple(found.values())

    def file(self, key: str) -> Path:
        """The path of a file that robot.yaml names, which must stay in the robot's folder."""
        name, folder = self.document.data.get(key), self.document.path.parent
        if not isinstance(name, str):
            raise InputError(())  # told by the model
        problem = None
        if len(name) > 200 or not inside(folder / name, folder):
            problem = "is outside the robot's folder"
        elif not is_file(folder / name):
            problem = "does not exist in the robot's folder"
        if problem:
            raise InputError(self.document.problem(f"{key}: {name[:80]!r} {problem}", key))
        return folder / name

    def problem(self, message: str, *keys: str, **more: Any) -> None:
        self.problems.append(self.document.problem(message, *keys, **more))

    def _spec(self, spec: RobotSpec, urdf: Urdf) -> None:
        links, joints = [link.name for link in urdf.links], [joint.name for joint in urdf.joints]
        if not ROBOT_NAME.fullmatch(spec.name):
            self.problem("name: use letters, digits, _ . and - only", "name", found=repr(spec.name))
        for key, link in (("base", spec.base), ("flange", spec.flange)):
            if link not in links:
                hint = nearest(link, links)
                self.problem(f"{key}: the URDF has no link {link!r}", key, allowed=", ".join(links), hint=hint)
        for joint in spec.controller:
            if joint not in joints:
                allowed, hint = ", ".join(joints), nearest(joint, joints)
                self.problem(
                    f"controller: the URDF has no joint {joint!r}", "controller", joint, allowed=allowed, hint=hint
                )
        if len(spec.gravity) != 3:
            self.problem("gravity must be three numbers", "gravity", found=repr(spec.gravity))
        if not 0 <= spec.limits_tolerance < 0.1:
            self.problem("limits_tolerance must be between 0 and 0.1 rad", "limits_tolerance")


def robot_files(robot_yaml: Path) -> tuple[Path, ...]:
    """Paths relative to the robot's folder of what a copy of it needs, without robot.yaml and nominal values."""
    folder = robot_yaml.parent
    urdf = folder / str(read_yaml(robot_yaml).data["urdf"])
    files = [*files_of(urdf, folder), *_meshes(urdf, folder)]
    files += [f for f in sorted(folder.glob("LICENSE*")) if f.is_file()]
    return tuple(dict.fromkeys(f.resolve().relative_to(folder.resolve()) for f in files if inside(f, folder)))


def _meshes(urdf: Path, folder: Path) -> Iterator[Path]:
    """Mesh files that the folder holds; a mesh that is nowhere is drawn by nobody here, so a copy does without it."""
    for link in read_urdf(urdf, folder).links:
        for solid in (*link.meshes, *link.collisions):
            path = mesh_file(solid, urdf, folder) if isinstance(solid, MeshVisual) else None
            if path is not None:
                yield path
