"""Effects on trial: how large one must be for the full equilibrium to show a given s at planned poses."""

from __future__ import annotations

from typing import Any

import numpy as np

from qsframework.diagnose.linearization.candidates import Cause, widened
from qsframework.elastostatics import Model
from qsframework.errors import InputError, NotConverged
from qsframework.experiment import Experiment
from qsframework.plugin import Array, Poses

_TRIES = 8
_CLOSE = 0.01
_SHORT = 0.97
"""Share of the asked s that counts as reached where the search does not settle."""


class Bench:
    """Readings of poses by the exact laws, with one effect at a time."""

    def __init__(self, experiment: Experiment, poses: Poses, sigma: float):
        self.model, self.poses, self.sigma = experiment.model(), poses, sigma
        self.bare = self._readings(self.model, self.model.nominal)
        self._cause: Any = None
        self._wide = self.model

    def _readings(self, model: Model, x: Array) -> Array | None:
        try:
            return model.predict(self.poses, x).ravel() / self.sigma
        except (NotConverged, InputError):
            return None

    def shown(self, cause: Cause, j: int, Q: Array, size: float) -> float | None:
        """s of parameter j at a deviation (SI) along the cause's directions Q (m, k); None where nothing settles."""
        if cause is not self._cause:
            self._cause, self._wide = cause, widened(self.model, [cause])
        x = self._wide.nominal
        x[self._wide.index([cause.names[j]])] += size
        readings = self._readings(self._wide, x)
        if readings is None or self.bare is None:
            return None
        return float(np.linalg.norm(Q.T @ (readings - self.bare)))

    def size_for(self, cause: Cause, j: int, Q: Array, start: float, s: float) -> float:
        """Deviation (SI) of parameter j that shows s; from the linear model's answer by secants of the logarithms.

        inf where no larger one shows more; the start where the equilibrium does not settle.
        """
        size, power = start, 1.0
        tried: list[tuple[float, float]] = []
        for _ in range(_TRIES):
            seen = self.shown(cause, j, Q, size)
            if seen is None:
                return start
            if abs(seen / s - 1.0) <= _CLOSE:
                return size
            seen = max(seen, 1e-6 * s)
            if tried and tried[-1][0] != size and tried[-1][1] != seen:
                power = float(np.log(seen / tried[-1][1]) / np.log(size / tried[-1][0]))
            tried.append((size, seen))
            size *= float(np.clip((s / seen) ** (1.0 / np.clip(power, 0.3, 3.0)), 0.2, 5.0))
        enough = [size for size, seen in tried if seen >= _SHORT * s]
        return min(enough, default=float("inf"))
