"""What is wrong with the readings of a fit, with what its files state, or with its own size."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from qsframework.estimation.tails import chi2_sf
from qsframework.experiment.finding import Finding
from qsframework.fits.estimate import EstimateState
from qsframework.fits.record import SIGNIFICANT, FitRecord
from qsframework.screening import FILES, STAND_OUT, Mistake

TOO_SMALL, TOO_LARGE = 1.0 / 3.0, 3.0
"""Times the stated noise: a tracker's own statement of its noise is no further off."""
_INSTRUMENTS = 1e-6, 1e-2
"""m, of one coordinate: from an interferometer on a short line to a pair of cameras across a hall."""
_CARRIES = 0.5
"""Of the error of the nominal arm: a fit that leaves more of it at held-out poses predicts little."""
_IDENTIFIED = (EstimateState.FINE, EstimateState.OUTSIDE_PRIOR, EstimateState.FIXED)


def findings_of(fit: FitRecord, mistakes: Sequence[Mistake]) -> tuple[Finding, ...]:
    """What is wrong with a fit's readings and with the robot's files (`mistakes`), and with its own size where no
    mistake of the whole table explains it.

    Rows that the options say are right (`keep_all`) are no finding. Nor are single rows that stand out: noise can.
    """
    mistakes = [one for one in mistakes if one.told and one.name not in STAND_OUT]
    table = [one.finding for one in mistakes if not (fit.options.keep_all and one.mask is not None)]
    whole = any(one.mask is None and one.file != FILES for one in mistakes)
    return tuple(table) if whole else (*table, *_of_noise(fit), *_of_estimates(fit))


def _of_noise(fit: FitRecord) -> Iterator[Finding]:
    """A stated noise that no instrument has, or that the residuals contradict."""
    mend = "State the noise of the instrument (noise: sigma_mm in the experiment), or write noise: estimate."
    if fit.sigma_source == "estimated" or fit.dof <= 0:
        return
    stated = f"the stated noise of a coordinate, {1e3 * fit.sigma:.3g} mm,"
    if not _INSTRUMENTS[0] <= fit.sigma <= _INSTRUMENTS[1]:
        low, high = (1e3 * size for size in _INSTRUMENTS)
        yield Finding("noise", f"{stated} is not that of an instrument ({low:g} to {high:g} mm)", mend, "noise")
    ratio = float(np.sqrt(fit.chi2 / fit.dof))
    if ratio < TOO_SMALL and chi2_sf(fit.chi2, fit.dof) > 1.0 - SIGNIFICANT:
        words = f"the residuals are {ratio:.2g} times {stated.rstrip(',')}"
        yield Finding(
            "small_residuals", words, f"{mend} Look for copied rows, and at the units of the columns.", "noise"
        )
    if ratio > TOO_LARGE and fit.agrees is False and not fit.held_out_error < _CARRIES * fit.held_out_nominal:
        words = f"the residuals are {ratio:.1f} times {stated} and held-out poses are not predicted"
        yield Finding(
            "large_residuals", words, "Look at the axes, units and signs of the table, and at the loads.", "readings"
        )


def _of_estimates(fit: FitRecord) -> Iterator[Finding]:
    """A fit that identifies none of its parameters."""
    if not any(e.state in _IDENTIFIED for e in fit.estimates):
        mend = "Measure more poses or larger loads: `qsf design` plans them."
        yield Finding("nothing_identified", f"none of {len(fit.estimates)} parameters is identified", mend)
