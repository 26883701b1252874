"""What every fit works on: scalar readings, their prediction as a function of the parameters, and their noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from qsframework.estimation.noise import Noise, rounding
from qsframework.plugin import Array, Indices, Parameter


@dataclass(frozen=True, eq=False, kw_only=True)
class Observations:
    """m scalar readings and p parameters to be fitted.

    measured    (m,) SI
    predict     x (p,) -> (m,)
    jacobian    x (p,) -> (m, p), of the prediction there
    parameters  the p parameters: nominal value, bounds, prior sd, scale
    noise       covariance of the readings, up to a factor where `stated` is False
    block       (m,) number of what is left out together: the pose, and all that shares its references
    row         (m,) number of the reading that each scalar belongs to
    prior       (p,) value of each parameter before the readings, None: the nominal ones
    prior_sd    (p,) sd of that, inf where nothing is known; None: nothing is known of any
    reach       SI: size of the numbers that predictions are differences of, whose rounding they carry; 0: none
    """

    measured: Array
    predict: Callable[[Array], Array]
    jacobian: Callable[[Array], Array]
    parameters: tuple[Parameter, ...]
    noise: Noise
    block: Indices
    row: Indices
    stated: bool = True
    prior: Array | None = None
    prior_sd: Array | None = None
    reach: float = 0.0

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.parameters)

    @property
    def start(self) -> Array:
        """The nominal values (p,)."""
        return np.array([p.nominal for p in self.parameters])

    @property
    def known(self) -> tuple[Array, Array]:
        """By which weight (p,), 1 / sd, each parameter is known before the readings, and which value (p,) it has."""
        weight = np.zeros(len(self.parameters)) if self.prior_sd is None else 1.0 / self.prior_sd
        return weight, self.start if self.prior is None else self.prior

    def knowing(self, sds: Mapping[str, float]) -> Observations:
        """The same with other sds of some values before the readings, by name."""
        before = [np.inf] * len(self.parameters) if self.prior_sd is None else self.prior_sd.tolist()
        return replace(self, prior_sd=np.array([sds.get(n, b) for n, b in zip(self.names, before, strict=True)]))

    @property
    def least(self) -> float:
        """Whitened size that rounding leaves of residuals: no noise is estimated below it, and none is zero."""
        return rounding(self.noise, self.measured, self.reach)

    @property
    def scale(self) -> Array:
        """Size (p,) by which each parameter is scaled."""
        return scales(self.parameters)


def scales(parameters: tuple[Parameter, ...] | list[Parameter]) -> Array:
    """Size (p,) by which each parameter is scaled: its stated sd, else its nominal or natural size."""
    return np.array([p.scale if p.sd is None else p.sd for p in parameters])
