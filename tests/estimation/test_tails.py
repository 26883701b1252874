"""The tails agree with `scipy.stats`, at their ends too."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from qsframework.estimation import tails

X = np.array([-1.0, 0.0, 1e-3, 0.7, 5.0, 90.0, 4000.0])
DOF = np.array([1, 3, 17, 400])[:, None]
P = np.array([0.0, 1e-12, 1e-3, 0.05, 0.5, 0.999, 1.0])


def test_chi_square() -> None:
    np.testing.assert_allclose(tails.chi2_sf(X, DOF), stats.chi2.sf(X, DOF), rtol=1e-12)
    np.testing.assert_allclose(tails.chi2_cdf(X, DOF), stats.chi2.cdf(X, DOF), rtol=1e-12)
    np.testing.assert_allclose(tails.chi2_isf(P, DOF), stats.chi2.isf(P, DOF), rtol=1e-10)
    assert np.isnan(tails.chi2_sf(3.0, 0))


def test_f() -> None:
    for other in (1, 8, 500):
        np.testing.assert_allclose(tails.f_sf(X, DOF, other), stats.f.sf(X, DOF, other), rtol=1e-10)
        at = P[2:-1]
        np.testing.assert_allclose(tails.f_isf(at, DOF, other), stats.f.isf(at, DOF, other), rtol=1e-8)
    assert np.isnan(tails.f_sf(3.0, 0, 5))


def test_normal() -> None:
    np.testing.assert_allclose(tails.normal_sf(X[:-1]), stats.norm.sf(X[:-1]), rtol=1e-12)
    np.testing.assert_allclose(tails.normal_isf(P), stats.norm.isf(P), rtol=1e-12)


@pytest.mark.parametrize("x", [2.0, 1500.0])
def test_one_number_is_a_number(x: float) -> None:
    assert np.ndim(tails.chi2_sf(x, 3)) == 0
    assert np.ndim(tails.f_sf(x, 3, 9)) == 0
