"""Pseudo-values: calibrated tests under heavy tails, more power than least squares."""

from __future__ import annotations

import numpy as np

from qsframework.estimation import orthonormal
from qsframework.estimation.linear_fit import winsorised
from qsframework.hypotheses.search.family_test import family_test
from qsframework.hypotheses.search.model_selection import blocks_of
from tests.diagnose.cases import SIGMA
from tests.diagnose.test_statistics import linear, lone

RUNS = 200


def test_scores_keep_their_level_and_see_as_much_as_least_squares_under_student_t3() -> None:
    case, subspaces = linear()
    blocks, fits = blocks_of(case, subspaces), lone(case)
    F = orthonormal(case.A)
    rng = np.random.default_rng(0)
    threshold = family_test(blocks, fits, rng.standard_normal(len(F)) * SIGMA, seed=1).threshold(0.04)
    direction = next(s for s in subspaces if s.cause.name == "joint_hardening[joint_3]").Q[:, 0]
    alarms = sizes = plain = 0.0
    for _ in range(RUNS):
        noise = rng.standard_t(3, len(F)) / np.sqrt(3.0)  # unit variance
        r = winsorised(noise, F)
        alarms += family_test(blocks, fits, r * SIGMA, draws=10).log_p.min() <= threshold
        spread = np.std(r - F @ (F.T @ r))
        sizes += direction @ winsorised(noise + 8.0 * direction, F) / spread
        plain += direction @ (noise + 8.0 * direction)
    assert alarms / RUNS < 0.08
    assert sizes > 1.1 * plain


def test_normal_errors_are_hardly_changed() -> None:
    rng = np.random.default_rng(1)
    Q, _ = np.linalg.qr(rng.standard_normal((600, 20)))
    noise = rng.standard_normal(600)
    left = noise - Q @ (Q.T @ noise)
    noise /= np.sqrt(left @ left / 580)
    kept = winsorised(noise, Q)
    assert np.corrcoef(Q.T @ kept, Q.T @ noise)[0, 1] > 0.95


def test_too_few_readings_stay_as_they_are() -> None:
    Q, _ = np.linalg.qr(np.random.default_rng(2).standard_normal((30, 20)))
    noise = np.random.default_rng(3).standard_t(3, 30)
    assert winsorised(noise, Q) is noise


def test_readings_whose_weights_go_to_and_fro_are_tame_too() -> None:
    """Few readings with wild errors, where the steps never settle: still tame, and finite."""
    rng = np.random.default_rng(7)
    Q, _ = np.linalg.qr(rng.standard_normal((30, 10)))
    wild = rng.standard_t(2, 30)
    wild[3] = 30.0
    kept = winsorised(wild, Q)
    left = kept - Q @ (Q.T @ kept)
    raw = wild - Q @ (Q.T @ wild)
    assert np.abs(left).max() < np.abs(raw).max()
