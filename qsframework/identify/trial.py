"""A linear fit to try changes of the readings on: what the model says of them, and what remains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsframework.errors import NotIdentifiable
from qsframework.experiment import Experiment, Readings
from qsframework.identify.linear import fit_rows
from qsframework.information import rank_test, scales
from qsframework.plugin import Array, Indices


@dataclass(frozen=True, eq=False)
class Trial:
    """R used rows with their measured displacement, sigma (R,), and whitened, scaled columns A (R, 3, p).

    stated: whether sigma is known; target (R, 3) whitened measured less what fixed parameters give
    """

    experiment: Experiment
    readings: Readings
    keep: Indices
    sigma: Array
    stated: bool
    A: Array
    target: Array

    @property
    def dof(self) -> int:
        return self.target.size - self.A.shape[-1]

    @property
    def Q(self) -> Array:
        """Orthonormal columns (3R, p)."""
        return np.linalg.qr(self.A.reshape(-1, self.A.shape[-1]))[0]

    @property
    def residuals(self) -> Array:
        """measured minus fitted (R, 3) m."""
        return left(self.Q, self.target) * self.sigma[:, None]

    def unit(self, square: float) -> float:
        """Variance of unit weight where a fit leaves this sum of squares; 1 where the noise is stated."""
        return 1.0 if self.stated else square / max(self.dof, 1)

    def row_squares(self) -> Array:
        """How much (R,) the sum of squares falls when a row is left out; 0 where the others cannot do without it."""
        Q = self.Q
        r = left(Q, self.target)
        q = Q.reshape(*r.shape, -1)
        rest = np.eye(3) - q @ q.transpose(0, 2, 1)
        told = np.linalg.cond(rest) < 1e10
        square = np.zeros(len(r))
        square[told] = np.einsum("ri,ri->r", r[told], np.linalg.solve(rest[told], r[told][..., None])[..., 0])
        return square

    def row_p_values(self) -> Array:
        """Probability (R,) that a row of three coordinates fits this badly, each against the fit without it."""
        from scipy.stats import chi2, f

        square = self.row_squares()
        if self.stated:
            return chi2.sf(square, 3)
        total, free = float(np.square(left(self.Q, self.target)).sum()), max(self.dof - 3, 1)
        return f.sf(square / 3.0 / np.maximum((total - square) / free, 1e-300), 3, free)


def left(Q: Array, target: Array) -> Array:
    """What orthonormal columns (m, p) do not reach of a target of m numbers, in the target's shape."""
    flat = target.reshape(-1)
    return (flat - Q @ (Q.T @ flat)).reshape(target.shape)


def trial(experiment: Experiment, readings: Readings) -> Trial:
    """The fit of the experiment's parameters about their nominal values. NotIdentifiable where they are not told."""
    model, names = experiment.model(), experiment.fit_names()
    rows, source = fit_rows(experiment, readings, len(names))
    x0 = model.nominal
    chosen = [model.parameters[i] for i in model.index(names)]
    A = rows.of(model.sensitivity(readings.poses, x0, names)) * scales(chosen) / rows.sigma[:, None, None]
    test = rank_test(A.reshape(-1, len(names)), names)
    if not test.full:
        raise NotIdentifiable(test.words())
    predicted = rows.of(model.predict(readings.poses, x0))
    target = (rows.measured - predicted) / rows.sigma[:, None]
    return Trial(experiment, readings, rows.keep, rows.sigma, source == "stated", A, target)
