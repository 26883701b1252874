"""Displacement readings by the full equilibrium, with sensors."""

from __future__ import annotations

from qsframework.elastostatics.equilibrium import full_displacement
from qsframework.elastostatics.model import Model, make_model
from qsframework.plugin import Array, Poses, Sensor


def exact_readings(model: Model, poses: Poses, x: Array) -> Array:
    """Displacement readings (N, K, 3) m by the full equilibrium; sensors act as in the linear model."""
    plain = [(e, s) for e, s in zip(model.effects, model.slices, strict=True) if not isinstance(e, Sensor)]
    if len(plain) == len(model.effects):
        return full_displacement(model, poses, x)
    index = [i for _, s in plain for i in range(s.start, s.stop)]
    markers = list(zip(model.marker_names, model.markers, strict=True))
    bare = make_model(
        model.facts, [e for e, _ in plain], [model.parameters[i] for i in index], model.tip, markers, model.gravity
    )
    own = x[index]
    defect = full_displacement(bare, poses, own) - bare.predict(poses, own)
    return model.predict(poses, x) + defect
