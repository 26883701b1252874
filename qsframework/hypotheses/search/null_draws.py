"""Readings as they might have been with nothing in them: what the fitted columns left, dealt out anew.

The whitened residuals change places, row by row, and their signs: tails stay as they were measured, where Gaussian
draws would have none, and whatever acts somewhere loses its place.
"""

from __future__ import annotations

import numpy as np

from qsframework.estimation.projection import Flags
from qsframework.estimation.visit_noise import Reml
from qsframework.plugin import Array


def null_draws(fits: Reml, k: int, values: Array, draws: int, seed: int, measured: Flags | None = None) -> Array:
    """Draws (3 R, draws) m of readings (3 R,) m in noise k; measured (3 R,): those that there are, None: all."""
    rng = np.random.default_rng(seed)
    rows = fits.left(k, values).reshape(-1, 3)
    there = np.ones(rows.shape, dtype=bool) if measured is None else measured.reshape(-1, 3)
    kind = there @ [1, 2, 4]
    drawn = np.zeros((len(rows), 3, draws))
    for pattern in np.unique(kind).tolist():
        at = np.flatnonzero(kind == pattern)
        order = rng.permuted(np.tile(at, (draws, 1)), axis=1)
        drawn[at] = rows[order].transpose(1, 2, 0)
    drawn *= rng.choice(np.array([-1.0, 1.0]), drawn.shape)
    return fits.noise.noises[k].colour(drawn.reshape(len(values), draws)) * there.reshape(-1, 1)
