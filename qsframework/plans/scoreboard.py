"""Scores of many candidates under one slope after the other, of which few have to be computed again.

Where G <= c G0 as matrices, no candidate scores more under G than c times what it scored under G0. A candidate that
stays below the level from which on scores count is left at this bound, and a certificate from it is a true one.
"""

from __future__ import annotations

import numpy as np

from qsframework.information.rows import CandidateRows, scores
from qsframework.plugin import Array

_MANY = 0.5
"""Share of the candidates from which on a full pass, which brings later bounds nearer, is the better bargain."""
_REGULAR = 1e-10


class Scoreboard:
    """The candidates' scores (N,) under the slope of the last full pass; `passes` counts, parts as fractions.

    slopes (S, p, p) are those in the basis T (p, p) of the parameters
    """

    def __init__(self, rows: CandidateRows, basis: Array | None = None) -> None:
        self.rows, self.basis = rows, basis
        self.passes = 0.0
        self._slope: Array | None = None
        self._values = np.zeros(len(rows))

    def exact(self, slope: Array) -> Array:
        """Scores (N,) under a slope: a full pass, unless it was made already."""
        if self._slope is not slope:
            self._slope, self._values = slope, scores(self.rows, slope, basis=self.basis)
            self.passes += 1.0
        return self._values

    def bounds(self, slope: Array, level: Array | float) -> Array:
        """Scores (N,) under a slope where they may reach the level of the candidate, elsewhere bounds below it."""
        growth = np.inf if self._slope is None else _growth(self._slope, slope)
        again = np.flatnonzero(self._values >= level / growth)
        if not np.isfinite(growth) or len(again) > _MANY * len(self.rows):
            return self.exact(slope)
        most = growth * self._values
        most[again] = scores(self.rows, slope, basis=self.basis, index=again)
        self.passes += len(again) / len(self.rows)
        return most


def _growth(old: Array, new: Array) -> float:
    """The smallest c with new <= c old in every scenario; infinite where the old slope does not see every direction."""
    values = np.linalg.eigvalsh(old)
    if (values[:, 0] <= _REGULAR * values[:, -1]).any():
        return np.inf
    L = np.linalg.inv(np.linalg.cholesky(old))
    return float(np.linalg.eigvalsh(L @ new @ np.swapaxes(L, -1, -2)).max())
