"""URDF and xacro: expanded without ROS, read with line numbers, and checked, because no library does.

Pinocchio and others accept negative masses, impossible inertias and links with two parents.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from qsframework.errors import InputError, Problem, nearest
from qsframework.files import read_text
from qsframework.plugin import Array

_MOST_INCLUDES = 50
MOVING = ("revolute", "continuous", "prismatic")
JOINT_TYPES = (*MOVING, "fixed", "floating", "planar")


@dataclass
class Node:
    """An XML element with the line on which it starts."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Node] = field(default_factory=list)

    def all(self, tag: str) -> Iterator[Node]:
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> Node | None:
        return next(self.all(tag), None)

    def get(self, name: str, default: str = "") -> str:
        return self.attributes.get(name, default)


@dataclass(frozen=True, eq=False)
class Urdf:
    """The expanded text, its tree, and where its elements stand in the source file."""

    path: Path
    text: str
    root: Node
    source: str

    def line(self, node: Node, name: str = "") -> int | None:
        """Line in the source: exact for plain URDF, for xacro where the name stands, if it does."""
        if self.source == self.text:
            return node.line
        match = re.search(rf'name\s*=\s*["\']{re.escape(name)}["\']', self.source) if name else None
        return None if match is None else self.source.count("\n", 0, match.start()) + 1

    def links(self) -> dict[str, Node]:
        return {link.get("name"): link for link in self.root.all("link")}

    def joints(self) -> dict[str, Node]:
        return {joint.get("name"): joint for joint in self.root.all("joint")}


def read_urdf(path: Path) -> Urdf:
    """Read a URDF, or expand a xacro, whose includes must stay in its folder. InputError if it is broken."""
    source = read_text(path)
    if path.suffix != ".xacro":
        return Urdf(path, source, parse_xml(source, path), source)
    _check_includes(path, path.parent.resolve(), set())
    text = _expand(path)
    return Urdf(path, text, parse_xml(text, path), source)


def _check_includes(path: Path, folder: Path, seen: set[Path]) -> None:
    """Refuse includes outside the robot's folder, and XML with a document type in any of the files."""
    seen.add(path.resolve())
    if len(seen) > _MOST_INCLUDES:
        raise InputError(Problem(f"includes more than {_MOST_INCLUDES} files", file=str(path)))
    text = read_text(path)
    parse_xml(text, path)
    for match in re.finditer(r'<xacro:include\s[^>]*filename\s*=\s*["\']([^"\']+)["\']', text):
        target = (path.parent / match[1]).resolve()
        line = text.count("\n", 0, match.start()) + 1
        if not target.is_relative_to(folder):
            raise InputError(Problem(f"includes {match[1]!r}, outside the robot's folder", file=str(path), line=line))
        if target not in seen:
            _check_includes(target, folder, seen)


def _expand(path: Path) -> str:
    import contextlib
    import io

    import xacro

    errors = io.StringIO()
    try:
        with contextlib.redirect_stderr(errors):
            return xacro.process_file(str(path)).toprettyxml(indent="  ")
    except (Exception, SystemExit) as error:  # xacro raises anything, from NameError to its own
        said = str(error).splitlines() or errors.getvalue().splitlines() or [type(error).__name__]
        raise InputError(Problem(f"xacro cannot expand it: {said[0]}", file=str(path))) from error


def parse_xml(text: str, path: Path) -> Node:
    """Parse XML with line numbers. InputError on malformed text and on any document type."""
    parser = expat.ParserCreate()
    stack: list[Node] = [Node("", {}, 0)]

    def start(tag: str, attributes: dict[str, str]) -> None:
        node = Node(tag, attributes, parser.CurrentLineNumber)
        stack[-1].children.append(node)
        stack.append(node)

    def refuse(*_: object) -> None:
        raise InputError(
            Problem("a document type (DOCTYPE) is not allowed", file=str(path), line=parser.CurrentLineNumber)
        )

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise InputError(
            Problem(f"is not complete XML: {reason}", file=str(path), line=error.lineno, hint="Is the file truncated?")
        ) from error
    return stack[0].children[0]


def numbers(text: str, count: int) -> Array | None:
    """The finite numbers of an attribute such as xyz, None if they are not exactly `count`."""
    try:
        values = np.array([float(part) for part in text.split()])
    except ValueError:
        return None
    return values if len(values) == count and np.isfinite(values).all() else None


def check_structure(urdf: Urdf) -> list[Problem]:
    """Everything wrong in the tree, with its file and line."""
    if urdf.root.tag != "robot":
        return [Problem(f"the outermost element is <{urdf.root.tag}>, must be <robot>", file=str(urdf.path))]
    problems = [*_duplicates(urdf), *_check_tree(urdf)]
    moved = {c.get("link") for j in urdf.joints().values() if j.get("type") in MOVING for c in j.all("child")}
    for name, link in urdf.links().items():
        problems += _check_inertial(urdf, name, link, name in moved)
    for name, joint in urdf.joints().items():
        problems += _check_joint(urdf, name, joint)
    return problems


