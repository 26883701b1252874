"""A scene as a page holds it: every solid, colour and part of the tree once, however often it is drawn.

A robot at twelve poses is the same seven links at twelve places. Parts of the tree that are equal but for where they
stand are one node, so a pose costs its links' placements and little more.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from qsframework.plugin import Array, Indices

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


def corners(vertices: Array, faces: Indices) -> tuple[str, str]:
    """Vertices (V, 3) m and faces (F, 3) of a mesh as the page reads them."""
    parts = (np.asarray(vertices, dtype=np.float32), np.asarray(faces, dtype=np.uint32))
    points, triangles = (base64.b64encode(part.tobytes()).decode() for part in parts)
    return points, triangles


class _Once:
    """Values that are kept once; a number for each."""

    def __init__(self) -> None:
        self.values: list[Any] = []
        self._known: dict[Any, int] = {}

    def number(self, value: Any) -> int:
        known = self._known.setdefault(value, len(self.values))
        if known == len(self.values):
            self.values.append(value)
        return known


def packed(placed: Mapping[str, Array], drawn: Mapping[str, Drawn], paths: Sequence[str] = ()) -> dict[str, Any]:
    """Solids, colours, matrices, nodes and the number of the root node.

    A node is (solid, colour, length, name, matrix, node, name, ...): what stands there, -1 for nothing, how long it is
    where it is a cylinder, and its children. paths: that are there even where nothing is drawn.
    """
    solids, colours, matrices, nodes = _Once(), _Once(), _Once(), _Once()
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
            content = [solids.number(solid), colours.number(colour), _short(here.length)]
        for child in children[path]:
            content += [child.rpartition("/")[2], matrices.number(_matrix(placed.get(child))), node(child)]
        return nodes.number(tuple(content))

    root = node("")
    return {
        "solids": solids.values,
        "colours": colours.values,
        "matrices": matrices.values,
        "nodes": nodes.values,
        "root": root,
    }


def _matrix(placement: Array | None) -> tuple[float, ...] | int:
    """Three rows of four; 0 where nothing is moved."""
    if placement is None:
        return 0
    rows = tuple(map(_short, placement[:3].ravel().tolist()))
    return 0 if rows == _UNMOVED else rows


def _short(value: float) -> float | int:
    rounded = round(float(value), _DIGITS)
    return int(rounded) if rounded == int(rounded) else rounded
