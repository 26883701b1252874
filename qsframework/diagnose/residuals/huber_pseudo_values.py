"""Heavy tails in the search: pseudo-values of Huber's estimator take the place of the residuals.

The pseudo-value of a reading is its fit plus its clipped residual, raised so that its slope is right on average. Least
squares on pseudo-values is Huber's estimate, and their spread is what its tests need: no single reading weighs much.
"""

from __future__ import annotations

import numpy as np

from qsframework.plugin import Array

_CLIP = 2.5
"""In sds. At 1.345 the power of tests falls; without a clip 5 % of gross readings raise false alarms in 8 to 13 %."""
_MAD = 1.4826
_STEPS = 100
_STILL = 1e-4
"""Of the clip."""


def huber_pseudo_values(residuals: Array, Q: Array) -> Array:
    """Pseudo-values (m,) of whitened residuals about a fit's orthonormal directions Q (m, q).

    As given where the fit leaves too few degrees of freedom to know the errors by. Zeros were not measured.
    """
    count, size = int(np.count_nonzero(residuals)), Q.shape[1]
    if count < 2 * size:
        return residuals
    y, told = residuals, residuals != 0.0
    for _ in range(_STEPS):
        fit = Q @ (Q.T @ y)
        error = residuals - fit
        clip = _CLIP * _MAD * float(np.median(np.abs(error[told]))) * float(np.sqrt(count / (count - size)))
        inside = float(np.mean(np.abs(error[told]) < clip))
        new = fit + np.clip(error, -clip, clip) / max(inside, 0.1)
        done = float(np.abs(new - y).max()) <= _STILL * clip
        y = new
        if done:
            break
    return y
