"""Where the markers are in one state, FK(q + dq, placements) + D eps, and the derivatives.

eps is what gravity and the compensators bend, tau_0, and in the loaded state the wrench too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics.direct import element_readings, geometry_tangents
from qsframework.elastostatics.evaluation import Stages, evaluate_stages
from qsframework.elastostatics.sensors import Sensed
from qsframework.elastostatics.springs import Response
from qsframework.elastostatics.structure import Structure
from qsframework.elastostatics.tangents import carry, changes, reading_along
from qsframework.plugin import Array, Poses


@dataclass(frozen=True, eq=False)
class OneState(Stages):
    """The answer of one state, with the conditions under which it was measured."""

    loaded: bool
    response: Response
    sensed: Sensed | None


def evaluate_state(model: Structure, poses: Poses, x: Array, loaded: bool) -> OneState:
    """Run all stages for one state."""
    s = evaluate_stages(model, poses, x, preload=True, loaded=loaded)
    assert s.preload is not None
    response = s.respond(s.preload + s.tau if loaded else s.preload)
    return OneState(**vars(s), loaded=loaded, response=response, sensed=s.sense(response.eps))


def position(ev: OneState) -> Array:
    """Reading (K, 3, N) m of each marker, base frame."""
    if ev.sensed is not None:
        return ev.sensed.position
    return np.stack([m.position for m in ev.state.markers]) + carry(ev.state.markers, ev.response.eps)


def position_tangents(ev: OneState, wanted: Sequence[int]) -> Array:
    """d reading / d parameter for the wanted positions in x: (P, K, 3, N)."""
    out = np.empty((len(wanted), len(ev.state.markers), 3, len(ev.poses)))
    left = geometry_tangents(ev, wanted, lambda: element_readings(ev, ev.sensed, ev.response, ev.loaded), out)
    for row, change in changes(ev, [wanted[i] for i in left]):
        out[left[row]] = reading_along(ev, ev.sensed, ev.response, change, ev.loaded)
    return out
