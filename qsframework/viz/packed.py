"""A scene as a page holds it: every solid, colour and part of the tree once, however often it is drawn.

A robot at twelve poses is the same seven links at twelve places. Parts of the tree that are equal but for where they
stand are one node, so a pose costs its links' placements and little more.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from typing import Any

_DIGITS = 5
"""Decimals of a placement: 0.01 mm in a scene where deflections are drawn 100 times as large."""
_SIZES = {
    "BoxGeometry": ("width", "height", "depth"),
    "SphereGeometry": ("radius",),
    "CylinderGeometry": ("radiusTop", "radiusBottom"),
}


class _Once:
    """Values that are kept once; a number for each."""

    def __init__(self) -> None:
        self.values: list[Any] = []
        self._known: dict[str, int] = {}

    def number(self, value: Any) -> int:
        key = json.dumps(value)
        if key not in self._known:
            self._known[key] = len(self.values)
            self.values.append(value)
        return self._known[key]


def packed(commands: Sequence[Mapping[str, Any]], paths: Sequence[str] = ()) -> dict[str, Any]:
    """Solids, colours, matrices, nodes and the number of the root node, of meshcat's commands.

    A node is [solid, colour, length, name, matrix, node, name, ...]: what stands there, -1 for nothing, how long it is
    where it is a cylinder, and its children. paths: that are there even where nothing is drawn.
    """
    solids, colours, matrices, nodes = _Once(), _Once(), _Once(), _Once()
    placed = {_own(c["path"]): c["matrix"] for c in commands if c["type"] == "set_transform"}
    drawn = {_own(c["path"]): c["object"] for c in commands if c["type"] == "set_object"}
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
        if path in drawn:
            solid, length = _solid(drawn[path]["geometries"][0])
            material = drawn[path]["materials"][0]
            colour = [material["color"], round(material["opacity"], 3)]
            content = [solids.number(solid), colours.number(colour), length]
        for child in children[path]:
            content += [child.rpartition("/")[2], matrices.number(_matrix(placed.get(child))), node(child)]
        return nodes.number(content)

    root = node("")
    return {
        "solids": solids.values,
        "colours": colours.values,
        "matrices": matrices.values,
        "nodes": nodes.values,
        "root": root,
    }


def _own(path: str) -> str:
    return path.removeprefix("/meshcat/")


def _matrix(columns: Sequence[float] | None) -> list[float] | int:
    """Three rows of four, of a matrix column by column; 0 for none."""
    if columns is None:
        return 0
    rows = [_short(columns[4 * k + i]) for i in range(3) for k in range(4)]
    return 0 if rows == [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0] else rows


def _short(value: float) -> float | int:
    rounded = round(float(value), _DIGITS)
    return int(rounded) if rounded == int(rounded) else rounded


def _solid(geometry: Mapping[str, Any]) -> tuple[list[Any], float]:
    """A solid without its length, where it has one, so that rods of one thickness are one solid; and the length."""
    kind = geometry["type"]
    if kind in _SIZES:
        sizes = [_short(geometry[key]) for key in _SIZES[kind]]
        return [kind, *sizes], _short(geometry.get("height", 0)) if kind == "CylinderGeometry" else 0
    data = geometry["data"]
    points, faces = data["attributes"]["position"]["array"].data, data["index"]["array"].data
    return [kind, *(base64.b64encode(part).decode() for part in (points, faces))], 0
