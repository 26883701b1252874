"""Errors that readings share: covariances against their definition, their size by REML; losses against gross ones."""

from __future__ import annotations

import numpy as np
import pytest

from qsframework.errors import InputError
from qsframework.estimation import Independent, Noise, Scaled, grouped, shared_error
from qsframework.estimation.noise import Blocks
from qsframework.estimation.robust import Loss


def dense(noise: Noise, m: int) -> np.ndarray:
    """Covariance (m, m) behind a noise: L^-1 of the unit matrix, inverted."""
    L = np.linalg.inv(noise.whiten(np.eye(m)))
    return L @ L.T


def test_a_grouped_covariance_is_what_it_says() -> None:
    rng = np.random.default_rng(0)
    m = 24
    sigma = rng.uniform(0.5, 2.0, m)
    a, b = rng.integers(-1, 6, m), rng.integers(-1, 9, m)
    sa, sb = rng.uniform(0.1, 3.0, m), rng.uniform(0.1, 3.0, m)
    noise = grouped(sigma, [(a, sa), (b, sb)])
    cov = np.diag(sigma**2)
    for i in range(m):
        for j in range(m):
            cov[i, j] += sa[i] * sa[j] * (a[i] == a[j] >= 0) + sb[i] * sb[j] * (b[i] == b[j] >= 0)
    assert isinstance(noise, Blocks)
    assert np.allclose(dense(noise, m), cov, rtol=1e-12, atol=1e-12)
    assert np.isclose(noise.log_det(), np.linalg.slogdet(cov)[1], rtol=1e-12)
    one = rng.normal(size=m)
    assert np.isclose(np.square(noise.whiten(one)).sum(), one @ np.linalg.solve(cov, one), rtol=1e-12)
    assert np.allclose(noise.whiten(np.column_stack([one, 2 * one]))[:, 1], 2 * noise.whiten(one))


def test_all_that_a_noise_does_is_of_one_covariance() -> None:
    """Whitened and coloured again; L'^-1 L^-1 is the inverse; the weights are its diagonal; and k times it."""
    rng = np.random.default_rng(1)
    m = 13
    sigma = rng.uniform(0.5, 2.0, m)
    shared = grouped(sigma, [(rng.integers(-1, 4, m), rng.uniform(0.1, 3.0, m))])
    y, two = rng.normal(size=m), rng.normal(size=(m, 2))
    for noise in (Independent(sigma), shared, Scaled(shared, 2.5, m)):
        inverse = np.linalg.inv(dense(noise, m))
        assert noise.colour(noise.whiten(y)) == pytest.approx(y, rel=1e-12)
        assert noise.turned(noise.whiten(two)) == pytest.approx(inverse @ two, rel=1e-9)
        assert noise.turned(noise.whiten(y)) == pytest.approx(inverse @ y, rel=1e-9)
        assert noise.weights() == pytest.approx(np.diag(inverse), rel=1e-9)
        assert noise.log_det() == pytest.approx(-np.linalg.slogdet(inverse)[1], rel=1e-12)
    assert dense(Scaled(shared, 2.5, m), m) == pytest.approx(6.25 * dense(shared, m), rel=1e-12)


def test_squares_of_a_few_places_are_those_of_the_whole_vector() -> None:
    rng = np.random.default_rng(2)
    m, n = 40, 12
    sigma = rng.uniform(0.5, 2.0, m)
    chains = [(rng.integers(-1, 8, m), rng.uniform(0.1, 1.0, m)), (rng.integers(-1, 15, m), rng.uniform(0.1, 1.0, m))]
    at, values = np.stack([rng.choice(m, 7, replace=False) for _ in range(n)]), rng.normal(size=(n, 7))
    whole = np.zeros((m, n))
    whole[at.T, np.arange(n)] = values.T
    for noise in (Independent(sigma), grouped(sigma, chains[:1]), grouped(sigma, chains)):
        assert noise.squares(at, values) == pytest.approx(np.square(noise.whiten(whole)).sum(axis=0), rel=1e-12)


