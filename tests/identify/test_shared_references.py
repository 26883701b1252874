"""Fits of readings that share unloaded ones: covariances and statistics against dense algebra and campaigns."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import kstest

from qsframework.errors import InputError
from qsframework.estimation import FitOptions, Independent
from qsframework.experiment import (
    Experiment,
    Plan,
    Readings,
    differences,
    make_plan,
    make_rows,
    read_readings,
    simulate,
    write_readings,
)
from qsframework.fits import Fit, identify
from qsframework.plugin import Array, Poses
from tests.identify.arm import shared_unloaded, with_sigma
from tests.identify.test_states import BASE, dense, measured

LINEAR = FitOptions(linear=True, keep_all=True)


def two_loads(experiment: Experiment) -> Plan:
    controller = experiment.robot.controller
    rng = np.random.default_rng(0)
    pendant = np.repeat(rng.uniform(controller.lower, controller.upper, (4, 6)) * 0.7, 2, axis=0)
    wrench = np.tile([[0, 0, -4000.0, 0, 0, 0], [0, 1500.0, -4000, 0, 0, 0]], (4, 1))
    return make_plan(Poses(pendant, controller.to_joints(pendant), wrench), ["weight", "side"] * 4)


def referenced(readings: Readings) -> Readings:
    """Both loads of a pose against one unloaded reading."""
    return shared_unloaded(readings, np.arange(len(readings.states) // 2) // 2)


def test_rows_against_one_reference_share_half_their_variance(m900ib: Experiment, tmp_path: Path) -> None:
    readings = simulate(m900ib, two_loads(m900ib), seed=0).readings
    write_readings(tmp_path / "r.csv", referenced(readings), m900ib)
    again = read_readings(tmp_path / "r.csv", m900ib)
    _, first = np.unique(again.minus, return_inverse=True)
    assert first.tolist() == (again.plus // 2).tolist()
    cov = dense(again) / 0.03e-3**2
    K = len(m900ib.markers)
    assert np.allclose(np.diag(cov), 1.0)
    assert np.isclose(cov[0, 3 * K], 0.5)  # the same marker and axis under the other load of the pose
    assert np.isclose(np.abs(cov[0]).sum(), 1.5)  # and nothing else
    assert isinstance(make_rows(readings).noise, Independent)


def test_a_loaded_row_without_an_unloaded_one_is_named(m900ib: Experiment) -> None:
    given = measured(m900ib, m900ib.model().nominal, 4, BASE, 5)
    use = np.array(given.use)
    use[0] = False
    K = len(m900ib.markers)
    with pytest.raises(InputError) as caught:
        differences(replace(given, use=use), m900ib)
    assert [p.line for p in caught.value.problems] == [2 + K, 2 + 2 * K]
    with pytest.raises(InputError, match="no row of a loaded state"):
        differences(replace(given, use=~given.states.loaded[given.plus]), m900ib)


def rates(fit: Fit, readings: Readings, linear: bool = True) -> Array:
    """Sensitivities (m, p) per 1e-6 of the parameters."""
    return make_rows(readings).rates(fit.model, fit.x, (), fit.names, linear)[1].reshape(-1, len(fit.names)) * 1e-6


@pytest.mark.parametrize("options", [LINEAR, FitOptions()], ids=["linear", "equilibrium"])
def test_a_fit_takes_shared_references_into_account(m900ib: Experiment, options: FitOptions) -> None:
    """The covariance and the estimates of generalised least squares, computed with the dense covariance."""
    plain = simulate(m900ib, two_loads(m900ib), seed=0).readings
    named = referenced(plain)
    fit = identify(m900ib, named, options=options)
    A, W = rates(fit, named, options.linear), np.linalg.inv(dense(named))
    assert np.allclose(fit.covariance, 1e-12 * np.linalg.inv(A.T @ W @ A), rtol=1e-6, atol=0.0)
    r = fit.residuals.ravel()
    assert np.allclose(A.T @ W @ r, 0.0, atol=1e-6 * np.linalg.norm(A.T @ W) * np.linalg.norm(r))
    assert fit.chi2 == pytest.approx(r @ W @ r)
    assert not fit.notes
    apart = identify(m900ib, plain, options=options)
    assert not np.allclose(fit.covariance, apart.covariance, rtol=0.05, atol=0.0)


def test_studentised_and_left_out_against_refits(m900ib: Experiment) -> None:
    """A coordinate with a shift of its own, and a fit without the poses that share a reading, each done in full."""
    named = referenced(simulate(m900ib, two_loads(m900ib), seed=3).readings)
    fit = identify(m900ib, named, options=LINEAR)
    A, L = rates(fit, named), np.linalg.cholesky(dense(named))
    m = len(A)
    for i in (0, 31, m - 1):
        B = np.linalg.solve(L, np.column_stack([A, np.eye(m)[:, i] * 1e-4]))
        y = np.linalg.solve(L, fit.residuals.ravel())
        shift, left, *_ = np.linalg.lstsq(B, y, rcond=None)
        sd = np.sqrt(left[0] / (m - 7) * np.linalg.inv(B.T @ B)[6, 6])
        assert fit.studentised.ravel()[i] == pytest.approx(shift[6] / sd, rel=1e-6)
    out = np.isin(named.plus, (2, 3))
    rest = identify(m900ib, replace(named, use=~out), options=LINEAR)
    predicted, value = rest.predict(named)
    assert np.allclose(fit.left_out[out], (value - predicted)[out], rtol=1e-4, atol=1e-9)


def campaigns(experiment: Experiment, count: int, options: FitOptions = LINEAR) -> list[Fit]:
    """Fits of campaigns in which both loads of a pose are measured against one unloaded reading."""
    readings = referenced(simulate(experiment, two_loads(experiment), seed=0, linear=options.linear).readings)
    exact = make_rows(readings).predict(experiment.model(), experiment.model().nominal, (), options.linear)
    out, K = [], len(experiment.markers)
    for seed in range(count):
        rng = np.random.default_rng([21, seed])
        u = np.repeat(rng.standard_normal((4, 1, K, 3)), 2, axis=1).reshape(-1, 3)
        e = 0.03e-3 / np.sqrt(2.0) * (rng.standard_normal(exact.shape) - u)
        out.append(identify(experiment, readings.with_values(exact + e), options=options))
    return out


def test_chi_square_of_shared_references_is_chi_square(m900ib: Experiment) -> None:
    """p-values uniform (Kolmogorov-Smirnov), mean and variance of chi-square, residuals of unit variance, coverage."""
    fits = campaigns(m900ib, 60)
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
    unknown = m900ib.with_(noise=replace(m900ib.noise, sigma=None))
    base = with_sigma(referenced(simulate(m900ib, two_loads(m900ib), seed=0).readings), None)
    sigma = [identify(unknown, base.with_values(f.measured), options=LINEAR).sigma for f in fits[:25]]
    mean = np.mean(np.square(sigma)) / 0.03e-3**2
    assert mean == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / dof / 25)), "an estimated sigma is a displacement's"
