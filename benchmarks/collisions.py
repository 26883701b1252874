"""Collisions of makers' arms against their own meshes as Pinocchio and coal read them, at random poses.

    python benchmarks/collisions.py ARM.urdf ... [--flange LINK] [--package NAME=FOLDER] [--poses 2000]

For each arm: `qsf new`, the pairs of links that it keeps apart, and at every pose whether these touch, by the new robot
and by the file's own meshes. Missed is a contact that the robot does not see; refused is a free pose that it calls one.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from time import process_time
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import trimesh

from qsf_onboarding.folder import Arm, new
from qsframework.robot import Robot, load_robot
from qsframework.robot.collision import Collider, make_collider
from qsframework.robot.kinematics import joint_frames


def main() -> None:
    """Print a line for each arm."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("urdf", nargs="+", type=Path)
    parser.add_argument("--flange", action="append", default=[], help="FILE=LINK, where the file needs it")
    parser.add_argument("--package", action="append", default=[], help="NAME=FOLDER")
    parser.add_argument("--poses", type=int, default=2000)
    options = parser.parse_args()
    flanges = dict(text.split("=", 1) for text in options.flange)
    packages = {name: Path(folder) for name, folder in (text.split("=", 1) for text in options.package)}
    print("| arm | triangles | pairs | poses that touch | missed | refused though free | CPU s for all poses |")
    print("|---|---|---|---|---|---|---|")
    for file in options.urdf:
        with tempfile.TemporaryDirectory() as folder:
            print(row(file, flanges.get(file.stem), packages, Path(folder), options.poses), flush=True)


def row(file: Path, flange: str | None, packages: dict[str, Path], folder: Path, count: int) -> str:
    """A line of the table."""
    new("arm", file, folder=folder / "arm", arm=Arm(flange=flange, packages=packages))
    robot = load_robot(folder / "arm")
    collider = make_collider(robot)
    controller = robot.controller
    pendant = np.random.default_rng(0).uniform(controller.lower, controller.upper, (count, controller.axes))
    q = controller.to_joints(pendant)
    start = process_time()
    found = collider.collides(joint_frames(robot.facts, q))
    seconds = process_time() - start
    true = exact(file, packages, robot, collider, q)
    triangles = sum(len(s.surface.faces) if s.surface is not None else 0 for s in robot.shapes)
    missed, refused = int((true & ~found).sum()), int((found & ~true).sum())
    share = 100.0 * refused / max(1, int((~true).sum()))
    return (
        f"| {file.stem} | {triangles} | {len(collider.pairs)} | {int(true.sum())} | {missed} | "
        f"{refused} ({share:.1f} %) | {seconds:.2f} |"
    )


def exact(file: Path, packages: dict[str, Path], robot: Robot, collider: Collider, q: np.ndarray) -> np.ndarray:
    """Which poses (N,) have two links in contact, by the meshes of the file itself."""
    dirs = [str(file.parent), *(str(folder.parent) for folder in packages.values()), *map(str, file.parents)]
    model = pin.buildModelFromUrdf(str(file))
    geometry, drawn = (
        pin.buildGeomFromUrdf(model, str(file), kind, package_dirs=dirs)
        for kind in (pin.GeometryType.COLLISION, pin.GeometryType.VISUAL)
    )
    stated = {g.parentFrame for g in geometry.geometryObjects}
    for more in drawn.geometryObjects:  # a link without a <collision> is as it is drawn
        if more.parentFrame not in stated:
            geometry.addGeometryObject(more)
    data = model.createData()
    moved = {name: k for k, name in enumerate(robot.facts.joints, start=1)}
    body = [_link_of(model, g, moved) for g in geometry.geometryObjects]
    apart = {tuple(sorted((collider.shapes[i].link, collider.shapes[j].link))) for i, j in collider.pairs.tolist()}
    pairs = [
        (a, b)
        for a in range(len(body))
        for b in range(a)
        if body[a] is not None and body[b] is not None and tuple(sorted((body[a], body[b]))) in apart
    ]
    index = [model.joints[model.getJointId(name)].idx_q for name in robot.facts.joints]
    wide = [model.joints[model.getJointId(name)].nq for name in robot.facts.joints]
    out = np.zeros(len(q), dtype=bool)
    for n, row in enumerate(q):
        full = pin.neutral(model)
        for k, (at, size) in enumerate(zip(index, wide, strict=True)):
            full[at : at + size] = [row[k]] if size == 1 else [np.cos(row[k]), np.sin(row[k])]
        pin.forwardKinematics(model, data, full)
        out[n] = any(_touch(geometry, data, a, b) for a, b in pairs)
    return out


def _link_of(model: pin.Model, geometry: pin.GeometryObject, moved: dict[str, int]) -> int | None:
    """The robot's link that carries a geometry; None beside the arm."""
    joint = geometry.parentJoint
    if joint == 0:
        return 0
    return moved.get(model.names[joint])


def _touch(geometry: pin.GeometryModel, data: pin.Data, a: int, b: int) -> bool:
    """Whether the surfaces of two bodies meet, or one body is inside the other."""
    objects = [geometry.geometryObjects[k] for k in (a, b)]
    where = [data.oMi[g.parentJoint] * g.placement for g in objects]
    there = [coal.Transform3s(w.rotation, w.translation) for w in where]
    bodies = [g.geometry for g in objects]
    request = coal.CollisionRequest()
    if coal.collide(bodies[0], there[0], bodies[1], there[1], request, coal.CollisionResult()) > 0:
        return True
    points = [_vertices(body) for body in bodies]
    if any(len(p) == 0 for p in points):
        return False
    placed = [p @ w.rotation.T + w.translation for p, w in zip(points, where, strict=True)]
    for inner, outer in ((0, 1), (1, 0)):
        low, high = placed[outer].min(axis=0), placed[outer].max(axis=0)
        if ((placed[inner] > low) & (placed[inner] < high)).all():
            point = where[outer].inverse().act(placed[inner][0])
            if _closed(bodies[outer]).contains(point[None])[0]:
                return True
    return False


_KNOWN: dict[int, Any] = {}


def _vertices(body: Any) -> np.ndarray:
    return np.array(body.vertices()) if isinstance(body, coal.BVHModelBase) else np.zeros((0, 3))


def _closed(body: Any) -> Any:
    """A body's mesh as trimesh has it, which shoots rays to tell inside from outside."""
    if id(body) not in _KNOWN:
        faces = [[t[0], t[1], t[2]] for t in (body.tri_indices(k) for k in range(body.num_tris))]
        _KNOWN[id(body)] = body, trimesh.Trimesh(_vertices(body), faces, process=True)
    return _KNOWN[id(body)][1]


if __name__ == "__main__":
    main()
