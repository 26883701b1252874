"""A 3D scene: objects by path, in metres, z up; steps of a slider and layers to hide. `html` writes it as one page.

The page is meshcat's viewer with the scene packed in, and what one does with it; it loads nothing. Every solid, colour
and part of the tree is held once, however often it is drawn: a robot at twelve poses is the same seven links at twelve
places. Parts of the tree that are equal but for where they stand are one node, so a pose costs its links' placements
and little more.
"""

from __future__ import annotations

import base64
import html
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from qsframework.plugin import Array, Indices
from qsframework.plugin.rotations import homogeneous

Colour = tuple[float, float, float, float]
Text = tuple[str, str, tuple[float, ...], str, int]
Glow = tuple[str, tuple[float, ...], float, str, float, bool]
_UPRIGHT = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""The viewer's cylinder lies along y."""
_AXES: tuple[Colour, ...] = ((0.85, 0.1, 0.1, 1.0), (0.1, 0.6, 0.1, 1.0), (0.1, 0.2, 0.85, 1.0))
_HERE = "qsframework.viz"
_DIGITS = 5
"""Decimals of a placement: 0.01 mm in a scene where deflections are drawn 100 times as large."""
_UNMOVED = (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0)


@dataclass(frozen=True)
class Drawn:
    """A solid: what three.js calls it with its sizes in m or the bytes of its corners; colour 0xrrggbb and opacity.

    length: of a cylinder, apart from its radii, so that rods of one thickness are one solid
    """

    solid: tuple[str | float, ...]
    colour: int
    opacity: float
    length: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Facts:
    """What the page says of a step, and how it plays.

    name: by which a link leads to it; angles: joint and angle, as people read them; shares: spring, and its part of
    what the load point moves; plays: paths of the arm and of the bent arm, between which it swings
    """

    name: str = ""
    angles: tuple[tuple[str, str], ...] = ()
    shares: tuple[tuple[str, float], ...] = ()
    plays: tuple[str, str] | None = None