@pytest.mark.parametrize("sigma", [[0.1, 0.0], [0.1, np.nan], [0.1, -1.0]])
def test_shared_errors_need_a_noise_of_their_own(sigma: list[float]) -> None:
    with pytest.raises(InputError, match="the noise of every reading must be a positive number"):
        grouped(np.array(sigma), [(np.zeros(2, dtype=np.intp), np.full(2, 0.1))])


@pytest.mark.parametrize("name", ["huber", "soft_l1", "linear"])
def test_losses_are_the_integrals_of_their_weights(name: str) -> None:
    """rho' = 2 w r, and the slope is that of w r: by differences, below and beyond the corner."""
    loss = Loss(name, 0.7)
    r = np.array([-5.0, -0.8, -0.1, 0.2, 0.9, 3.0])
    h = 1e-6
    np.testing.assert_allclose((loss.rho(r + h) - loss.rho(r - h)) / (2 * h), 2 * loss.weights(r) * r, rtol=1e-6)
    psi = [loss.weights(s) * s for s in (r + h, r - h)]
    np.testing.assert_allclose((psi[0] - psi[1]) / (2 * h), loss.slope(r), atol=1e-6)


def test_without_a_group_readings_are_independent() -> None:
    assert isinstance(grouped(np.ones(6), [(np.full(6, -1), np.ones(6))]), Independent)
    with pytest.raises(InputError, match="positive"):
        grouped(np.zeros(4), [(np.zeros(4, dtype=int), np.ones(4))])


SIMULATED = 80


def campaign(rng: np.random.Generator, shared: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Residuals of 12 poses x 3 markers x 3 axes with 6 parameters, their columns, sigma and labels."""
    A = rng.normal(size=(108, 6))
    label = (3 * np.repeat(np.arange(12), 3)[:, None] + np.arange(3)).ravel()
    y = rng.normal(size=108) + shared * rng.normal(size=36)[label]
    return y - A @ np.linalg.lstsq(A, y, rcond=None)[0], A, np.ones(108), label


@pytest.mark.parametrize("stated", [True, False])
def test_the_shared_error_of_a_pose_is_found_and_not_invented(stated: bool) -> None:
    """REML is unbiased for the variance (4 sigma of the mean), and the test keeps its level of 5 %."""
    rng = np.random.default_rng(1)
    found = [shared_error(*campaign(rng, 1.0), stated=stated) for _ in range(SIMULATED)]
    variance = np.array([f.sd**2 for f in found])
    assert abs(variance.mean() - 1.0) < 4.0 * variance.std() / np.sqrt(SIMULATED)
    assert np.mean([f.p_value < 0.01 for f in found]) > 0.95
    none = np.array([shared_error(*campaign(rng, 0.0), stated=stated).p_value for _ in range(SIMULATED)])
    assert np.mean(none < 0.05) < 0.05 + 3.0 * np.sqrt(0.05 * 0.95 / SIMULATED)
    assert np.mean(none == 1.0) > 0.3  # half of the estimates are zero


def test_reml_is_the_closed_form_where_there_is_one() -> None:
    """Balanced groups and one mean: between and within sums of squares, the textbook's analysis of variance."""
    rng = np.random.default_rng(3)
    groups, size = 15, 4
    label = np.repeat(np.arange(groups), size)
    y = rng.normal(size=groups * size) + 1.5 * rng.normal(size=groups)[label]
    means = y.reshape(groups, size).mean(axis=1)
    within = np.square(y - means[label]).sum() / (groups * (size - 1))
    between = size * means.var(ddof=1)
    found = shared_error(y - y.mean(), np.ones((len(y), 1)), np.ones(len(y)), label, stated=False)
    assert np.isclose(found.unit**2, within, rtol=1e-4)
    assert np.isclose(found.sd**2, (between - within) / size, rtol=1e-4)
