"""The result of an identification, with its own proof."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from qsframework.elastostatics import Model
from qsframework.files.formats import FORMAT
from qsframework.information import RankTest
from qsframework.plugin import Array, Indices

HIGH_CORRELATION = 0.9
_SIGNIFICANT = 1e-3


@dataclass(frozen=True)
class Estimate:
    """One identified parameter, SI. `status` is "" or says that the value breaks or meets a bound.

    sd is NaN where the value stands at its bound, for the fit then says nothing about the other side; 0 where fixed.
    """

    name: str
    unit: str
    value: float
    sd: float
    initial: float
    lower: float
    upper: float
    status: str


@dataclass(frozen=True)
class Interval:
    """A profile interval, SI: all values of one parameter at which the best fit of the others is not much worse.

    An end at the parameter's bound is that bound, for the readings allow all up to it.
    linear: the ends by the covariance alone, value +- t sd; where the two differ, the model bends
    """

    name: str
    level: float
    lower: float
    upper: float
    linear: tuple[float, float]


@dataclass(frozen=True)
class Masked:
    """Rows of a file that were masked before the fit, and why; `readings` is "displacements" or "positions"."""

    kind: str
    rows: tuple[int, ...]
    words: str
    readings: str


@dataclass(frozen=True, eq=False)
class Fit:
    """Estimates with covariance (p, p) and the residuals of R used rows.

    x holds all parameters of the model, estimated or not. measured, predicted, residuals,
    studentised, left_out (R, 3): left_out are the errors at each pose when it is left out of the fit.
    sigma (m) is the sd of one coordinate of unit weight, "stated" or "estimated" from the residuals.
    """

    method: str
    model: Model
    x: Array
    estimates: tuple[Estimate, ...]
    covariance: Array
    rank: RankTest
    sigma: float
    sigma_source: str
    rows: Indices
    poses: tuple[str, ...]
    measured: Array
    predicted: Array
    nominal: Array
    residuals: Array
    studentised: Array
    left_out: Array
    chi2: float
    dof: int
    data_sha256: str
    notes: tuple[str, ...] = ()
    """What else to know about how the fit was made."""
    shared_sd: float = 0.0
    """sd (m) of the error that all markers of a pose share, beside sigma; 0 where none was looked for or seen."""
    total_covariance: Array | None = None
    """Covariance (p, p) with the load's stated uncertainty; None where none is stated."""
    intervals: tuple[Interval, ...] = ()
    """Profile intervals, of the parameters for which they were asked."""
    cleaned: tuple[Masked, ...] | None = None
    """What was masked before the fit because it cannot be right; None where nobody looked."""

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(e.name for e in self.estimates)

    @property
    def masked_rows(self) -> tuple[int, ...]:
        """Rows of the readings' file that were found wrong and not used."""
        return tuple(sorted({row for one in self.cleaned or () for row in one.rows}))

    @property
    def sd_total(self) -> tuple[float, ...]:
        """sd of each estimate with the load's stated uncertainty; that of the noise alone where none is stated."""
        covariance = self.covariance if self.total_covariance is None else self.total_covariance
        return tuple(float(s) for s in np.sqrt(np.diag(covariance)))

    @property
    def rms_readings(self) -> float:
        """RMS per axis of the readings themselves, m."""
        return rms(self.measured)

    @property
    def rms_nominal(self) -> float:
        """RMS per axis of the error of the nominal model, m."""
        return rms(self.measured - self.nominal)

    @property
    def rms(self) -> float:
        """RMS per axis of the residuals, m."""
        return rms(self.residuals)

    @property
    def rms_left_out(self) -> float:
        """RMS per axis of the leave-one-pose-out errors, m, over the poses that can be left out; NaN if none can."""
        told = self.left_out[~np.isnan(self.left_out).any(axis=1)]
        return rms(told) if len(told) else float("nan")

    @property
    def carriers(self) -> tuple[str, ...]:
        """Poses that alone carry a parameter: without one of them the others cannot tell it."""
        lost = np.flatnonzero(np.isnan(self.left_out).any(axis=1))
        return tuple(dict.fromkeys(self.poses[i] for i in lost))

    @property
    def p_value(self) -> float | None:
        """Probability of residuals this large under the stated noise; None if the noise is estimated."""
        from scipy.stats import chi2

        return None if self.sigma_source == "estimated" else float(chi2.sf(self.chi2, self.dof))

    def verdict(self) -> str:
        """Whether the residuals fit the noise, and what to do if they do not."""
        if self.p_value is None:
            return "The noise is estimated from the residuals, so they cannot say whether the model is right."
        ratio = float(np.sqrt(self.chi2 / self.dof))
        said = f"chi-square {self.chi2:.1f} on {self.dof} degrees of freedom, p = {self.p_value:.2g}"
        if self.p_value > 1.0 - _SIGNIFICANT:
            return (
                f"The residuals are only {ratio:.2g} of the stated noise ({said}): the noise is less than stated, rows "
                "were copied, or the displacements are in a larger unit than their columns say."
            )
        if self.p_value >= _SIGNIFICANT:
            return f"The residuals agree with the stated noise ({said})."
        order = np.argsort(-np.abs(self.studentised).max(axis=1))[:3]
        rows = ", ".join(f"{self.rows[i]} (pose {self.poses[i]})" for i in order)
        return (
            f"The residuals are {ratio:.1f} times the stated noise ({said}): the model or a reading is wrong, and the "
            f"standard deviations are too small by that factor. Largest residuals: rows {rows}. Check the unit of the "
            "load, the load point, the markers' names and places, and the noise."
        )

    @property
    def correlation(self) -> Array:
        """Correlation matrix of the estimates (p, p); zero where no sd is quoted."""
        sd = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(np.where(sd > 0, sd, 1.0), np.where(sd > 0, sd, 1.0))

    def high_correlations(self, above: float = HIGH_CORRELATION) -> list[tuple[str, str, float]]:
        """Pairs of estimates that the readings hardly tell apart."""
        c = self.correlation
        return [
            (self.names[i], self.names[j], float(c[i, j]))
            for i in range(len(c))
            for j in range(i + 1, len(c))
            if abs(c[i, j]) > above
        ]

    def as_json(self) -> dict[str, Any]:
        """What `fit.json` holds (SI units)."""
        return {
            "format": FORMAT,
            "robot": self.model.facts.name,
            "method": self.method,
            "parameters": list(self.names),
            "estimates": {
                e.name: {
                    "value": e.value,
                    "sd": None if np.isnan(e.sd) else e.sd,
                    "sd_total": None if np.isnan(e.sd) else total,
                    "unit": e.unit,
                    "initial": e.initial,
                    "status": e.status,
                }
                for e, total in zip(self.estimates, self.sd_total, strict=True)
            },
            "covariance": self.covariance.tolist(),
            "covariance_total": None if self.total_covariance is None else self.total_covariance.tolist(),
            "intervals": {
                i.name: {"level": i.level, "lower": i.lower, "upper": i.upper, "linear": list(i.linear)}
                for i in self.intervals
            },
            "sigma_mm": self.sigma * 1e3,
            "sigma_source": self.sigma_source,
            "shared_by_pose_mm": self.shared_sd * 1e3,
            "chi2": self.chi2,
            "dof": self.dof,
            "p_value": self.p_value,
            "poses_that_cannot_be_left_out": list(self.carriers),
            "model": {name: float(v) for name, v in zip(self.model.names, self.x, strict=True)},
            "notes": list(self.notes),
            "data_sha256": self.data_sha256,
            **self._of_readings(),
        }

    def _of_readings(self) -> dict[str, Any]:
        """What `fit.json` says of the readings' errors and of those that were not used."""
        return {
            "masked": None if self.cleaned is None else [{**asdict(m), "rows": list(m.rows)} for m in self.cleaned],
            "masked_rows": list(self.masked_rows),
            "rms_mm": {
                "readings": self.rms_readings * 1e3,
                "nominal": self.rms_nominal * 1e3,
                "identified": self.rms * 1e3,
                "leave_one_out": None if np.isnan(self.rms_left_out) else self.rms_left_out * 1e3,
            },
        }


def rms(values: Array) -> float:
    """Root mean square over all rows and axes."""
    return float(np.sqrt(np.mean(np.square(values))))
