"""A URDF as typed values: links, joints, inertias and simple shapes, each with its place in the file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import reduce
from pathlib import Path

import numpy as np

from qsframework import plausible
from qsframework.errors import InputError, Problem
from qsframework.plugin import Array
from qsframework.robot.expand import read_tree
from qsframework.robot.packages import Sources
from qsframework.robot.xml_tree import Node, XmlPlace

MOVING = ("revolute", "continuous", "prismatic", "floating", "planar")
JOINT_TYPES = (*MOVING, "fixed")
_MIMIC = (("multiplier", "1"), ("offset", "0"))
"""And what they are where the file does not say."""
_GREY = (0.7, 0.7, 0.7, 1.0)
_LARGEST = 1e9
"""No length, mass or inertia of an arm comes near; the square of a number beyond 1e154 is infinite."""
_NO_LIMIT = 1e300
"""How large the ends of a joint's range are written where it has none."""
_MOST_LINKS = 1000
"""Cells of several arms with all that stands in them have 300."""


@dataclass(frozen=True, eq=False)
class Origin:
    """`<origin xyz rpy>`: a placement by position (m) and roll, pitch, yaw (rad)."""

    xyz: Array
    rpy: Array

    def matrix(self) -> Array:
        """The placement (4, 4): R = Rz(yaw) Ry(pitch) Rx(roll)."""
        (cr, cp, cy), (sr, sp, sy) = np.cos(self.rpy), np.sin(self.rpy)
        out = np.eye(4)
        out[:3, 3] = self.xyz
        out[:3, :3] = [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
        return out


@dataclass(frozen=True, eq=False)
class Inertial:
    """Mass (kg), placement of the centre, and inertia (3, 3) kg m2 there; NaN where the file has no number."""

    mass: float
    origin: Origin
    inertia: Array
    mass_place: XmlPlace
    inertia_place: XmlPlace


@dataclass(frozen=True, eq=False)
class Visual:
    """A solid to draw; kind and size as in `robot.Shape`."""

    kind: str
    size: tuple[float, ...]
    origin: Origin
    rgba: tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class MeshVisual:
    """A mesh: the name in the file, a factor (3,) for its lengths, and where the file names it."""

    name: str
    scale: Array
    origin: Origin
    rgba: tuple[float, float, float, float]
    place: XmlPlace


@dataclass(frozen=True, eq=False)
class Link:
    """A body: its mass, if it has one, its solids and meshes to draw, and those for collisions where they differ."""

    name: str
    place: XmlPlace
    inertial: Inertial | None
    visuals: tuple[Visual, ...]
    meshes: tuple[MeshVisual, ...] = ()
    collisions: tuple[Visual | MeshVisual, ...] = ()


@dataclass(frozen=True)
class Mimic:
    """`<mimic>`: the joint's angle is the multiplier times that of another joint, plus the offset (rad)."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Joint:
    """limits are (lower, upper) rad or m, None where the file has none."""

    name: str
    kind: str
    parent: str
    child: str
    origin: Origin
    axis: Array
    limits: tuple[float, float] | None
    mimic: Mimic | None
    place: XmlPlace

    @property
    def moves(self) -> bool:
        return self.kind in MOVING


@dataclass(frozen=True, eq=False)
class Urdf:
    """All links and joints in the file's order, duplicates included, the numbers that could not be read, notes on
    what the file says twice, and the tree that all was read from, None of an arm that comes from no URDF."""

    path: Path
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    unreadable: tuple[Problem, ...]
    notes: tuple[str, ...] = ()
    tree: Node | None = None

    def link(self, name: str) -> Link:
        return next(link for link in self.links if link.name == name)

    def above(self) -> dict[str, Joint]:
        """The joint that carries each link."""
        return {joint.child: joint for joint in self.joints}

    def below(self, link: str) -> list[Joint]:
        """All joints on the far side of a link, parents first."""
        children: dict[str, list[Joint]] = {}
        for joint in self.joints:
            children.setdefault(joint.parent, []).append(joint)
        below = list(children.get(link, ()))
        for upper in below:  # which grows meanwhile
            below += children.get(upper.child, ())
        return below

    def fixed_to(self, link: str) -> list[str]:
        """A link and all that is fixed to it, the nearest first."""
        links = [link]
        for parent in links:  # which grows meanwhile
            fixed = (j.child for j in self.joints if j.parent == parent and j.kind == "fixed")
            links += [child for child in fixed if child not in links]
        return links


def placement(joints: Iterable[Joint]) -> Array:
    """Where the last of joints that follow one another stands in the frame before the first (4, 4), all at zero."""
    return reduce(np.matmul, (joint.origin.matrix() for joint in joints), np.eye(4))


def read_urdf(path: Path, folder: Path, sources: Sources | None = None) -> Urdf:
    """Read a URDF or expand a xacro of a robot's folder. InputError if it is no XML of a robot."""
    reader, notes = _Reader(), list[str]()
    root = read_tree(path, folder, sources, notes)
    if root.tag != "robot":
        reader.problems.append(root.place.problem("the outermost element must be <robot>", found=f"<{root.tag}>"))
    reader.materials = {node.get("name"): node for node in root.all("material")}
    links = tuple(reader.link(node) for node in root.all("link"))
    if len(links) > _MOST_LINKS:
        hint = "Leave out what is no part of the arm and of what it carries."
        raise InputError(
            Problem(f"holds {len(links)} links", file=str(path), allowed=f"up to {_MOST_LINKS}", hint=hint)
        )
    joints = tuple(reader.joint(node) for node in root.all("joint"))
    return Urdf(path, links, joints, tuple(reader.problems), tuple(notes), root)


@dataclass
class _Reader:
    """Reads elements; a number that cannot be read becomes a problem and NaN."""

    problems: list[Problem] = field(default_factory=list[Problem])
    materials: dict[str, Node] = field(default_factory=dict[str, Node])

    def numbers(self, node: Node, key: str, count: int, owner: str, default: str | None = None, si: str = "") -> Array:
        """The numbers of an attribute, of this SI unit where they have one."""
        text = node.attributes.get(key, default)
        if text is None:
            self.problems.append(node.place.problem(f"{owner}: <{node.tag}> has no {key}"))
            return np.full(count, np.nan)
        most = _NO_LIMIT if node.tag == "limit" else _LARGEST
        try:
            values = np.array([float(part) for part in text.split()]) if text.isascii() else np.empty(0)
        except ValueError:
            values = np.empty(0)
        if len(values) != count or not (np.abs(values) <= most).all():
            wanted = "a finite number" if count == 1 else f"{count} finite numbers"
            wanted += f" of up to {most:g}" if np.isfinite(values).all() and len(values) == count else ""
            self.problems.append(
                node.place.problem(f"{owner}: {key} of <{node.tag}> must be {wanted}", found=repr(text[:60]))
            )
            return np.full(count, np.nan)
        for far in filter(None, (plausible.beyond(v, si) for v in values.tolist())):
            message = f"{owner}: {key} of <{node.tag}> is no {far.quantity} of an arm"
            hint, limit = "A URDF is in metres, kilograms and radians.", plausible.allowed(far, si)
            self.problems.append(node.place.problem(message, found=repr(text[:60]), allowed=limit, hint=hint))
            return np.full(count, np.nan)
        return values

    def origin(self, node: Node, owner: str) -> Origin:
        element = node.first("origin")
        if element is None:
            return Origin(np.zeros(3), np.zeros(3))
        sizes = (("xyz", "m"), ("rpy", "rad"))
        return Origin(*(self.numbers(element, key, 3, owner, "0 0 0", si) for key, si in sizes))

    def link(self, node: Node) -> Link:
        name = node.get("name")
        owner = f"link {name!r}"
        inertial = node.first("inertial")
        for second in list(node.all("inertial"))[1:]:
            self.problems.append(second.place.problem(f"{owner} has two <inertial>; one of them is not its mass"))
        return Link(
            name,
            node.place,
            None if inertial is None else self.inertial(inertial, owner),
            *self.solids(node, "visual", owner),
            tuple(solid for kind in self.solids(node, "collision", owner) for solid in kind),
        )

    def solids(self, node: Node, tag: str, owner: str) -> tuple[tuple[Visual, ...], tuple[MeshVisual, ...]]:
        """The simple solids of all <visual> or <collision>, and the meshes."""
        simple = (self.visual(element, owner) for element in node.all(tag))
        meshes = (mesh for element in node.all(tag) for mesh in self.meshes(element, owner))
        return tuple(solid for solid in simple if solid is not None), tuple(meshes)

    def meshes(self, node: Node, owner: str) -> Iterator[MeshVisual]:
        """The mesh of a <visual>, if it is one."""
        geometry = node.first("geometry")
        for mesh in () if geometry is None else geometry.all("mesh"):
            scale = self.numbers(mesh, "scale", 3, owner, "1 1 1")
            colour = self.colour(node.first("material"), owner)
            yield MeshVisual(mesh.get("filename"), scale, self.origin(node, owner), colour, mesh.place)

    def inertial(self, node: Node, owner: str) -> Inertial:
        mass, inertia = node.first("mass"), node.first("inertia")
        for tag, element in (("mass", mass), ("inertia", inertia)):
            if element is None:
                self.problems.append(node.place.problem(f"{owner}: <inertial> has no <{tag}>"))
        value = np.nan if mass is None else float(self.numbers(mass, "value", 1, owner, si="kg")[0])
        matrix = np.full((3, 3), np.nan)
        if inertia is not None:
            for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
                entry = self.numbers(inertia, f"i{'xyz'[i]}{'xyz'[j]}", 1, owner, None if i == j else "0", "kg m^2")
                matrix[i, j] = matrix[j, i] = entry[0]
        return Inertial(value, self.origin(node, owner), matrix, (mass or node).place, (inertia or node).place)

    def visual(self, node: Node, owner: str) -> Visual | None:
        """The solid of a <visual>, None for a mesh."""
        geometry = node.first("geometry")
        solid = next(iter(geometry.children), None) if geometry else None
        keys = {"box": (("size", 3),), "cylinder": (("radius", 1), ("length", 1)), "sphere": (("radius", 1),)}
        if solid is None or solid.tag not in keys:
            return None
        size = [float(v) for key, count in keys[solid.tag] for v in self.numbers(solid, key, count, owner, si="m")]
        if any(v <= 0 for v in size):
            self.problems.append(solid.place.problem(f"{owner}: a <{solid.tag}> needs positive sizes"))
        return Visual(solid.tag, tuple(size), self.origin(node, owner), self.colour(node.first("material"), owner))

    def colour(self, material: Node | None, owner: str) -> tuple[float, float, float, float]:
        if material is not None and material.first("color") is None:
            material = self.materials.get(material.get("name"))
        colour = material.first("color") if material else None
        if colour is None:
            return _GREY
        red, green, blue, alpha = np.clip(self.numbers(colour, "rgba", 4, owner), 0.0, 1.0).tolist()
        return red, green, blue, alpha

    def joint(self, node: Node) -> Joint:
        name = node.get("name")
        owner = f"joint {name!r}"
        ends = [(node.first(end) or Node("", {}, node.place)).get("link") for end in ("parent", "child")]
        axis, mimic = node.first("axis"), node.first("mimic")
        return Joint(
            name=name,
            kind=node.get("type"),
            parent=ends[0],
            child=ends[1],
            origin=self.origin(node, owner),
            axis=np.array([1.0, 0.0, 0.0]) if axis is None else self.numbers(axis, "xyz", 3, owner, "1 0 0"),
            limits=self.limits(node, owner),
            mimic=None if mimic is None else self.mimic(mimic, owner),
            place=node.place,
        )

    def mimic(self, node: Node, owner: str) -> Mimic:
        multiplier, offset = (float(self.numbers(node, k, 1, owner, d)[0]) for k, d in _MIMIC)
        return Mimic(node.get("joint"), multiplier, offset)

    def limits(self, node: Node, owner: str) -> tuple[float, float] | None:
        limit = node.first("limit")
        if limit is None or limit.attributes.keys().isdisjoint(("lower", "upper")):
            return None
        # not bounded as angles are: a limit of 1e16 is how many files say that there is none
        lower, upper = (float(self.numbers(limit, key, 1, owner, "0")[0]) for key in ("lower", "upper"))
        return lower, upper
