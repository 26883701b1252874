"""Two campaigns of one arm: which parameters have moved beyond their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsframework.estimation.tails import chi2_sf, normal_isf
from qsframework.fits.record import FitRecord

LEVEL = 0.01
"""Chance of calling any parameter moved where none has."""


@dataclass(frozen=True, kw_only=True)
class ParameterChange:
    """A parameter that both campaigns identified, SI: its value and sd now and before; beyond: moved further than the
    two uncertainties explain, at 1 % for all parameters together."""

    name: str
    unit: str
    value: float
    sd: float
    before: float
    sd_before: float
    beyond: bool

    @property
    def apart(self) -> float:
        """The difference in its own sd; NaN where none is quoted."""
        size = float(np.hypot(self.sd, self.sd_before))
        return (self.value - self.before) / size if size > 0.0 else float("nan")


def same_readings(fit: FitRecord, before: FitRecord) -> bool:
    """Whether two fits rest on readings in common."""
    return fit.account.shares(before.account.marks) or before.account.shares(fit.account.marks)


def moved(fit: FitRecord, before: FitRecord) -> tuple[ParameterChange, ...]:
    """The parameters that both fits have, with the load's stated uncertainty in their sds; what both hold at nominal
    is off by the same.

    The two are taken as independent; of fits to the same readings nothing is beyond.
    """
    new, old = (np.sqrt(np.diag(one.whole_covariance)).tolist() for one in (fit, before))
    theirs = dict(zip(before.names, zip(before.values.tolist(), old, strict=True), strict=True))
    both = [(e, sd, *theirs[e.name]) for e, sd in zip(fit.estimates, new, strict=True) if e.name in theirs]
    apart = not same_readings(fit, before)
    limit = float(normal_isf(0.5 * LEVEL / max(len(both), 1)))
    return tuple(
        ParameterChange(
            name=e.name,
            unit=e.unit,
            value=e.value,
            sd=sd,
            before=was,
            sd_before=sd_was,
            beyond=apart and bool(abs(e.value - was) > limit * np.hypot(sd, sd_was) > 0.0),
        )
        for e, sd, was, sd_was in both
    )


def together(fit: FitRecord, before: FitRecord) -> float:
    """Probability of differences this large of all that both fits, of different readings, estimate of the arm together,
    where nothing moved: d' (C1 + C2)^-1 d against chi-square. What the readings know only together, only this shows."""
    names = [e.name for e in fit.estimates if e.name in before.names and e.name in fit.model_values and e.sd > 0.0]
    if not names:
        return 1.0
    index = [[one.names.index(n) for n in names] for one in (fit, before)]
    new, old = (one.whole_covariance[np.ix_(at, at)] for one, at in zip((fit, before), index, strict=True))
    size = np.sqrt(np.diag(new + old))
    apart = (fit.values[index[0]] - before.values[index[1]]) / size
    return float(chi2_sf(float(apart @ np.linalg.solve((new + old) / np.outer(size, size), apart)), len(names)))
