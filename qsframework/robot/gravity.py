"""The weight of the links: the torques that it puts on the elements of a chain."""

from __future__ import annotations

import numpy as np

from qsframework.plugin.facts import Array
from qsframework.robot.kinematics import Frames, cross


def element_gravity(placed: Frames, moments: Array, gravity: Array) -> Array:
    """Torque of the masses on every element of the chain, (m, N) N m.

    Element e carries the summed mass M and mass moment h of all links after it: g . (z x (h - M o)). A branch hangs
    on its link with its own weight.
    """
    stops, limbs, elements = placed.chain.stops, placed.chain.limbs, placed.chain.elements
    torque = np.empty((len(elements), placed.positions.shape[-1]))
    pull = cross(gravity[:, None], placed.axes)
    hung: dict[int, tuple[float, Array]] = {}

    def add(link: int, mass: float, weight: Array) -> tuple[float, Array]:
        r, m = placed.rotations[link], moments[link]
        weight = weight + m[0] * placed.positions[link] + m[1] * r[0] + m[2] * r[1] + m[3] * r[2]
        more, moment = hung.get(link, (0.0, 0.0))
        return mass + m[0] + more, weight + moment

    def moment(e: int, mass: float, weight: Array) -> Array:
        if elements[e].rotation:
            return np.einsum("cn,cn->n", pull[e], weight - mass * placed.origins[e])
        return mass * (gravity @ placed.axes[e])

    for i in range(len(limbs) - 1, -1, -1):
        mass, weight = add(len(stops) + i, 0.0, np.zeros((3, 1)))
        torque[len(elements) - len(limbs) + i] = moment(len(elements) - len(limbs) + i, mass, weight)
        before, held = hung.get(limbs[i], (0.0, np.zeros((3, 1))))
        hung[limbs[i]] = before + mass, held + weight
    mass, weight, link = 0.0, np.zeros((3, 1)), len(stops)
    for e in range(placed.chain.arm - 1, -1, -1):
        while link > 0 and stops[link - 1] > e:
            link -= 1
            mass, weight = add(link, mass, weight)
        torque[e] = moment(e, mass, weight)
    return torque
