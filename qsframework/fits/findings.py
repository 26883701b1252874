"""What is wrong with the readings of a fit, with what its files state, or with its own size."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from qsframework.errors import listed
from qsframework.estimation.tails import chi2_sf
from qsframework.experiment import Experiment, Readings
from qsframework.experiment.finding import Finding
from qsframework.experiment.prior import from_priors
from qsframework.fits.estimate import FAR, EstimateState
from qsframework.fits.fit import Fit
from qsframework.fits.record import SIGNIFICANT
from qsframework.screening import FILES, STAND_OUT, Mistake, find_mistakes, state_findings

TOO_SMALL, TOO_LARGE = 1.0 / 3.0, 3.0
"""Times the stated noise: a tracker's own statement of its noise is no further off."""
_INSTRUMENTS = 1e-6, 1e-2
"""m, of one coordinate: from an interferometer on a short line to a pair of cameras across a hall."""
_CARRIES = 0.5
"""Of the error of the nominal arm: a fit that leaves more of it at held-out poses predicts little."""
_ALONE = 20.0
"""Times as far off as half of the others: a zero by more than a degree, a joint by a centimetre."""
_IDENTIFIED = (EstimateState.FINE, EstimateState.OUTSIDE_PRIOR, EstimateState.FIXED)


def every_finding(fit: Fit, experiment: Experiment, readings: Readings) -> tuple[Finding, ...]:
    """What is wrong with a fit's readings, with the files of its campaign and with its own size."""
    mistakes = find_mistakes(experiment, readings)
    return (*findings_of(fit, mistakes, experiment, readings), *state_findings(experiment, readings))


def findings_of(
    fit: Fit, mistakes: Sequence[Mistake], experiment: Experiment, readings: Readings
) -> tuple[Finding, ...]:
    """What is wrong with a fit's readings and with the robot's files (`mistakes`), and with its own size where no
    mistake of the whole table explains it.

    Rows that the options say are right (`keep_all`) are no finding. Nor are single rows that stand out: noise can.
    """
    mistakes = [one for one in mistakes if one.told and one.name not in STAND_OUT]
    table = [one.finding for one in mistakes if not (fit.options.keep_all and one.mask is not None)]
    return (*table, *unexplained(mistakes, (*_of_fit(fit), *_of_estimates(fit, experiment, readings))))


def unexplained(mistakes: Sequence[Mistake], found: Iterable[Finding]) -> tuple[Finding, ...]:
    """What is found of a fit beside mistakes: nothing where one is of the whole table, which explains any residuals."""
    return () if any(one.mask is None and one.file != FILES for one in mistakes) else tuple(found)


def _of_fit(fit: Fit) -> Iterator[Finding]:
    """A noise that no instrument has, or that the residuals contradict; of several kinds of readings the one counts
    that the fit predicts worst."""
    if fit.sigma_source != "estimated" and fit.dof > 0:
        refuted = fit.agrees is False or chi2_sf(fit.chi2, fit.dof) > 1.0 - SIGNIFICANT
        ratio = float(np.sqrt(fit.chi2 / fit.dof)) if refuted else 1.0
        kinds = fit.errors.values()
        pairs = [(of["nominal"], of.get("held_out_without_masked", of.get("held_out", math.inf))) for of in kinds]
        yield from noise_findings(fit.sigma, ratio, max(pairs, key=lambda pair: pair[1] - _CARRIES * pair[0]))


def noise_findings(sigma: float, ratio: float, held_out: tuple[float, float]) -> Iterator[Finding]:
    """A stated noise, m, that no instrument has, or that the residuals contradict, which are `ratio` times it, 1 where
    they agree with it; held_out: the errors of the nominal arm and of the fit there, m."""
    mend = "State the noise of the instrument (noise: sigma_mm in the experiment), or write noise: estimate."
    stated = f"the stated noise of a coordinate, {1e3 * sigma:.3g} mm,"
    if not _INSTRUMENTS[0] <= sigma <= _INSTRUMENTS[1]:
        low, high = (1e3 * size for size in _INSTRUMENTS)
        yield Finding("noise", f"{stated} is not that of an instrument ({low:g} to {high:g} mm)", mend, "noise")
    if ratio < TOO_SMALL:
        words = f"the residuals are {ratio:.2g} times {stated.rstrip(',')}"
        yield Finding(
            "small_residuals", words, f"{mend} Look for copied rows, and at the units of the columns.", "noise"
        )
    if ratio > TOO_LARGE and not held_out[1] < _CARRIES * held_out[0]:
        words = f"the residuals are {ratio:.1f} times {stated} and held-out poses are not predicted"
        yield Finding(
            "large_residuals", words, "Look at the axes, units and signs of the table, and at the loads.", "readings"
        )


def _of_estimates(fit: Fit, experiment: Experiment, readings: Readings) -> Iterator[Finding]:
    """A fit that identifies none of its parameters; values that nothing known before the readings would expect."""
    if not any(e.state in _IDENTIFIED for e in fit.estimates):
        mend = "Measure more poses or larger loads: `qsf design` plans them."
        yield Finding("nothing_identified", f"none of {len(fit.estimates)} parameters is identified", mend)
    values = {e.name: e.value for e in fit.estimates if e.share is not None}
    yield from outside_prior(from_priors(experiment.model(), readings, [*values], np.array([*values.values()])))


def outside_prior(distance: Mapping[str, float]) -> Iterator[Finding]:
    """Values that lie too many sds (`distance`, by name) from what was known of them before the readings.

    One that lies there alone stops what follows: a zero that far off and a column that is off by as much look alike,
    and by the one the arm is mended, by the other spoiled.
    """
    outside = [f"{name} by {sds:.0f} sds" for name, sds in distance.items() if sds > FAR]
    if outside:
        words = f"{listed(outside)} from what was known: the arm is so, or a column or a file is off by as much"
        mend = "Look at each; if the arm is so, state the value with its sd under nominal: in the experiment."
        usual = float(np.median([*distance.values()]))
        yield Finding("outside_prior", words, mend, stops=max(distance.values()) > _ALONE * max(usual, 1.0))
