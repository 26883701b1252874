"""A robot's URDF with corrected joint origins, for other programs."""

from __future__ import annotations

import io
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from qsframework.errors import InputError
from qsframework.files import read_yaml, write_text
from qsframework.plugin import Array
from qsframework.plugin.rotations import homogeneous, turns
from qsframework.robot.expand import read_tree
from qsframework.robot.model import build_model
from qsframework.robot.robot import Robot
from qsframework.robot.urdf import read_urdf
from qsframework.robot.xml_tree import Node


def write_corrected_urdf(robot: Robot, twists: Array, angles: Array, path: Path) -> Path:
    """Write the robot's URDF with each joint's origin moved, written out by yourdfpy.

    twists (n, 6): each joint's placement moved by x, y, z (m), then turned about x, y and z (rad), in its own frame;
    angles (n,) rad: added to the joint's angle, here turned into its origin. Joints that do not bend keep theirs.
    """
    import yourdfpy

    text = ElementTree.tostring(_element(_tree(robot)), encoding="unicode")
    urdf = yourdfpy.URDF.load(
        io.StringIO(text), load_meshes=False, build_scene_graph=False, load_collision_meshes=False
    )
    for name, moved in zip(robot.facts.joints, moves(robot, twists, angles), strict=True):
        joint = urdf.joint_map[name]
        joint.origin = (np.eye(4) if joint.origin is None else joint.origin) @ moved
    return write_text(path, urdf.write_xml_string().decode("utf-8"))


def moves(robot: Robot, twists: Array, angles: Array) -> Array:
    """What each joint's nominal placement is multiplied by (n, 4, 4), from the right."""
    x, y, z = (turns(axis, twists[:, k]) for k, axis in enumerate(np.eye(3), start=3))
    own = np.stack([turns(axis, angle) for axis, angle in zip(robot.facts.axes, angles, strict=True)])
    return homogeneous(x @ y @ z @ own, twists[:, :3])


def read_placements(robot: Robot, path: Path) -> Array:
    """The placements (n, 4, 4) of the robot's joints in another URDF of it, as Pinocchio reads them."""
    model = build_model(read_urdf(path, path.parent), robot.facts.base, robot.gravity)
    names = list(model.names)
    return np.stack([model.jointPlacements[names.index(name)].homogeneous for name in robot.facts.joints])


def _tree(robot: Robot) -> Node:
    file = robot.folder / "robot.yaml"
    if not file.is_file():
        raise InputError(f"{robot.folder}: the robot's file is not named robot.yaml; its URDF is not found again")
    return read_tree(robot.folder / str(read_yaml(file).data["urdf"]), robot.folder)


def _element(node: Node) -> ElementTree.Element:
    element = ElementTree.Element(node.tag, {k: v for k, v in node.attributes.items() if ":" not in k})
    # a URDF's readers pass over what they do not know, and a prefix that nobody explains is no XML
    element.extend(_element(child) for child in node.children if ":" not in child.tag)
    return element
