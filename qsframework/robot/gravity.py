"""The weight of the links: the torques that it puts on the elements of a chain."""

from __future__ import annotations

import numpy as np

from qsframework.plugin.facts import Array
from qsframework.robot.kinematics import SMALL, Frames, cross


def element_gravity(placed: Frames, moments: Array, gravity: Array) -> Array:
    """Torque of the masses on every element of the chain, (m, N) N m.

    Element e carries the summed mass M and mass moment h of all links after it: g . (z x (h - M o)). A branch hangs
    on its link with its own weight.
    """
    chain, moments = placed.chain, moments[: len(placed.positions)]
    masses = moments[:, 0].tolist()
    weights = _weights(placed, moments)
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
    torque = np.einsum("ecn,ecn->en", cross(gravity[:, None], placed.axes), behind)
    for e, element in enumerate(chain.elements):
        if not element.rotation:
            torque[e] = carried[e] * (gravity @ placed.axes[e])
    return torque


def _weights(placed: Frames, moments: Array) -> Array:
    """Mass times position of every body, (links, 3, N) kg m."""
    if placed.positions.size <= SMALL:
        own = np.einsum("lk,lkcn->lcn", moments[:, 1:], placed.rotations)
        return np.asarray(moments[:, 0, None, None] * placed.positions + own)
    out = np.empty_like(placed.positions)
    for weight, (mass, *arm), position, columns in zip(
        out, moments.tolist(), placed.positions, placed.rotations, strict=True
    ):
        np.multiply(position, mass, out=weight)
        for moment, column in zip(arm, columns, strict=True):
            if moment != 0.0:
                weight += moment * column
    return out
