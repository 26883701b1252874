"""A linear fit to try changes of the readings on: what the model says of them, and what remains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from qsframework.errors import NotIdentifiable
from qsframework.estimation import Noise, falls, left, orthonormal, rank_test, rms, scales, shifts
from qsframework.estimation.projection import chi_square
from qsframework.experiment import Bridge, Experiment, Frame, Readings, bridge
from qsframework.experiment.observations import Rows, start_values
from qsframework.experiment.together import positions_of, rates_of
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
    predicted, J = rows.rates(seen.model, seen.x, seen.frames, seen.names, linear=True)
    slopes = rows.flat(J) * scales(list(seen.parameters))
    if not rank_test(rows.noise.whiten(slopes), [p.name for p in seen.parameters]).rank:
        raise NotIdentifiable(unseen=[p.name for p in seen.parameters])
    errors = rows.scalars - rows.flat(predicted)
    return LinearizedFit(experiment, rows, slopes, errors, rows.noise, rows.stated)


def other_readings(given: LinearizedFit, many: Sequence[Readings], far: float) -> list[LinearizedFit | None]:
    """The fits to the same rows with other values or at other angles, or all of them under other loads; None for
    readings more than `far` times further from the nominal arm than as given where a frame is to be found.

    On loads the slopes hardly depend where geometry moves the markers: those stay.
    """
    experiment, names = given.experiment, given.experiment.fit_names()
    model, x = experiment.model(), start_values(experiment, names)
    parameters = [model.parameters[i] for i in model.index(names)]
    rows = [replace(given.rows, readings=readings) for readings in many]
    frames: list[tuple[Frame, ...]] = [() for _ in rows]
    out: list[LinearizedFit | None] = [None] * len(rows)
    near = list(range(len(rows)))
    if given.rows.estimated:
        there = positions_of(rows, model, x)
        frames = [r.nearest(positions) for r, positions in zip(rows, there, strict=True)]
        errors = [r.scalars - r.flat(r.seen(p, f)) for r, p, f in zip(rows, there, frames, strict=True)]
        near = [i for i in near if not rms(errors[i]) > far * rms(given.errors)]
        if not near:
            return out
    still: set[str] = set()
    before = given.readings
    if all(r.states is not before.states and np.array_equal(r.poses.q, before.poses.q) for r in many):
        still = {p.name for e in model.effects if isinstance(e, Geometry | Sensor) for p in e.parameters(model.facts)}
    at = [i for i, name in enumerate(names) if name not in still]
    motions = 6 * len(frames[0])
    size = scales([p for f in frames[0] for p in f.parameters()] + [parameters[i] for i in at])
    columns = [*range(motions), *(motions + i for i in at)]
    found = rates_of([rows[i] for i in near], model, x, [frames[i] for i in near], [names[i] for i in at])
    for i, (predicted, J) in zip(near, found, strict=True):
        slopes = given.slopes.copy()
        slopes[:, columns] = rows[i].flat(J) * size
        if np.any(slopes):
            out[i] = replace(given, rows=rows[i], slopes=slopes, errors=rows[i].scalars - rows[i].flat(predicted))
    return out
