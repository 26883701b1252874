"""Where the markers are in one state, FK(q + dq, placements) + D eps, and the derivatives.

eps is what gravity and the compensators bend, tau_0, and in the loaded state the wrench too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics.evaluation import Stages, evaluate_stages
from qsframework.elastostatics.sensors import Sensed
from qsframework.elastostatics.springs import Response
from qsframework.elastostatics.structure import Structure
from qsframework.elastostatics.tangents import carry, tangents
from qsframework.plugin import Array, Poses


@dataclass(frozen=True, eq=False)
class OneState(Stages):
    """The answer of one state, with the conditions under which it was measured."""

    loaded: bool
    response: Response
    sensed: Sensed | None

    @property
    def reading(self) -> Array:
        """What the instrument says (N, K, 3) m of the markers, base frame."""
        if self.sensed is not None:
            return self.sensed.position.transpose(2, 0, 1)
        position = np.stack([m.position for m in self.state.markers]) + carry(self.state.markers, self.response.eps)
        return position.transpose(2, 0, 1)

    def tangents(self, wanted: Sequence[int]) -> Array:
        """d reading / d parameter (N, K, 3, P) for the wanted positions in x."""
        return tangents(self, wanted, self.sensed, self.response, self.loaded)


def evaluate_state(model: Structure, poses: Poses, x: Array, loaded: bool) -> OneState:
    """Run all stages for one state."""
    s = evaluate_stages(model, poses, x, preload=True, loaded=loaded)
    assert s.preload is not None
    response = s.respond(s.preload + s.tau if loaded else s.preload)
    return OneState(**vars(s), loaded=loaded, response=response, sensed=s.sense(response.eps))
