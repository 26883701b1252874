"""The meshes of a stranger's URDF as a new robot keeps them: coarse ones to draw, those for collisions as they are."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

import numpy as np

from qsframework.errors import InputError, some_of
from qsframework.robot.mesh import KINDS, LARGEST, coarser, mesh_file, obj_text, read_mesh, whole_hull
from qsframework.robot.packages import Sources
from qsframework.robot.urdf import Link, MeshVisual, Urdf, Visual

_DRAWN, _SOLID = 3000, 30_000
"""Most triangles of a mesh to draw, and of one for collisions: of a larger one the convex hull."""


@dataclass
class _Kept:
    """The files written so far, and the names of the meshes that are not there, cannot be read, or are too fine."""

    urdf: Urdf
    sources: Sources
    files: dict[str, str] = field(default_factory=dict[str, str])
    missing: list[str] = field(default_factory=list[str])
    broken: list[str] = field(default_factory=list[str])
    fine: list[str] = field(default_factory=list[str])

    def link(self, link: Link, number: int) -> Link:
        stem = f"meshes/{number}_{re.sub(r'[^A-Za-z0-9]+', '_', link.name)[:40]}"
        drawn = [self.mesh(m, f"{stem}_{k}.obj", solid=False) for k, m in enumerate(link.meshes)]
        solids = [self.solid(s, f"{stem}_solid_{k}.obj") for k, s in enumerate(link.collisions)]
        if link.meshes and not any(solids):
            every = (*link.visuals, *link.meshes)
            solids = [self.solid(s, f"{stem}_solid_{k}.obj") for k, s in enumerate(every)]
        return replace(
            link,
            meshes=tuple(mesh for mesh in drawn if mesh is not None),
            collisions=tuple(solid for solid in solids if solid is not None),
        )

    def solid(self, solid: Visual | MeshVisual, name: str) -> Visual | MeshVisual | None:
        return solid if isinstance(solid, Visual) else self.mesh(solid, name, solid=True)

    def mesh(self, mesh: MeshVisual, name: str, solid: bool) -> MeshVisual | None:
        path = mesh_file(mesh, self.urdf.path, self.urdf.path.parent, self.sources)
        if path is None or path.suffix.lower() not in KINDS:
            self.missing.append(mesh.name)
            return None
        try:
            vertices, faces = read_mesh(mesh, path)
        except InputError:
            self.broken.append(f"{mesh.name} ({mesh.place})")
            return None
        if solid and len(faces) > _SOLID:
            self.fine.append(mesh.name)
            vertices, faces = whole_hull(vertices)
        self.files[name] = obj_text(*((vertices, faces) if solid else coarser(vertices, faces, _DRAWN)))
        return replace(mesh, name=name, scale=np.ones(3))


def with_meshes(urdf: Urdf, sources: Sources) -> tuple[Urdf, dict[str, str], tuple[str, ...]]:
    """The URDF with meshes of its own, these files by name, and what has to be said of the others.

    InputError with file and line for a mesh outside the packages.
    """
    kept = _Kept(urdf, sources)
    links = tuple(kept.link(link, k) for k, link in enumerate(urdf.links))
    notes = (
        (f"meshes: not there, or of a kind that is not read ({', '.join(KINDS)} are)", kept.missing),
        (f"meshes: these cannot be read or have more than {LARGEST // 10**6} MB, and are omitted", kept.broken),
        (f"meshes: with more than {_SOLID} triangles the convex hull stands for them in collisions", kept.fine),
    )
    words = (f"{head}: {some_of([*dict.fromkeys(names)], 3)}" for head, names in notes if names)
    return replace(urdf, links=links), kept.files, tuple(words)
