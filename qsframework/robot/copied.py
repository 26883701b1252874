"""The files that a robot is made of beside its robot.yaml: URDF or xacro, includes, meshes, licences."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from qsframework.files import read_yaml
from qsframework.robot.expand import files_of, read_tree
from qsframework.robot.packages import inside
from qsframework.robot.xml_tree import Node

_PACKAGE = "package://"


def robot_files(robot_yaml: Path) -> tuple[Path, ...]:
    """Paths relative to the robot's folder of what a copy of it needs, without robot.yaml and nominal values."""
    folder = robot_yaml.parent
    urdf = folder / str(read_yaml(robot_yaml).data["urdf"])
    files = [*files_of(urdf, folder), *_meshes(read_tree(urdf, folder), urdf, folder)]
    files += [f for f in sorted(folder.glob("LICENSE*")) if f.is_file()]
    return tuple(dict.fromkeys(f.resolve().relative_to(folder.resolve()) for f in files if inside(f, folder)))


def _meshes(root: Node, urdf: Path, folder: Path) -> Iterator[Path]:
    """Mesh files that the folder holds; a mesh elsewhere is drawn by nobody here, so a copy does without it."""
    for node in _every(root):
        name = node.get("filename")
        if node.tag != "mesh" or not name:
            continue
        inner = name.removeprefix(_PACKAGE)
        wanted = [folder / inner, folder / inner.partition("/")[2]] if inner != name else [urdf.parent / name]
        yield from (path for path in wanted if path.is_file())


def _every(node: Node) -> Iterator[Node]:
    yield node
    for child in node.children:
        yield from _every(child)
