"""What a table of Denavit and Hartenberg leaves open: zeros and signs of the joints, and where the first bearing is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsframework.plugin import Array
from qsframework.robot.urdf import Joint, placement

_ALONG = 0.999
"""Of a cosine, within 2.6 degrees of a coordinate axis."""


def zero_notes(chain: Sequence[Joint], bearing: float | None) -> tuple[str, ...]:
    """The pose in which all joints are at zero and the sense of each, to hold against the manual.

    chain: all joints from base to flange; bearing: m, the height that was stated of the first one
    """
    moving = [joint for joint in chain if joint.moves]
    frames = [placement(chain[: chain.index(joint) + 1]) for joint in moving]
    flange = placement(chain)
    x, y, z = (f"{1e3 * value + 0.0:.5g}" for value in np.round(flange[:3, 3], 6))
    senses = ", ".join(f"{j.name} {_direction(f[:3, :3] @ j.axis)}" for j, f in zip(moving, frames, strict=True))
    notes = (
        f"zeros: with all joints at 0 the flange stands at x {x}, y {y}, z {z} mm of the base and its z points along "
        f"{_direction(flange[:3, 2])}; does the manual's picture of the pendant's zeros show that? Else write, where "
        "the pendant shows 0 for 90 deg here, such as equals: J2 + 90 deg in controller",
        f"signs: seen against these directions positive joints turn anticlockwise: {senses}; do the manual's arrows? "
        "Where the pendant counts the other way (A1, A4 and A6 of a KUKA) write equals: -J1, -J4, -J6 there",
        f"bearing: a tilt compliance of {moving[0].name} acts {frames[0][:3, 3] @ frames[0][:3, 2]:.4g} m up its axis; "
        "where its bearing is higher by the manual, make the folder again with that height",
    )
    return notes if bearing is None else notes[:2]


def _direction(axis: Array) -> str:
    """A direction in words: a coordinate axis, or its components."""
    axis = axis / np.linalg.norm(axis)
    k = int(np.argmax(np.abs(axis)))
    if abs(axis[k]) > _ALONG:
        return f"{'+' if axis[k] > 0 else '-'}{'xyz'[k]}"
    return "(" + ", ".join(f"{value + 0.0:.2f}" for value in np.round(axis, 2)) + ")"
