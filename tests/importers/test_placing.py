"""The frame from points: its standard deviations are true, and points that belong elsewhere do not pull it."""

from __future__ import annotations

import numpy as np
import pytest

from qsf_trackers.placing import agreed_frame, align, likely_unit
from qsframework.elastostatics.so3 import exponential, rotation_vector
from qsframework.errors import InputError
from qsframework.experiment import Frame

FRAME = Frame("", exponential(np.array([0.3, -0.2, 1.1])), np.array([2.0, -1.0, 0.5]))
THERE = np.array(
    [[0.9, 0.8, 0.0], [0.9, -0.8, 0.1], [-0.7, 0.9, 0.0], [-0.6, -0.9, 0.3], [0.2, 0.1, 1.4], [1.2, 0.0, 0.7]]
)
NAMES = tuple(f"B{k}" for k in range(1, 7))


def test_shift_and_turn_are_as_sure_as_they_say() -> None:
    """Over 400 draws of the noise the pulls have mean 0 and the sd of Student's t with 12 degrees of freedom."""
    rng = np.random.default_rng(1)
    pulls = []
    for _ in range(400):
        seen = FRAME.apply(THERE) + 3e-5 * rng.standard_normal(THERE.shape)
        found = align("known", THERE, seen, NAMES, "", "here")
        shift = found.frame.origin - FRAME.origin
        turn = rotation_vector(found.frame.rotation @ FRAME.rotation.T)
        pulls.append(np.concatenate([shift, turn]) / found.sd)
    wanted = np.sqrt(12 / 10)
    assert np.abs(np.mean(pulls, axis=0)).max() < 0.2
    assert np.std(pulls, axis=0) == pytest.approx(np.full(6, wanted), rel=0.12)


def test_the_covariance_is_that_of_how_the_points_move_with_the_frame() -> None:
    """Every element, by differences of moved frames: its shifts and turns are correlated, since the points lie to one
    side of the base's origin."""
    away = THERE + np.array([2.0, -1.0, 0.7])
    seen = FRAME.apply(away) + 3e-5 * np.random.default_rng(2).standard_normal(away.shape)
    found = align("known", away, seen, NAMES, "", "here")
    steps = 1e-5 * np.eye(6)
    moved = [(found.frame.moved(h).apply(away) - found.frame.moved(-h).apply(away)) / 2e-5 for h in steps]
    J = np.reshape(moved, (6, -1)).T
    variance = np.sum(found.missed**2) / (J.shape[0] - 6)
    np.testing.assert_allclose(found.covariance, variance * np.linalg.inv(J.T @ J), rtol=1e-6)


def test_three_points_are_enough() -> None:
    found = align("known", THERE[:3], FRAME.apply(THERE[:3]), NAMES[:3], "", "here")
    assert np.abs(found.frame.origin - FRAME.origin).max() < 1e-12
    assert found.rms < 1e-12


@pytest.mark.parametrize("tilt", [0.0, 1e-3])
def test_points_in_a_line(tilt: float) -> None:
    line = np.array([[0.3 * k, 0.1 * k, tilt * (k % 2)] for k in range(6)])
    with pytest.raises(InputError, match="lie in a line"):
        align("known", line, FRAME.apply(line), NAMES, "", "here")


def test_a_third_of_wrong_points_does_not_pull_the_frame() -> None:
    rng = np.random.default_rng(3)
    there = rng.uniform(-1.0, 1.0, (60, 3))
    seen = FRAME.apply(there) + 1e-4 * rng.standard_normal(there.shape)
    wrong = np.arange(60) % 3 == 0
    seen[wrong] += rng.uniform(0.2, 0.5, (int(wrong.sum()), 3))
    fit = agreed_frame(there, seen, 0.05)
    assert fit is not None
    assert np.array_equal(fit.agrees, ~wrong)
    assert np.abs(fit.frame.origin - FRAME.origin).max() < 1e-4


@pytest.mark.parametrize(("unit", "size"), [("mm", 1e-3), ("m", 1.0), ("inch", 0.0254), ("um", 1e-6), ("foot", 0.3048)])
def test_the_unit_by_which_points_spread_as_the_arm_does(unit: str, size: float) -> None:
    assert likely_unit(FRAME.apply(THERE) / size, THERE) == unit
    assert likely_unit(1.6 * FRAME.apply(THERE) / size, THERE) is None
