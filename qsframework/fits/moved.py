"""Two campaigns of one arm: which parameters have moved beyond their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsframework.estimation.tails import normal_isf
from qsframework.fits.record import FitRecord

_LEVEL = 0.01
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
    """The parameters that both fits have, with the load's stated uncertainty in their sds.

    The two are taken as independent; of fits to the same readings nothing is beyond.
    """
    theirs = dict(zip(before.names, zip(before.values.tolist(), before.sd_total, strict=True), strict=True))
    both = [(e, sd, *theirs[e.name]) for e, sd in zip(fit.estimates, fit.sd_total, strict=True) if e.name in theirs]
    apart = not same_readings(fit, before)
    limit = float(normal_isf(0.5 * _LEVEL / max(len(both), 1)))
    return tuple(
        ParameterChange(
            name=e.name,
            unit=e.unit,
            value=e.value,
            sd=sd,
            before=old,
            sd_before=sd_old,
            beyond=apart and bool(abs(e.value - old) > limit * np.hypot(sd, sd_old) > 0.0),
        )
        for e, sd, old, sd_old in both
    )
