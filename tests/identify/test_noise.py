"""Errors that readings share: covariances against their definition, and against simulated campaigns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

from qsframework.errors import InputError
from qsframework.experiment import (
    Experiment,
    Readings,
    StateReadings,
    make_plan,
    read_readings,
    simulate,
    write_readings,
)
from qsframework.identify import Fit, identify
from qsframework.identify.differences import differences
from qsframework.identify.noise import Blocks, grouped, readings_noise, shared_error
from qsframework.identify.observations import Independent
from qsframework.plugin import Conditions, Poses


def dense(noise: Blocks, m: int) -> np.ndarray:
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


def test_without_a_group_readings_are_independent() -> None:
    assert isinstance(grouped(np.ones(6), [(np.full(6, -1), np.ones(6))]), Independent)
    with pytest.raises(InputError, match="positive"):
        grouped(np.zeros(4), [(np.zeros(4, dtype=int), np.ones(4))])


SIMULATED = 200


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
    assert "share an error" in found[0].words()
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


def test_rows_against_one_reference_share_half_their_variance(m900ib: Experiment, tmp_path) -> None:  # type: ignore[no-untyped-def]
    readings = simulate(m900ib, two_loads(m900ib), seed=0).readings
    named = replace(readings, reference=tuple(f"u{readings.measurement[i] // 2}" for i in range(len(readings.use))))
    write_readings(tmp_path / "r.csv", named, m900ib)
    again = read_readings(tmp_path / "r.csv", m900ib)
    assert again.reference == named.reference
    keep = np.arange(len(readings.use))
    noise = readings_noise(again, keep, again.sigma)
    assert isinstance(noise, Blocks)
    cov = dense(noise, 3 * len(keep)) / 0.03e-3**2
    K = len(m900ib.markers)
    assert np.allclose(np.diag(cov), 1.0)
    assert np.isclose(cov[0, 3 * K], 0.5)  # the same marker and axis under the other load of the pose
    assert np.isclose(np.abs(cov[0]).sum(), 1.5)  # and nothing else
    assert isinstance(readings_noise(readings, keep, readings.sigma), Independent)


def two_loads(experiment: Experiment):  # type: ignore[no-untyped-def]
    controller = experiment.robot.controller
    rng = np.random.default_rng(0)
    pendant = np.repeat(rng.uniform(controller.lower, controller.upper, (4, 6)) * 0.7, 2, axis=0)
    wrench = np.tile([[0, 0, -4000.0, 0, 0, 0], [0, 1500.0, -4000, 0, 0, 0]], (4, 1))
    return make_plan(Poses(pendant, controller.to_joints(pendant), wrench), ["weight", "side"] * 4)


def states(experiment: Experiment, repeats: int = 1) -> StateReadings:
    """4 poses, each unloaded once and loaded twice, all markers; positions are numbers in order."""
    plan = two_loads(experiment)
    K = len(experiment.markers)
    order = [i for p in range(4) for i in (2 * p, 2 * p, 2 * p + 1)]
    loaded = np.array([False, True, True] * 4)
    taken = plan.poses.take(np.array(order))
    poses = Poses(taken.pendant, taken.q, taken.wrench * loaded[:, None], Conditions(), Conditions())
    rng = np.random.default_rng(5)
    R = 12 * K
    return StateReadings(
        poses, loaded, tuple(f"p{i // 2}" for i in order), ("", "weight", "side") * 4, ("",) * 12,
        np.ones(12, dtype=int), np.ones(12, dtype=int), np.repeat(np.arange(12), K), np.tile(np.arange(K), 12),
        rng.normal(size=(R, 3)), np.full(R, 0.02e-3), np.ones(R, dtype=bool), np.arange(2, 2 + R), None, None,
    )  # fmt: skip


def test_differences_of_states_and_their_covariance(m900ib: Experiment) -> None:
    """Against the definition: displacements are T times positions, their covariance T T' sigma^2."""
    given = states(m900ib)
    K = len(m900ib.markers)
    readings, noise = differences(given, m900ib)
    T = np.zeros((8 * K, 12 * K))
    for row in range(8 * K):
        m, k = divmod(row, K)
        pose, load = divmod(m, 2)
        T[row, (3 * pose + 1 + load) * K + k] = 1.0
        T[row, 3 * pose * K + k] = -1.0
    T3 = np.kron(T, np.eye(3))
    assert np.allclose(readings.displacement, T @ given.position)
    assert np.allclose(dense(noise, 24 * K), T3 @ T3.T * 0.02e-3**2)  # type: ignore[arg-type]
    assert np.allclose(readings.sigma, 0.02e-3 * np.sqrt(2.0))
    assert readings.rows.tolist() == given.rows[given.loaded[given.measurement]].tolist()
    again = readings_noise(readings, np.arange(8 * K), readings.sigma)
    assert np.allclose(dense(again, 24 * K), dense(noise, 24 * K))  # type: ignore[arg-type]


def test_a_loaded_row_without_an_unloaded_one_is_named(m900ib: Experiment) -> None:
    given = states(m900ib)
    use = np.array(given.use)
    use[0] = False
    with pytest.raises(InputError) as caught:
        differences(replace(given, use=use), m900ib)
    assert [p.line for p in caught.value.problems] == [5, 8]
    with pytest.raises(InputError, match="no row of a loaded state"):
        differences(replace(given, use=~given.loaded[given.measurement]), m900ib)


def referenced(experiment: Experiment, readings: Readings) -> Readings:
    """Both loads of a pose against one unloaded reading."""
    return replace(readings, reference=tuple(f"u{m // 2}" for m in readings.measurement))


