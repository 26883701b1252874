"""Heavy tails in the search: pseudo-values of Huber's estimator take the place of the residuals.

The pseudo-value of a reading is its fit plus its clipped residual, raised so that its slope is right on average. Least
squares on pseudo-values is Huber's estimate, and their spread is what its tests need: no single reading weighs much.
"""

from __future__ import annotations

import numpy as np

from qsframework.estimation import left
from qsframework.plugin import Array

_CLIP = 1.345
"""In sds: 95 % efficient for normal errors (Huber 1964)."""
_MAD = 1.4826
_STEPS = 100
_STILL = 1e-4


def huber_pseudo_values(residuals: Array, Q: Array) -> Array:
    """Pseudo-values (m,) of whitened residuals about a library's orthonormal directions Q (m, q), with unit variance.

    As given where the library leaves too few degrees of freedom to know the errors by.
    """
    count, size = Q.shape
    if count < 2 * size:
        return residuals
    y = residuals
    for _ in range(_STEPS):
        fit = Q @ (Q.T @ y)
        error = residuals - fit
        clip = _CLIP * _MAD * float(np.median(np.abs(error))) * float(np.sqrt(count / (count - size)))
        inside = float(np.mean(np.abs(error) < clip))
        new = fit + np.clip(error, -clip, clip) / max(inside, 0.1)
        done = float(np.abs(new - y).max()) <= _STILL
        y = new
        if done:
            break
    rest = left(Q, y)
    return y / float(np.sqrt(rest @ rest / (count - size)))
