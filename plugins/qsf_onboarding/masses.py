"""Masses where a stranger's URDF has none, and bodies where its inertias are those of none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from qsframework.plugin import Array
from qsframework.robot.urdf import Inertial, Joint, Link, Origin, Urdf

_MASS = {True: (40.0, 0.25, 2.0), False: (8.0, 0.5, 0.9)}
"""kg at 1 kg of payload and 1 m of reach, and the powers of these with which it grows, of arms of castings and gears
(thirty data sheets within a factor of 2: R-2000iC 920 kg, IRB 2400 270 kg move) and of others (seventeen lightweight
ones: UR10 28 kg, iiwa 14 26 kg)."""
_PAYLOAD = {True: (8.3, 2.5), False: (7.0, 0.0)}
"""Where none is stated: kg at a reach of 1 m, and the power of the reach with which it grows."""
_NEXT = 0.5
"""A link's mass over that of the link before it."""


def mass_of(urdf: Urdf, name: str) -> float:
    """Mass (kg) of a link and of what is fixed to it."""
    links = {link.name: link.inertial for link in urdf.links}
    inertials = (links[fixed] for fixed in urdf.fixed_to(name))
    return sum(inertial.mass for inertial in inertials if inertial is not None)


def with_bodies(urdf: Urdf) -> tuple[Urdf, tuple[str, ...]]:
    """With the inertia of a ball where a mass has that of no body; and the names of these links.

    An inertia without a mass says nothing of an arm at rest and is left out.
    """
    links: list[Link] = []
    changed: list[str] = []
    for link in urdf.links:
        given = link.inertial
        if given is not None and given.mass == 0.0:
            given = None
        elif given is not None and given.mass > 0.0 and not _of_a_body(given.inertia):
            changed.append(link.name)
            given = replace(given, inertia=_ball(given.mass, 0.5 * max(0.01, given.mass / 1000.0) ** (1.0 / 3.0)))
        links.append(replace(link, inertial=given))
    return replace(urdf, links=tuple(links)), tuple(changed)


def _of_a_body(inertia: Array) -> bool:
    moments = np.linalg.eigvalsh(inertia)
    return bool(moments[0] > 0.0 and moments[2] <= (moments[0] + moments[1]) * (1.0 + 1e-9))


def _ball(mass: float, radius: float) -> Array:
    return 0.4 * mass * radius**2 * np.eye(3)


def moving_mass(payload: float | None, reach: float, heavy: bool) -> float:
    """What moves (kg) of an arm of this payload (kg) and reach (m). heavy: built as industrial arms are"""
    typical, growth = _PAYLOAD[heavy]
    mass, by_payload, by_reach = _MASS[heavy]
    return float(mass * (payload or typical * reach**growth) ** by_payload * reach**by_reach)


def with_masses(urdf: Urdf, chain: list[Joint], base: str, total: float) -> tuple[Urdf, tuple[str, ...]]:
    """With assumed masses on moving links that have none, and the names of these links.

    Where most links have one, a bare link gets half of what the link before it has; else all are assumed, `total` kg
    for the arm, and as much as its first link for each carriage before it.
    """
    moving = [j for j in chain if j.moves]
    known = np.array([mass_of(urdf, j.child) for j in moving])
    bare = ~(known > 0.0)
    if not bare.any():
        return urdf, ()
    reach = sum(float(np.linalg.norm(j.origin.xyz)) for j in chain[1:]) or 1.0
    everything = 2 * int(bare.sum()) > len(moving)
    if everything:
        first = next((k for k, j in enumerate(moving) if j.kind != "prismatic"), 0)  # what carries an arm is none of it
        shares = _NEXT ** np.maximum(np.arange(len(moving)) - first, 0)
        masses, bare = total * shares / shares[first:].sum(), np.ones(len(moving), dtype=bool)
    else:
        masses = known.copy()
        for k in np.flatnonzero(bare):
            masses[k] = _NEXT * masses[k - 1] if k else masses[~bare][0] / _NEXT
    links = {link.name: link for link in urdf.links}
    for k in np.flatnonzero(bare):
        link = links[moving[k].child]
        links[link.name] = replace(link, inertial=_assumed(urdf, link, chain, float(masses[k]), max(0.1 * reach, 0.05)))
    if everything:
        for j in urdf.joints:  # a mass on a fixed link would count twice
            if not j.moves and j.parent != base:
                links[j.child] = replace(links[j.child], inertial=None)
    return replace(urdf, links=tuple(links.values())), tuple(moving[k].child for k in np.flatnonzero(bare))


def _assumed(urdf: Urdf, link: Link, chain: list[Joint], mass: float, radius: float) -> Inertial:
    """A ball half way to the next joint."""
    after = [j for j in urdf.joints if j.parent == link.name and j.child in {c.child for c in chain}]
    half = 0.5 * after[0].origin.xyz if after else np.zeros(3)
    return Inertial(mass, Origin(half, np.zeros(3)), _ball(mass, radius), link.place, link.place)