def _problem(urdf: Urdf, node: Node, name: str, message: str, **more: str | None) -> Problem:
    return Problem(message, file=str(urdf.path), line=urdf.line(node, name), **more)


def _duplicates(urdf: Urdf) -> Iterator[Problem]:
    for tag in ("link", "joint"):
        seen: set[str] = set()
        for node in urdf.root.all(tag):
            name = node.get("name")
            if not name:
                yield _problem(urdf, node, name, f"a {tag} has no name")
            if name in seen:
                yield _problem(urdf, node, name, f"{tag} {name!r} stands here twice")
            seen.add(name)


def _check_tree(urdf: Urdf) -> Iterator[Problem]:
    links, parents = urdf.links(), dict[str, str]()
    for name, joint in urdf.joints().items():
        ends = {}
        for end in ("parent", "child"):
            node = joint.first(end)
            link = node.get("link") if node else ""
            ends[end] = link
            if link not in links:
                yield _problem(urdf, joint, name, f"joint {name!r} has an unknown {end} link {link!r}",
                               allowed=", ".join(links), hint=nearest(link, links))  # fmt: skip
        child = ends["child"]
        if child in parents:
            both = f"{parents[child]!r} and {name!r}"
            yield _problem(urdf, joint, name, f"link {child!r} has two parents: joints {both}",
                           hint="A closed loop is written as an effect in robot.yaml, not in the URDF.")  # fmt: skip
        parents[child] = name
    roots = [name for name in links if name not in parents]
    if len(roots) != 1:
        found = ", ".join(roots) or "none: the joints run in a circle"
        yield Problem("the links must hang on one root", file=str(urdf.path), found=found)


def _check_joint(urdf: Urdf, name: str, joint: Node) -> Iterator[Problem]:
    kind = joint.get("type")
    if kind not in JOINT_TYPES:
        yield _problem(urdf, joint, name, f"joint {name!r} has the unknown type {kind!r}", allowed=", ".join(JOINT_TYPES))
    limit, axis, mimic = joint.first("limit"), joint.first("axis"), joint.first("mimic")
    if kind in ("revolute", "prismatic"):
        low, high = (numbers(limit.get(end), 1) if limit else None for end in ("lower", "upper"))
        if low is None or high is None:
            yield _problem(urdf, joint, name, f"joint {name!r} has no limits: <limit lower=.. upper=..> is missing")
        elif low[0] >= high[0]:
            yield _problem(urdf, joint, name, f"joint {name!r} has its lower limit above its upper limit",
                           found=f"{low[0]:g} .. {high[0]:g}")  # fmt: skip
    if kind in MOVING and axis is not None:
        direction = numbers(axis.get("xyz"), 3)
        if direction is None or not np.linalg.norm(direction) > 0:
            yield _problem(urdf, joint, name, f"joint {name!r} has no axis direction", found=repr(axis.get("xyz")))
    if mimic is not None and mimic.get("joint") not in urdf.joints():
        yield _problem(urdf, joint, name, f"joint {name!r} mimics the unknown joint {mimic.get('joint')!r}",
                       hint=nearest(mimic.get("joint"), urdf.joints()))  # fmt: skip
    origin = joint.first("origin")
    for attribute in ("xyz", "rpy"):
        if origin is not None and attribute in origin.attributes and numbers(origin.get(attribute), 3) is None:
            yield _problem(urdf, joint, name, f"joint {name!r}: origin {attribute} must be three numbers",
                           found=repr(origin.get(attribute)))  # fmt: skip


def _check_inertial(urdf: Urdf, name: str, link: Node, moving: bool) -> Iterator[Problem]:
    inertial = link.first("inertial")
    if inertial is None:
        if moving:
            yield _problem(urdf, link, name, f"moving link {name!r} has no mass: <inertial> is missing")
        return
    mass_node, node = inertial.first("mass"), inertial.first("inertia")
    mass = numbers(mass_node.get("value"), 1) if mass_node else None
    if mass is None or mass[0] < 0 or (moving and mass[0] == 0):
        found = mass_node.get("value") if mass_node else "nothing"
        yield _problem(urdf, link, name, f"link {name!r} needs a positive mass", found=found)
    entries = [numbers(node.get(key, "0"), 1) if node else None for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")]
    if any(e is None for e in entries):
        yield _problem(urdf, link, name, f"link {name!r} has no complete inertia")
        return
    xx, xy, xz, yy, yz, zz = (float(e[0]) for e in entries if e is not None)
    moments = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    found = "principal moments " + ", ".join(f"{m:g}" for m in moments) + " kg m2"
    if moments[0] <= 0 and moving:
        yield _problem(urdf, link, name, f"the inertia of link {name!r} is not positive definite", found=found)
    elif moments[2] > (moments[0] + moments[1]) * (1 + 1e-6):
        yield _problem(urdf, link, name, f"no body has the inertia of link {name!r} (triangle inequality)", found=found)
