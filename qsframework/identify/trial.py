"""A linear fit to try changes of the readings on: what the model says of them, and what remains."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from qsframework.errors import NotIdentifiable
from qsframework.experiment import Experiment, Readings
from qsframework.identify.linear import fit_rows
from qsframework.identify.noise import readings_noise
from qsframework.identify.observations import Noise
from qsframework.identify.positions import Mask
from qsframework.information import rank_test, scales
from qsframework.plugin import Array, Indices


@dataclass(frozen=True, eq=False)
class Trial:
    """R used rows, their scaled sensitivities `slopes` (R, 3, p) m, and `errors` (R, 3) m: measured less what the
    nominal arm gives. sigma (R,) of a coordinate; noise: the covariance of all scalars, with what rows share.

    stated: whether sigma is known
    """

    experiment: Experiment
    readings: Readings
    keep: Indices
    sigma: Array
    stated: bool
    slopes: Array
    errors: Array
    noise: Noise

    @cached_property
    def A(self) -> Array:
        """Whitened columns (R, 3, p)."""
        return self.noise.whiten(self.slopes.reshape(self.errors.size, -1)).reshape(self.slopes.shape)

    @cached_property
    def target(self) -> Array:
        """Whitened errors (R, 3)."""
        return self.noise.whiten(self.errors.ravel()).reshape(self.errors.shape)

    @property
    def dof(self) -> int:
        return self.errors.size - self.slopes.shape[-1]

    @cached_property
    def Q(self) -> Array:
        """Orthonormal columns (3R, p)."""
        return np.linalg.qr(self.A.reshape(-1, self.A.shape[-1]))[0]

    @property
    def residuals(self) -> Array:
        """measured minus fitted (R, 3) m."""
        return self.noise.colour(left(self.Q, self.target).ravel()).reshape(self.errors.shape)

    def unit(self, square: float) -> float:
        """Variance of unit weight where a fit leaves this sum of squares; 1 where the noise is stated."""
        return 1.0 if self.stated else square / max(self.dof, 1)

    def square(self) -> float:
        """Sum of squares that the fit leaves."""
        return float(np.square(left(self.Q, self.target)).sum())

    def take(self, rows: Mask) -> Trial:
        """Some of the rows (R,), with the errors that they share among themselves."""
        keep, sigma = self.keep[rows], self.sigma[rows]
        noise = readings_noise(self.readings, keep, sigma)
        return replace(
            self, keep=keep, sigma=sigma, slopes=self.slopes[rows], errors=self.errors[rows], noise=noise
        )  # fmt: skip

    def shifts(self) -> tuple[Array, Array]:
        """Slopes t (3R,) and columns q (3R, p) by which a shift of some coordinates is judged: left out together, they
        take t' (I - q q')^-1 t off the sum of squares, if they are not coupled by a shared error."""
        root = np.sqrt(self.noise.weights())
        r = left(self.Q, self.target).ravel()
        return self.noise.turned(r) / root, self.noise.turned(self.Q) / root[:, None]

    def row_squares(self) -> Array:
        """How much (R,) the sum of squares falls when a row is left out; 0 where the others cannot do without it."""
        t, q = self.shifts()
        t, q = t.reshape(self.errors.shape), q.reshape(*self.errors.shape, -1)
        rest = np.eye(3) - q @ q.transpose(0, 2, 1)
        told = np.linalg.cond(rest) < 1e10
        square = np.zeros(len(t))
        square[told] = np.einsum("ri,ri->r", t[told], np.linalg.solve(rest[told], t[told][..., None])[..., 0])
        return square

    def row_p_values(self) -> Array:
        """Probability (R,) that a row of three coordinates fits this badly, each against the fit without it."""
        from scipy.stats import chi2, f

        square = self.row_squares()
        if self.stated:
            return chi2.sf(square, 3)
        free = max(self.dof - 3, 1)
        return f.sf(square / 3.0 / np.maximum((self.square() - square) / free, 1e-300), 3, free)


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
    slopes = rows.of(model.sensitivity(readings.poses, x0, names)) * scales(chosen)
    test = rank_test(rows.noise.whiten(slopes.reshape(-1, len(names))), names)
    if not test.full:
        raise NotIdentifiable(test.words())
    errors = rows.measured - rows.of(model.predict(readings.poses, x0))
    return Trial(experiment, readings, rows.keep, rows.sigma, source == "stated", slopes, errors, rows.noise)
