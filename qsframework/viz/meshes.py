"""Meshes of a URDF's visuals: read where they lie in the robot's folder and are not too large."""

from __future__ import annotations

import io
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from qsframework.plugin import Array, Indices
from qsframework.robot import Robot
from qsframework.robot.robot import MeshShape
from qsframework.viz.scene import Colour, Scene

KINDS = (".stl", ".obj", ".dae")
LARGEST = 20_000_000
"""Bytes of a mesh's file."""
MOST = 1_500_000
"""Triangles of one page: every drawn robot holds its own."""


class Meshes:
    """What can be drawn of a robot's meshes `copies` times on one page, and what has to be said of the others."""

    def __init__(self, robot: Robot, copies: int) -> None:
        self.drawn: list[tuple[MeshShape, Any]] = []
        self.notes: list[str] = []
        for shape in robot.meshes:
            problem, triangles = _triangles(shape)
            if problem:
                self.notes.append(f"Mesh {shape.name} is not drawn: {problem}; simple shapes stand for it.")
            else:
                self.drawn.append((shape, triangles))
        count = copies * sum(len(faces) for _, (_, faces) in self.drawn)
        if count > MOST:
            said = f"{count} triangles for {copies} drawings of {robot.name}, more than {MOST}"
            self.notes.append(f"Meshes are not drawn: {said}; simple shapes stand for them.")
            self.drawn = []

    @property
    def links(self) -> frozenset[int]:
        """Links with a mesh that is drawn."""
        return frozenset(shape.link for shape, _ in self.drawn)


def draw_meshes(
    scene: Scene, path: str, meshes: Meshes, opacity: float, tint: Colour | None, without: frozenset[int]
) -> None:
    """The meshes below the links that stand at `path`/link_..."""
    from meshcat import geometry

    make: Any = geometry.TriangularMeshGeometry
    for k, (shape, (vertices, faces)) in enumerate(meshes.drawn):
        if shape.link in without:
            continue
        colour = (*(tint or shape.rgba)[:3], shape.rgba[3] * opacity)
        solid = make(vertices * shape.scale, faces)
        scene.mesh(f"{path}/link_{shape.link}/mesh_{k}", solid, shape.placement, colour)


def _triangles(shape: MeshShape) -> tuple[str, tuple[Array, Indices]]:
    """Why a mesh cannot be drawn ("" if it can), its vertices (V, 3) and its faces (F, 3)."""
    nothing = np.zeros((0, 3)), np.zeros((0, 3), dtype=np.intp)
    if shape.path is None:
        return "it is not a file of the robot's folder", nothing
    if shape.path.suffix.lower() not in KINDS:
        return f"only {', '.join(KINDS)} are read", nothing
    state = shape.path.stat()
    if state.st_size > LARGEST:
        return f"{state.st_size / 1e6:.0f} MB, more than {LARGEST / 1e6:.0f}", nothing
    read = _read(shape.path, state.st_mtime_ns)
    return ("it cannot be read", nothing) if read is None else ("", read)


@lru_cache(maxsize=64)
def _read(path: Path, changed: int) -> tuple[Array, Indices] | None:
    """Vertices and faces of a file, None where it is no mesh; changed: when, so that a new one is read anew.

    The bytes alone are given away: no other file that the mesh names is opened.
    """
    from importlib import import_module

    trimesh: Any = import_module("trimesh")
    data = path.read_bytes()
    if b"<!" in data[:4096] and path.suffix.lower() == ".dae" and (b"<!DOCTYPE" in data or b"<!ENTITY" in data):
        return None
    try:
        mesh: Any = trimesh.load(io.BytesIO(data), file_type=path.suffix.lower()[1:], force="mesh", process=False)
        vertices, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.intp)
    except Exception:  # whatever a spoilt file makes the readers do, the page is drawn without it
        return None
    good = len(faces) > 0 and bool(np.isfinite(vertices).all()) and int(faces.max()) < len(vertices)
    return (vertices, faces) if good else None
