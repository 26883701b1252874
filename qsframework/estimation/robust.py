"""Losses that a few gross readings cannot pull: Huber's and the soft absolute value."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array

_CORNER = {"linear": np.inf, "huber": 1.345, "soft_l1": 1.345}
"""Residuals, in their sd, beyond which a reading loses weight; Huber's value keeps 95 % of the information."""


@dataclass(frozen=True)
class Loss:
    """rho(r) of whitened residuals, r^2 near zero; `unit` is the size of a good reading's residual."""

    name: str = "linear"
    unit: float = 1.0

    @property
    def corner(self) -> float:
        return _CORNER[self.name] * self.unit

    def rho(self, r: Array) -> Array:
        """Loss (m,), r^2 for good readings."""
        k = self.corner
        if self.name == "huber":
            return np.where(np.abs(r) <= k, r**2, 2.0 * k * np.abs(r) - k**2)
        return 2.0 * k**2 * (np.sqrt(1.0 + (r / k) ** 2) - 1.0) if self.name == "soft_l1" else r**2

    def weights(self, r: Array) -> Array:
        """rho'(r) / (2 r) (m,), 1 for good readings."""
        k = self.corner
        if self.name == "huber":
            return np.minimum(1.0, k / np.maximum(np.abs(r), 1e-300))
        return 1.0 / np.sqrt(1.0 + (r / k) ** 2) if self.name == "soft_l1" else np.ones_like(r)

    def of_squares(self, readings: int) -> str | Callable[[Array], Array]:
        """The loss as SciPy asks for it, of squared residuals (m,): rho and its two derivatives (3, m), the first rows
        being readings and the others plain squares."""
        if self.name == "linear":
            return "linear"

        def rho(squares: Array) -> Array:
            r, rest = np.sqrt(squares[:readings]), squares[readings:]
            weight, slope = self.weights(r), self.slope(r)
            bend = (slope - weight) / np.maximum(2.0 * squares[:readings], 1e-300)
            own = np.stack([self.rho(r), weight, bend])
            return np.hstack([own, np.stack([rest, np.ones(len(rest)), np.zeros(len(rest))])])

        return rho

    def slope(self, r: Array) -> Array:
        """d (weight r) / d r (m,)."""
        k = self.corner
        if self.name == "huber":
            return (np.abs(r) <= k).astype(float)
        return (1.0 + (r / k) ** 2) ** -1.5 if self.name == "soft_l1" else np.ones_like(r)

    def price(self, r: Array, parameters: int) -> float:
        """Factor on the covariance of plain least squares with noise of `unit`: mean psi^2 / (mean psi')^2.

        1 where there are no residuals at all.
        """
        if self.name == "linear":
            return 1.0
        psi = self.weights(r) * r / self.unit
        return float((psi**2).sum() / max(len(r) - parameters, 1) / np.mean(self.slope(r)) ** 2) or 1.0
