"""The weight of the links: their mass moments, and the torques that it puts on the elements of a chain."""

from __future__ import annotations

import numpy as np

from qsframework.plugin.facts import Array, RobotFacts
from qsframework.robot.kinematics import Frames, cross


def nominal_moments(facts: RobotFacts) -> Array:
    """Mass and mass times centre of each link, (n + 1, 4)."""
    return np.concatenate([facts.masses[:, None], facts.masses[:, None] * facts.centres], axis=1)


def element_gravity(placed: Frames, moments: Array, gravity: Array) -> Array:
    """Torque of the masses on every element of the chain, (m, N) N m.

    Element e carries the summed mass M and mass moment h of all links after it: g . (z x (h - M o)).
    """
    stops, elements = placed.chain.stops, placed.chain.elements
    torque = np.empty((len(elements), placed.positions.shape[-1]))
    pull = cross(gravity[:, None], placed.axes)
    mass, weight, link = 0.0, np.zeros((3, 1)), len(stops)
    for e in range(len(elements) - 1, -1, -1):
        while link > 0 and stops[link - 1] > e:
            link -= 1
            r, m = placed.rotations[link], moments[link]
            weight = weight + m[0] * placed.positions[link] + m[1] * r[0] + m[2] * r[1] + m[3] * r[2]
            mass = mass + m[0]
        if elements[e].rotation:
            torque[e] = np.einsum("cn,cn->n", pull[e], weight - mass * placed.origins[e])
        else:
            torque[e] = mass * (gravity @ placed.axes[e])
    return torque
