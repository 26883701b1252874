"""Readings by the full equilibrium, with sensors: where the markers of each state settle, and what the instrument says.

Each state stands under its own conditions: what warms up between two states moves the arm between them.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from qsframework.elastostatics.equilibrium import Settled, settle
from qsframework.elastostatics.model import Model
from qsframework.elastostatics.sensors import sense
from qsframework.elastostatics.structure import chunks
from qsframework.plugin import Array, Poses, Sensor


def exact_positions(model: Model, poses: Poses, x: Array | None = None, loaded: bool = True) -> Array:
    """Position readings (N, K, 3) m of one state, base frame: `Model.positions` without its linearisation.

    Raises NotConverged where a pose does not settle.
    """
    x = model.nominal if x is None else model.checked(x)
    out = np.empty((len(poses), len(model.markers), 3))
    for part, chunk in chunks(poses):
        own = chunk if loaded else replace(chunk, loaded=chunk.unloaded)
        out[part] = _read(model, settle(model, own, x, loaded), own, x)
    return out


def exact_readings(model: Model, poses: Poses, x: Array | None = None) -> Array:
    """Displacement readings (N, K, 3) m: the loaded less the unloaded equilibrium, each under its own conditions."""
    x = model.nominal if x is None else model.checked(x)
    out = np.empty((len(poses), len(model.markers), 3))
    for part, chunk in chunks(poses):
        before = replace(chunk, loaded=chunk.unloaded)
        unloaded = settle(model, before, x, False)
        loaded = settle(model, chunk, x, True, start=unloaded if _alike(chunk) else None)
        out[part] = _read(model, loaded, chunk, x) - _read(model, unloaded, before, x)
    return out


def _alike(poses: Poses) -> bool:
    """Whether nothing recorded tells the two states apart, so that both are of one arm."""
    pairs = ((getattr(poses.unloaded, f.name), getattr(poses.loaded, f.name)) for f in fields(poses.loaded))
    return all(a is b or (a is not None and b is not None and np.array_equal(a, b)) for a, b in pairs)


def _read(model: Model, settled: Settled, poses: Poses, x: Array) -> Array:
    """What the instrument says (N, K, 3) of a settled batch."""
    state = settled.at.state
    if not state.markers:
        return np.zeros((len(poses), 0, 3))
    sensors = model.of_kind(Sensor, x)
    if sensors:
        return sense(sensors, state, None, model.marker_names, poses.loaded).position.transpose(2, 0, 1)
    return np.stack([m.position for m in state.markers]).transpose(2, 0, 1)
