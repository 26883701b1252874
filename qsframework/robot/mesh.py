"""Meshes of a URDF: found in the robot's packages, read where they are not too large, and made convex or coarse."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from qsframework.errors import InputError, Problem
from qsframework.plugin import Array, Indices
from qsframework.plugin.facts import frozen
from qsframework.robot.packages import Sources, inside
from qsframework.robot.urdf import MeshVisual

KINDS = (".stl", ".obj", ".dae")
LARGEST = 20_000_000
"""Bytes of a mesh's file."""
_LONGEST = 1000
_CORNERS, _DIRECTIONS = 150, 400
"""Most corners of a hull; directions of a sphere in which they are the outermost."""
_THIN = 1e-4
"""m, to each side of a mesh that is flat."""
_CONVEX = 0.999
"""Share of its hull's volume above which a mesh is taken as convex."""
_SPACE = "package://"


class BrokenMesh(InputError):
    """A file that holds no mesh."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Hull:
    """A convex solid: corners (V, 3) m, faces (F, 3) of them, and planes normals (K, 3) x <= offsets (K,) m.

    whole (W, 3) m: all corners, where the others are only the outermost in so many directions; volume m3 of these;
    surface: the mesh of which it is the hull, where that is not convex
    """

    corners: Array
    faces: Indices
    normals: Array
    offsets: Array
    whole: Array
    volume: float
    surface: Surface | None = None


@dataclass(frozen=True, eq=False)
class Surface:
    """A mesh as it is, not made convex: vertices (V, 3) m, faces (F, 3)."""

    vertices: Array
    faces: Indices

    def holds(self, point: Array) -> bool:
        """Whether a point (3,) lies inside: the triangles surround it, seen from there, by more than half."""
        a, b, c = (self.vertices[self.faces[:, k]] - point for k in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        spat = np.einsum("fi,fi->f", a, np.cross(b, c))
        rest = la * lb * lc + _dot(a, b) * lc + _dot(b, c) * la + _dot(c, a) * lb
        return bool(abs(np.arctan2(spat, rest).sum()) > np.pi)  # half of each solid angle; 2 pi all around


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("fi,fi->f", a, b), dtype=np.float64)


def mesh_file(mesh: MeshVisual, urdf: Path, folder: Path, sources: Sources | None = None) -> Path | None:
    """The file of a mesh: beside the URDF, in the robot's folder or one of its packages; None where there is none.

    InputError with file and line where the name leads out of these.
    """
    sources, name = sources or Sources(), mesh.name
    rest = name.removeprefix("file://")
    roots = [folder, sources.home(folder), *sources.packages.values()]
    tried = [urdf.parent / rest, folder / rest]
    if name.startswith(_SPACE):
        package, _, rest = name.removeprefix(_SPACE).partition("/")
        found = sources.find(package, folder)
        roots += [] if found is None else [found]
        tried = [*([] if found is None else [found / rest]), folder / rest, urdf.parent / rest]
    if len(name) > _LONGEST or "\0" in name:
        raise InputError(mesh.place.problem("the name of a mesh is too long or no name", found=repr(name[:80])))
    there = [path for path in tried if path.is_file()]
    good = [path for path in there if any(inside(path, root) for root in roots)]
    if there and not good:
        message = f"mesh {name[:80]!r} lies outside the robot's folder and packages, and is not read"
        hint = "Put the file into the folder of the robot or of a package that it names."
        raise InputError(mesh.place.problem(message, hint=hint, argument=sources.argument))
    return good[0] if good else None


def read_mesh(mesh: MeshVisual, path: Path) -> tuple[Array, Indices]:
    """Vertices (V, 3) m and faces (F, 3) of a mesh, its scale applied.

    InputError with the file and line that name it where the file is too large or broken.
    """
    try:
        vertices, faces = mesh_of(path)
    except InputError as error:
        told = [mesh.place.problem(f"mesh {mesh.name!r}: {p.message}", hint=p.hint) for p in error.problems]
        raise type(error)(told) from error
    return vertices * mesh.scale, faces


def mesh_of(path: Path) -> tuple[Array, Indices]:
    """Vertices (V, 3) in the file's unit, faces (F, 3). InputError for a file too large, broken or of another kind."""
    if path.suffix.lower() not in KINDS:
        raise InputError(Problem(f"only {', '.join(KINDS)} are read", file=str(path)))
    state = path.stat()
    if state.st_size > LARGEST:
        message = f"{state.st_size / 1e6:.0f} MB, more than {LARGEST / 1e6:.0f}"
        hint = "Write it with fewer triangles, or put a box or a cylinder in its place."
        raise InputError(Problem(message, file=str(path), hint=hint))
    read = _read(path, state.st_mtime_ns)
    if read is None:
        raise BrokenMesh(Problem("it cannot be read", file=str(path)))
    return read


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
    except Exception:  # whatever a spoilt file makes the readers do, it is no mesh
        return None
    good = len(faces) > 0 and bool(np.isfinite(vertices).all()) and int(faces.max()) < len(vertices)
    return (frozen(vertices), faces) if good else None


