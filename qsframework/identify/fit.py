"""The result of an identification, with its own proof."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from qsframework.elastostatics import Model
from qsframework.information import RankTest
from qsframework.plugin import Array, Indices

HIGH_CORRELATION = 0.9


@dataclass(frozen=True)
class Estimate:
    """One identified parameter, SI. `status` is "" or says that the value breaks or meets a bound."""

    name: str
    unit: str
    value: float
    sd: float
    initial: float
    lower: float
    upper: float
    status: str


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
    measured: Array
    predicted: Array
    nominal: Array
    residuals: Array
    studentised: Array
    left_out: Array
    chi2: float
    dof: int
    data_sha256: str

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(e.name for e in self.estimates)

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
        """RMS per axis of the leave-one-pose-out errors, m."""
        return rms(self.left_out)

    @property
    def correlation(self) -> Array:
        """Correlation matrix of the estimates (p, p)."""
        sd = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(sd, sd)

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
            "method": self.method,
            "estimates": {
                e.name: {"value": e.value, "sd": e.sd, "unit": e.unit, "initial": e.initial, "status": e.status}
                for e in self.estimates
            },
            "covariance": self.covariance.tolist(),
            "sigma_mm": self.sigma * 1e3,
            "sigma_source": self.sigma_source,
            "chi2": self.chi2,
            "dof": self.dof,
            "rms_mm": {
                "readings": self.rms_readings * 1e3,
                "nominal": self.rms_nominal * 1e3,
                "identified": self.rms * 1e3,
                "leave_one_out": self.rms_left_out * 1e3,
            },
            "model": {name: float(v) for name, v in zip(self.model.names, self.x, strict=True)},
            "data_sha256": self.data_sha256,
        }


def rms(values: Array) -> float:
    """Root mean square over all rows and axes."""
    return float(np.sqrt(np.mean(np.square(values))))
