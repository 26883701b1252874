"""What is shown of a fit, declared once: tables, fit.json and the data frame read these lists."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from qsframework.fits.estimate import Estimate
from qsframework.plugin import Array

if TYPE_CHECKING:
    from qsframework.fits.fit import Fit
    from qsframework.fits.record import FitRecord

OWN = "own"
"""The unit of a column whose numbers are in the unit of their parameter."""


@dataclass(frozen=True, kw_only=True)
class FitColumn:
    """One number or word of each estimate.

    key: in fit.json and in the data frame, "" in neither; head: over the column of a table, "" in none; value: of a fit
    and one of its estimates, SI, None or NaN where it has none; sd: of the value, shown beside it; unit: OWN or SI;
    brief: also where room is scarce
    """

    key: str = ""
    head: str = ""
    value: Callable[[FitRecord, Estimate], Any]
    sd: Callable[[FitRecord, Estimate], float] | None = None
    unit: str = ""
    brief: bool = False


def share_of(e: Estimate, sd: float) -> float:
    """An sd as a share of the value beside it; none of what is nominally zero, as an offset."""
    return sd / abs(e.value) if e.initial and e.value and sd > 0.0 else math.nan


def sd_of(fit: FitRecord, e: Estimate) -> float:
    """The sd that stands beside an estimate: by the noise, the load and what was held at nominal."""
    return fit.sd_total[fit.names.index(e.name)] + 0.0 * e.sd


COLUMNS = [
    FitColumn(key="parameter", head="parameter", value=lambda _, e: e.name, brief=True),
    FitColumn(key="value", head="value ± sd", value=lambda _, e: e.value, sd=sd_of, unit=OWN, brief=True),
    FitColumn(key="sd", value=lambda _, e: e.sd, unit=OWN),
    FitColumn(key="sd_total", value=sd_of, unit=OWN),
    FitColumn(key="unit", head="unit", value=lambda _, e: e.unit, unit=OWN, brief=True),
    FitColumn(
        head="stiffness",
        value=lambda _, e: 1.0 / e.value if e.unit in ("rad/(N m)", "m/N") and e.value > 0.0 else math.nan,
        unit="stiffness",
    ),
    FitColumn(head="sd, %", value=lambda fit, e: share_of(e, sd_of(fit, e)), unit="%", brief=True),
    FitColumn(key="share", head="identified, %", value=lambda _, e: math.nan if e.share is None else e.share, unit="%"),
    FitColumn(key="limit", head="95 % limit", value=lambda _, e: e.limit, unit=OWN),
    FitColumn(key="initial", head="initial", value=lambda _, e: e.initial, unit=OWN, brief=True),
    FitColumn(key="state", head="status", value=lambda _, e: e.state.value, brief=True),
]
"""The columns, in their order."""


@dataclass(frozen=True, kw_only=True)
class ErrorRow:
    """An error of a fit at its readings of one kind.

    key: in fit.json; head: in tables; errors: (k, 3) m of the rows of a kind, (0, 3) where the fit has none to show
    """

    key: str
    head: str
    errors: Callable[[Fit, str], Array]


def _of(fit: Fit, values: Array, kind: str) -> Array:
    return values[fit.kind == kind]


def _missed(fit: Fit, kind: str) -> Array:
    return fit.missed[fit.missed_kind == kind]


def _readings(fit: Fit, kind: str) -> Array:
    return np.zeros((0, 3)) if kind == "position" else _of(fit, fit.measured, kind)


def _kept(fit: Fit, kind: str) -> Array:
    """Held-out errors without the masked rows, where rows are masked."""
    return _of(fit, fit.left_out, kind) if len(_missed(fit, kind)) else np.zeros((0, 3))


SUITED = "in the frame, nests and tool that suit it best where these are estimated"
"""How the arm before its readings is seen."""
ERRORS = [
    ErrorRow(key="readings", head="readings", errors=_readings),
    ErrorRow(key="nominal", head="nominal model", errors=lambda fit, k: _of(fit, fit.measured - fit.nominal, k)),
    ErrorRow(key="identified", head="identified", errors=lambda fit, k: _of(fit, fit.residuals, k)),
    ErrorRow(
        key="held_out",
        head="held-out (leave one pose out)",
        errors=lambda fit, k: np.concatenate([_of(fit, fit.left_out, k), _missed(fit, k)]),
    ),
    ErrorRow(key="held_out_without_masked", head="the same without masked rows", errors=_kept),
]
"""The errors, in their order; each is shown as its 3D RMS."""


def values_of(fit: FitRecord) -> dict[str, list[Any]]:
    """The columns that have a key, each with the values of all estimates, SI."""
    return {c.key: [c.value(fit, e) for e in fit.estimates] for c in COLUMNS if c.key}
