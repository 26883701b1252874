"""What makes a plan good: convex functions of the information matrix, smaller is better.

All are homogeneous of degree -1, so that a ratio of values is an efficiency and the certificate of
`information.certificate` holds. Parameters are scaled before; D does not depend on the scaling.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from qsframework.errors import InputError, Problem, nearest
from qsframework.plugin import Array


class Criterion(ABC):
    """A criterion psi(M) and its slope; `weights` are the shares of trace and determinant in it."""

    name: str
    title: str
    trace_share: float
    determinant_share: float

    @abstractmethod
    def value(self, M: Array) -> Array:
        """psi of information matrices (..., p, p); inf where M is singular."""

    @abstractmethod
    def gradient(self, M: Array) -> Array:
        """G = -d psi / d M (p, p), positive semidefinite."""


@dataclass(frozen=True)
class TraceDeterminant(Criterion):
    """trace_share * trace(cov) + determinant_share * det(cov)^(1/p): the paper's O1, O2 and O3."""

    name: str
    title: str
    trace_share: float
    determinant_share: float

    def value(self, M: Array) -> Array:
        p = M.shape[-1]
        sign, logdet = np.linalg.slogdet(M)
        good = (sign > 0) & np.isfinite(logdet) & (logdet > -600.0)
        total = np.where(good, self.determinant_share * np.exp(-np.where(good, logdet, 0.0) / p), np.inf)
        if self.trace_share:
            safe = np.where(good[..., None, None], M, np.eye(p))
            trace = np.trace(np.linalg.inv(safe), axis1=-2, axis2=-1)
            total = np.where(good & (trace > 0), total + self.trace_share * trace, np.inf)
        return total

    def gradient(self, M: Array) -> Array:
        p = M.shape[-1]
        cov = np.linalg.inv(M)
        cov = 0.5 * (cov + cov.T)
        _, logdet = np.linalg.slogdet(M)
        return self.trace_share * cov @ cov + self.determinant_share * np.exp(-logdet / p) / p * cov


CRITERIA: dict[str, Criterion] = {
    "D": TraceDeterminant("D", "det(cov)^(1/p), the volume of the confidence ellipsoid", 0.0, 1.0),
    "A": TraceDeterminant("A", "trace(cov), the mean variance of the scaled parameters", 1.0, 0.0),
    "O3": TraceDeterminant("O3", "the paper's (trace(cov) + det(cov)^(1/p)) / 2", 0.5, 0.5),
}


def find_criterion(name: str) -> Criterion:
    """The criterion of a name; an InputError lists them."""
    if name not in CRITERIA:
        raise InputError(
            Problem(f"unknown criterion {name!r}", allowed=", ".join(CRITERIA), hint=nearest(name, CRITERIA))
        )
    return CRITERIA[name]
