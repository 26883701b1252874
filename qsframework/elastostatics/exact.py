"""Readings by the full equilibrium, with sensors: where the markers of each state settle, and what the instrument says.

Each state stands under its own conditions: what warms up between two states moves the arm between them.
"""

from __future__ import annotations

import numpy as np

from qsframework.elastostatics.equilibrium import Settled, settle
from qsframework.elastostatics.model import Model
from qsframework.elastostatics.sensors import said
from qsframework.elastostatics.structure import chunks
from qsframework.plugin import Array, Poses, Sensor


def exact_positions(model: Model, poses: Poses, x: Array | None = None, loaded: bool = True) -> Array:
    """Position readings (N, K, 3) m of one state, base frame: `Model.positions` without its linearisation.

    Raises NotConverged where a pose does not settle.
    """
    x = model.nominal if x is None else model.checked(x)
    out = np.empty((len(poses), len(model.markers), 3))
    for part, chunk in chunks(poses):
        out[part] = _read(model, settle(model, chunk, x, loaded), x)
    return out


def exact_readings(model: Model, poses: Poses, x: Array | None = None) -> Array:
    """Displacement readings (N, K, 3) m: the loaded less the unloaded equilibrium, each under its own conditions."""
    x = model.nominal if x is None else model.checked(x)
    out = np.empty((len(poses), len(model.markers), 3))
    for part, chunk in chunks(poses):
        unloaded = settle(model, chunk, x, False)
        loaded = settle(model, chunk, x, True, start=None if model.differs(x) else unloaded)
        out[part] = _read(model, loaded, x) - _read(model, unloaded, x)
    return out


def _read(model: Model, settled: Settled, x: Array) -> Array:
    """What the instrument says (N, K, 3) of a settled batch."""
    state = settled.at.state
    if not state.markers:
        return np.zeros((settled.eps.shape[1], 0, 3))
    return said(model.of_kind(Sensor, x), state, model.marker_names)
