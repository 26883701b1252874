"""The balancer's closed form against the energy of a spring between two points."""

from __future__ import annotations

import numpy as np
import pytest

from qsf_plugins.spring_triangle import SpringTriangle

LC, L2, S0, K = 0.235, 1.12, 0.70, 1.0e5
B = np.linspace(-2.5, 2.5, 41)


def energy(b: np.ndarray) -> np.ndarray:
    """K (s - s0)^2 / 2 of a spring from (lc, 0) to l2 (cos b, sin b): nothing but Pythagoras."""
    s = np.hypot(L2 * np.cos(b) - LC, L2 * np.sin(b))
    return 0.5 * K * (s - S0) ** 2


def slope(function, b: np.ndarray, h: float = 1e-4) -> np.ndarray:  # type: ignore[no-untyped-def]
    return (8 * (function(b + h) - function(b - h)) - (function(b + 2 * h) - function(b - 2 * h))) / (12 * h)


def test_moment_is_the_slope_of_the_energy() -> None:
    moment = K * SpringTriangle(LC, L2).moment(B, S0)
    assert np.allclose(moment, slope(energy, B), rtol=1e-8, atol=1e-4)


def test_eta_is_the_slope_of_the_moment() -> None:
    """Equation (11) with sin^2; as printed, with sin, it is off by several percent."""
    triangle = SpringTriangle(LC, L2)
    eta = LC * L2 * triangle.eta(B, S0)
    numeric = slope(lambda b: triangle.moment(b, S0), B)
    assert np.allclose(eta, numeric, rtol=1e-9, atol=1e-10)
    s = triangle.length(B)
    printed = LC * L2 * (np.cos(B) + S0 * LC * L2 / s**3 * np.sin(B) - S0 / s * np.cos(B))
    assert np.abs(printed - numeric).max() > 0.05 * np.abs(numeric).max()


@pytest.mark.parametrize("free_length", [0.3, 0.7, 1.2])
def test_slopes_of_eta(free_length: float) -> None:
    triangle = SpringTriangle(LC, L2)
    assert np.allclose(
        triangle.eta_angle(B, free_length), slope(lambda b: triangle.eta(b, free_length), B), rtol=1e-7, atol=1e-8
    )
    h = 1e-5
    by_length = (triangle.eta(B, free_length + h) - triangle.eta(B, free_length - h)) / (2 * h)
    assert np.allclose(triangle.eta_free_length(B), by_length, rtol=1e-7, atol=1e-9)
