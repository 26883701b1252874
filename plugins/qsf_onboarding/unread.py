"""What a URDF says that is not read and could change what the file means."""

from __future__ import annotations

from collections.abc import Iterator

from qsframework.errors import some_of
from qsframework.robot.xml_tree import Node

_PARTS = {
    "robot": "link joint material transmission gazebo ros2_control sensor",
    "link": "inertial visual collision self_collision_checking contact",
    "joint": "origin parent child axis limit mimic dynamics",
    "inertial": "origin mass inertia",
    "visual": "origin geometry material",
    "collision": "origin geometry material contact_coefficients verbose",
    "geometry": "box cylinder sphere mesh capsule",
}
"""Elements by the one that holds them: those that are read, and those that say nothing of an arm at rest."""
_VALUES = {
    "joint": "name type",
    "origin": "xyz rpy",
    "parent": "link",
    "child": "link",
    "axis": "xyz",
    "limit": "lower upper effort velocity acceleration jerk",
    "mimic": "joint multiplier offset",
    "mass": "value",
    "inertia": "ixx ixy ixz iyy iyz izz",
    "box": "size",
    "cylinder": "radius length",
    "sphere": "radius",
    "mesh": "filename scale",
}
"""Attributes by their element."""
_MEANINGS = {
    "calibration": "do the zeros of the pendant and of the URDF agree?",
    "safety_controller": "where its soft limits are narrower, write them in controller:",
}


def unread_of(tree: Node) -> list[str]:
    """Elements and attributes of a file that are not read, each with the lines where it stands and what to look at.

    A sentence for each kind of element or attribute, in the order of the file.
    """
    found: dict[tuple[str, str], list[str]] = {}
    for kind, meaning, place in _unread(tree):
        found.setdefault((kind, meaning), []).append(place)
    return [f"{kind} is not read ({some_of(places, 6)}): {meaning}" for (kind, meaning), places in found.items()]


def _unread(node: Node) -> Iterator[tuple[str, str, str]]:
    """Of an element and those in it: what is not read, what to look at, and where it stands."""
    parts, values = _PARTS.get(node.tag, "").split(), _VALUES.get(node.tag, "").split()
    unknown = f"unknown in <{node.tag}>; does it change the arm?"
    for name in node.attributes if values else ():
        if name not in values and ":" not in name:
            yield f"{name}=", unknown, str(node.place)
    for child in node.children if parts else ():
        if child.tag in parts:
            yield from _unread(child)
        elif ":" not in child.tag:
            owner = f" of {node.get('name')}" if node.get("name") else ""
            yield f"<{child.tag}>", _MEANINGS.get(child.tag, unknown), f"{child.place}{owner}"
