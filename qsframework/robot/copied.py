"""The files that a robot is made of beside its robot.yaml: URDF or xacro, includes, meshes, licences."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from qsframework.files import read_yaml
from qsframework.robot.expand import files_of
from qsframework.robot.mesh import mesh_file
from qsframework.robot.packages import inside
from qsframework.robot.urdf import MeshVisual, read_urdf


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
