"""A linear fit to try changes of the readings on: what the model says of them, and what remains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from qsframework.errors import NotIdentifiable
from qsframework.estimation import Noise, falls, left, orthonormal, rank_test, scales, shifts
from qsframework.estimation.projection import chi_square
from qsframework.experiment import Bridge, Experiment, Readings, bridge
from qsframework.experiment.observations import Rows
from qsframework.plugin import Array, Geometry, Indices, Sensor

CARRIED = 1e-10


@dataclass(frozen=True, eq=False)
class LinearizedFit:
    """m measured coordinates about the nominal arm in its best frames: scaled sensitivities `slopes` (m, p), of frames
    and of the fitted parameters, and `errors` (m,) m, measured less nominal.

    stated: whether the size of the noise is known
    """

    experiment: Experiment
    rows: Rows
    slopes: Array
    errors: Array
    noise: Noise
    stated: bool

    @property
    def readings(self) -> Readings:
        return self.rows.readings

    @property
    def keep(self) -> Indices:
        """Places (R,) of the rows in the readings."""
        return self.rows.keep

    @property
    def row(self) -> Indices:
        """The row (m,) of each coordinate."""
        return self.rows.row

    @cached_property
    def A(self) -> Array:
        """Whitened columns (m, p)."""
        return self.noise.whiten(self.slopes)

    @cached_property
    def target(self) -> Array:
        """Whitened errors (m,)."""
        return self.noise.whiten(self.errors)

    @property
    def dof(self) -> int:
        return len(self.errors) - self.Q.shape[1]

    @cached_property
    def Q(self) -> Array:
        """Orthonormal columns (m, f)."""
        return orthonormal(self.A)

    @cached_property
    def white(self) -> Array:
        """Whitened residuals (m,)."""
        return left(self.Q, self.target)

    @property
    def residuals(self) -> Array:
        """Measured minus fitted (m,) m."""
        return self.noise.colour(self.white)

    def unit(self, square: float) -> float:
        """Variance of unit weight where a fit leaves this sum of squares; 1 where the noise is stated."""
        return 1.0 if self.stated else square / max(self.dof, 1)

    def square(self) -> float:
        """Sum of squares that the fit leaves."""
        return float(self.white @ self.white)

    def take(self, kept: npt.NDArray[np.bool_]) -> LinearizedFit:
        """Some of the rows (R,), with the errors that they share among themselves."""
        rows, scalars = self.rows.take(kept), kept[self.row]
        return replace(self, rows=rows, slopes=self.slopes[scalars], errors=self.errors[scalars], noise=rows.noise)

    def without(self, label: Indices) -> tuple[Array, Indices, Indices]:
        """By how much the sum of squares falls without blocks of coordinates, by label (m,): falls, labels, sizes."""
        slope, q = shifts(self.white, self.Q, self.noise)
        return falls(q, slope, label, CARRIED)

    def row_squares(self) -> Array:
        """How much (R,) the sum of squares falls when a row is left out; 0 where the others cannot do without it."""
        out = np.zeros(len(self.keep))
        fall, label, _ = self.without(self.row)
        out[label] = fall
        return out

    def row_p_values(self) -> Array:
        """Probability (R,) that a row fits this badly, each against the fit without it."""
        out = np.ones(len(self.keep))
        fall, label, size = self.without(self.row)
        out[label] = chi_square(fall, size, self.square(), self.dof, self.stated)
        return out


def linearized_fit(experiment: Experiment, readings: Readings, names: Sequence[str] | None = None) -> LinearizedFit:
    """The fit of the experiment's parameters about their nominal values. NotIdentifiable where it has none to tell."""
    seen = bridge(experiment, readings, names, linear=True)
    return of_bridge(experiment, seen)


def of_bridge(experiment: Experiment, seen: Bridge) -> LinearizedFit:
    """The same about the values and frames of a bridge."""
    rows = seen.rows
    predicted, J = rows.rates(seen.model, seen.x, seen.frames, seen.names)
    slopes = rows.flat(J) * scales(list(seen.parameters))
    if not rank_test(rows.noise.whiten(slopes), [p.name for p in seen.parameters]).rank:
        raise NotIdentifiable(unseen=[p.name for p in seen.parameters])
    errors = rows.scalars - rows.flat(predicted)
    return LinearizedFit(experiment, rows, slopes, errors, rows.noise, rows.stated)


def other_loads(given: LinearizedFit, seen: Bridge) -> LinearizedFit:
    """The fit to the same poses under other loads, on which it hardly depends where geometry moves the markers."""
    rows, model = seen.rows, seen.model
    still = {p.name for e in model.effects if isinstance(e, Geometry | Sensor) for p in e.parameters(model.facts)}
    names = [n for n in seen.names if n not in still]
    predicted, J = rows.rates(model, seen.x, seen.frames, names)
    at = [*range(seen.motions), *(seen.motions + seen.names.index(n) for n in names)]
    slopes = given.slopes.copy()
    slopes[:, at] = rows.flat(J) * scales(list(seen.parameters))[at]
    return replace(given, rows=rows, slopes=slopes, errors=rows.scalars - rows.flat(predicted))
