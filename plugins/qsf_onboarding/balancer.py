"""A balancer that a stranger's URDF draws beside the arm: where its pivots are."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsf_onboarding.joints import body_of
from qsframework.plugin import Array
from qsframework.robot.urdf import Joint, Urdf

_CALLED = re.compile(r"balanc|counter_?spring|gas_?spring|equilibr", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class Balancer:
    """Two links of the arm with a pivot each, (3,) m in the frame of the link; drawn: the URDF's links there."""

    first: str
    second: str
    pivots: tuple[Array, Array]
    drawn: tuple[str, str]


def find_balancer(urdf: Urdf, base: str, chain: Sequence[Joint]) -> Balancer | None:
    """The balancer whose two ends hang on bodies of the arm that one joint parts; None where there are not two."""
    bodies = [base, *(joint.child for joint in chain if joint.moves)]
    found: list[tuple[int, Array, str]] = []
    for joint in urdf.joints:
        here = body_of(urdf, joint.parent)
        here = base if here not in bodies and base in urdf.fixed_to(here) else here
        if _CALLED.search(joint.child) and not _CALLED.search(joint.parent) and here in bodies:
            place = _place(urdf, here, joint.parent) @ joint.origin.matrix()
            found.append((bodies.index(here), place[:3, 3], joint.child))
    found.sort(key=lambda end: end[0])
    if len(found) != 2 or found[1][0] - found[0][0] != 1:
        return None
    (one, start, low), (other, end, high) = found
    return Balancer(bodies[one], bodies[other], (start, end), (low, high))


def _place(urdf: Urdf, body: str, link: str) -> Array:
    """Placement (4, 4) of a link in the frame of one that is fixed to it."""
    above = urdf.above()

    def up(name: str) -> Array:
        out = np.eye(4)
        while name in above and not above[name].moves:
            out = above[name].origin.matrix() @ out
            name = above[name].parent
        return out

    return np.linalg.inv(up(body)) @ up(link)
