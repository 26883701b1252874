"""What the audit says of noise whose truth is known, and how far its alarms are false."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from qsframework.diagnoses.residuals.audited_rows import find_outliers
from qsframework.diagnoses.residuals.noise_components import (
    FEWEST,
    NoiseAudit,
    audit_noise,
    estimate,
    lack_p_value,
    replicate_basis,
    visible,
)
from qsframework.estimation import Independent, LinearFit, orthonormal, shared_error
from qsframework.estimation.variance_component import variance_component
from qsframework.plugin import Array, Indices
from qsframework.report.words.noise import audit_words

POSES, MARKERS, COLUMNS, FITTED = 60, 3, 80, 6
ROWS = POSES * MARKERS
SIGMA = 3e-5
MEASUREMENT = np.repeat(np.arange(POSES), MARKERS)
MARKER = np.tile(np.arange(MARKERS), POSES)


def make_library(seed: int = 0, columns: int = COLUMNS) -> Array:
    """Rigid motions of the tool, other ones at each pose, seen by all its markers; (R, 3, q), s about 60 each."""
    rng = np.random.default_rng(seed)
    shift = rng.standard_normal((POSES, 1, 3, columns))
    turn = np.broadcast_to(rng.standard_normal((POSES, 1, 3, columns)), (POSES, MARKERS, 3, columns))
    arm = np.broadcast_to(rng.standard_normal((1, MARKERS, 3, 1)), turn.shape)
    return (shift + 0.5 * np.cross(turn, arm, axis=2)).reshape(ROWS, 3, columns) * 3.0


LIBRARY = make_library()
SEEN = visible(LIBRARY)
FIT = np.linalg.qr(LIBRARY.reshape(3 * ROWS, -1)[:, :FITTED])[0]


def outliers(white: Array, Q: Array) -> Indices:
    """At a level of 1 %, beside columns (3 R, k)."""
    return find_outliers(white, Q, 0.01, np.ones(white.shape, dtype=bool))


def audit(errors: Array, replicate: Array | None = None, stated: bool = True, library: Array = LIBRARY) -> NoiseAudit:
    """Of the residuals (R, 3) that a fit of the first columns leaves of errors, gross rows left out."""
    flat = errors.ravel()
    white = (flat - FIT @ (FIT.T @ flat)).reshape(ROWS, 3)
    replicate = np.arange(ROWS) if replicate is None else replicate
    Q = SEEN if library is LIBRARY else visible(library)
    out = outliers(white, Q) if white.size - Q.shape[1] >= FEWEST else np.zeros(0, dtype=np.intp)
    keep, sigma = np.setdiff1d(np.arange(ROWS), out), np.full(ROWS, SIGMA)
    own = Q if len(keep) == ROWS else orthonormal(Q.reshape(ROWS, 3, -1)[keep].reshape(3 * len(keep), -1))
    size = estimate(LinearFit.onto(own, white[keep]), sigma[keep], MEASUREMENT[keep], "residuals")
    return audit_noise(
        white[keep],
        library[keep],
        sigma[keep],
        stated,
        MEASUREMENT[keep],
        replicate[keep].astype(np.intp),
        unit=size.unit if size.dof else float(np.sqrt(np.mean(white**2))),
        shared=size.shared,
        outliers=out,
    )


def normal(rng: np.random.Generator) -> Array:
    return rng.standard_normal((ROWS, 3))


def with_shared(size: float) -> Callable[[np.random.Generator], Array]:
    return lambda rng: normal(rng) + size * rng.standard_normal((POSES, 3))[MEASUREMENT]


def test_clean_readings_raise_no_alarm() -> None:
    """100 times: each alarm has a level of 1 %, so more than 5 of 100 have a probability of 5e-4."""
    rng = np.random.default_rng(1)
    found = [audit(normal(rng)) for _ in range(100)]
    assert sum(len(a.outliers) > 0 for a in found) <= 5
    assert sum(a.heavy < 0.01 for a in found) <= 5
    assert sum(a.p_unit < 0.01 for a in found) <= 5
    assert sum(a.p_shared < 0.01 for a in found) <= 5
    assert all(a.unit == 1.0 and a.shared == 0.0 for a in found if a.p_unit >= 0.01 and a.p_shared >= 0.01)


def test_a_sigma_that_is_too_small_is_measured() -> None:
    rng = np.random.default_rng(3)
    found = [audit(1.5 * normal(rng)) for _ in range(20)]
    assert all(a.unit_source == "residuals" and a.p_unit < 0.01 for a in found)
    assert abs(np.mean([a.unit for a in found]) - 1.5) < 0.03
    assert {a.dof for a in found if not len(a.outliers)} == {3 * ROWS - COLUMNS}
    assert "times the stated one" in audit_words(found[0])[0]


@pytest.mark.parametrize("size", [1.0, 2.0])
def test_an_error_that_markers_share_is_found(size: float) -> None:
    rng = np.random.default_rng(4)
    found = [audit(with_shared(size)(rng)) for _ in range(20)]
    assert all(a.p_shared < 0.01 for a in found)
    assert abs(np.mean([a.shared for a in found]) / SIGMA - size) < 0.1 * size
    assert sum(a.unit == 1.0 for a in found) >= 18  # the rest of the noise is as stated


def test_the_shared_error_is_the_one_of_the_general_routine() -> None:
    """The eigenvectors give the same REML estimate and likelihood ratio as the factored covariance."""
    errors = with_shared(0.8)(np.random.default_rng(5)) * SIGMA
    jacobian = LIBRARY.reshape(3 * ROWS, -1) * SIGMA
    label = (3 * MEASUREMENT[:, None] + np.arange(3)).ravel()
    slow = shared_error(errors.ravel(), jacobian, np.full(3 * ROWS, SIGMA), label, stated=False)
    found = audit(errors / SIGMA)
    assert np.isclose(found.shared, slow.sd, rtol=1e-4)
    assert np.isclose(found.p_shared, slow.p_value, rtol=1e-3)


def gross(rng: np.random.Generator) -> tuple[Array, set[int]]:
    """5 % of the rows are off by 10 to 30 sigma."""
    errors, rows = normal(rng), rng.choice(ROWS, ROWS // 20, replace=False)
    away = rng.standard_normal((len(rows), 3))
    errors[rows] += away / np.linalg.norm(away, axis=1, keepdims=True) * rng.uniform(10, 30, (len(rows), 1))
    return errors, {int(r) for r in rows}


def test_gross_rows_are_left_out() -> None:
    rng = np.random.default_rng(6)
    missed = wrong = total = 0
    for _ in range(20):
        errors, rows = gross(rng)
        found = audit(errors)
        out = set(found.outliers.tolist())
        missed, wrong, total = missed + len(rows - out), wrong + len(out - rows), total + len(rows)
    assert missed <= 0.05 * total
    assert wrong <= 3


def test_one_gross_row_has_the_p_value_of_a_refit() -> None:
    """The exact F test: against least squares on the other rows, at a size just beyond and just below the level."""
    from scipy.stats import f

    errors = normal(np.random.default_rng(7))
    basis = visible(LIBRARY)
    others = np.arange(ROWS) != 40
    A = LIBRARY[others].reshape(-1, COLUMNS)
    there = LIBRARY[40]
    spread = np.eye(3) + there @ np.linalg.inv(A.T @ A) @ there.T
    away = np.linalg.cholesky(spread)[:, 0]
    x = np.linalg.lstsq(A, errors[others].ravel(), rcond=None)[0]
    variance = np.sum((errors[others].ravel() - A @ x) ** 2) / (3 * (ROWS - 1) - COLUMNS)
    critical = np.sqrt(3.0 * variance * f.isf(0.01 / ROWS, 3, 3 * (ROWS - 1) - COLUMNS))
    for factor, expected in ((0.99, []), (1.01, [40])):
        spoilt = errors.copy()
        spoilt[40] = there @ x + factor * critical * away
        assert outliers(spoilt, basis).tolist() == expected


def test_heavy_tails_are_seen() -> None:
    rng = np.random.default_rng(8)
    found = [audit(rng.standard_t(3, (ROWS, 3))) for _ in range(20)]
    assert sum(a.heavy < 0.01 for a in found) >= 19
    assert any("heavier tails" in w for w in audit_words(found[0]))


def repeated() -> tuple[Array, Array]:
    """30 poses measured twice: a library whose columns repeat, and the numbers of the replicates."""
    half = make_library(1).reshape(POSES, MARKERS, 3, COLUMNS)[: POSES // 2]
    columns = np.concatenate([half, half]).reshape(ROWS, 3, COLUMNS)
    return columns, np.tile(np.arange(ROWS // 2), 2)


def test_replicates_tell_noise_from_physics_that_no_candidate_explains() -> None:
    columns, replicate = repeated()
    rng = np.random.default_rng(9)
    missing = rng.standard_normal((ROWS // 2, 3))
    hidden = audit(normal(rng) + np.concatenate([missing, missing]), replicate, library=columns)
    assert hidden.p_missing < 1e-6
    assert hidden.unit == 1.0  # the replicates confirm the stated noise
    assert hidden.shared == 0.0
    assert any("beyond the replicates" in w for w in audit_words(hidden))
    larger = audit(1.5 * normal(rng) + np.concatenate([missing, missing]), replicate, library=columns)
    assert larger.unit_source == "replicates"
    assert larger.dof == 3 * ROWS // 2
    assert abs(larger.measured - 1.5) < 0.2
    clean = audit(1.5 * normal(rng), replicate, library=columns)
    assert clean.p_missing > 0.01
    assert clean.unit_source == "residuals"


def test_lack_against_replicates_is_uniform() -> None:
    from scipy.stats import kstest

    columns, replicate = repeated()
    Q, own = visible(columns), replicate_basis(replicate.astype(np.intp))
    rng, one = np.random.default_rng(10), np.full(ROWS, SIGMA)
    noise = Independent(np.full(3 * ROWS, SIGMA))
    drawn = [normal(rng) for _ in range(200)]
    p = [lack_p_value(white, LinearFit.onto(Q, white), LinearFit.onto(own, white), noise, one) for white in drawn]
    assert kstest(p, "uniform").pvalue > 1e-3


def test_a_library_that_takes_all_readings() -> None:
    """As many columns as numbers: the stated noise stands, and the words say that only replicates could tell."""
    rng = np.random.default_rng(11)
    everything = np.eye(3 * ROWS).reshape(ROWS, 3, -1)
    stated = audit(5.0 * normal(rng), library=everything)
    assert (stated.unit, stated.unit_source, stated.dof, len(stated.outliers)) == (1.0, "stated", 0, 0)
    assert "without replicates" in audit_words(stated)[0]
    unknown = audit(5.0 * normal(rng), stated=False, library=everything)
    assert 4.0 < unknown.unit < 6.0
    assert "upper limit" in audit_words(unknown)[0]


def test_columns_too_small_to_be_seen_cost_nothing() -> None:
    """A column that ten typical sizes do not lift above the noise takes no degree of freedom."""
    small = LIBRARY.copy()
    small[..., 70:] *= 1e-4
    assert visible(small).shape[1] == 70
    assert visible(np.concatenate([LIBRARY, LIBRARY], axis=2)).shape[1] == COLUMNS


def test_a_gross_row_is_found_where_the_robust_fit_has_too_little_to_go_by() -> None:
    """A library that leaves 15 of 60 numbers: no robust fit, yet the exact test takes the row out, and no other."""
    rng = np.random.default_rng(12)
    basis = visible(rng.standard_normal((20, 3, 45)) * 3.0)
    assert basis.shape == (60, 45)
    errors = rng.standard_normal((20, 3))
    assert outliers(errors, basis).tolist() == []
    errors[7] += 3000.0
    assert outliers(errors, basis).tolist() == [7]


def test_rows_that_the_library_explains_alone_are_no_outliers() -> None:
    """Three columns of its own take all of a row: nothing tells whether it belongs."""
    rng = np.random.default_rng(13)
    columns = 10.0 * rng.standard_normal((30, 3, 6))
    own = np.zeros((30, 3, 3))
    own[4] = 10.0 * np.eye(3)
    errors = rng.standard_normal((30, 3))
    errors[4] += 1e4
    assert outliers(errors, visible(columns)).tolist() == [4]
    assert outliers(errors, visible(np.concatenate([columns, own], axis=2))).tolist() == []


def test_a_library_that_takes_all_readings_has_no_lack_of_fit() -> None:
    _, replicate = repeated()
    everything = visible(np.eye(3 * ROWS).reshape(ROWS, 3, -1) * 10.0)
    noise, one = Independent(np.full(3 * ROWS, SIGMA)), np.full(ROWS, SIGMA)
    white = normal(np.random.default_rng(14))
    own = replicate_basis(replicate.astype(np.intp))
    assert np.isnan(lack_p_value(white, LinearFit.onto(everything, white), LinearFit.onto(own, white), noise, one))


@pytest.mark.parametrize("reached", [0, 6])
def test_a_shared_error_is_as_likely_as_the_whole_covariance_says(reached: int) -> None:
    """Against the likelihood by dense matrices, with sds that differ by row, coordinates that were not read, and
    fitted columns that the visits reach whole."""
    rng = np.random.default_rng(reached)
    label = (3 * MEASUREMENT[:, None] + np.arange(3)).ravel()
    values = 1.0 / rng.uniform(0.5, 2.0, label.size)
    used = rng.uniform(size=label.size) > 0.05
    Z = np.where(used[:, None] & (label[:, None] == np.arange(3 * POSES)), values[:, None], 0.0)
    X = rng.standard_normal((label.size, 12)) * used[:, None]
    X[:, :reached] = Z[:, :reached]
    y = np.where(used, rng.standard_normal(label.size) + 0.8 * Z @ rng.standard_normal(3 * POSES), 0.0)
    fit = LinearFit.onto(np.linalg.qr(X)[0], y.reshape(-1, 3), used.reshape(-1, 3))

    def deviance(ratio: float) -> float:
        V = np.eye(label.size) + ratio**2 * Z @ Z.T
        inverse = np.linalg.inv(V)
        A = fit.Q.T @ inverse @ fit.Q
        by = fit.Q.T @ inverse @ fit.white
        square = fit.white @ inverse @ fit.white - by @ np.linalg.solve(A, by)
        return float(fit.dof * np.log(square) + np.linalg.slogdet(V)[1] + np.linalg.slogdet(A)[1])

    found = variance_component(fit, values[:, None], label[:, None])
    here = deviance(found.ratio)
    assert all(here < deviance(near * found.ratio) for near in (0.98, 1.02))
    assert np.isclose(found.gain, deviance(0.0) - here)
    both = np.column_stack([fit.Q, Z])
    beyond = fit.white - both @ np.linalg.lstsq(both, fit.white, rcond=None)[0]
    assert np.isclose(found.rest, beyond @ beyond)
    assert found.directions == np.linalg.matrix_rank(both) - fit.Q.shape[1]
