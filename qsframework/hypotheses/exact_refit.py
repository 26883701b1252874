"""Fits of the exact model with any of the causes, settled by the one solver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics import Model
from qsframework.errors import InputError, NotConverged
from qsframework.estimation import settle
from qsframework.estimation.projection import spanned
from qsframework.experiment import Frame, ObservationModel
from qsframework.experiment.observations import ReadingRows
from qsframework.plugin import Array

_CLOSE = 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class SettledFit:
    """A fit of the exact model: x (q,) all parameters, SI; names (f,) those fitted, with covariance (f, f).

    frames: as fitted; residuals (R, 3) m, white (3 R,) whitened, both zero where nothing was measured; chi2 their
    squares' sum; jacobian (3 R, 6 F + f) whitened, per SI; weight (6 F + f,): 1 / sd of what is known of each before
    the readings, in sds of their noise
    """

    model: Model
    names: tuple[str, ...]
    frames: tuple[Frame, ...]
    x: Array
    covariance: Array
    residuals: Array
    white: Array
    jacobian: Array
    chi2: float
    weight: Array

    def basis(self, without: Sequence[str] = ()) -> Array:
        """Orthonormal whitened directions (3 R, k) that the readings tell of what is fitted, some names left out."""
        first = len(self.weight) - len(self.names)
        at = [first + self.names.index(n) for n in without]
        return spanned(np.delete(self.jacobian, at, axis=1), np.delete(self.weight, at))

    def value(self, name: str) -> float:
        return float(self.x[self.model.names.index(name)])

    def sd(self, name: str) -> float:
        i = self.names.index(name)
        return float(np.sqrt(self.covariance[i, i]))

    def by_name(self) -> dict[str, float]:
        return dict(zip(self.model.names, (float(v) for v in self.x), strict=True))


def settle_fit(
    model: Model,
    rows: ReadingRows,
    names: Sequence[str],
    start: Array,
    priors: Sequence[tuple[str, float]] = (),
    frames: Sequence[Frame] | None = None,
) -> SettledFit:
    """Fit `names`, and the frames that nobody knows, from `start` (q,), all others held there.

    priors: (name, sd) of parameters that are pulled to their nominal values, so that directions which no reading shows
    stay there, beside what is known of the others. Bounds are not kept: a value beyond one says that the model is
    wrong.

    Raises NotConverged where the steps settle neither from the start nor from a linear fit, as where the arm cannot
    bear its loads; NotIdentifiable where readings cannot tell the names.
    """
    own = rows.start(model, start) if frames is None else tuple(frames)
    pulled = dict(priors)
    try:
        return _settled(ObservationModel(model, rows, own, start, tuple(names)), pulled)
    except (NotConverged, InputError):  # the nominal arm may not bear the load that a fitted one does
        try:
            linear = _settled(ObservationModel(model, rows, own, start, tuple(names), linear=True), pulled)
            return _settled(ObservationModel(model, rows, linear.frames, linear.x, tuple(names)), pulled)
        except (NotConverged, InputError) as error:
            raise NotConverged(
                f"the full equilibrium can be fitted neither from where it starts nor from a linear fit: {error}. "
                "Check the nominal values, and the units of loads and readings"
            ) from error


def _settled(seen: ObservationModel, priors: dict[str, float]) -> SettledFit:
    observations = seen.observations().knowing(priors)
    found = settle(observations, start=seen.start, tolerance=_CLOSE)
    unit = found.unit or 1.0
    weight = unit * observations.known[0]
    return _fit_at(seen, found.x, found.covariance, unit * found.residuals, unit * found.jacobian, weight)


def _fit_at(
    seen: ObservationModel, z: Array, covariance: Array, residuals: Array, jacobian: Array, weight: Array
) -> SettledFit:
    """The fit at values z (p,), frames first, with whitened residuals (m,) and sensitivities (m, p) there."""
    rows, k = seen.rows, seen.motions
    white = np.zeros(rows.measured.size)
    columns = np.zeros((len(white), jacobian.shape[1]))
    white[rows.at], columns[rows.at] = residuals, jacobian
    return SettledFit(
        model=seen.model,
        names=seen.names,
        frames=seen.moved(z),
        x=seen.values(z),
        covariance=covariance[k:, k:],
        residuals=rows.padded_noise.colour(white).reshape(rows.measured.shape),
        white=white,
        jacobian=columns,
        chi2=float(white @ white),
        weight=weight,
    )


def averaged_fit(
    model: Model, names: Sequence[str], rows: ReadingRows, fits: Sequence[tuple[float, SettledFit]]
) -> SettledFit:
    """The average of fits of the same readings by shares, as one fit of a model that holds the effects of all.

    A parameter that a fit does not have counts as vanishing there. Its covariance is that of the fits and of what they
    differ by:

        C = sum_k w_k (C_k + (x_k - x) (x_k - x)')
    """
    start = model.nominal
    known = [fit.by_name() for _, fit in fits]
    each = [np.array([own.get(n, v) for n, v in zip(model.names, start, strict=True)]) for own in known]
    x = np.asarray(sum(share * values for (share, _), values in zip(fits, each, strict=True)))
    at, place = model.index(list(names)), {n: i for i, n in enumerate(names)}
    covariance = np.zeros((len(names), len(names)))
    for (share, fit), values in zip(fits, each, strict=True):
        away = (values - x)[at]
        covariance += share * np.outer(away, away)
        own = [place[n] for n in fit.names]
        covariance[np.ix_(own, own)] += share * fit.covariance
    seen = ObservationModel(model, rows, rows.start(model, x), x, tuple(names))
    observations = seen.observations()
    predicted, J = seen.rates(seen.start)
    white = observations.noise.whiten(observations.measured - predicted)
    padded = np.pad(covariance, ((seen.motions, 0), (seen.motions, 0)))
    return _fit_at(seen, seen.start, padded, white, observations.noise.whiten(J), observations.known[0])
