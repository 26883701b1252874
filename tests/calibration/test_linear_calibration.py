"""What linear fits state, against draws: sds, p-values, studentised residuals, coverage, errors that visits share."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.stats import t as student

from qsframework.diagnoses.residuals.noise_components import NoiseAudit, audit_noise, estimate
from qsframework.estimation import (
    FitOptions,
    Independent,
    LinearFit,
    Observations,
    grouped,
    left,
    moments_held,
    orthonormal,
    propagated,
    settle,
    shared_error,
    solve,
)
from qsframework.estimation.linear_fit import Whitened
from qsframework.estimation.tails import chi2_sf
from qsframework.fits import FitRecord
from qsframework.fits.moved import moved, together
from qsframework.plugin import Array, Parameter
from tests.calibration.agreement import balanced, check_coverage, check_p_values, check_sds

ROWS, COLUMNS = 14, 3
"""Few readings: 11 degrees of freedom, where one too many or too few is noticed."""
COLUMN = np.random.default_rng(0).normal(size=(ROWS, COLUMNS)) * [1.0, 1e-6, 1e5]
Q = orthonormal(COLUMN)
SIGMA = np.random.default_rng(1).uniform(0.5, 2.0, ROWS)
BLOCKS = np.repeat(np.arange(6), [1, 2, 2, 3, 3, 3])


def observed(A: Array, y: Array, sigma: Array, stated: bool = True) -> Observations:
    """Readings y (m,) of columns A (m, p), truth zero."""
    parameters = tuple(Parameter(f"x{i}", "", nominal=0.0, typical=1.0 / s) for i, s in enumerate(abs(A).max(axis=0)))
    return Observations(
        measured=y,
        predict=lambda x: A @ x,
        jacobian=lambda x: A,
        parameters=parameters,
        noise=Independent(sigma),
        block=np.arange(len(y)),
        row=np.arange(len(y)),
        stated=stated,
    )


def test_sds_of_estimates() -> None:
    """Balanced draws: the ratio is 1 to the last digits."""
    drawn = [solve(observed(COLUMN, SIGMA * e, SIGMA)) for e in balanced(ROWS, np.random.default_rng(2))]
    check_sds(np.array([s.x for s in drawn]), np.sqrt(np.diag(drawn[0].covariance)), allowed=1e-6)


def test_scale_of_an_unstated_noise() -> None:
    drawn = [replace(LinearFit.onto(Q, 3.0 * e), stated=False) for e in balanced(ROWS, np.random.default_rng(15))]
    assert np.mean([fit.unit() for fit in drawn]) == pytest.approx(9.0)


def test_scale_of_an_unstated_noise_beside_priors() -> None:
    """Balanced draws leave as much as their degrees of freedom, to the digits that wide priors cost."""
    free = observed(COLUMN, np.zeros(ROWS), SIGMA, stated=False)
    wide = np.array([1e4 * p.typical for p in free.parameters])
    known = replace(free, prior=np.zeros(len(wide)), prior_sd=wide)
    drawn = [replace(known, measured=5.0 * SIGMA * e) for e in balanced(ROWS, np.random.default_rng(14))]
    units = [settle(one).unit or 0.0 for one in drawn]
    assert np.mean(np.square(units)) == pytest.approx(25.0, rel=1e-3)


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("loss", ["huber", "soft_l1"])
def test_sds_of_robust_estimates(loss: str, stated: bool) -> None:
    """A tenth of the readings errs six times as much: without the factor of the loss the sds are 1.2 times too small.

    Of an estimated noise the scale is the one that is found.
    """
    rng, m = np.random.default_rng(3), 60
    A, one = rng.normal(size=(m, 4)), np.ones(m)
    z: list[Array] = []
    for _ in range(100):
        y = rng.normal(size=m) * np.where(rng.uniform(size=m) < 0.1, 6.0, 1.0)
        fit = settle(observed(A, y, one, stated), FitOptions(loss=loss, starts=0))
        z.append(np.linalg.solve(np.linalg.cholesky(fit.covariance), fit.x) / (fit.unit or 1.0))
    check_sds(np.concatenate(z)[:, None], np.ones(1), allowed=0.1)


@pytest.mark.parametrize("stated", [True, False])
def test_moments_of_what_a_fit_holds(stated: bool) -> None:
    """The squared errors of the estimates are as large as said, also in those draws alone whose residuals are small; by
    what was known before alone they are much smaller there."""
    rng, sds = np.random.default_rng(8), np.array([3.0, 0.5])
    A, W = rng.normal(size=(40, 3)), rng.normal(size=(40, 2)) @ [[1.0, 1.0], [0.0, 0.2]]
    ratio, before, shown = list[Array](), list[Array](), list[float]()
    for _ in range(800):
        held = sds * rng.normal(size=2)
        fit = settle(observed(A, W @ held + rng.normal(size=40), np.ones(40), stated), FitOptions(starts=0))
        moved, noise = propagated(fit, W), np.diag(fit.covariance)
        ratio.append(fit.x**2 / (noise + np.diag(moved @ moments_held(fit, W, sds, stated) @ moved.T)))
        before.append(fit.x**2 / (noise + np.diag(moved * sds**2 @ moved.T)))
        shown.append(float(fit.residuals @ fit.residuals))
    least = np.argsort(shown)[:400]
    for some in (slice(None), least):
        assert np.mean(np.array(ratio)[some]) == pytest.approx(1.0, abs=0.15)
    assert np.mean(np.array(before)[least]) < 0.6


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("size", [1, 4])
def test_p_values_of_further_columns(stated: bool, size: int) -> None:
    """Of an unstated noise only its own residuals tell its size: F with what the further columns leave."""
    rng = np.random.default_rng(4)
    more = orthonormal(rng.normal(size=(ROWS, size)))
    p: list[float] = []
    for y in rng.normal(size=(1500, ROWS)) * (1.0 if stated else 50.0):
        fit = replace(LinearFit.onto(Q, y), stated=stated)
        drop = float(np.square(orthonormal(fit.given(more)).T @ fit.white).sum())
        p.append(float(fit.p_values(drop, size)))
    check_p_values(np.array(p))


@pytest.mark.parametrize("stated", [True, False])
def test_p_values_of_blocks_that_are_held_out(stated: bool) -> None:
    """In the fit and out of it a block is judged alike; a block out of it errs by chi-square."""
    rng = np.random.default_rng(5)
    p, unused = list[Array](), list[float]()
    for y in rng.normal(size=(500, ROWS)):
        fit = replace(LinearFit.onto(Q, y), stated=stated)
        alone = fit.held_out(BLOCKS)
        p.append(fit.p_values(alone.chi2_drop, alone.size))
        unused.append(Whitened(COLUMN, y).fit(BLOCKS != 4)[0].misfits(BLOCKS, 6)[4])
    for of_block in np.array(p).T:
        check_p_values(of_block)
    check_p_values(chi2_sf(np.array(unused), 3))


@pytest.mark.parametrize("shared", [False, True])
def test_studentised_residuals(shared: bool) -> None:
    """Student's t with one degree of freedom less than the fit, each reading's by itself."""
    noise = grouped(SIGMA, [(BLOCKS, np.full(ROWS, 1.5))]) if shared else Independent(SIGMA)
    rng = np.random.default_rng(6)
    drawn = [LinearFit.of(COLUMN, 9.0 * noise.colour(e), noise, False) for e in rng.normal(size=(800, ROWS))]
    r = np.array([fit.studentised() for fit in drawn])
    for one in r.T:
        check_p_values(2.0 * student.sf(np.abs(one), ROWS - COLUMNS - 1))


VISITS, MARKERS = 30, 3
LABEL = np.repeat(np.arange(VISITS), MARKERS)
BOUNDARY = np.array([0.05, 0.2, 0.4])
"""Levels of tests for a variance that cannot be negative: half of all p are 1."""


@pytest.mark.parametrize("stated", [True, False])
def test_p_of_an_error_that_visits_share(stated: bool) -> None:
    """Half of the draws without one give an estimate of zero, with p = 1; of the others p is half of chi-square's."""
    rng, m = np.random.default_rng(9), VISITS * MARKERS
    A, own = rng.normal(size=(m, 2)), np.full(m, 2e-5)
    basis = orthonormal(A)
    drawn = own[:, None] * rng.normal(size=(m, 220))
    residuals = drawn - basis @ (basis.T @ drawn)
    found = [shared_error(y, A, own, LABEL, stated) for y in residuals.T]
    check_p_values(np.array([one.p_value for one in found]), BOUNDARY)
    assert np.mean([one.sd == 0.0 for one in found]) == pytest.approx(0.5, abs=0.12)


