"""One identified parameter, and its state."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Annotated

import numpy as np

from qsframework.files import FileRecord, null
from qsframework.plugin import Parameter

CLEAR = 3.0
"""sds from zero from which a value is told, whatever its nominal was."""
_ABSURD = 100.0
"""Natural sizes beyond which an estimate is not plausible, whatever its sd: a joint's zero 6 deg off, a link 100 times
as soft, three payloads of unknown mass. The sizes and what they rest on stand with each effect."""
FAR = 5.0
"""Prior standard deviations from the initial value beyond which an estimate deserves a second look."""
_LIMIT = 1.96


class EstimateState(Enum):
    """What is to be said of an estimate."""

    FINE = "ok"
    FIXED = "fixed"
    UPPER_LIMIT = "may be 0"
    AT_BOUND = "at bound"
    NOT_IDENTIFIABLE = "not identifiable"
    BEYOND_BOUND = "beyond bound"
    OUTSIDE_PRIOR = "outside prior"
    IMPLAUSIBLE = "implausible"


@dataclass(frozen=True, kw_only=True)
class Estimate(FileRecord):
    """One identified parameter, SI.

    sd is NaN where the value stands at its bound, for the fit then says nothing about the other side; 0 where fixed.
    limit: of a value that is not told from zero, the size that it has at most (95 %); free_sd: the sd bounds aside;
    size: the parameter's natural size; initial, prior_sd: value and sd before the readings, None where nothing is
    known; share: of the variance before them that the readings removed, None where they alone count; counted_sd:
    that counted beside the readings, larger than prior_sd where this arm is seen to lie further off
    """

    name: str
    unit: str
    value: float
    sd: Annotated[float, null(math.nan)]
    initial: float
    lower: Annotated[float, null(-math.inf)]
    upper: Annotated[float, null(math.inf)]
    state: EstimateState = EstimateState.FINE
    limit: float | None = None
    free_sd: Annotated[float, null(math.inf)] = math.inf
    size: float = 1.0
    prior_sd: float | None = None
    share: float | None = None
    counted_sd: float | None = None

    @property
    def beyond(self) -> float:
        """How far the value lies beyond its bounds."""
        return max(self.lower - self.value, self.value - self.upper, 0.0)


def estimate_of(p: Parameter, value: float, sd: float, free: float, counted: bool = False) -> Estimate:
    """An estimate with its state, of a parameter as it was known before; `free` is the sd that it would have without
    its bounds; counted: whether what was known before counted beside the readings."""
    state, limit = _state(p, value, sd, free)
    return Estimate(
        name=p.name,
        unit=p.unit,
        value=value,
        sd=sd,
        initial=p.nominal,
        lower=max(p.lower, p.domain[0]),
        upper=min(p.upper, p.domain[1]),
        state=state,
        limit=limit,
        free_sd=free,
        size=p.scale,
        prior_sd=p.sd,
        share=max(1.0 - (sd / p.sd) ** 2, 0.0) if counted and p.sd and sd > 0.0 else None,
    )


def _state(p: Parameter, value: float, sd: float, free: float) -> tuple[EstimateState, float | None]:
    """A value that is clear of zero is told, however small its nominal value; one that is not is told where its sd is
    below what the parameter is expected to be: then it is an upper limit."""
    size = p.scale if p.sd is None else max(p.scale, p.sd)
    if sd == 0.0:
        return EstimateState.FIXED, None
    if np.isfinite(sd) and abs(value - p.nominal) - 2.0 * sd > _ABSURD * max(size, p.typical):
        return EstimateState.IMPLAUSIBLE, None
    if np.isnan(sd):
        told = np.isfinite(free) and free <= max(abs(value), size)
        return (EstimateState.AT_BOUND if told else EstimateState.NOT_IDENTIFIABLE), None
    beyond = max(p.lower - value, value - p.upper, 0.0)
    if sd > size and abs(value) < CLEAR * sd and beyond <= 2.0 * sd:
        return EstimateState.NOT_IDENTIFIABLE, None
    if beyond > 0.0:
        return EstimateState.BEYOND_BOUND, (abs(value) + _LIMIT * sd) if beyond <= sd else None
    if p.sd is not None and abs(value - p.nominal) > FAR * p.sd:
        return EstimateState.OUTSIDE_PRIOR, None
    if sd > abs(value):
        return EstimateState.UPPER_LIMIT, abs(value) + _LIMIT * sd
    return EstimateState.FINE, None
