"""What a planned pose must keep: the values of `constraints:`, and what can be wrong with them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from qsframework.errors import Place, Problem, nearest
from qsframework.experiment.spec import ConstraintsSpec, ExperimentSpec, SightSpec
from qsframework.files import Document
from qsframework.plugin import Array
from qsframework.plugin.facts import frozen
from qsframework.robot import Robot


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
    """What a planned pose must keep: positions and distances in m, pendant ranges in rad.

    x_min .. z_max and axis1_distance_min speak of the point `of`;
    flip_margin, N m: torque that must keep the passive joints of every loop pressed on one side;
    collision, with clearance and a sphere of tool_radius at the load point; floor: its height;
    singularity_margin: smallest singular value of the Jacobian, translations per length of the arm;
    load_capacity: whether the robot's stated torques are kept;
    joint_margin, rad: distance to the controller's limits, None for the usual one;
    joint_values, rad: the only angles at which a joint is planned, as the two-step method wants for joint 2
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
    collision: bool = False
    clearance: float = 0.0
    tool_radius: float | None = None
    floor: float | None = None
    sight: Sight | None = None
    singularity_margin: float | None = None
    load_capacity: bool = True
    joint_values: dict[str, tuple[float, ...]] = field(default_factory=dict[str, tuple[float, ...]])


def make_constraints(spec: ConstraintsSpec) -> Constraints:
    """The constraints of a file's `constraints:`."""
    values = {name: getattr(spec, name) for name in type(spec).model_fields}
    values["joint_limits"] = {joint: (ends[0], ends[1]) for joint, ends in spec.joint_limits.items()}
    values["joint_values"] = {joint: tuple(angles) for joint, angles in spec.joint_values.items()}
    values["sight"] = None if spec.sight is None else _sight(spec.sight)
    return Constraints(**values)


def _sight(spec: SightSpec) -> Sight:
    markers = None if spec.markers is None else tuple(spec.markers)
    return Sight(frozen(spec.station), markers, spec.clearance, spec.incidence_max)


def constraint_problems(document: Document, spec: ExperimentSpec, robot: Robot) -> list[Problem]:
    """What in `constraints:` does not fit the robot or the markers, with file and line."""
    problems: list[Problem] = []
    limits, file = spec.constraints, str(document.path)
    places = ("wrist_centre", "flange", "load_point", *robot.frames)
    if limits.of not in places:
        line = document.line("constraints", "of")
        problems.append(
            Problem(
                f"constraints: unknown point {limits.of!r}",
                file,
                line,
                allowed=", ".join(places),
                hint=nearest(limits.of, places),
            )
        )
    problems += _value_problems(document, spec, robot)
    for joint, ends in limits.joint_limits.items():
        problems += _joint_problems(document, robot, joint, ends)
    if (limits.collision or limits.floor is not None or limits.sight is not None) and not robot.shapes:
        hint = "Give its links boxes, cylinders or spheres as visuals."
        line = document.line("constraints")
        problems.append(Problem("constraints: the robot's URDF has no simple solids to check", file, line, hint=hint))
    if limits.sight is not None and limits.sight.incidence_max is not None:
        used = spec.markers if limits.sight.markers is None else limits.sight.markers
        if not any(name in spec.markers and spec.markers[name].normal is not None for name in used):
            line = document.line("constraints", "sight")
            hint = "Give a marker its normal: [x, y, z], the way its opening looks, in the frame of its link."
            problems.append(Problem("sight: incidence_max needs a marker with a normal", file, line, hint=hint))
    for name in (limits.sight.markers or ()) if limits.sight is not None else ():
        if name not in spec.markers:
            line, allowed = document.line("constraints", "sight"), ", ".join(spec.markers)
            hint = nearest(name, list(spec.markers))
            problems.append(Problem(f"sight: no marker {name!r}", file, line, allowed=allowed, hint=hint))
    return problems


def _joint_problems(document: Document, robot: Robot, joint: str, ends: list[float]) -> list[Problem]:
    here: Place = {"file": str(document.path), "line": document.line("constraints", "joint_limits_deg", joint)}
    if joint not in robot.facts.driven:
        return [
            Problem(f"joint_limits: no joint {joint!r} on the pendant", **here, allowed=", ".join(robot.facts.driven))
        ]
    if len(ends) != 2 or ends[0] >= ends[1]:
        return [Problem(f"joint_limits of {joint} must be [lower, upper]", **here)]
    k = robot.facts.driven.index(joint)
    lower, upper = float(robot.controller.lower[k]), float(robot.controller.upper[k])
    if ends[1] < lower or ends[0] > upper:
        allowed = f"{np.rad2deg(lower):g} to {np.rad2deg(upper):g} deg"
        return [Problem(f"joint_limits of {joint} leave nothing of its range", **here, allowed=allowed)]
    return []


def _value_problems(document: Document, spec: ExperimentSpec, robot: Robot) -> list[Problem]:
    problems: list[Problem] = []
    for joint, angles in spec.constraints.joint_values.items():
        file, line = str(document.path), document.line("constraints", "joint_values_deg", joint)
        if joint not in robot.facts.driven:
            problems.append(
                Problem(
                    f"joint_values: no joint {joint!r} on the pendant",
                    file,
                    line,
                    allowed=", ".join(robot.facts.driven),
                )
            )
            continue
        k = robot.facts.driven.index(joint)
        low, high = spec.constraints.joint_limits.get(joint, [-np.inf, np.inf])[:2]
        low, high = max(low, float(robot.controller.lower[k])), min(high, float(robot.controller.upper[k]))
        outside = [f"{np.rad2deg(a):g}" for a in angles if not low <= a <= high]
        if not angles or outside:
            allowed = f"{np.rad2deg(low):g} to {np.rad2deg(high):g} deg"
            found = ", ".join(outside) + " deg" if outside else "no angle"
            problems.append(Problem(f"joint_values of {joint}", file, line, found=found, allowed=allowed))
    return problems


def capacity_problems(document: Document, spec: ExperimentSpec, robot: Robot) -> list[Problem]:
    """Loads that are heavier than the robot's stated payload."""
    if robot.payload is None or not spec.constraints.load_capacity:
        return []
    most = robot.payload * float(np.linalg.norm(robot.gravity))
    allowed = f"{robot.payload:g} kg, {most:.0f} N"
    hint = "A load meant to be heavier needs constraints: {load_capacity: false}."
    problems: list[Problem] = []
    if spec.load.mass is not None and spec.load.mass > robot.payload:
        problems.append(
            Problem(
                f"load: {spec.load.mass:g} kg is more than the robot's payload",
                str(document.path),
                document.line("load"),
                allowed=allowed,
                hint=hint,
            )
        )
    for i, load in enumerate(spec.loads):
        force = float(np.linalg.norm(load.wrench()[:3]))
        if force > most:
            problems.append(
                Problem(
                    f"load {load.name!r}: {force:.0f} N is more than the robot's payload",
                    str(document.path),
                    document.line("loads", i),
                    allowed=allowed,
                    hint=hint,
                )
            )
    return problems