@pytest.mark.parametrize("stated", [True, False])
def test_size_of_an_error_that_visits_share(stated: bool) -> None:
    """Variance of the shared error without bias, and sds of the estimates with it."""
    rng, m = np.random.default_rng(10), VISITS * MARKERS
    A = np.repeat(rng.normal(size=(VISITS, 2)), MARKERS, axis=0)
    own, shared = np.full(m, 2e-5), 3e-5
    variance, errors, unit = list[float](), list[Array](), list[float]()
    for _ in range(150):
        y = own * rng.normal(size=m) + shared * rng.normal(size=VISITS)[LABEL]
        basis = orthonormal(A)
        scale = 1.0 if stated else 3.0
        found = shared_error(y - basis @ (basis.T @ y), A, own / scale, LABEL, stated)
        variance.append(found.sd**2)
        unit.append(found.unit)
        W = found.noise.whiten(A) / found.unit
        errors.append(np.linalg.cholesky(W.T @ W).T @ np.linalg.lstsq(W, found.noise.whiten(y) / found.unit)[0])
    assert np.mean(variance) == pytest.approx(shared**2, rel=0.08)
    assert np.mean(unit) == pytest.approx(1.0 if stated else 3.0, rel=0.03)
    check_sds(np.concatenate(errors)[:, None], np.ones(1), allowed=0.1)


