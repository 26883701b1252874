"""The configuration of an effect: typed dataclass fields, units in the file's names, SI inside."""

from __future__ import annotations

import dataclasses
import math
from functools import cache
from typing import Any

AXES = ("x", "y", "z")
DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
_PLURALS = {"joint": "joints", "axis": "axes", "link": "links", "marker": "markers"}


def setting(unit: str = "", default: Any = dataclasses.MISSING, *, span: tuple[float, float] = (0.0, math.inf)) -> Any:
    """A number from the spec. With unit "m" the file says `name_mm` or `name_m`, the field is in m.

    span: the smallest and the largest size that it can have, of either sign, beside 0
    """
    return dataclasses.field(default=default, metadata={"unit": unit, "span": span})


def place(default: Any = dataclasses.MISSING, *, axis: bool = False) -> Any:
    """Where the effect acts: a field `joint`, `axis`, `link` or `marker`, part of the instance's name.

    In a spec its plural with a list, or `all`, makes one instance for each; `joints: all` are those with an actuator.
    axis: one of several axes of a place; to a diagnosis all axes of one place together are one cause, too.
    """
    return dataclasses.field(default=default, metadata={"place": True, "axis": axis})


@cache
def place_fields(effect: type) -> tuple[str, ...]:
    """Names of the fields that say where an effect acts."""
    return tuple(f.name for f in dataclasses.fields(effect) if f.metadata.get("place"))


@cache
def axis_fields(effect: type) -> tuple[str, ...]:
    """Names of the place fields that are one of several axes of a place."""
    return tuple(f.name for f in dataclasses.fields(effect) if f.metadata.get("axis"))


def twice_hint(effect: type) -> str | None:
    """What to do where two effects have one name: those with a place `label` may stand side by side."""
    labelled = "label" in place_fields(effect)
    return "If there are two of them, give each a name of its own, such as label: left." if labelled else None


def plural(name: str) -> str:
    """The spec's spelling for several places: joint -> joints, axis -> axes."""
    return _PLURALS.get(name, name + "s")
