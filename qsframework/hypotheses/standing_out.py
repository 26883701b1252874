"""Visits of the arm whose readings stand out from a fit to those that agree, and what that fit predicts of others.

A mistake in one row spoils a fit of all rows: least absolute errors say first which visits most others agree on, then
visits come and go by their errors against the least squares of those that stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.estimation import Independent, LinearFit, scales
from qsframework.estimation.projection import Flags
from qsframework.estimation.tails import chi2_isf
from qsframework.experiment import Experiment, Frame, ObservationModel, ReadingRows, Readings
from qsframework.experiment.frames import motion_count, spans
from qsframework.hypotheses.linearized import Visits, agreed, linear_model, stops_of, visits_of
from qsframework.hypotheses.outliers import held_naturally, widened
from qsframework.plugin import Array, Indices

_CHANCE = 1e-6
"""Probability at which the misfit of a visit stands out, all of them together."""
_BEYOND = 1.5
"""And by how much more: noise has tails."""
_STEP = 1e-4
"""Share of a fit's step of which the rates are taken: what it does not tell may be far from linear."""
_SHARE = 0.35
"""Of the visits: more than these are not set aside, for then it is no mistake here and there."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Standing:
    """A linear fit about the nominal arm to the visits that agree.

    rows: all R rows in use; visits: of them; wrong (V,): visits that stand out; z (p,): frames and fitted parameters,
    in their scales; half (p, f): half half' is the covariance of z in units of the noise; frames: about which the
    motions are counted; misfit (V,): of each visit against a fit without it, a sum of squares in units of the noise
    that is seen; count (V,): its coordinates; unit: that noise, in sds as stated
    """

    experiment: Experiment
    seen: ObservationModel
    visits: Visits
    wrong: Flags
    z: Array
    half: Array
    frames: tuple[Frame, ...]
    misfit: Array
    count: Indices
    unit: float

    @property
    def rows(self) -> ReadingRows:
        return self.seen.rows

    @property
    def readings(self) -> Readings:
        return self.rows.readings

    def usual(self, count: int) -> float:
        """The largest misfit of so many coordinates at visits that agree, at least what chance allows."""
        good = ~self.wrong & (self.count > 0)
        scaled = self.misfit[good] / self.count[good]
        return max(float(chi2_isf(1e-3, count)), float(scaled.max(initial=0.0)) * count)

    def foretold(self, readings: Readings, keep: Indices) -> tuple[Array, Array]:
        """Errors (R, 3) of rows of other readings in units of the noise that is seen, and P (R, 3, f): I + P P' is
        their covariance. Coordinates that were not measured are zero in both."""
        rows, places = self._rows_of(readings, keep)
        own = [self.frames[i] for i in places]
        predicted, slopes = rows.rates(self.seen.model, self.seen.x, own, self.seen.names, linear=True)
        J = np.zeros((len(keep), 3, len(self.z)))
        for here, there in zip(spans(own), places, strict=True):
            J[:, :, spans(self.frames)[there]] = slopes[:, :, here]
        J[:, :, motion_count(self.frames) :] = slopes[:, :, motion_count(own) :]
        J *= scales(list(self.seen.parameters))
        error = rows.measured - predicted - J @ self.z
        size = rows.sigma * self.unit
        mask = rows.mask
        P = (J @ self.half) / rows.sigma[..., None]
        return np.where(mask, error / size, 0.0), np.where(mask[..., None], P, 0.0)

    def missed(self, readings: Readings) -> Array:
        """Errors (R, 3) of all rows of other readings as `foretold` has them, without what predicts them: faster."""
        rows, places = self._rows_of(readings, np.arange(len(readings)))
        step = _STEP * scales(list(self.seen.parameters)) * self.z
        there = [self._predicted(rows, places, sign * step) for sign in (1.0, -1.0)]
        predicted = 0.5 * (there[0] + there[1]) + (there[0] - there[1]) / (2.0 * _STEP)
        return np.where(rows.mask, (rows.measured - predicted) / (rows.sigma * self.unit), 0.0)

    def _rows_of(self, readings: Readings, keep: Indices) -> tuple[ReadingRows, list[int]]:
        """Rows of other readings, and which of the frames are theirs."""
        at = np.flatnonzero(np.isfinite(readings.value[keep]).ravel())
        rows = ReadingRows(readings, keep, at, np.zeros(len(keep), int))
        return rows, [self.rows.estimated.index(f) for f in rows.estimated]

    def _predicted(self, rows: ReadingRows, places: Sequence[int], step: Array) -> Array:
        """What the tangent model says (R, 3) after motions of the frames and changes of the parameters."""
        motions = motion_count(self.frames)
        x = self.seen.x.copy()
        x[self.seen.model.index(self.seen.names)] += step[motions:]
        frames = [self.frames[i].moved(step[spans(self.frames)[i]]) for i in places]
        return rows.predict(self.seen.model, x, frames, linear=True)


def stand_out(experiment: Experiment, readings: Readings, wide: bool = False) -> Standing:
    """Which visits stand out, each against the others. Errors as `observation_model` has them.

    wide: whole poses, from a model with geometry, springs and sag added, each held to its natural size. What visits
    share is left to the unit.
    """
    seen = widened(experiment, readings) if wide else linear_model(experiment, readings)
    rows = seen.rows
    visits = stops_of(rows) if wide else visits_of(rows)
    count = np.bincount(visits.of[rows.row], minlength=len(visits))

    def beyond(misfit: Array, wrong: Flags, _: LinearFit | None) -> Flags:
        return _beyond(misfit / _unit(misfit, count, wrong) ** 2, count)

    noise, scale = Independent(rows.flat(rows.sigma)), scales(list(seen.parameters))
    held = held_naturally(seen, scale) if wide else np.zeros(len(scale))
    found, frames = agreed(seen, visits.of, beyond, noise, scale, held)
    unit = _unit(found.misfit, count, found.wrong)
    return Standing(
        experiment=experiment,
        seen=seen,
        visits=visits,
        wrong=found.wrong,
        z=found.x,
        half=found.half,
        frames=frames,
        misfit=found.misfit / unit**2,
        count=count,
        unit=unit,
    )


def agreement(standing: Standing) -> float:
    """Log of how badly the visits fit, each with a noise of its own: what makes most of them better lowers it, what
    makes a few much better does not."""
    at = standing.count > 0
    square = standing.misfit[at] * standing.unit**2 / standing.count[at]
    return float(np.log(np.maximum(square, 1e-12)).sum())


def _beyond(misfit: Array, count: Indices) -> Flags:
    """The visits (V,) whose misfit no chance makes, at most a share of them."""
    out = misfit > _BEYOND * chi2_isf(_CHANCE / len(misfit), np.maximum(count, 1))
    most = max(2, int(_SHARE * len(misfit)))
    if out.sum() > most:
        out &= misfit >= np.sort(misfit)[-most]
    return out


def _unit(square: Array, count: Indices, wrong: Flags) -> float:
    """The noise that the usual good visit shows, in sds as stated."""
    use = ~wrong & (count > 0) & (square > 0.0)
    if not use.any():
        return 1.0
    return float(np.sqrt(max(np.median(square[use] / chi2_isf(0.5, count[use])), 1e-12)))
