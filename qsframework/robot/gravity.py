"""The weight of the links: where it hangs, and the torques that it puts on the elements of a chain."""

from __future__ import annotations

import numpy as np

from qsframework.plugin.facts import Array
from qsframework.robot.kinematics import SMALL, Chain, Frames, Twists, cross, twists


def element_gravity(placed: Frames, moments: Array, gravity: Array) -> Array:
    """Torque of the masses on every element of the chain, (m, N) N m: g . (z x (h - M o)), see `mass_levers`."""
    levers, masses = mass_levers(placed, moments)
    axes, torque = placed.axes, np.zeros(levers[:, 0].shape)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        if gravity[i] != 0.0:
            torque += gravity[i] * (axes[:, j] * levers[:, k] - axes[:, k] * levers[:, j])
    for e, element in enumerate(placed.chain.elements):
        if not element.rotation:
            torque[e] = masses[e] * (gravity @ axes[e])
    return torque


def mass_columns(placed: Frames, moments: Array) -> tuple[Twists, ...]:
    """Jacobians of the sums of mass times position: of each branch, and of all links of the arm together."""
    stops, weighs = len(placed.chain.stops), np.any(moments, axis=1)
    weights = _weights(placed.positions[stops:], placed.rotations[stops:], moments[stops:])
    branches = [link for link in np.flatnonzero(weighs).tolist() if link >= stops]
    out = [twists(placed, link, weights[link - stops], moments[link, 0]) for link in branches]
    return (*out, _arm_column(placed, moments[:stops])) if np.any(weighs[:stops]) else tuple(out)


def _arm_column(placed: Frames, moments: Array) -> Twists:
    chain, arm, stops = placed.chain, placed.chain.arm, len(placed.chain.stops)
    alone = Frames(
        chain=Chain(chain.elements[:arm], chain.stops),
        axes=placed.axes[:arm],
        origins=placed.origins[:arm],
        rotations=placed.rotations[:stops],
        positions=placed.positions[:stops],
    )
    levers, masses = mass_levers(alone, moments)
    linear, angular = cross(alone.axes, levers), alone.axes
    shifts = [e for e, element in enumerate(alone.chain.elements) if not element.rotation]
    if shifts:
        angular = angular.copy()
        linear[shifts] = np.array(masses)[shifts, None, None] * alone.axes[shifts]
        angular[shifts] = 0.0
    return Twists(linear, angular)


def mass_levers(placed: Frames, moments: Array) -> tuple[Array, list[float]]:
    """h - M o (m, 3, N) kg m and M kg for every element of the chain: the summed mass M and mass moment h of all links
    after it. A branch hangs on its link with its own weight."""
    chain, moments = placed.chain, moments[: len(placed.positions)]
    masses, weights = moments[:, 0].tolist(), _weights(placed.positions, placed.rotations, moments)
    behind, carried = np.empty_like(placed.axes), [0.0] * len(chain)
    for i in range(len(chain.limbs) - 1, -1, -1):
        e, link, parent = chain.arm + i, len(chain.stops) + i, chain.limbs[i]
        behind[e], carried[e] = weights[link], masses[link]
        weights[parent] += weights[link]
        masses[parent] += masses[link]
    mass, weight, link = 0.0, np.zeros((3, 1)), len(chain.stops)
    for e in range(chain.arm - 1, -1, -1):
        while link > 0 and chain.stops[link - 1] > e:
            link -= 1
            mass, weight = mass + masses[link], weight + weights[link]
        behind[e], carried[e] = weight, mass
    behind -= np.array(carried)[:, None, None] * placed.origins
    return behind, carried


def _weights(positions: Array, rotations: Array, moments: Array) -> Array:
    """Mass times position of bodies, (links, 3, N) kg m."""
    if positions.size <= SMALL:
        own = np.einsum("lk,lkcn->lcn", moments[:, 1:], rotations)
        return np.asarray(moments[:, 0, None, None] * positions + own)
    out = np.empty_like(positions)
    for weight, (mass, *arm), position, columns in zip(out, moments.tolist(), positions, rotations, strict=True):
        np.multiply(position, mass, out=weight)
        for moment, column in zip(arm, columns, strict=True):
            if moment != 0.0:
                weight += moment * column
    return out
