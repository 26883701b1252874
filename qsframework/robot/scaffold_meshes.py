"""The meshes of a stranger's URDF as a new robot keeps them: coarse ones to draw, convex ones for collisions."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

import numpy as np

from qsframework.robot.mesh import KINDS, coarser, convex_hull, mesh_file, obj_text, read_mesh
from qsframework.robot.packages import Sources
from qsframework.robot.urdf import Link, MeshVisual, Urdf, Visual

_DRAWN = 3000
"""Triangles of a mesh to draw."""
_TOLD = 3


@dataclass
class _Kept:
    """The files written so far, and the names of the meshes that are not there."""

    urdf: Urdf
    sources: Sources
    files: dict[str, str] = field(default_factory=dict[str, str])
    missing: list[str] = field(default_factory=list[str])

    def link(self, link: Link, number: int) -> Link:
        stem = f"meshes/{number}_{re.sub(r'[^A-Za-z0-9]+', '_', link.name)[:40]}"
        drawn = [self.mesh(m, f"{stem}_{k}.obj", hull=False) for k, m in enumerate(link.meshes)]
        solids = [self.solid(s, f"{stem}_hull_{k}.obj") for k, s in enumerate(link.collisions)]
        if link.meshes and not any(solids):
            every = (*link.visuals, *link.meshes)
            solids = [self.solid(s, f"{stem}_hull_{k}.obj") for k, s in enumerate(every)]
        return replace(
            link,
            meshes=tuple(mesh for mesh in drawn if mesh is not None),
            collisions=tuple(solid for solid in solids if solid is not None),
        )

    def solid(self, solid: Visual | MeshVisual, name: str) -> Visual | MeshVisual | None:
        return solid if isinstance(solid, Visual) else self.mesh(solid, name, hull=True)

    def mesh(self, mesh: MeshVisual, name: str, hull: bool) -> MeshVisual | None:
        path = mesh_file(mesh, self.urdf.path, self.urdf.path.parent, self.sources)
        if path is None or path.suffix.lower() not in KINDS:
            self.missing.append(mesh.name)
            return None
        vertices, faces = read_mesh(mesh, path)
        if hull:
            solid = convex_hull(vertices)
            self.files[name] = obj_text(solid.corners, solid.faces)
        else:
            self.files[name] = obj_text(*coarser(vertices, faces, _DRAWN))
        return replace(mesh, name=name, scale=np.ones(3))


def with_meshes(urdf: Urdf, sources: Sources) -> tuple[Urdf, dict[str, str], tuple[str, ...]]:
    """The URDF with meshes of its own, these files by name, and what has to be said of the others.

    InputError with file and line for a mesh that is too large, broken, or outside the packages.
    """
    kept = _Kept(urdf, sources)
    links = tuple(kept.link(link, k) for k, link in enumerate(urdf.links))
    missing = list(dict.fromkeys(kept.missing))
    more = f" and {len(missing) - _TOLD} more" if len(missing) > _TOLD else ""
    told = (
        f"meshes: not there, or of a kind that is not read ({', '.join(KINDS)} are): {', '.join(missing[:_TOLD])}{more}"
    )
    return replace(urdf, links=links), kept.files, (told,) if missing else ()
