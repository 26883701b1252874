"""Visits of the arm whose readings stand out from a fit to those that agree, and what that fit foretells of others.

A mistake in one row spoils a fit of all rows: least absolute errors say first which visits most others agree on, then
visits come and go by their errors against the least squares of those that stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from qsframework.estimation import left, scales
from qsframework.estimation.projection import blocks_of, falls
from qsframework.estimation.tails import chi2_isf
from qsframework.experiment import Bridge, Experiment, Frame, Readings, Rows, bridge
from qsframework.plugin import Array, Indices
from qsframework.screening.logging_faults import Visits, visits_of

Flags = npt.NDArray[np.bool_]
_ROUNDS = 8
_REWEIGHED = 10
"""Steps of the fit of least absolute errors."""
_CHANCE = 1e-6
"""Probability at which the misfit of a visit stands out, all of them together."""
_BEYOND = 1.5
"""And by how much more: noise has tails."""
_STEP = 1e-4
"""Share of a fit's step of which the rates are taken: what it does not tell may be far from linear."""
_TOLD = 1e-12
"""Share of the largest weighted square of a direction below which the visits that agree do not tell it."""
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
    seen: Bridge
    visits: Visits
    wrong: Flags
    z: Array
    half: Array
    frames: tuple[Frame, ...]
    misfit: Array
    count: Indices
    unit: float

    @property
    def rows(self) -> Rows:
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
        rows = Rows(readings, keep, np.flatnonzero(np.isfinite(readings.value[keep]).ravel()), np.zeros(len(keep), int))
        places = [self.rows.estimated.index(f) for f in rows.estimated]
        predicted, slopes = rows.rates(
            self.seen.model, self.seen.x, [self.frames[i] for i in places], self.seen.names, linear=True
        )
        J = np.zeros((len(keep), 3, len(self.z)))
        for here, there in enumerate(places):
            J[:, :, 6 * there : 6 * there + 6] = slopes[:, :, 6 * here : 6 * here + 6]
        motions = 6 * len(self.frames)
        J[:, :, motions:] = slopes[:, :, 6 * len(places) :]
        J *= scales(list(self.seen.parameters))
        error = rows.measured - predicted - J @ self.z
        size = rows.sigma * self.unit
        mask = rows.mask
        P = (J @ self.half) / rows.sigma[..., None]
        return np.where(mask, error / size, 0.0), np.where(mask[..., None], P, 0.0)

    def missed(self, readings: Readings) -> Array:
        """Errors (R, 3) of all rows of other readings as `foretold` has them, without what foretells them: faster."""
        keep = np.arange(len(readings))
        rows = Rows(readings, keep, np.flatnonzero(np.isfinite(readings.value).ravel()), np.zeros(len(keep), int))
        places = [self.rows.estimated.index(f) for f in rows.estimated]
        step = _STEP * scales(list(self.seen.parameters)) * self.z
        there = [self._predicted(rows, places, sign * step) for sign in (1.0, -1.0)]
        predicted = 0.5 * (there[0] + there[1]) + (there[0] - there[1]) / (2.0 * _STEP)
        return np.where(rows.mask, (rows.measured - predicted) / (rows.sigma * self.unit), 0.0)

    def _predicted(self, rows: Rows, places: Sequence[int], step: Array) -> Array:
        """What the tangent model says (R, 3) after motions of the frames and changes of the parameters."""
        motions = 6 * len(self.frames)
        x = self.seen.x.copy()
        x[self.seen.model.index(self.seen.names)] += step[motions:]
        frames = [self.frames[i].moved(step[6 * i : 6 * i + 6]) for i in places]
        return rows.predict(self.seen.model, x, frames, linear=True)


def stand_out(experiment: Experiment, readings: Readings) -> Standing:
    """Which visits stand out, each against the others. Errors as `bridge` has them."""
    seen = bridge(experiment, readings, experiment.fit_names(), linear=True)
    rows = seen.rows
    visits = visits_of(rows)
    label = visits.of[rows.row]
    count = np.bincount(label, minlength=len(visits))
    wrong = np.zeros(len(visits), dtype=bool)
    frames = seen.frames
    A, target = _linear(seen, frames)
    misfit, unit, z, half = _misfits(A, target, label, wrong, robust=True)
    for _ in range(_ROUNDS):
        now = _beyond(misfit, count)
        if rows.estimated and now.any():
            frames = rows.take(~now[visits.of]).start(seen.model, seen.x)
            A, target = _linear(seen, frames)
        misfit, unit, z, half = _misfits(A, target, label, now, robust=False)
        done, wrong = np.array_equal(now, wrong), now
        if done:
            break
    return Standing(
        experiment=experiment,
        seen=seen,
        visits=visits,
        wrong=wrong,
        z=z,
        half=half,
        frames=frames,
        misfit=misfit,
        count=count,
        unit=unit,
    )


