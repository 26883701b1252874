"""From a sound URDF to the `pin.Model` of the arm, and from that model to the arm's constants."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from qsframework.errors import InputError, Problem
from qsframework.plugin import Array, Branch, RobotFacts
from qsframework.plugin.facts import frozen
from qsframework.robot.checks import chain_joints
from qsframework.robot.mesh import KINDS, mesh_file, read_mesh, solid_of
from qsframework.robot.robot import LinkFrame, MeshShape, Shape
from qsframework.robot.urdf import Inertial, Joint, Link, MeshVisual, Origin, Urdf, Visual
from qsframework.robot.xml_tree import quoted

if TYPE_CHECKING:
    import pinocchio as pin

_NO_LIMIT = (-1e3, 1e3)


def build_model(urdf: Urdf, base: str, gravity: Array) -> pin.Model:
    """The `pin.Model` of what hangs on the base: one joint per moving joint, fixed links merged.

    Pinocchio reads plain numbers, so that a continuous joint has one angle and not a cosine and a sine.
    """
    import pinocchio as pin

    try:
        model = pin.buildModelFromXML(plain_urdf(urdf, base))
    except Exception as error:  # the bindings raise several kinds
        raise InputError(Problem(f"Pinocchio cannot read it: {error}", file=str(urdf.path))) from error
    model.gravity = pin.Motion(np.array(gravity, dtype=float), np.zeros(3))
    return model


def plain_urdf(urdf: Urdf, base: str) -> str:
    """The part of the URDF below the base: links with masses and joints, all numbers in full."""
    joints = urdf.below(base)
    names = {base, *(joint.child for joint in joints)}
    body = [_link(link) for link in urdf.links if link.name in names]
    body += [_joint(joint) for joint in joints]
    return '<robot name="robot">\n' + "\n".join(body) + "\n</robot>\n"


def read_facts(
    name: str, model: pin.Model, urdf: Urdf, base: str, flange: str, payload: float | None = None
) -> RobotFacts:
    """The constants of the chain, all but the payload (kg) from the model: they cannot differ from it."""
    chain = [joint for joint in chain_joints(urdf, base, flange) or [] if joint.moves]
    joints = tuple(joint.name for joint in chain)
    if tuple(model.names)[1:] != joints or model.nq != len(joints) or model.nv != len(joints):
        raise InputError(Problem("Pinocchio reads another chain than the file holds", file=str(urdf.path)))
    return RobotFacts(
        name=name,
        joints=joints,
        links=(base, *(joint.child for joint in chain)),
        axes=frozen([_axis(model, k)[0] for k in range(1, model.njoints)]),
        sliding=tuple(_axis(model, k)[1] for k in range(1, model.njoints)),
        placements=frozen([placement.homogeneous for placement in model.jointPlacements][1:]),
        masses=frozen([inertia.mass for inertia in model.inertias]),
        centres=frozen([inertia.lever for inertia in model.inertias]),
        gravity=frozen(model.gravity.linear),
        payload=payload,
        flange=flange,
        flange_placement=read_frames(model)[flange].placement,
    )


def read_branches(
    tree: pin.Model, urdf: Urdf, base: str, facts: RobotFacts
) -> tuple[tuple[Branch, ...], dict[str, LinkFrame]]:
    """The links that move beside the arm, and every link of the URDF on them as a frame of one of the bodies.

    tree: the `pin.Model` of the arm with its branches
    """
    import pinocchio as pin

    links = {joint.name: joint.child for joint in urdf.joints}
    names = tuple(tree.names)
    beside = [k for k in range(1, tree.njoints) if names[k] not in facts.joints]
    branches = tuple(
        Branch(
            joint=names[k],
            link=links[names[k]],
            parent=base if tree.parents[k] == 0 else links[names[tree.parents[k]]],
            placement=frozen(tree.jointPlacements[k].homogeneous),
            axis=_axis(tree, k)[0],
            mass=float(tree.inertias[k].mass),
            centre=frozen(tree.inertias[k].lever),
        )
        for k in beside
    )
    frames = {
        frame.name: LinkFrame(facts.n + 1 + beside.index(frame.parentJoint), frozen(frame.placement.homogeneous))
        for frame in tree.frames
        if frame.type == pin.FrameType.BODY and frame.parentJoint in beside
    }
    return branches, frames


def _axis(model: pin.Model, k: int) -> tuple[Array, bool]:
    """The axis (3,) of a joint in its frame, and whether the joint slides along it."""
    data = model.joints[k].createData()
    model.joints[k].calc(data, np.zeros(model.nq))
    twist = np.asarray(data.S, dtype=float).ravel()
    slides = not twist[3:].any()
    return frozen(twist[:3] if slides else twist[3:]), slides


def read_frames(model: pin.Model) -> MappingProxyType[str, LinkFrame]:
    """Every link of the URDF as a frame of a moving link, in the model's order."""
    import pinocchio as pin

    return MappingProxyType(
        {
            frame.name: LinkFrame(int(frame.parentJoint), frozen(frame.placement.homogeneous))
            for frame in model.frames
            if frame.type == pin.FrameType.BODY
        }
    )


