"""The page around a scene: meshcat's viewer with the scene packed in, and what one does with it. It loads nothing.

Every solid, colour and part of the tree is held once, however often it is drawn: a robot at twelve poses is the same
seven links at twelve places. Parts of the tree that are equal but for where they stand are one node, so a pose costs
its links' placements and little more.
"""

from __future__ import annotations

import base64
import html
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qsframework.plugin import Array, Indices

if TYPE_CHECKING:
    from qsframework.viz.scene import Scene

_HERE = "qsframework.viz"
_DIGITS = 5
"""Decimals of a placement: 0.01 mm in a scene where deflections are drawn 100 times as large."""
_UNMOVED = (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0)


def render(scene: Scene, watch: str | None = None) -> str:
    """The page as HTML.

    watch: an address of the same server that answers with a number, a new one when the page is out of date
    """
    steps = [{"path": path, "label": label, **_facts(scene, path)} for path, label in scene.steps]
    layers = {name: {"paths": paths, "shown": name not in scene.off} for name, paths in scene.layers.items()}
    content = {
        **packed(scene.placed, scene.drawn, [path for path, *_ in (*scene.texts, *scene.glows)]),
        "texts": [[*text] for text in scene.texts],
        "glows": [[*glow] for glow in scene.glows],
        "moves": [[path, *(_rows(p) for p in ends)] for path, *ends in scene.moves],
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
    facts = scene.facts.get(path)
    return {
        "ghost": scene.ghosts.get(path),
        "name": facts.name if facts else "",
        "angles": [list(a) for a in facts.angles] if facts else [],
        "shares": [[name, f"{100.0 * share:.0f} %", share] for name, share in facts.shares] if facts else [],
        "plays": list(facts.plays) if facts and facts.plays else None,
    }


def _rows(placement: Any) -> list[float]:
    """The first three rows of a placement (4, 4)."""
    return [round(float(v), 5) for v in placement[:3].ravel()]


@dataclass(frozen=True)
class Drawn:
    """A solid: what three.js calls it with its sizes in m or the bytes of its corners; colour 0xrrggbb and opacity.

    length: of a cylinder, apart from its radii, so that rods of one thickness are one solid
    """

    solid: tuple[str | float, ...]
    colour: int
    opacity: float
    length: float = 0.0


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