@dataclass(kw_only=True)
class Scene:
    """Objects to draw, in metres, z up. Built up, then written once with `html`."""

    title: str
    placed: dict[str, Array] = field(default_factory=dict[str, Array])
    """Path -> its placement (4, 4) in what is above it."""
    drawn: dict[str, Drawn] = field(default_factory=dict[str, Drawn])
    """Path -> the solid that stands there."""
    steps: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])
    """Paths that a slider shows one at a time, with the label of each."""
    ghosts: dict[str, str] = field(default_factory=dict[str, str])
    """Path of a step -> path of what stands for it while another step is chosen."""
    first: int = 0
    """The step that is shown at first, counted from 1; 0 shows all."""
    layers: dict[str, list[str]] = field(default_factory=dict[str, list[str]])
    """Paths that a box on the page shows or hides together."""
    off: set[str] = field(default_factory=set[str])
    """Layers that are hidden at first."""
    facts: dict[str, Facts] = field(default_factory=dict[str, Facts])
    """Path of a step -> what the page says of it."""
    texts: list[Text] = field(default_factory=list[Text])
    glows: list[Glow] = field(default_factory=list[Glow])
    moves: list[tuple[str, Array, Array]] = field(default_factory=list[tuple[str, Array, Array]])
    """Path -> where it stands without and with the load, while the page plays it."""
    factor: str = ""
    """By how much what plays is exaggerated, as the page says it."""
    notes: list[str] = field(default_factory=list[str])
    """Sentences on the page: what is seen, at what scale."""
    size: float = 3.0
    """How large the scene is, m, where nothing in it says so."""

    @property
    def poses(self) -> tuple[str, ...]:
        """The pose that each step shows."""
        return tuple(self.facts[path].name for path, _ in self.steps)

    def transform(self, path: str, placement: Array) -> None:
        """Move a path and everything below it by a placement (4, 4)."""
        self.placed[path] = np.array(placement, dtype=float)

    def box(self, path: str, size: tuple[float, ...], placement: Array, colour: Colour) -> None:
        """A box of size x, y, z about its placement (4, 4)."""
        self._add(path, ("BoxGeometry", *size), placement, colour)

    def sphere(self, path: str, radius: float, placement: Array, colour: Colour) -> None:
        """A sphere about its placement."""
        self._add(path, ("SphereGeometry", radius), placement, colour)

    def ellipsoid(self, path: str, centre: Array, axes: Array, colour: Colour) -> None:
        """An ellipsoid about a point (3,) with its half axes (m) as the columns of axes (3, 3)."""
        placement = placed_at(centre)
        placement[:3, :3] = axes if np.linalg.det(axes) > 0.0 else -axes
        self._add(path, ("SphereGeometry", 1.0), placement, colour)

    def cylinder(
        self, path: str, radius: float, length: float, placement: Array, colour: Colour, top: float | None = None
    ) -> None:
        """A cylinder along the z axis of its placement; a cone where the radius at its `top` is another."""
        ends = (radius if top is None else top, radius)
        self._add(path, ("CylinderGeometry", *ends), placement @ _UPRIGHT, colour, length)

    def mesh(self, path: str, vertices: Array, faces: Indices, placement: Array, colour: Colour) -> None:
        """Triangles between vertices (V, 3) m: faces (F, 3)."""
        self._add(path, ("BufferGeometry", *corners(vertices, faces)), placement, colour)

    def rod(self, path: str, start: Array, end: Array, radius: float, colour: Colour) -> None:
        """A cylinder between two points (3,)."""
        length = float(np.linalg.norm(end - start))
        if length > 0.0:
            self.cylinder(path, radius, length, along(start, end), colour)

    def arrow(self, path: str, start: Array, vector: Array, radius: float, colour: Colour) -> None:
        """An arrow from a point (3,) whose tip is `vector` (3,) away; nothing where that is zero."""
        length = float(np.linalg.norm(vector))
        if length == 0.0:
            return
        end, share = start + vector, min(6.0 * radius / length, 0.6)
        neck = end - share * vector
        self.rod(f"{path}/shaft", start, neck, radius, colour)
        head = along(neck, end)
        head[:3, 3] = end
        self.transform(f"{path}/head", head)
        back = placed_at(np.array([0.0, 0.0, -0.5 * share * length]))
        self.cylinder(f"{path}/head/cone", 2.4 * radius, share * length, back, colour, top=0.0)

    def axes(self, path: str, placement: Array, size: float) -> None:
        """A frame: its x, y and z axis in red, green and blue."""
        self.transform(path, placement)
        for name, vector, colour in zip("xyz", np.eye(3), _AXES, strict=True):
            self.rod(f"{path}/{name}", np.zeros(3), size * vector, 0.06 * size, colour)

    def text(self, path: str, text: str, point: Array, ink: str = "#222", step: int = 0) -> None:
        """Words at a point (3,) of a path that is drawn; step: a number on which a click chooses that step."""
        self.texts.append((path, text, _rounded(point), ink, step))

    def glow(
        self, path: str, point: Array, radius: float, colour: str, strength: float = 1.0, pulse: bool = False
    ) -> None:
        """A light at a point (3,) of a path, strength 0 to 1; it comes and goes with the load, or pulses by itself."""
        self.glows.append((path, _rounded(point), radius, colour, strength, pulse))

    def step(self, path: str, label: str, ghost: str | None = None, facts: Facts | None = None) -> None:
        """Make a path one of the slider's steps; its ghost is seen while another step is chosen."""
        self.steps.append((path, label))
        self.facts[path] = facts or Facts(name=label)
        if ghost is not None:
            self.ghosts[path] = ghost

    def layer(self, name: str, path: str, shown: bool = True) -> None:
        """Put a path into a layer that a box shows or hides."""
        self.layers.setdefault(name, []).append(path)
        if not shown:
            self.off.add(name)

    def _add(
        self, path: str, solid: tuple[str | float, ...], placement: Array, colour: Colour, length: float = 0.0
    ) -> None:
        red, green, blue = (int(255 * c) for c in colour[:3])
        self.drawn[path] = Drawn(solid, (red << 16) + (green << 8) + blue, colour[3], length)
        self.transform(path, placement)

    def html(self, watch: str | None = None) -> str:
        """The page: no request leaves it, but to `watch` on the same server, if it is given."""
        return render(self, watch)


def _rounded(values: Array) -> tuple[float, ...]:
    return tuple(round(float(v), _DIGITS) for v in values)


def placed_at(position: Array) -> Array:
    """A placement (4, 4) at a position (3,), not turned."""
    return homogeneous(np.eye(3), position)


