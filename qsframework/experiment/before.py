"""The arm before its readings: the values that stood before any of these was used, seen as it suits the arm best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from qsframework.errors import InputError, NotConverged
from qsframework.estimation import scales
from qsframework.experiment.observations import ObservationModel, ReadingRows, start_values, values_before
from qsframework.experiment.setup import Experiment
from qsframework.plugin import Array, Sensor

_ROUNDS = 8
"""Linear steps in which frames and nests settle: each leaves the square of what the one before left, in rad."""
_STILL = 1e-9
"""Step, in natural sizes, that changes no reading."""


def errors_before(
    experiment: Experiment, rows: ReadingRows, names: Sequence[str], linear: bool = False, used: Sequence[str] = ()
) -> Array:
    """Errors (R, 3) m of the arm as it was before any of these readings was used, where `names` are estimated: in the
    unknown frames, the nests and the tool that suit it best, since no guess of these is an error of the arm.

    used: hashes of readings beside them, which a fit that is judged has used
    """
    model = experiment.model()
    x = start_values(experiment, names, values_before(model, {*rows.readings.hashes, *used}))
    # What is estimated of the instrument and of the nests, unless a diagnosis of readings has added it.
    own = model.names_of(Sensor) - {p.name for p in model.parameters if p.added}
    seen = _suited(ObservationModel(model, rows, rows.start(model, x), x, tuple(n for n in names if n in own), True))
    try:
        return rows.measured - rows.predict(model, seen.x, seen.frames, linear)
    except (NotConverged, InputError):  # values far off may bear no load
        return rows.measured - rows.predict(model, seen.x, seen.frames, True)


def _suited(seen: ObservationModel) -> ObservationModel:
    """Frames and named values that bring the arm closest to its positions; the nearest of those that do so."""
    if not seen.names or np.all(seen.rows.minus >= 0):  # displacements hardly depend on where a nest is
        return seen
    noise, scale = seen.rows.noise, scales(list(seen.parameters))
    for _ in range(_ROUNDS):
        predicted, J = seen.rates(seen.start)
        left = noise.whiten(seen.rows.scalars - predicted)
        step = np.linalg.lstsq(noise.whiten(J) * scale, left, rcond=_STILL)[0]
        z = seen.start + scale * step
        seen = replace(seen, x=seen.values(z), frames=seen.moved(z))
        if np.abs(step).max() < _STILL:
            break
    return seen
