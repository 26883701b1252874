"""Displacement readings, loaded minus unloaded: their value and their derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.elastostatics.direct import element_readings, geometry_tangents
from qsframework.elastostatics.evaluation import Stages, evaluate_stages
from qsframework.elastostatics.sensors import Sensed
from qsframework.elastostatics.springs import Response
from qsframework.elastostatics.structure import Structure
from qsframework.elastostatics.tangents import Change, answer, carry, changes, reading_along
from qsframework.plugin import Array, Context, Poses, SpringLaw

_SAME = 1e-12


@dataclass(frozen=True, eq=False)
class Evaluation(Stages):
    """The answers of both states of a displacement.

    The unloaded response is None where every law is linear: what gravity bends then drops out.
    """

    unloaded: Response | None
    loaded: Response
    sensed: tuple[Sensed, Sensed] | None

    @property
    def deflection(self) -> Array:
        """eps (ne, N) of the loaded state less that of the unloaded one."""
        return self.loaded.eps if self.unloaded is None else self.loaded.eps - self.unloaded.eps


def evaluate(model: Structure, poses: Poses, x: Array) -> Evaluation:
    """Run all stages for both states, of an arm that is the same in both."""
    s = evaluate_stages(model, poses, x, preload=any(isinstance(e, SpringLaw) for e in model.effects))
    unloaded = None if s.preload is None else s.respond(s.preload)
    loaded = s.respond(s.tau if s.preload is None else s.preload + s.tau)
    first = s.sense(None if unloaded is None else unloaded.eps, Context(model.facts, poses, loaded=False))
    second = s.sense(loaded.eps)
    return Evaluation(
        **vars(s), unloaded=unloaded, loaded=loaded, sensed=None if first is None or second is None else (first, second)
    )


def displacement(ev: Evaluation) -> Array:
    """Loaded minus unloaded reading (N, K, 3) m of each marker."""
    if ev.sensed is not None:
        return (ev.sensed[1].position - ev.sensed[0].position).transpose(2, 0, 1)
    return carry(ev.state.markers, ev.deflection).transpose(2, 0, 1)


def sensitivities(ev: Evaluation, wanted: Sequence[int]) -> Array:
    """d reading / d parameter (N, K, 3, P) for the wanted positions in x."""
    out = np.empty((len(wanted), len(ev.state.markers), 3, len(ev.poses)))
    acting = replace(ev, preload=None) if _preload_cancels(ev) else ev
    left = geometry_tangents(ev, wanted, lambda: _by_element(acting), out)
    for row, change in changes(acting, [wanted[i] for i in left]):
        out[left[row]] = _along(ev, change)
    return out.transpose(3, 1, 2, 0)


def _by_element(ev: Evaluation) -> Array:
    """d displacement / d element of the chain, (m, K, 3, N)."""
    first, second = (None, None) if ev.sensed is None else ev.sensed
    return element_readings(ev, second, ev.loaded, True) - element_readings(ev, first, ev.unloaded, False)


def _preload_cancels(ev: Evaluation) -> bool:
    """Whether a change of the preload moves both states alike: no law bends now, the instrument is alike."""
    if ev.unloaded is None or not np.array_equal(ev.unloaded.slope, ev.loaded.slope):
        return False
    if ev.sensed is None:
        return True
    first, second = ev.sensed
    return bool(
        np.allclose(first.by_position, second.by_position, rtol=0.0, atol=_SAME)
        and np.allclose(first.by_rotation, second.by_rotation, rtol=0.0, atol=_SAME)
    )


def _along(ev: Evaluation, change: Change) -> Array:
    """d displacement (K, 3, N) of a change; the geometric part of the markers' motion cancels."""
    if ev.sensed is not None:
        loaded = reading_along(ev, ev.sensed[1], ev.loaded, change, True)
        return loaded - reading_along(ev, ev.sensed[0], ev.unloaded, change, False)
    if change.spring is not None and not set(change.spring) & set(ev.rates.active):
        own = list(change.spring)
        torque = ev.loaded.T[own] if ev.unloaded is None else ev.loaded.T[own] - ev.unloaded.T[own]
        return np.stack([np.einsum("ekn,en->kn", m.linear[own], torque) for m in ev.state.markers])
    rate = answer(ev, ev.loaded, change, True)
    if ev.unloaded is not None:
        rate = rate - answer(ev, ev.unloaded, change, False)
    out = carry(ev.state.markers, rate)
    return out if change.markers is None else out + carry(change.markers, ev.deflection)