def read_shapes(urdf: Urdf, frames: Mapping[str, LinkFrame], folder: Path) -> tuple[Shape, ...]:
    """The solids for collisions, placed on the moving links: those of <collision>, or else of <visual>.

    Of a mesh its convex hull, and the mesh where it is not convex; one whose file is not there counts as none.
    InputError for one that cannot be read.
    """
    shapes: list[Shape] = []
    for link, frame in ((link, frames[link.name]) for link in urdf.links if link.name in frames):
        for solids in (link.collisions, (*link.visuals, *link.meshes)):
            own = [shape for solid in solids if (shape := _shape(solid, frame, urdf.path, folder)) is not None]
            shapes += own
            if own:
                break
    return tuple(shapes)


def _shape(solid: Visual | MeshVisual, frame: LinkFrame, urdf: Path, folder: Path) -> Shape | None:
    placement = frozen(frame.placement @ solid.origin.matrix())
    if isinstance(solid, Visual):
        return Shape(frame.link, placement, solid.kind, solid.size, solid.rgba)
    path = mesh_file(solid, urdf, folder)
    if path is None or path.suffix.lower() not in KINDS:
        return None
    return Shape(frame.link, placement, "hull", (), solid.rgba, solid_of(*read_mesh(solid, path)))


def read_meshes(urdf: Urdf, frames: Mapping[str, LinkFrame], folder: Path) -> tuple[MeshShape, ...]:
    """The meshes of the visuals, placed on the moving links, each with its file where that lies in the folder."""
    return tuple(
        MeshShape(
            frame.link,
            frozen(frame.placement @ mesh.origin.matrix()),
            mesh.name,
            mesh_file(mesh, urdf.path, folder),
            frozen(mesh.scale),
            mesh.rgba,
        )
        for link in urdf.links
        if (frame := frames.get(link.name)) is not None
        for mesh in link.meshes
    )


def _text(values: npt.ArrayLike) -> str:
    return '"' + " ".join(repr(float(v)) for v in np.atleast_1d(values)) + '"'


def _origin(origin: Origin) -> str:
    return f"<origin xyz={_text(origin.xyz)} rpy={_text(origin.rpy)}/>"


def _link(link: Link) -> str:
    inside = "" if link.inertial is None else _inertial(link.inertial)
    return f"<link name={quoted(link.name)}>{inside}</link>"


def _inertial(inertial: Inertial) -> str:
    entries = " ".join(f"i{'xyz'[i]}{'xyz'[j]}={_text(inertial.inertia[i, j])}" for i in range(3) for j in range(i, 3))
    return f"<inertial>{_origin(inertial.origin)}<mass value={_text(inertial.mass)}/><inertia {entries}/></inertial>"


def _joint(joint: Joint) -> str:
    kind = "fixed" if not joint.moves else "prismatic" if joint.kind == "prismatic" else "revolute"
    lower, upper = joint.limits or _NO_LIMIT
    moving = (
        f'<axis xyz={_text(joint.axis)}/><limit lower={_text(lower)} upper={_text(upper)} effort="0" velocity="0"/>'
        if joint.moves
        else ""
    )
    ends = f"<parent link={quoted(joint.parent)}/><child link={quoted(joint.child)}/>"
    return f'<joint name={quoted(joint.name)} type="{kind}">{_origin(joint.origin)}{ends}{moving}</joint>'
