"""Linear least squares within bounds, by active sets (Stark and Parker 1995): exact, for a few parameters."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from qsframework.plugin import Array

Ends = npt.NDArray[np.int_]
"""Where each parameter stands: -1 at its lower bound, 1 at its upper one, 0 between them."""


def bounded(A: Array, b: Array, lower: Array, upper: Array, tolerance: float, most: int) -> tuple[Array, Ends]:
    """The x (q,) that minimises |A x - b| with lower < upper about it, and where each of its parameters stands.

    tolerance: a slope below it counts as none, and a step that gains less than this share is the last; most: steps
    """
    x: Array = np.asarray(np.linalg.lstsq(A, b, rcond=-1)[0], dtype=np.float64)
    at = np.where(x <= lower, -1, np.where(x >= upper, 1, 0))
    x = np.clip(x, lower, upper)
    while (at == 0).any():  # what lies outside goes to its bound, until the others lie inside without it
        free, best = _best_of_free(A, b, x, at)
        beyond = np.where(best < lower[free], -1, np.where(best > upper[free], 1, 0))
        x[free], at[free] = np.clip(best, lower[free], upper[free]), beyond
        if not beyond.any():
            break
    rest = A @ x - b
    cost = 0.5 * float(rest @ rest)
    for _ in range(most):
        slope = A.T @ rest
        if np.where(at == 0, np.abs(slope), slope * at).max() < tolerance:
            break
        at[np.argmax(slope * at)] = 0
        _between(A, b, x, at, lower, upper)
        rest = A @ x - b
        before, cost = cost, 0.5 * float(rest @ rest)
        if before - cost < tolerance * before:
            break
    return x, at


def _between(A: Array, b: Array, x: Array, at: Ends, lower: Array, upper: Array) -> None:
    """Move the free parameters to their best place, holding each that meets its bound on the way; x and at change."""
    while True:
        free, best = _best_of_free(A, b, x, at)
        low, high = np.flatnonzero(best < lower[free]), np.flatnonzero(best > upper[free])
        if not len(low) and not len(high):
            x[free] = best
            return
        beyond, here = np.concatenate([low, high]), x[free]
        ends = np.concatenate([lower[free][low], upper[free][high]])
        shares = (ends - here[beyond]) / (best[beyond] - here[beyond])
        first = int(np.argmin(shares))
        x[free] = here * (1.0 - shares[first]) + shares[first] * best
        at[free[beyond[first]]] = -1 if first < len(low) else 1


def _best_of_free(A: Array, b: Array, x: Array, at: Ends) -> tuple[npt.NDArray[np.intp], Array]:
    """The free parameters and their least squares, the others held where they stand."""
    free = np.flatnonzero(at == 0)
    best = np.linalg.lstsq(A[:, free], b - A @ np.where(at == 0, 0.0, x), rcond=None)[0]
    return free, np.asarray(best, dtype=np.float64)
