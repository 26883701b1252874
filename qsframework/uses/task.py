"""task.yaml: the work that robots are compared for: a path with forces, a slice of the workspace, a campaign.

It is said so that it means the same to every robot: the load point lies on the last axis, `tool` beyond the flange,
and `approach` is the way the tool points, base frame. How the tool is turned about the last axis is free.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import pydantic

from qsframework.arguments import checked
from qsframework.errors import Problem, ProblemPlace, refuse
from qsframework.experiment.spec import SHORTEST, LoadCaseSpec
from qsframework.files import FileModel, Unit, read_yaml, validate
from qsframework.plugin import Array
from qsframework.plugin.facts import frozen


def _direction(value: list[float]) -> list[float]:
    if len(value) != 3 or max(map(abs, value)) < SHORTEST:
        raise ValueError("approach needs three numbers, not all zero: the way the tool points, base frame")
    return value


Direction = Annotated[list[float], pydantic.AfterValidator(_direction)]
"""In which the tool points."""


class PointSpec(FileModel):
    """A point of the path, base frame, with the force and moment on the tool there."""

    approach: Direction | None = None
    xyz: Annotated[list[float], Unit("m")]
    fx: Annotated[float, Unit("N")] = 0.0
    fy: Annotated[float, Unit("N")] = 0.0
    fz: Annotated[float, Unit("N")] = 0.0
    mx: Annotated[float, Unit("N m")] = 0.0
    my: Annotated[float, Unit("N m")] = 0.0
    mz: Annotated[float, Unit("N m")] = 0.0

    @pydantic.field_validator("xyz")
    @classmethod
    def _three(cls, value: list[float]) -> list[float]:
        if len(value) != 3:
            raise ValueError("xyz needs three numbers, base frame")
        return value


class MapSpec(FileModel):
    """A slice x, z of the workspace at one y, and the force of its deflection map."""

    approach: Direction | None = None
    x: Annotated[list[float], Unit("m")]
    z: Annotated[list[float], Unit("m")]
    y: Annotated[float, Unit("m")] = 0.0
    steps: int = pydantic.Field(default=14, ge=2, le=100)
    fx: Annotated[float, Unit("N")] = 0.0
    fy: Annotated[float, Unit("N")] = 0.0
    fz: Annotated[float, Unit("N")] = 0.0

    @pydantic.model_validator(mode="after")
    def _ranges(self) -> MapSpec:
        for axis in ("x", "z"):
            ends = getattr(self, axis)
            if len(ends) != 2 or ends[0] >= ends[1]:
                raise ValueError(f"{axis} of the map needs [from, to]")
        if not any((self.fx, self.fy, self.fz)):
            raise ValueError("the map needs a force, such as fz_N: -1000")
        return self


class CampaignSpec(FileModel):
    """The campaign that every robot is given: as many poses, the same noise, the same loads.

    lever: how far to the side of the last axis the load hangs; on the axis it would tell nothing of the last joint
    """

    poses: int = pydantic.Field(default=12, ge=1, le=1000)
    candidates: int = pydantic.Field(default=300, ge=20, le=100000)
    sigma: Annotated[float, Unit("m")] = pydantic.Field(gt=0)
    lever: Annotated[float, Unit("m")] = pydantic.Field(default=0.2, ge=0)
    loads: list[LoadCaseSpec] = pydantic.Field(min_length=1)


class PathSpec(FileModel):
    """What a task.yaml says of the path."""

    title: str
    tool: Annotated[float, Unit("m")] = pydantic.Field(ge=0)
    approach: Direction
    path: list[PointSpec] = pydantic.Field(min_length=1)
    floor: Annotated[float | None, Unit("m")] = None


class WorkSpec(PathSpec):
    """task.yaml of which the path alone is asked for: no force needs to act."""

    map: MapSpec | None = None
    campaign: CampaignSpec | None = None


class TaskSpec(PathSpec):
    """task.yaml of a comparison."""

    map: MapSpec
    campaign: CampaignSpec


@dataclass(frozen=True, eq=False, kw_only=True)
class TaskPath:
    """Where a tool, m from the flange along the last axis, is to stand: points (P, 3) m, directions (P, 3) that it
    points in, wrenches (P, 6) on it, all base frame."""

    tool: float
    points: Array
    directions: Array
    wrenches: Array


def load_task_path(path: str | Path) -> TaskPath:
    """The path of a task.yaml. InputError with all its problems, each with file and line."""
    return _path_of(validate(read_yaml(path), WorkSpec))


def _path_of(spec: PathSpec) -> TaskPath:
    return TaskPath(
        tool=spec.tool,
        points=frozen([p.xyz for p in spec.path]),
        directions=frozen([_unit(p.approach or spec.approach) for p in spec.path]),
        wrenches=frozen([[p.fx, p.fy, p.fz, p.mx, p.my, p.mz] for p in spec.path]),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Task(TaskPath):
    """What is asked: a path, and beside it a map and a campaign.

    floor: its height, m, base frame; None: not known
    map_x, map_z (steps,) m at map_y, with map_direction (3,) and map_force (3,) N
    """

    path: Path
    title: str
    map_x: Array
    map_z: Array
    map_y: float
    map_direction: Array
    map_force: Array
    campaign: CampaignSpec
    floor: float | None = None


@checked
def load_task(path: str | Path) -> Task:
    """Read a task.yaml.

    Args:
        path: of the file.

    Returns:
        What is asked of the robots: a path or a box of points (m) with wrenches (N, N m), or a campaign.

    Raises:
        InputError: with all problems of the file, each with its line.
    """
    document = read_yaml(path)
    spec = validate(document, TaskSpec)
    work, allowed = _path_of(spec), "fx_N, fy_N, fz_N, mx_Nm, my_Nm, mz_Nm"
    problems = [
        Problem(f"path, point {i + 1}: no force acts there", str(path), document.line("path", i), allowed=allowed)
        for i in np.flatnonzero(~np.any(work.wrenches, axis=1)).tolist()
    ]
    names = [load.name for load in spec.campaign.loads]
    for i, load in enumerate(spec.campaign.loads):
        where: ProblemPlace = {"file": str(path), "line": document.line("campaign", "loads", i)}
        if names.index(load.name) != i:
            problems.append(Problem(f"load {load.name!r} stands here twice", **where))
        if not any(load.wrench()):
            problems.append(Problem(f"load {load.name!r} is zero", **where, allowed="fx_N, fy_N, fz_N"))
    refuse(problems)
    return Task(
        **vars(work),
        path=Path(path),
        title=spec.title,
        map_x=frozen(np.linspace(spec.map.x[0], spec.map.x[1], spec.map.steps)),
        map_z=frozen(np.linspace(spec.map.z[0], spec.map.z[1], spec.map.steps)),
        map_y=spec.map.y,
        map_direction=frozen(_unit(spec.map.approach or spec.approach)),
        map_force=frozen([spec.map.fx, spec.map.fy, spec.map.fz]),
        campaign=spec.campaign,
        floor=spec.floor,
    )


def _unit(direction: list[float]) -> Array:
    return np.array(direction) / np.linalg.norm(direction)
