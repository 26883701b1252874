"""A loop that a URDF closes by two joints which carry one link: the tie to delete and the effect to write."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from qsframework.errors import Problem
from qsframework.plugin import Array
from qsframework.robot.checks import two_parents
from qsframework.robot.spec import yaml_key
from qsframework.robot.urdf import Joint, Urdf, placement


def closed_loops(urdf: Urdf) -> list[Problem]:
    """Every link with two parents, and how to write the loop that they close."""
    return two_parents(urdf, partial(_advice, {joint.child: joint for joint in reversed(urdf.joints)}))


def _advice(above: Mapping[str, Joint], one: Joint, other: Joint) -> str:
    """Which joint to delete of those that carry a link, and the lines of the two effects that the loop may be, with the
    lengths that are drawn. above: the joint that carries each link, the first where there are two
    """
    ways = [[*_upwards(above, joint.parent)[::-1], joint] for joint in (one, other)]
    shared = {joint.name for joint in ways[0]} & {joint.name for joint in ways[1]} - {one.name, other.name}
    arm, bars = sorted(
        ([j for j in way if j.name not in shared] for way in ways), key=lambda way: sum(j.moves for j in way)
    )
    tie = (
        f"A URDF is a tree: delete joint {bars[-1].name!r}, which ties the loop; name the flange, as its bars then hang"
    )
    tie += " open; and write the loop in robot.yaml under effects:"
    turning, pivots = [j for j in arm if j.moves], [*(j for j in bars[:-1] if j.moves), bars[-1]]
    places = {j.name: placement(way[: k + 1]) for way in (arm, bars) for k, j in enumerate(way)}
    if len(turning) != 2 or len(pivots) != 3 or not np.isfinite([*places.values()]).all():
        return f"{tie} as {{effect: closed_chain, ...}}"
    axis = places[turning[0].name][:3, :3] @ (turning[0].axis / (np.linalg.norm(turning[0].axis) or 1.0))
    across = np.eye(3) - np.outer(axis, axis)
    shoulder, elbow, lever, bar, end = (across @ places[joint.name][:3, 3] for joint in (*turning, *pivots))
    ends = f"driver: {yaml_key(turning[0].name)}, driven: {yaml_key(turning[1].name)}"
    long, zero = float(np.linalg.norm(bar - lever)), _angle(axis, elbow - shoulder, bar - lever)
    more = f"bar_m: {np.linalg.norm(end - bar):.6g}, rocker_m: {np.linalg.norm(end - elbow):.6g}"
    more += f", lever_zero_deg: {zero:.6g}, rocker_zero_deg: {_angle(axis, elbow - shoulder, end - elbow):.6g}"
    if axis @ np.cross(end - bar, end - elbow) < 0.0:
        more += ", branch: -1"
    return (
        f"{tie} as {{effect: parallelogram, {ends}, lever_m: {long:.6g}, zero_deg: {zero:.6g}}} where its bars are "
        f"parallel, else as {{effect: four_bar, {ends}, lever_m: {long:.6g}, {more}}}"
    )


def _upwards(above: Mapping[str, Joint], link: str) -> list[Joint]:
    """The joints from a link to the root, or once around where they run in a circle."""
    way: dict[str, Joint] = {}
    while link in above and link not in way:
        way[link] = above[link]
        link = above[link].parent
    return list(way.values())


def _angle(axis: Array, start: Array, end: Array) -> float:
    """The angle, deg, about an axis from one vector to another."""
    return float(np.rad2deg(np.arctan2(axis @ np.cross(start, end), start @ end)))
