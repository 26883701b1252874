"""What every fit works on: scalar readings, their prediction as a function of the parameters, and their noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from qsframework.estimation.noise import Noise, rounding
from qsframework.plugin import Array, Indices, Parameter


@dataclass(frozen=True, eq=False, kw_only=True)
class Observations:
    """m scalar readings and p parameters to be fitted.

    measured    (m,) SI
    predict     x (p,) -> (m,)
    jacobian    x (p,) -> (m, p), of the prediction there
    rates       both at once, where that is cheaper than one after the other; None: it is not
    parameters  the p parameters: nominal value, bounds, prior sd, scale
    noise       covariance of the readings, up to a factor where `stated` is False
    block       (m,) number of what is left out together: the pose, and all that shares its references
    row         (m,) number of the reading that each scalar belongs to
    held        (p,) weak hold on each parameter, 1 / sd of whitened readings per SI: what keeps a direction that
                readings hardly tell near its nominal value; None: none
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
    held: Array | None = None
    reach: float = 0.0
    rates: Callable[[Array], tuple[Array, Array]] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.parameters)

    @property
    def start(self) -> Array:
        """The nominal values (p,)."""
        return np.array([p.nominal for p in self.parameters])

    def holds(self, priors: bool) -> tuple[Array, Array]:
        """By which weight (p,), 1 / sd, each parameter is held to which value (p,).

        To its nominal value by its stated sd where `priors`, by `held` else; what is pulled by itself to its null.
        """
        weight = np.zeros(len(self.parameters)) if self.held is None else self.held.copy()
        towards = self.start
        for i, p in enumerate(self.parameters):
            if priors and p.sd is not None:
                weight[i] = 1.0 / p.sd
            elif p.pull is not None and p.null is not None:
                towards[i] = p.null
        return weight, towards

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