def test_p_values_of_the_audit_of_the_noise() -> None:
    """Of the stated size and of a shared error, from what a library of columns leaves."""
    rng, rows = np.random.default_rng(11), VISITS * MARKERS
    library = rng.normal(size=(rows, 3, 20))
    basis, sigma, each = orthonormal(library.reshape(3 * rows, -1)), np.full(rows, 3e-5), np.arange(rows)
    found: list[NoiseAudit] = []
    for white in left(basis, rng.normal(size=(3 * rows, 300))).T:
        size = estimate(LinearFit.onto(basis, white.reshape(rows, 3)), sigma, LABEL, "residuals")
        found.append(
            audit_noise(
                white.reshape(rows, 3),
                library,
                sigma,
                True,
                LABEL,
                each,
                unit=size.unit,
                shared=size.shared,
                outliers=np.zeros(0, dtype=np.intp),
            )
        )
    check_p_values(np.array([one.p_unit for one in found]))
    check_p_values(np.array([one.p_shared for one in found]), BOUNDARY)


def fits_of(values: Array, C: Array) -> FitRecord:
    """What `moved` asks of a fit, each of readings of its own."""
    estimates = [SimpleNamespace(name=f"x{i}", unit="", value=v, sd=1.0) for i, v in enumerate(values.tolist())]
    account = SimpleNamespace(marks=(), shares=lambda marks: False)
    names = tuple(e.name for e in estimates)
    record: Any = SimpleNamespace(estimates=estimates, names=names, values=values, whole_covariance=C, account=account)
    record.model_values = dict.fromkeys(names, 0.0)
    return cast(FitRecord, record)


def test_an_arm_that_has_not_changed_is_seldom_called_moved() -> None:
    """1 % for all six parameters together; by each at 1 % it would be 6 %."""
    rng = np.random.default_rng(12)
    C, before = (np.diag(sds**2) for sds in rng.uniform(0.1, 3.0, (2, 6)))
    new, old = (rng.multivariate_normal(np.zeros(6), one, 9000) for one in (C, before))
    pairs = [(fits_of(a, C), fits_of(b, before)) for a, b in zip(new, old, strict=True)]
    check_coverage(~np.array([any(m.beyond for m in moved(*pair)) for pair in pairs]), 0.99)


def test_what_moved_along_a_direction_that_is_known_alone_is_called_moved() -> None:
    """Two zeros of which the readings know the sum to .01 sds of each: neither moves far for its own sd."""
    rng, C = np.random.default_rng(13), np.eye(6)
    C[0, 1] = C[1, 0] = -0.9999
    new, old = rng.multivariate_normal(np.zeros(6), C, (2, 4000))
    check_p_values(np.array([together(fits_of(a, C), fits_of(b, C)) for a, b in zip(new, old, strict=True)]))
    pair = fits_of(np.array([0.2, 0.2, 0.0, 0.0, 0.0, 0.0]), C), fits_of(np.zeros(6), C)
    assert not any(m.beyond for m in moved(*pair))
    assert together(*pair) < 1e-9
