"""What a planned pose must keep: the values of `constraints:`, and what can be wrong with them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from qsframework.errors import Problem, ProblemPlace, nearest
from qsframework.experiment.spec import ConstraintsSpec, ExperimentSpec, SightSpec
from qsframework.files import Document
from qsframework.plugin import Array
from qsframework.plugin.facts import frozen
from qsframework.plugin.rotations import homogeneous
from qsframework.robot import Robot
from qsframework.robot.robot import NamedShape
from qsframework.units import allowed_names


@dataclass(frozen=True, eq=False)
class Sight:
    """A tracker at station (3,) m, base frame, that must see the markers (None: all of them).

    clearance, m: the last piece of the line of sight, at the marker, that no solid can hide;
    incidence_max, rad: largest angle between the line and the normal of a marker that has one
    """

    station: Array
    markers: tuple[str, ...] | None = None
    clearance: float = 0.005
    incidence_max: float | None = None


@dataclass(frozen=True, kw_only=True)
class Constraints:
    """What a planned pose must keep: positions and distances in m, pendant ranges in rad, in m where a joint slides.

    x_min .. z_max and axis1_distance_min speak of the point `of`;
    flip_margin, N m: torque that must keep the passive joints of every loop pressed on one side;
    collision: whether the arm's solids keep apart, None: where it has some; clearance, m, and a sphere of tool_radius
    at the load point hold for these, for the floor at its height and for the obstacles, solids of the base;
    singularity_margin: smallest singular value of the Jacobian, translations per length of the arm;
    load_capacity: whether the robot's stated torques are kept;
    joint_margin, rad: distance of turning joints to the controller's limits, None for the usual one;
    joint_values, rad or m: the only values at which a joint is planned, as the two-step method wants for joint 2
    """

    z_min: float | None = None
    axis1_distance_min: float | None = None
    of: str = "wrist_centre"
    joint_limits: dict[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    joint_margin: float | None = None
    flip_margin: float | None = None
    x_min: float | None = None
    x_max: float | None = None
    y_min: float | None = None
    y_max: float | None = None
    z_max: float | None = None
    collision: bool | None = None
    clearance: float = 0.0
    tool_radius: float | None = None
    floor: float | None = None
    obstacles: tuple[NamedShape, ...] = ()
    sight: Sight | None = None
    singularity_margin: float | None = None
    load_capacity: bool = True
    joint_values: dict[str, tuple[float, ...]] = field(default_factory=dict[str, tuple[float, ...]])


def make_constraints(spec: ConstraintsSpec, obstacles: tuple[NamedShape, ...] = ()) -> Constraints:
    """The constraints of a file's `constraints:`, with the obstacles that it names."""
    values = {name: getattr(spec, name) for name in type(spec).model_fields}
    limits, stated = spec.joint_limits | values.pop("joint_travel"), spec.joint_values | values.pop("joint_places")
    values["joint_limits"] = {joint: (ends[0], ends[1]) for joint, ends in limits.items()}
    values["joint_values"] = {joint: tuple(own) for joint, own in stated.items()}
    values["obstacles"] = obstacles
    values["sight"] = None if spec.sight is None else _sight(spec.sight)
    return Constraints(**values)


def _sight(spec: SightSpec) -> Sight:
    markers = None if spec.markers is None else tuple(spec.markers)
    return Sight(frozen(spec.station), markers, spec.clearance, spec.incidence_max)


def tool_shapes(radius: float | None, link: int, xyz: Array) -> tuple[NamedShape, ...]:
    """The sphere (m) at the load point, (3,) m in the frame of a link, that stands for the tool and the load."""
    if radius is None:
        return ()
    return (NamedShape(link, homogeneous(np.eye(3), xyz), "sphere", (radius,), (0.8, 0.1, 0.1, 1.0), name="tool"),)


def constraint_problems(document: Document, spec: ExperimentSpec, robot: Robot) -> list[Problem]:
    """What in `constraints:` does not fit the robot or the markers, with file and line."""
    problems: list[Problem] = []
    limits = spec.constraints
    places = ("wrist_centre", "flange", "load_point", *robot.frames)
    if limits.of not in places:
        message, allowed = f"constraints: unknown point {limits.of!r}", ", ".join(places)
        hint = nearest(limits.of, places)
        problems.append(document.problem(message, "constraints", "of", allowed=allowed, hint=hint))
    problems += _value_problems(document, spec, robot)
    for slides, stated in ((False, limits.joint_limits), (True, limits.joint_travel)):
        for joint, ends in stated.items():
            problems += _joint_problems(document, robot, joint, ends, slides)
    own = limits.collision or limits.sight is not None
    others = limits.floor is not None or bool(limits.obstacles)
    if not robot.shapes and (own or (others and limits.tool_radius is None)):
        keys = [k for k in ("collision", "sight", "floor", "obstacles") if getattr(limits, k) not in (None, False, ())]
        hint = "Give its links boxes, cylinders, spheres or meshes as visuals, or leave these constraints out."
        message = f"constraints: the robot's URDF has no solids to check {' and '.join(keys)} with"
        problems.append(document.problem(message, "constraints", hint=hint))
    if limits.sight is not None and limits.sight.incidence_max is not None:
        used = spec.markers if limits.sight.markers is None else limits.sight.markers
        if not any(name in spec.markers and spec.markers[name].normal is not None for name in used):
            message = "sight: incidence_max needs a marker with a normal"
            hint = "Give a marker its normal: [x, y, z], the way its opening looks, in the frame of its link."
            problems.append(document.problem(message, "constraints", "sight", hint=hint))
    for name in (limits.sight.markers or ()) if limits.sight is not None else ():
        if name not in spec.markers:
            allowed, hint = ", ".join(spec.markers), nearest(name, spec.markers)
            message = f"sight: no marker {name!r}"
            problems.append(document.problem(message, "constraints", "sight", allowed=allowed, hint=hint))
    return problems


