"""What every solver works on: scalar readings, their prediction as a function of the parameters, and their noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from qsframework.errors import InputError
from qsframework.plugin import Array, Indices, Parameter


class Noise(Protocol):
    """Covariance of m scalar readings, up to a common factor: Cov = L L'."""

    def whiten(self, values: Array) -> Array:
        """L^-1 values, for values (m,) or (m, p)."""
        ...

    def log_det(self) -> float:
        """log det Cov."""
        ...

    def turned(self, values: Array) -> Array:
        """L'^-1 values, for values (m,) or (m, p)."""
        ...

    def colour(self, values: Array) -> Array:
        """L values (m,): back from whitened to metres."""
        ...

    def weights(self) -> Array:
        """Diagonal (m,) of Cov^-1."""
        ...


@dataclass(frozen=True, eq=False)
class Independent:
    """Readings with errors of their own: sigma (m,), in the unit of the readings."""

    sigma: Array

    def __post_init__(self) -> None:
        if not (np.all(np.isfinite(self.sigma)) and np.all(self.sigma > 0)):
            raise InputError(
                "the noise of every reading must be a positive number; leave it out (noise: estimate, and no sigma_mm) "
                "to have it estimated from the residuals"
            )

    def whiten(self, values: Array) -> Array:
        return values / (self.sigma if values.ndim == 1 else self.sigma[:, None])

    def log_det(self) -> float:
        return float(2.0 * np.log(self.sigma).sum())

    def turned(self, values: Array) -> Array:
        return self.whiten(values)

    def colour(self, values: Array) -> Array:
        return values * self.sigma

    def weights(self) -> Array:
        return 1.0 / self.sigma**2


@dataclass(frozen=True, eq=False)
class Observations:
    """m scalar readings and p parameters to be fitted.

    measured    (m,) SI, pose by pose
    predict     x (p,) -> (m,)
    jacobian    x (p,) -> (m, p)
    parameters  the p parameters: nominal value, bounds, prior sd, scale
    noise       covariance of the readings, up to a factor where the noise is to be estimated
    block       (m,) number of the pose that each scalar belongs to
    rows        (m,) line in the file
    """

    measured: Array
    predict: Callable[[Array], Array]
    jacobian: Callable[[Array], Array]
    parameters: tuple[Parameter, ...]
    noise: Noise
    block: Indices
    rows: Indices

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.parameters)

    @property
    def start(self) -> Array:
        """The nominal values (p,)."""
        return np.array([p.nominal for p in self.parameters])
