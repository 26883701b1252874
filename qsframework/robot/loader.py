"""`load_robot`: from the files of a robot to a frozen `Robot`."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from qsframework.errors import InputError, Problem, nearest
from qsframework.files import Document, read_yaml, validate
from qsframework.plugin import Array, RobotFacts
from qsframework.plugin.facts import frozen
from qsframework.robot.controller import Controller, parse_expression
from qsframework.robot.robot import LinkFrame, Robot, Shape
from qsframework.robot.spec import RobotSpec, read_effects, read_nominal
from qsframework.robot.urdf import Node, Urdf, check_structure, numbers, read_urdf


def search_path() -> tuple[Path, ...]:
    """Folders that hold robots: $QSF_ROBOTS, the repository's `robots`, the installed ones."""
    package = Path(__file__).resolve().parents[1]
    own = [Path(p) for p in os.environ.get("QSF_ROBOTS", "").split(os.pathsep) if p]
    return (*own, package.parent / "robots", package / "_robots")


def robot_names() -> tuple[str, ...]:
    """Names of all robots on the search path."""
    return tuple(sorted({f.parent.name for folder in search_path() for f in folder.glob("*/robot.yaml")}))


def find_robot(name: str | Path, beside: Path | None = None) -> Path:
    """The robot.yaml of a name on the search path, or of a path; an InputError offers the nearest name."""
    for folder in search_path():
        if (folder / str(name) / "robot.yaml").is_file() and os.sep not in str(name):
            return folder / str(name) / "robot.yaml"
    for base in (beside, Path()):
        if base is not None and ("/" in str(name) or str(name).endswith(".yaml") or (base / name).is_dir()):
            path = base / name
            if path.is_dir():
                path = path / "robot.yaml"
            if path.is_file():
                return path
    names = robot_names()
    raise InputError(
        Problem(f"unknown robot {str(name)!r}", allowed=", ".join(names), hint=nearest(str(name), names)
                or "A path to a folder with a robot.yaml is allowed too.")
    )  # fmt: skip


def load_robot(name: str | Path, beside: Path | None = None) -> Robot:
    """Load a robot by name or path. InputError with all problems of its files, each with file and line."""
    document = read_yaml(find_robot(name, beside))
    spec = validate(document, RobotSpec)
    folder = document.path.parent
    urdf = read_urdf(_inside(document, folder, "urdf", spec.urdf))
    problems = [*check_structure(urdf), *_check_names(document, spec, urdf)]
    if problems:
        raise InputError(problems)
    chain = _chain(document, spec, urdf)
    model = _pin_model(urdf)
    facts, frames = _facts(spec.name, model, urdf, chain)
    controller = _controller(document, spec, facts)
    effects, problems = read_effects(document, spec.effects, facts)
    effects = tuple(sorted(effects, key=lambda e: (e.stage, e.order)))
    parameters = {p.name: p for e in effects for p in e.parameters(facts)}
    if spec.nominal is not None and not problems:
        values, problems = read_nominal(read_yaml(_inside(document, folder, "nominal", spec.nominal)), parameters)
        parameters.update(values)
    if problems:
        raise InputError(problems)
    return Robot(
        spec.name, spec.title, folder, model, facts, controller, effects, tuple(parameters.values()), frames,
        frames[spec.flange], _shapes(urdf, frames), frozen(model.gravity.linear),
    )  # fmt: skip


def _inside(document: Document, folder: Path, key: str, name: str) -> Path:
    """A file of the robot, which must stay in its folder."""
    path = folder / name
    if not path.resolve().is_relative_to(folder.resolve()):
        raise InputError(Problem(f"{key}: {name!r} is outside the robot's folder", str(document.path), document.line(key)))
    if not path.is_file():
        raise InputError(Problem(f"{key}: no such file {name!r}", str(document.path), document.line(key)))
    return path


def _check_names(document: Document, spec: RobotSpec, urdf: Urdf) -> list[Problem]:
    problems: list[Problem] = []
    for key, name in (("base", spec.base), ("flange", spec.flange)):
        if name not in urdf.links():
            problems.append(Problem(f"{key}: the URDF has no link {name!r}", str(document.path), document.line(key),
                                    allowed=", ".join(urdf.links()), hint=nearest(name, urdf.links())))  # fmt: skip
    for name in spec.controller:
        if name not in urdf.joints():
            line = document.line("controller", name)
            problems.append(Problem(f"controller: the URDF has no joint {name!r}", str(document.path), line,
                                    allowed=", ".join(urdf.joints()), hint=nearest(name, urdf.joints())))  # fmt: skip
    return problems


def _chain(document: Document, spec: RobotSpec, urdf: Urdf) -> tuple[str, ...]:
    """Names of the moving joints from base to flange."""
    above = {c.get("link"): name for name, j in urdf.joints().items() for c in j.all("child")}
    joints: list[str] = []
    link = spec.flange
    while link != spec.base:
        if link not in above:
            raise InputError(Problem(f"flange {spec.flange!r} does not hang on base {spec.base!r}", str(document.path)))
        joint = urdf.joints()[above[link]]
        if joint.get("type") not in ("fixed", "revolute", "continuous"):
            raise InputError(Problem(f"joint {above[link]!r} is {joint.get('type')}; an arm's joints turn", str(urdf.path)))
        if joint.get("type") != "fixed":
            joints.append(above[link])
        link = next(joint.all("parent")).get("link")
    if not joints:
        raise InputError(Problem("no joint moves between base and flange", str(document.path)))
    missing = [j for j in joints if j not in spec.controller]
    if missing:
        line = document.line("controller")
        raise InputError(Problem(f"controller: no limits for {', '.join(sorted(missing))}", str(document.path), line))
    return tuple(reversed(joints))


