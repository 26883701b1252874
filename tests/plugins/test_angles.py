"""Cosine and sine of one tangent are those of numpy, where the tangent has no bounds too."""

from __future__ import annotations

import numpy as np
import pytest

from qsframework.plugin import cos_sin


def test_they_are_those_of_numpy() -> None:
    rng = np.random.default_rng(0)
    special = np.arange(-16, 17) * np.pi / 8
    angles = np.concatenate([rng.uniform(-4 * np.pi, 4 * np.pi, 100_000), special, special + 1e-9, [0.0, 1e-300, 1e4]])
    cos, sin = cos_sin(angles)
    assert np.abs(cos - np.cos(angles)).max() < 1e-15
    assert np.abs(sin - np.sin(angles)).max() < 1e-15
    assert np.abs(cos**2 + sin**2 - 1.0).max() < 1e-15


@pytest.mark.parametrize("angle", [-np.pi, -1.0, 0.0, 0.5 * np.pi, 3.0, np.pi, 2.0 * np.pi])
def test_their_derivatives_by_complex_step(angle: float) -> None:
    cos, sin = cos_sin(np.array([angle + 1e-30j]))
    assert cos.imag[0] / 1e-30 == pytest.approx(-np.sin(angle), abs=1e-14)
    assert sin.imag[0] / 1e-30 == pytest.approx(np.cos(angle), abs=1e-14)
