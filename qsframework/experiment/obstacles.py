"""What stands around the robot: boxes, cylinders, planes and meshes in the base frame, from a file or in place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated

import numpy as np
import pydantic

from qsframework.errors import InputError, Problem, ProblemPlace
from qsframework.files import Document, FileModel, Unit, read_yaml, validate
from qsframework.plugin import Array
from qsframework.plugin.facts import frozen
from qsframework.robot import Robot
from qsframework.robot.collision import obstacle_collider
from qsframework.robot.kinematics import joint_frames
from qsframework.robot.mesh import Hull, mesh_of, solid_of
from qsframework.robot.packages import inside
from qsframework.robot.robot import NamedShape
from qsframework.robot.urdf import Origin

_COLOUR = (0.55, 0.45, 0.25, 0.55)
_TRIED = 64
_KINDS = ("box", "cylinder", "plane", "mesh")


class ObstacleSpec(FileModel):
    """One solid: a box by its sides, a cylinder by radius and length along its z axis, a plane by its normal, which
    looks to the side where the arm is, or a mesh by its file, whose lengths are multiplied by `scale`.

    at: its middle, a point of the plane, the origin of the mesh; turned: roll, pitch and yaw
    """

    box: Annotated[list[float] | None, Unit("m")] = None
    cylinder: Annotated[list[float] | None, Unit("m")] = None
    plane: list[float] | None = None
    mesh: str | None = None
    scale: float = pydantic.Field(default=1.0, gt=0)
    at: Annotated[list[float], Unit("m")] = pydantic.Field(default_factory=lambda: [0.0, 0.0, 0.0])
    turned: Annotated[list[float], Unit("rad")] = pydantic.Field(default_factory=lambda: [0.0, 0.0, 0.0])

    @pydantic.model_validator(mode="after")
    def _whole(self) -> ObstacleSpec:
        if sum(getattr(self, kind) is not None for kind in _KINDS) != 1:
            raise ValueError("is one of box_m: [x, y, z], cylinder_m: [radius, length], plane: [x, y, z], mesh: FILE")
        for name, count in (("box", 3), ("cylinder", 2), ("plane", 3), ("at", 3), ("turned", 3)):
            value = getattr(self, name)
            if value is not None and len(value) != count:
                raise ValueError(f"{name} needs {count} numbers")
        if min((*(self.box or ()), *(self.cylinder or ())), default=1.0) <= 0.0:
            raise ValueError("its sizes must be positive")
        if self.plane is not None and max(map(abs, self.plane)) < 1e-9:
            raise ValueError("the normal of a plane needs three numbers, not all zero")
        return self


class CellSpec(FileModel):
    """A file of obstacles, such as cell.yaml: `obstacles:` by their names."""

    obstacles: dict[str, ObstacleSpec] = pydantic.Field(examples=["{table: {box_m: [1, 1, 0.8], at_m: [2, 0, 0.4]}}"])


def read_obstacles(
    document: Document, given: Mapping[str, ObstacleSpec] | str, robot: Robot
) -> tuple[tuple[NamedShape, ...], list[Problem]]:
    """The obstacles of an experiment or of the file that it names beside itself, and what is wrong with them."""
    keys: tuple[str, ...] = ("constraints", "obstacles")
    if isinstance(given, str):
        try:
            document, given, keys = _file(document, given)
        except InputError as error:
            return (), list(error.problems)
    shapes: list[NamedShape] = []
    problems: list[Problem] = []
    for name, spec in given.items():
        place: ProblemPlace = {"file": str(document.path), "line": document.line(*keys, name)}
        try:
            shapes.append(_shape(name, spec, document.path.parent))
        except InputError as error:
            problems += [replace(p, message=f"obstacle {name!r}: {p.message}", **place) for p in error.problems]
            continue
        problems += [replace(p, **place) for p in _enclosing(robot, shapes[-1])]
    return tuple(shapes), problems


def _file(document: Document, name: str) -> tuple[Document, Mapping[str, ObstacleSpec], tuple[str, ...]]:
    path = document.path.parent / name
    if len(name) > 200 or not inside(path, document.path.parent):
        line = document.line("constraints", "obstacles")
        message = f"obstacles: {name[:80]!r} is outside the experiment's folder"
        raise InputError(Problem(message, str(document.path), line, hint="Put the file beside the experiment."))
    other = read_yaml(path)
    return other, validate(other, CellSpec).obstacles, ("obstacles",)


def _shape(name: str, spec: ObstacleSpec, folder: Path) -> NamedShape:
    """An obstacle as a solid of the base."""
    placement = Origin(np.array(spec.at), np.array(spec.turned)).matrix()
    if spec.plane is not None:
        placement[:3, :3] = placement[:3, :3] @ _facing(np.array(spec.plane))
        return NamedShape(0, frozen(placement), "plane", (), _COLOUR, name=name)
    if spec.mesh is not None:
        path = folder / spec.mesh
        if len(spec.mesh) > 200 or not inside(path, folder) or not path.is_file():
            hint = "Put the file beside the one that names it."
            raise InputError(Problem(f"there is no mesh {spec.mesh[:80]!r} in its folder", hint=hint))
        hull = _solid(path, path.stat().st_mtime_ns, spec.scale)
        return NamedShape(0, frozen(placement), "hull", (), _COLOUR, hull, name=name)
    if spec.box is not None:
        return NamedShape(0, frozen(placement), "box", tuple(spec.box), _COLOUR, name=name)
    return NamedShape(0, frozen(placement), "cylinder", tuple(spec.cylinder or ()), _COLOUR, name=name)


@lru_cache(maxsize=32)
def _solid(path: Path, changed: int, scale: float) -> Hull:
    """The hull of a mesh, with its surface. changed: when, so that a new file is read anew."""
    vertices, faces = mesh_of(path)
    return solid_of(scale * vertices, faces)


def _facing(normal: Array) -> Array:
    """A rotation (3, 3) whose z axis is the normal."""
    z = normal / np.linalg.norm(normal)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _enclosing(robot: Robot, obstacle: NamedShape) -> list[Problem]:
    """A problem where the arm touches an obstacle wherever it stands."""
    collider = obstacle_collider(robot, (obstacle,))
    if not len(collider.pairs):
        return []
    lower, upper = robot.controller.once_around()
    pendant = np.random.default_rng(0).uniform(lower, upper, (_TRIED, robot.controller.axes))
    if not collider.collides(joint_frames(robot.facts, robot.controller.to_joints(pendant))).all():
        return []
    message = f"obstacle {obstacle.name!r}: the arm touches it at every one of {_TRIED} poses"
    hint = "Its place is in the base frame, m unless the key says mm; walls around the arm are planes or boxes each."
    return [Problem(message, hint=hint)]
