"""What a description leaves open: zeros and signs of the joints, and where the first bearing is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsf_onboarding.joints import slides
from qsframework.plugin import Array
from qsframework.robot.urdf import Joint, placement

_ALONG = 0.999
"""Of a cosine, within 2.6 degrees of a coordinate axis."""


def zero_notes(chain: Sequence[Joint]) -> tuple[str, ...]:
    """The pose in which all joints of a chain are at zero and the sense of each, to hold against the manual."""
    moving = [joint for joint in chain if joint.moves]
    frames = [placement(chain[: chain.index(joint) + 1]) for joint in moving]
    flange = placement(chain)
    x, y, z = (f"{1e3 * value + 0.0:.5g}" for value in np.round(flange[:3, 3], 6))
    senses = ", ".join(f"{j.name} {_direction(f[:3, :3] @ j.axis)}" for j, f in zip(moving, frames, strict=True))
    return (
        f"zeros: with all joints at 0 the flange stands at x {x}, y {y}, z {z} mm of the base and its z points along "
        f"{_direction(flange[:3, 2])}; does the manual's picture of the pendant's zeros show that? Else write, where "
        "the pendant shows 0 for 90 deg here, such as equals: J2 + 90 deg in controller",
        f"signs: seen against these directions positive joints turn anticlockwise: {senses}; do the manual's arrows? "
        "Where the pendant counts the other way (A1, A4 and A6 of a KUKA) write equals: -J1, -J4, -J6 there",
    )


def first_bearing(chain: Sequence[Joint], height: float | None) -> tuple[dict[str, float], tuple[str, ...]]:
    """Where the bearing of the first joint that turns is, m along its axis from its frame, by the joint's name.

    height: m above the base, of the bearing; where nobody states it, there is a note in its stead
    """
    for k, joint in enumerate(chain):
        if joint.moves and not slides(joint):
            frame = placement(chain[: k + 1])
            axis = frame[:3, :3] @ joint.axis
            here = float(frame[2, 3])
            if height is not None:
                return {joint.name: (height - here) * (1.0 if axis[2] >= 0.0 else -1.0)}, ()
            frame_at = f"its frame, {here:.4g} m above the base, give or take a tenth of the reach"
            to_do = f"where the manual shows its bearing, add bearing_mm to {joint.name} in controller, from there"
            return {}, (f"bearing: a tilt of {joint.name} is taken about {frame_at}; {to_do} along the axis",)
    return {}, ()


def _direction(axis: Array) -> str:
    """A direction in words: a coordinate axis, or its components."""
    axis = axis / np.linalg.norm(axis)
    k = int(np.argmax(np.abs(axis)))
    if abs(axis[k]) > _ALONG:
        return f"{'+' if axis[k] > 0 else '-'}{'xyz'[k]}"
    return "(" + ", ".join(f"{value + 0.0:.2f}" for value in np.round(axis, 2)) + ")"