def convex_hull(points: Array) -> Hull:
    """The convex hull of points (N, 3) m; its faces, where it has very many, of those outermost in 400 directions."""
    points, hull = _hull(points)
    whole, volume = frozen(points[hull.vertices]), float(hull.volume)
    if len(whole) > _CORNERS:
        points, hull = _hull(whole[np.unique(np.argmax(whole @ _sphere(_DIRECTIONS).T, axis=0))])
    equations: Array = np.asarray(hull.equations, dtype=np.float64)
    planes = np.unique(np.round(equations, 9), axis=0)
    return Hull(
        corners=frozen(points[hull.vertices]),
        faces=_outward(points, hull),
        normals=frozen(planes[:, :3]),
        offsets=frozen(-planes[:, 3]),
        whole=whole,
        volume=volume,
    )


def whole_hull(points: Array) -> tuple[Array, Indices]:
    """Vertices (V, 3) and faces (F, 3) of the convex hull of points (N, 3) m, none of which is outside."""
    points, hull = _hull(points)
    return points[hull.vertices], _outward(points, hull)


def _hull(points: Array) -> tuple[Array, Any]:
    """Points (N, 3) m and their hull by qhull; flat ones made a little thick."""
    from importlib import import_module

    spatial: Any = import_module("scipy.spatial")
    try:
        return points, spatial.ConvexHull(points)
    except (spatial.QhullError, ValueError):
        points = np.concatenate([points + way for way in (*_THIN * np.eye(3), *-_THIN * np.eye(3))])
        return points, spatial.ConvexHull(points)


def solid_of(vertices: Array, faces: Indices) -> Hull:
    """The convex hull of a mesh (V, 3) m, (F, 3), with the mesh itself where it is not as good as convex."""
    hull = convex_hull(vertices)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    convex = abs(float(np.einsum("fi,fi->f", a, np.cross(b, c)).sum() / 6.0)) > _CONVEX * hull.volume
    return hull if convex else replace(hull, surface=Surface(frozen(vertices), faces))


def _outward(points: Array, hull: Any) -> Indices:
    """The triangles (F, 3) of a hull, as numbers of its corners, each turned so that it is seen from outside."""
    faces = np.array(hull.simplices, dtype=np.intp)
    first, second, third = (points[faces[:, k]] for k in range(3))
    turned = np.einsum("fi,fi->f", np.cross(second - first, third - first), hull.equations[:, :3]) < 0.0
    faces[turned] = faces[turned][:, ::-1]
    place = np.zeros(len(points), dtype=np.intp)
    place[hull.vertices] = np.arange(len(hull.vertices))
    return place[faces]


def _sphere(count: int) -> Array:
    """Directions (count, 3) spread evenly."""
    k = np.arange(count) + 0.5
    polar, around = np.arccos(1.0 - 2.0 * k / count), np.pi * (1.0 + 5.0**0.5) * k
    return np.stack([np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)], axis=1)


def coarser(vertices: Array, faces: Indices, most: int) -> tuple[Array, Indices]:
    """A mesh (V, 3), (F, 3) with at most so many triangles: vertices in one cell of a grid become one."""
    if len(faces) <= most:
        return vertices, faces
    low, size = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max())
    cells = max(2.0, (most / 2.0) ** 0.5)
    while True:
        _, label = np.unique(np.floor((vertices - low) / size * cells).astype(np.intp), axis=0, return_inverse=True)
        label = label.ravel()
        found = label[faces]
        found = found[(found[:, 0] != found[:, 1]) & (found[:, 1] != found[:, 2]) & (found[:, 2] != found[:, 0])]
        _, first = np.unique(np.sort(found, axis=1), axis=0, return_index=True)
        found = found[np.sort(first)]
        if len(found) <= most or cells <= 2.0:
            break
        cells *= 0.85
    count = np.bincount(label)
    middle = np.stack([np.bincount(label, vertices[:, k]) / count for k in range(3)], axis=1)
    used, place = np.unique(found, return_inverse=True)
    return frozen(middle[used]), place.reshape(found.shape)


def obj_text(vertices: Array, faces: Indices) -> str:
    """A mesh as the text of an OBJ file, m to a micrometre."""
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    return "\n".join(lines) + "\n"