def along(start: Array, end: Array) -> Array:
    """A placement (4, 4) in the middle of two points (3,), its z axis from one to the other."""
    z = (end - start) / np.linalg.norm(end - start)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    placement = placed_at(0.5 * (start + end))
    placement[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    return placement


def render(scene: Scene, watch: str | None = None) -> str:
    """The page as HTML.

    watch: an address of the same server that answers with a number, a new one when the page is out of date
    """
    steps = [{"path": path, "label": label, **_facts(scene, path)} for path, label in scene.steps]
    layers = {name: {"paths": paths, "shown": name not in scene.off} for name, paths in scene.layers.items()}
    content = {
        **packed(scene.placed, scene.drawn, [path for path, *_ in (*scene.texts, *scene.glows)]),
        "texts": scene.texts,
        "glows": scene.glows,
        "moves": [[path, *(_rounded(p[:3].ravel()) for p in ends)] for path, *ends in scene.moves],
        "factor": scene.factor,
        "steps": steps,
        "layers": layers,
        "first": scene.first,
        "all": not scene.ghosts and scene.first == 0,
        "size": scene.size,
        "watch": watch,
    }
    parts = {
        "title": html.escape(scene.title),
        "unfolded": "" if scene.steps else " open",
        "notes": "".join(f"<p>{html.escape(note)}</p>" for note in scene.notes),
        "meshcat": _meshcat(),
        "scene": json.dumps(content, separators=(",", ":")).replace("<", "\\u003c"),
        "script": files(_HERE).joinpath("page.js").read_text(encoding="utf-8"),
    }
    page = files(_HERE).joinpath("page.html").read_text(encoding="utf-8")
    return re.sub(r"\{(\w+)\}", lambda m: parts.get(m[1], m[0]), page)


def _meshcat() -> str:
    """The viewer's own script, from the package, of which nothing else is loaded."""
    found = find_spec("meshcat")
    assert found is not None
    assert found.origin is not None
    script = Path(found.origin).parent / "viewer" / "dist" / "main.min.js"
    return script.read_text(encoding="utf-8").replace("</script", "<\\/script")


def _facts(scene: Scene, path: str) -> dict[str, Any]:
    facts = scene.facts[path]
    return {
        "ghost": scene.ghosts.get(path),
        "name": facts.name,
        "angles": facts.angles,
        "shares": [[name, f"{100.0 * share:.0f} %", share] for name, share in facts.shares],
        "plays": facts.plays,
    }


def corners(vertices: Array, faces: Indices) -> tuple[str, str]:
    """Vertices (V, 3) m and faces (F, 3) of a mesh as the page reads them."""
    parts = (np.asarray(vertices, dtype=np.float32), np.asarray(faces, dtype=np.uint32))
    points, triangles = (base64.b64encode(part.tobytes()).decode() for part in parts)
    return points, triangles


def packed(placed: Mapping[str, Array], drawn: Mapping[str, Drawn], paths: Sequence[str] = ()) -> dict[str, Any]:
    """Solids, colours, matrices, nodes and the number of the root node.

    A node is (solid, colour, length, name, matrix, node, name, ...): what stands there, -1 for nothing, how long it is
    where it is a cylinder, and its children. paths: that are there even where nothing is drawn.
    """
    once: dict[str, dict[Any, int]] = {name: {} for name in ("solids", "colours", "matrices", "nodes")}

    def number(name: str, value: Any) -> int:
        return once[name].setdefault(value, len(once[name]))

    children: dict[str, list[str]] = {"": []}
    for path in dict.fromkeys([*placed, *drawn, *paths]):
        parts = path.split("/")
        for k in range(len(parts)):
            here = "/".join(parts[: k + 1])
            if here not in children:
                children[here] = []
                children["/".join(parts[:k])].append(here)

    def node(path: str) -> int:
        content: list[Any] = [-1, -1, 0]
        if (here := drawn.get(path)) is not None:
            solid = tuple(part if isinstance(part, str) else _short(part) for part in here.solid)
            colour = (here.colour, round(here.opacity, 3))
            content = [number("solids", solid), number("colours", colour), _short(here.length)]
        for child in children[path]:
            content += [child.rpartition("/")[2], number("matrices", _matrix(placed.get(child))), node(child)]
        return number("nodes", tuple(content))

    root = node("")
    return {**{name: list(values) for name, values in once.items()}, "root": root}


def _matrix(placement: Array | None) -> tuple[float, ...] | int:
    """Three rows of four; 0 where nothing is moved."""
    if placement is None:
        return 0
    rows = tuple(map(_short, placement[:3].ravel().tolist()))
    return 0 if rows == _UNMOVED else rows


def _short(value: float) -> float | int:
    rounded = round(float(value), _DIGITS)
    return int(rounded) if rounded == int(rounded) else rounded