def _pin_model(urdf: Urdf) -> Any:
    import pinocchio as pin

    try:
        return pin.buildModelFromXML(urdf.text)
    except Exception as error:
        raise InputError(Problem(f"Pinocchio cannot read it: {error}", file=str(urdf.path))) from error


def _facts(name: str, model: Any, urdf: Urdf, chain: tuple[str, ...]) -> tuple[RobotFacts, dict[str, LinkFrame]]:
    """Constants of the chain from the pin.Model, and the frame of every link on it."""
    import pinocchio as pin

    ids = [model.getJointId(joint) for joint in chain]
    above = {c.get("link"): j for j, node in urdf.joints().items() for c in node.all("child")}
    moved = {above[link]: link for link in above}
    axes, placements, masses, centres = [], [], [0.0], [np.zeros(3)]
    previous = 0
    for joint, i in zip(chain, ids, strict=True):
        if model.parents[i] != previous:
            raise InputError(Problem(f"joint {joint!r} does not follow the joint before it", file=str(urdf.path)))
        motion = model.joints[i].createData()
        model.joints[i].calc(motion, np.zeros(model.nq))
        axes.append(np.asarray(motion.S).ravel()[3:6])
        placements.append(model.jointPlacements[i].homogeneous)
        masses.append(model.inertias[i].mass)
        centres.append(model.inertias[i].lever)
        previous = i
    links = (_root(urdf), *(moved[joint] for joint in chain))
    facts = RobotFacts(
        name, chain, links, frozen(axes), frozen(placements), frozen(masses), frozen(centres)
    )
    frames: dict[str, LinkFrame] = {}
    for frame in model.frames:
        owner = [0, *ids]
        if frame.type == pin.FrameType.BODY and frame.parentJoint in owner:
            frames[frame.name] = LinkFrame(owner.index(frame.parentJoint), frozen(frame.placement.homogeneous))
    return facts, frames


def _root(urdf: Urdf) -> str:
    children = {c.get("link") for j in urdf.joints().values() for c in j.all("child")}
    return next(link for link in urdf.links() if link not in children)


def _controller(document: Document, spec: RobotSpec, facts: RobotFacts) -> Controller:
    n = facts.n
    matrix, offset = np.eye(n), np.zeros(n)
    lower, upper = np.zeros(n), np.zeros(n)
    problems: list[Problem] = []
    for k, joint in enumerate(facts.joints):
        entry = spec.controller[joint]
        line = document.line("controller", joint)
        if len(entry.limits) != 2 or entry.limits[0] >= entry.limits[1]:
            problems.append(Problem(f"{joint}: limits must be [lower, upper]", str(document.path), line))
            continue
        lower[k], upper[k] = entry.limits
        if entry.equals is not None:
            try:
                matrix[k], offset[k] = parse_expression(entry.equals, n)
            except InputError as error:
                problems += [replace(p, file=str(document.path), line=line) for p in error.problems]
    if not problems and abs(np.linalg.det(matrix)) < 1e-9:
        line = document.line("controller")
        problems.append(Problem("controller: the pendant's angles do not determine the joints", str(document.path), line))
    if problems:
        raise InputError(problems)
    return Controller(frozen(matrix), frozen(offset), frozen(lower), frozen(upper), spec.limits_tolerance)


def _shapes(urdf: Urdf, frames: dict[str, LinkFrame]) -> tuple[Shape, ...]:
    """Boxes, cylinders and spheres of the URDF's visuals; meshes are left to the viewer."""
    materials = {m.get("name"): m for m in urdf.root.all("material")}
    out: list[Shape] = []
    for name, link in urdf.links().items():
        for visual in link.all("visual") if name in frames else ():
            shape = _geometry(visual)
            if shape is None:
                continue
            material = visual.first("material")
            rgba = _colour(material, materials)
            placement = frames[name].placement @ _origin(visual.first("origin"))
            out.append(Shape(frames[name].link, frozen(placement), *shape, rgba))
    return tuple(out)


def _geometry(visual: Node) -> tuple[str, tuple[float, ...]] | None:
    geometry = visual.first("geometry")
    for node in geometry.children if geometry else ():
        keys = {"box": ("size", 3), "sphere": ("radius", 1)}.get(node.tag)
        if keys is not None:
            size = numbers(node.get(keys[0]), keys[1])
            return None if size is None else (node.tag, tuple(size.tolist()))
        if node.tag == "cylinder":
            size = numbers(f"{node.get('radius')} {node.get('length')}", 2)
            return None if size is None else ("cylinder", tuple(size.tolist()))
    return None


def _colour(material: Node | None, materials: dict[str, Node]) -> tuple[float, float, float, float]:
    if material is not None and material.first("color") is None:
        material = materials.get(material.get("name"))
    colour = material.first("color") if material else None
    values = numbers(colour.get("rgba"), 4) if colour else None
    return (0.7, 0.7, 0.7, 1.0) if values is None else (*values.tolist(),)  # type: ignore[return-value]


def _origin(node: Node | None) -> Array:
    """Homogeneous matrix of an <origin xyz rpy>."""
    xyz = numbers(node.get("xyz", "0 0 0"), 3) if node else None
    rpy = numbers(node.get("rpy", "0 0 0"), 3) if node else None
    out = np.eye(4)
    if xyz is not None:
        out[:3, 3] = xyz
    if rpy is not None:
        (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
        out[:3, :3] = [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    return out
