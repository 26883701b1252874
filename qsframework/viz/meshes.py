"""Meshes of a URDF's visuals as they are drawn: coarser where one page would hold too many triangles."""

from __future__ import annotations

from qsframework.errors import InputError
from qsframework.plugin import Array, Indices
from qsframework.robot import Robot
from qsframework.robot.mesh import coarser, mesh_of
from qsframework.robot.robot import MeshShape
from qsframework.viz.scene import Colour, Scene

MOST = 200_000
"""Triangles of one page, which holds each mesh once: some 4 MB."""
FEWEST = 60
"""Triangles of a mesh that still look like it."""


class Meshes:
    """What can be drawn of a robot's meshes, and what has to be said of the others."""

    def __init__(self, robot: Robot) -> None:
        self.drawn: list[tuple[MeshShape, tuple[Array, Indices]]] = []
        self.notes: list[str] = []
        for shape in robot.meshes:
            try:
                if shape.path is None:
                    self.notes.append(_not_drawn(shape, "its file is not in the robot's folder"))
                else:
                    self.drawn.append((shape, mesh_of(shape.path)))
            except InputError as error:
                self.notes.append(_not_drawn(shape, error.problems[0].message))
        count = sum(len(faces) for _, (_, faces) in self.drawn)
        if count <= MOST:
            return
        said = f"{robot.name} has {count} triangles, more than {MOST}"
        reduced = [(shape, coarser(*mesh, len(mesh[1]) * MOST // count)) for shape, mesh in self.drawn]
        if any(len(faces) < FEWEST for _, (_, faces) in reduced):
            self.notes.append(f"Meshes are not drawn: {said}; simple shapes stand for them.")
            reduced = []
        else:
            self.notes.append(f"Meshes are drawn with fewer triangles: {said}.")
        self.drawn = reduced

    @property
    def links(self) -> frozenset[int]:
        """Links with a mesh that is drawn."""
        return frozenset(shape.link for shape, _ in self.drawn)


def draw_meshes(
    scene: Scene, path: str, meshes: Meshes, opacity: float, tint: Colour | None, without: frozenset[int]
) -> None:
    """The meshes below the links that stand at `path`/link_..."""
    for k, (shape, (vertices, faces)) in enumerate(meshes.drawn):
        if shape.link in without:
            continue
        colour = (*(tint or shape.rgba)[:3], shape.rgba[3] * opacity)
        where = f"{path}/link_{shape.link}/mesh_{k}"
        scene.mesh(where, vertices * shape.scale, faces, shape.placement, colour)


def _not_drawn(shape: MeshShape, why: str) -> str:
    return f"Mesh {shape.name} is not drawn: {why}; simple shapes stand for it."
