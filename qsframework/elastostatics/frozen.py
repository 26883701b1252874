"""Readings of the arm at its commanded angles, with the first step of its springs: their value and derivatives.

Candidates are scored with it. FK(q + dq, placements) + D eps: eps is what gravity and the compensators bend, tau_0, and
in the loaded state the wrench too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from qsframework.elastostatics.evaluation import Stages, evaluate_stages
from qsframework.elastostatics.structure import Structure
from qsframework.elastostatics.tangents import ReadState, carry, tangents
from qsframework.plugin import Array, Context, Poses, SpringLaw


@dataclass(frozen=True, eq=False, kw_only=True)
class Frozen(Stages):
    """A batch with the states that are read: one, or the loaded less the unloaded one of an arm alike in both."""

    states: tuple[ReadState, ...]

    @property
    def deflection(self) -> Array:
        """eps (ne, N) of the state, or of the loaded less that of the unloaded one."""
        return reduce(np.subtract, [s.response.eps for s in self.states if s.response is not None])

    @property
    def reading(self) -> Array:
        """What the instrument says (N, K, 3) m of the markers, base frame."""
        sensed = [s.sensed.position for s in self.states if s.sensed is not None]
        if sensed:
            return reduce(np.subtract, sensed).transpose(2, 0, 1)
        shift = carry(self.state.markers, self.deflection)
        if len(self.states) == 1:
            shift += np.stack([m.position for m in self.state.markers])
        return shift.transpose(2, 0, 1)

    def tangents(self, wanted: Sequence[int]) -> Array:
        """d reading / d parameter (N, K, 3, P) for the wanted positions in x."""
        return tangents(self, wanted, self.states)


def frozen_states(model: Structure, poses: Poses, x: Array, states: Sequence[bool]) -> Frozen:
    """Run all stages for one state, loaded or not, or for both of an arm that is the same in both: (True, False).

    What gravity bends drops out of the difference where every law is linear.
    """
    preload = len(states) == 1 or any(isinstance(e, SpringLaw) for e in model.effects)
    stages = evaluate_stages(model, poses, x, preload, loaded=states[0])
    read: list[ReadState] = []
    for loaded in states:
        torques = [t for t in (stages.preload, stages.tau if loaded else None) if t is not None]
        response = stages.respond(reduce(np.add, torques)) if torques else None
        sensed = stages.sense(None if response is None else response.eps, Context(model.facts, poses, loaded))
        read.append(ReadState(loaded, response, sensed))
    return Frozen(**vars(stages), states=tuple(read))
