"""A fit says when its residuals do not fit the noise, and which poses carry a parameter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Plan, simulate
from qsframework.fits import EstimateState, identify
from qsframework.plans import design
from qsframework.report.words.fit import verdict_words
from tests.identify.arm import spoilt, with_sigma

KEEP = FitOptions(keep_all=True)


@pytest.fixture(scope="module")
def plan(m900ib: Experiment) -> Plan:
    return design(m900ib, 12, "D", 300)


def test_a_good_fit_agrees_with_the_noise(m900ib: Experiment, plan: Plan) -> None:
    fit = identify(m900ib, simulate(m900ib, plan, seed=1).readings)
    assert fit.p_value is not None
    assert fit.p_value > 1e-3
    assert verdict_words(fit).startswith("The residuals agree with the stated noise")
    assert fit.carriers == ()


def test_one_gross_reading_is_told_and_named(m900ib: Experiment, plan: Plan) -> None:
    readings = simulate(m900ib, plan, seed=1).readings
    wrong = spoilt(readings, [7], np.array([0.0, 3e-3, 0.0]))
    fit = identify(m900ib, wrong, options=KEEP)
    assert "times the stated noise" in verdict_words(fit)
    assert f"rows {readings.line[7]} (pose {readings.pose[7]})" in verdict_words(fit)
    assert fit.as_json()["p_value"] < 1e-6


def test_one_gross_reading_is_masked_and_counts_as_unseen(m900ib: Experiment, plan: Plan) -> None:
    """The fit without it agrees with the noise; the held-out error counts it, and says what it is without."""
    readings = simulate(m900ib, plan, seed=1).readings
    wrong = spoilt(readings, [7], np.array([0.0, 3e-3, 0.0]))
    fit = identify(m900ib, wrong)
    assert fit.masked == (int(readings.line[7]),)
    assert verdict_words(fit).startswith("The residuals agree")
    assert fit.rms_left_out_kept < 0.1e-3
    count = 3 * len(readings)
    both = np.sqrt((fit.rms_left_out_kept**2 * (count - 3) + np.square(fit.missed).sum()) / count)
    assert fit.missed.shape == (1, 3)
    assert fit.rms_left_out == pytest.approx(both, rel=1e-6)
    stored = fit.as_json()
    assert stored["masked_rows"] == [int(readings.line[7])]
    assert stored["rms_per_axis_mm"]["leave_one_out"] > stored["rms_per_axis_mm"]["leave_one_out_without_masked"]
    kept = np.arange(len(readings)) != 7
    again = identify(m900ib, replace(wrong, use=kept), options=KEEP)
    assert np.allclose(fit.x, again.x, rtol=1e-9)


def test_swapped_markers_and_a_wrong_load_unit_are_told(m900ib: Experiment, plan: Plan) -> None:
    readings = simulate(m900ib, plan, seed=1).readings
    swapped = np.where(readings.marker == 0, 1, np.where(readings.marker == 1, 0, readings.marker))
    assert "the model or a reading is wrong" in verdict_words(
        identify(m900ib, replace(readings, marker=swapped), options=KEEP)
    )
    kilograms = readings.with_poses(replace(readings.poses, wrench=readings.poses.wrench / 9.81))
    states = [e.state for e in identify(m900ib, kilograms, options=KEEP).estimates]
    assert EstimateState.OUTSIDE_PRIOR in states


def test_a_pose_that_alone_carries_a_parameter_is_named(m900ib: Experiment) -> None:
    loads = (m900ib.loads[0], replace(m900ib.loads[1], poses=1))
    once = m900ib.with_(loads=loads)
    fit = identify(once, simulate(once, design(once, 12, "A", 300), seed=2).readings)
    assert len(fit.carriers) == 1
    assert np.isfinite(fit.rms_left_out)
    assert fit.as_json()["carriers"] == list(fit.carriers)


def test_noise_that_is_to_be_estimated_is_estimated(m900ib: Experiment, plan: Plan) -> None:
    """A sigma that is known only up to a factor weighs the rows, and nothing more."""
    fit = identify(m900ib, replace(simulate(m900ib, plan, seed=3).readings, stated=False))
    assert fit.sigma_source == "estimated"
    assert 0.8 < fit.sigma / 0.03e-3 < 1.2


def test_residuals_far_below_the_noise_are_said(m900ib: Experiment, plan: Plan) -> None:
    """A third of the stated noise, and readings in metres under a column of millimetres."""
    quiet = m900ib.with_(noise=replace(m900ib.noise, sigma=1e-5))
    readings = simulate(quiet, plan, seed=1).readings
    loud = with_sigma(readings, 3e-5)
    assert "The residuals are only 0.29 of the stated noise" in verdict_words(identify(m900ib, loud))
    metres = simulate(m900ib, plan, seed=1).readings
    small = identify(m900ib, metres.with_values(metres.value * 1e-3))
    assert "in a larger unit than their columns say" in verdict_words(small)
    assert "The residuals agree" in verdict_words(identify(m900ib, metres))