METHODS = ("linear", "one-step")


@pytest.mark.parametrize("method", METHODS)
def test_a_fit_takes_shared_references_into_account(m900ib: Experiment, method: str) -> None:
    """The covariance and the estimates of generalised least squares, computed with the dense covariance."""
    named = referenced(m900ib, simulate(m900ib, two_loads(m900ib), seed=0).readings)
    fit = identify(m900ib, named, method=method)
    m = 3 * len(named.use)
    A = fit.model.sensitivity(named.poses, fit.x, fit.names)[named.measurement, named.marker].reshape(-1, 6) * 1e-6
    W = np.linalg.inv(dense(readings_noise(named, np.arange(len(named.use)), named.sigma), m))  # type: ignore[arg-type]
    assert np.allclose(fit.covariance, 1e-12 * np.linalg.inv(A.T @ W @ A), rtol=1e-6, atol=0.0)
    r = fit.residuals.ravel()
    assert np.allclose(A.T @ W @ r, 0.0, atol=1e-6 * np.linalg.norm(A.T @ W) * np.linalg.norm(r))
    assert fit.chi2 == pytest.approx(r @ W @ r)
    assert not fit.notes
    plain = identify(m900ib, replace(named, reference=None), method=method)
    assert not np.allclose(fit.covariance, plain.covariance, rtol=0.05, atol=0.0)


def test_studentised_and_left_out_against_refits(m900ib: Experiment) -> None:
    """A coordinate with a shift of its own, and a fit without the poses that share a reading, each done in full."""
    named = referenced(m900ib, simulate(m900ib, two_loads(m900ib), seed=3).readings)
    fit = identify(m900ib, named)
    m, at = 3 * len(named.use), (named.measurement, named.marker)
    A = fit.model.sensitivity(named.poses, fit.x, fit.names)[at].reshape(-1, 6) * 1e-6
    L = np.linalg.cholesky(dense(readings_noise(named, np.arange(len(named.use)), named.sigma), m))  # type: ignore[arg-type]
    for i in (0, 31, m - 1):
        B = np.linalg.solve(L, np.column_stack([A, np.eye(m)[:, i] * 1e-4]))
        y = np.linalg.solve(L, fit.residuals.ravel())
        shift, left, *_ = np.linalg.lstsq(B, y, rcond=None)
        sd = np.sqrt(left[0] / (m - 7) * np.linalg.inv(B.T @ B)[6, 6])
        assert fit.studentised.ravel()[i] == pytest.approx(shift[6] / sd, rel=1e-6)
    out = np.isin(named.measurement, (2, 3))
    rest = identify(m900ib, replace(named, use=~out))
    predicted = fit.model.predict(named.poses, rest.x)[at]
    assert np.allclose(fit.left_out[out], (named.displacement - predicted)[out], rtol=1e-4, atol=1e-9)


def campaigns(experiment: Experiment, count: int, method: str = "linear") -> list[Fit]:
    """Fits of campaigns in which both loads of a pose are measured against one unloaded reading."""
    readings = referenced(experiment, simulate(experiment, two_loads(experiment), seed=0).readings)
    exact = experiment.model().predict(readings.poses)[readings.measurement, readings.marker]
    out, K = [], len(experiment.markers)
    for seed in range(count):
        rng = np.random.default_rng([21, seed])
        u = np.repeat(rng.standard_normal((4, 1, K, 3)), 2, axis=1).reshape(-1, 3)
        e = 0.03e-3 / np.sqrt(2.0) * (rng.standard_normal(exact.shape) - u)
        out.append(identify(experiment, replace(readings, displacement=exact + e), method=method))
    return out


def test_chi_square_of_shared_references_is_chi_square(m900ib: Experiment) -> None:
    """p-values uniform (Kolmogorov-Smirnov), mean and variance of chi-square, residuals of unit variance, coverage."""
    fits = campaigns(m900ib, 300)
    dof = fits[0].dof
    squares = np.array([f.chi2 for f in fits])
    assert abs(squares.mean() - dof) < 4.0 * np.sqrt(2.0 * dof / len(fits))
    assert kstest([f.p_value for f in fits], "uniform").pvalue > 1e-3
    r = np.array([f.studentised for f in fits])
    each = np.mean(r**2, axis=0) / ((dof - 1) / (dof - 3))  # variance of Student's t with dof - 1
    assert abs(each.mean() - 1.0) < 0.03
    assert np.all(np.abs(each - 1.0) < 5.0 * np.sqrt(2.0 * 1.2 / len(fits)))
    truth = np.array([e.initial for e in fits[0].estimates])
    z = np.array([[(e.value - t) / e.sd for e, t in zip(f.estimates, truth, strict=True)] for f in fits])
    spread = (np.abs(z) < 1.96).mean(axis=1).std() / np.sqrt(len(fits))
    assert abs((np.abs(z) < 1.96).mean() - 0.95) < 0.005 + 3.0 * spread


def test_an_estimated_sigma_is_that_of_a_displacement(m900ib: Experiment) -> None:
    unknown = m900ib.with_(noise=replace(m900ib.noise, sigma=None))
    readings = [f.measured for f in campaigns(m900ib, 100)]
    base = referenced(m900ib, simulate(m900ib, two_loads(m900ib), seed=0).readings)
    bare = replace(base, sigma=np.full(len(base.sigma), np.nan))
    sigma = [identify(unknown, replace(bare, displacement=np.array(r))).sigma for r in readings]
    assert np.mean(np.square(sigma)) / 0.03e-3**2 == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 66 / 100))