def _line(document: Document, stem: str, joint: str) -> int | None:
    """Of a joint under `joint_limits_deg`, or another spelling of the stem."""
    found = [keys for keys in document.lines if keys[:1] == ("constraints",) and keys[2:] == (joint,)]
    key = next((str(keys[1]) for keys in found if str(keys[1]).startswith(stem + "_")), stem)
    return document.line("constraints", key, joint)


def _unit_problems(stem: str, robot: Robot, joint: str, slides: bool, here: ProblemPlace) -> list[Problem]:
    """What is wrong with the name of a joint, or with the unit of its values. slides: whether they are lengths"""
    if joint not in robot.facts.driven:
        return [Problem(f"{stem}: no joint {joint!r} on the pendant", **here, allowed=", ".join(robot.facts.driven))]
    if robot.facts.slides(joint) != slides:
        moves, unit = "turns" if slides else "slides", robot.facts.unit_of(joint)
        return [Problem(f"{stem}: {joint} {moves}", **here, allowed=allowed_names(stem, unit.si))]
    return []


def _joint_problems(document: Document, robot: Robot, joint: str, ends: list[float], slides: bool) -> list[Problem]:
    here: ProblemPlace = {"file": str(document.path), "line": _line(document, "joint_limits", joint)}
    wrong = _unit_problems("joint_limits", robot, joint, slides, here)
    if wrong:
        return wrong
    if len(ends) != 2 or ends[0] >= ends[1]:
        return [Problem(f"joint_limits of {joint} must be [lower, upper]", **here)]
    k = robot.facts.driven.index(joint)
    lower, upper = float(robot.controller.lower[k]), float(robot.controller.upper[k])
    if ends[1] < lower or ends[0] > upper:
        allowed = robot.controller.units[k].between(lower, upper)
        return [Problem(f"joint_limits of {joint} leave nothing of its range", **here, allowed=allowed)]
    return []


def _value_problems(document: Document, spec: ExperimentSpec, robot: Robot) -> list[Problem]:
    problems: list[Problem] = []
    limits = spec.constraints.joint_limits | spec.constraints.joint_travel
    turns, slides = spec.constraints.joint_values, spec.constraints.joint_places
    for joint, angles in (*turns.items(), *slides.items()):
        here: ProblemPlace = {"file": str(document.path), "line": _line(document, "joint_values", joint)}
        wrong = _unit_problems("joint_values", robot, joint, joint in slides, here)
        problems += wrong
        if wrong:
            continue
        k = robot.facts.driven.index(joint)
        unit = robot.controller.units[k]
        low, high = limits.get(joint, [-np.inf, np.inf])[:2]
        low, high = max(low, float(robot.controller.lower[k])), min(high, float(robot.controller.upper[k]))
        outside = [f"{a * unit.per:g}" for a in angles if not low <= a <= high]
        if not angles or outside:
            found = f"{', '.join(outside)} {unit.shown}" if outside else "no value"
            problems.append(Problem(f"joint_values of {joint}", **here, found=found, allowed=unit.between(low, high)))
    return problems


def capacity_problems(document: Document, spec: ExperimentSpec, robot: Robot) -> list[Problem]:
    """Loads that are heavier than the robot's stated payload."""
    if robot.payload is None or not spec.constraints.load_capacity:
        return []
    most = robot.payload * float(np.linalg.norm(robot.gravity))
    allowed = f"{robot.payload:g} kg, {most:.0f} N"
    hint = "A load meant to be heavier needs constraints: {load_capacity: false}."
    problems: list[Problem] = []
    message = "{} is more than the robot's payload"
    if spec.load.mass is not None and spec.load.mass > robot.payload:
        said = message.format(f"load: {spec.load.mass:g} kg")
        problems.append(document.problem(said, "load", allowed=allowed, hint=hint))
    for i, load in enumerate(spec.loads):
        force = float(np.linalg.norm(load.wrench()[:3]))
        if force > most:
            said = message.format(f"load {load.name!r}: {force:.0f} N")
            problems.append(document.problem(said, "loads", i, allowed=allowed, hint=hint))
    return problems
