"""Fits of the exact model: the full equilibrium and every stage at its place, settled by least squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics import Model, exact_readings
from qsframework.errors import InputError, NotConverged, NotIdentifiable
from qsframework.experiment import Readings
from qsframework.identify.linear import Rows
from qsframework.identify.observations import Noise
from qsframework.plugin import Array, Poses

_STEPS = 60
_HALVINGS = 12
_STILL = 1e-3
"""Change of the whitened residuals' norm, in units of noise, at which a fit has settled."""
_SLOW = 0.1
"""How much of the last step the next one may be before the sensitivities are taken anew."""
_UP = 1.0 + 1e-9
_FLAT = 1e-10
"""Smallest pivot relative to the largest, of columns in their scales."""


@dataclass(frozen=True, eq=False)
class Settled:
    """A fit of the exact model: x (q,) all parameters, SI; names (f,) those fitted, with covariance (f, f).

    residuals (R, 3) m, white (3R,) whitened, chi2 their squares' sum; jacobian (3R, f) whitened, per SI
    """

    model: Model
    names: tuple[str, ...]
    x: Array
    covariance: Array
    residuals: Array
    white: Array
    jacobian: Array
    chi2: float
    exact: bool

    def value(self, name: str) -> float:
        return float(self.x[self.model.names.index(name)])

    def sd(self, name: str) -> float:
        i = self.names.index(name)
        return float(np.sqrt(self.covariance[i, i]))

    def by_name(self) -> dict[str, float]:
        return dict(zip(self.model.names, (float(v) for v in self.x), strict=True))


def exact_displacement(model: Model, readings: Readings, x: Array) -> Array:
    """Displacement readings (N, K, 3) m by the full equilibrium; sensors act as in the linear model."""
    return displacement_at(model, readings.poses, x)


def displacement_at(model: Model, poses: Poses, x: Array) -> Array:
    """The same at any poses."""
    return exact_readings(model, poses, x)


def displacement_or_linear(model: Model, readings: Readings, x: Array) -> tuple[Array, bool]:
    """The same at the readings, of the linear model where the equilibrium does not settle; whether it did."""
    try:
        return exact_displacement(model, readings, x), True
    except NotConverged:
        return model.predict(readings.poses, x), False


def settle_fit(
    model: Model, readings: Readings, rows: Rows, noise: Noise, names: Sequence[str], start: Array,
    priors: Sequence[tuple[str, float]] = (),
) -> Settled:  # fmt: skip
    """Fit `names` from `start` (q,), all others held there, by Gauss-Newton steps on the exact model.

    The sensitivities are the linear model's, which the equilibrium leaves right to a percent: the steps settle on the
    exact model's least squares all the same. priors: (name, sd) of parameters that are pulled to their start, so that
    directions which no reading shows stay there. Bounds are not kept: a value beyond one says that the model is wrong.

    Raises NotConverged where the steps do not settle.
    """
    problem = _Problem(model, readings, rows, noise, model.index(names), start, dict(priors), tuple(names))
    x, size = start.copy(), np.inf
    white, exact, jacobian, fresh = *problem.residuals(x), problem.jacobian(x), True
    for _ in range(_STEPS):
        pull, ridge = problem.prior(x)
        step, _ = problem.solve(jacobian, white, pull, ridge)
        found = problem.descend(x, step, white)
        if found is None:
            if fresh:
                break
            jacobian, fresh = problem.jacobian(x), True
            continue
        x, new, exact = found
        moved = float(np.linalg.norm(new - white))
        white = new
        if moved <= _STILL:
            break
        if moved > _SLOW * size:
            jacobian, fresh = problem.jacobian(x), True
        else:
            fresh = False
        size = moved
    else:
        raise NotConverged(
            f"the exact model did not settle in {_STEPS} steps; {', '.join(names)} act far from linearly"
        )
    return problem.settled(x, white, exact)


@dataclass(frozen=True, eq=False)
class _Problem:
    """Residuals and sensitivities of a fit."""

    model: Model
    readings: Readings
    rows: Rows
    noise: Noise
    index: list[int]
    start: Array
    priors: dict[str, float]
    names: tuple[str, ...]

    @property
    def scale(self) -> Array:
        return np.array([self.priors.get(n, self.model.parameters[i].scale)
                         for n, i in zip(self.names, self.index, strict=True)])  # fmt: skip

    def prior(self, x: Array) -> tuple[Array, Array]:
        """Distance of each parameter to its start, and 1 / sd; 0 where it has no prior."""
        ridge = np.array([1.0 / self.priors[n] if n in self.priors else 0.0 for n in self.names])
        return self.start[self.index] - x[self.index], ridge

    def solve(self, J: Array, white: Array, pull: Array, ridge: Array) -> tuple[Array, Array]:
        """A Gauss-Newton step with rows of the priors below, and its covariance, SI."""
        scale = self.scale
        A = np.concatenate([J * scale, np.diag(ridge * scale)[ridge > 0.0]])
        b = np.concatenate([white, (pull * ridge)[ridge > 0.0]])
        Q, R = np.linalg.qr(A)
        if np.abs(np.diag(R)).min() <= _FLAT * np.abs(np.diag(R)).max():
            raise NotIdentifiable(
                f"these readings cannot tell the parameters {', '.join(self.names)} from each other at the values that "
                "the fit has come to. If these are far off, check the nominal values that it starts from, and units"
            )
        half = scale[:, None] * np.linalg.inv(R)
        return scale * np.linalg.solve(R, Q.T @ b), half @ half.T

    def residuals(self, x: Array) -> tuple[Array, bool]:
        """Whitened (m,), of the linear model where the equilibrium does not settle."""
        predicted, exact = displacement_or_linear(self.model, self.readings, x)
        return self.noise.whiten((self.rows.measured - self.rows.of(predicted)).ravel()), exact

    def jacobian(self, x: Array) -> Array:
        """Whitened (m, f), per SI."""
        columns = self.rows.of(self.model.sensitivity(self.readings.poses, x, self.names))
        return self.noise.whiten(columns.reshape(-1, len(self.names)))

    def descend(self, x: Array, step: Array, white: Array) -> tuple[Array, Array, bool] | None:
        """The longest of halved steps that does not raise the squares; None if none is short enough."""
        pull, ridge = self.prior(x)
        cost = float(white @ white) + float(np.square(pull * ridge).sum())
        for _ in range(_HALVINGS):
            new = x.copy()
            new[self.index] += step
            try:
                left, exact = self.residuals(new)
            except InputError:  # a loop that cannot close, a parameter beyond what the effect allows
                left, exact = np.full_like(white, np.inf), False
            far, _ = self.prior(new)
            if np.isfinite(left).all() and float(left @ left) + float(np.square(far * ridge).sum()) <= cost * _UP:
                return new, left, exact
            step = 0.5 * step
        return None

    def settled(self, x: Array, white: Array, exact: bool) -> Settled:
        """The result, with its covariance at the end."""
        jacobian = self.jacobian(x)
        _, covariance = self.solve(jacobian, white, *self.prior(x))
        predicted = exact_displacement(self.model, self.readings, x) if exact else self.model.predict(
            self.readings.poses, x)  # fmt: skip
        residuals = self.rows.measured - self.rows.of(predicted)
        return Settled(self.model, self.names, x, covariance, residuals, white, jacobian, float(white @ white), exact)