def agreement(standing: Standing) -> float:
    """Log of how badly the visits fit, each with a noise of its own: what makes most of them better lowers it, what
    makes a few much better does not."""
    at = standing.count > 0
    square = standing.misfit[at] * standing.unit**2 / standing.count[at]
    return float(np.log(np.maximum(square, 1e-12)).sum())


def _linear(seen: Bridge, frames: Sequence[Frame]) -> tuple[_Columns, Array]:
    """Columns of p parameters and errors (m,) in sigmas as stated; what visits share is left to the unit."""
    rows = seen.rows
    predicted, J = rows.rates(seen.model, seen.x, frames, seen.names, linear=True)
    sigma = rows.sigma.ravel()[rows.at]
    columns = _columns(rows.flat(J) * scales(list(seen.parameters)) / sigma[:, None])
    return columns, (rows.scalars - rows.flat(predicted)) / sigma


def _beyond(misfit: Array, count: Indices) -> Flags:
    """The visits (V,) whose misfit no chance makes, at most a share of them."""
    out = misfit > _BEYOND * chi2_isf(_CHANCE / len(misfit), np.maximum(count, 1))
    most = max(2, int(_SHARE * len(misfit)))
    if out.sum() > most:
        out &= misfit >= np.sort(misfit)[-most]
    return out


@dataclass(frozen=True, eq=False)
class _Columns:
    """Columns (m, p) as orthonormal ones U (m, d) and `turn` (p, d), which leads back to their parameters."""

    U: Array
    turn: Array


def _columns(A: Array) -> _Columns:
    size = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    U, values, V = np.linalg.svd(A / size, full_matrices=False)
    told = values > 1e-9 * max(float(values[0]), 1e-300)
    return _Columns(U[:, told], V[told].T / values[told] / size[:, None])


def _misfits(
    A: _Columns, target: Array, label: Indices, wrong: Flags, robust: bool
) -> tuple[Array, float, Array, Array]:
    """Misfit (V,) of each visit against the good ones without it, the unit that makes the usual visit usual, z and
    half of the fit; robust: of least absolute errors, misfits of all visits as they are left."""
    count = np.bincount(label, minlength=len(wrong))
    if robust:
        z, half = _least_absolute(A, target, label, count)
        square = _squares(label, target - A.U @ z, len(wrong))
    else:
        good = (~wrong[label]).astype(np.float64)
        z, half = _solved(A, target, good)
        rest = target - A.U @ z
        square = _squares(label, rest, len(wrong))
        Q = (A.U * good[:, None]) @ half
        fall, own, _ = falls(Q, left(Q, good * target), np.where(good > 0.0, label, -1))
        square[own] = fall
        for at in blocks_of(np.where(good > 0.0, -1, label)):
            P = A.U[at] @ half
            spread = np.eye(at.shape[1]) + P @ P.transpose(0, 2, 1)
            weighed = np.asarray(np.linalg.solve(spread, rest[at][..., None]), dtype=np.float64)[..., 0]
            square[label[at[:, 0]]] = np.einsum("bs,bs->b", rest[at], weighed)
    unit = _unit(square, count, wrong)
    return square / unit**2, unit, A.turn @ z, A.turn @ half


def _squares(label: Indices, values: Array, count: int) -> Array:
    return np.asarray(np.bincount(label, values**2, count), dtype=np.float64)


def _least_absolute(A: _Columns, target: Array, label: Indices, count: Indices) -> tuple[Array, Array]:
    """The fit whose sum of the lengths of the errors of visits is least: a few may be far off."""
    z, half = _solved(A, target, np.ones(len(target)))
    for _ in range(_REWEIGHED):
        length = np.sqrt(_squares(label, target - A.U @ z, len(count)) / np.maximum(count, 1))
        weight = 1.0 / np.maximum(length, 1e-2 * float(np.median(length)) + 1e-300)
        z, half = _solved(A, target, weight[label])
    return z, half


def _unit(square: Array, count: Indices, wrong: Flags) -> float:
    """The noise that the usual good visit shows, in sds as stated."""
    use = ~wrong & (count > 0) & (square > 0.0)
    if not use.any():
        return 1.0
    return float(np.sqrt(max(np.median(square[use] / chi2_isf(0.5, count[use])), 1e-12)))


def _solved(A: _Columns, target: Array, weight: Array) -> tuple[Array, Array]:
    """Least squares of weighted squares: weights (d,) of the orthonormal columns, and half (d, f), half half' their
    covariance. U half, times the roots of the weights, is orthonormal."""
    heavy = A.U * weight[:, None]
    values, vectors = np.linalg.eigh(A.U.T @ heavy)
    told = values > _TOLD * max(float(values[-1]), 1e-300)
    half = vectors[:, told] / np.sqrt(values[told])
    return half @ (half.T @ (heavy.T @ target)), half
