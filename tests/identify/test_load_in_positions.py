"""The load's own error in fits of loaded positions: its columns against differences, and how the table says it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, LoadUncertainty, observation_model
from qsframework.fits import identify
from qsframework.fits.load_error import load_columns
from qsframework.report import fit_table
from tests.calibration.small_arm import SPRINGS, acting, positions, small_arm, small_plan

LINEAR = FitOptions(linear=True, keep_all=True)


@pytest.fixture
def arm(tmp_path: Path) -> Experiment:
    uncertainty = LoadUncertainty(0.01, np.deg2rad(0.3))
    return small_arm(tmp_path).with_(load_uncertainty=uncertainty, fit=("joint_compliance",))


@pytest.mark.parametrize("linear", [True, False])
def test_columns_against_finite_differences(arm: Experiment, linear: bool) -> None:
    states = positions(arm, small_plan(arm, 6), np.zeros(4))
    fit = identify(arm, states, options=LINEAR)
    seen = observation_model(arm, states, linear=linear, frames=fit.frames)
    columns = seen.rows.spread(load_columns(seen, fit.x))
    assert np.array_equal(np.abs(columns).max(axis=(1, 2)) > 0.0, states.states.loaded[states.plus])
    h = 1e-4
    for i, (k, *r) in enumerate(np.eye(4)):
        ends = []
        for s in (h, -h):
            turned = states.with_poses(acting(states.poses, s * k, s * np.array(r)))
            moved = observation_model(arm, turned, linear=linear, frames=fit.frames)
            ends.append(moved.rows.predict(fit.model, fit.x, fit.frames, linear))
        assert np.allclose(columns[..., i], (ends[0] - ends[1]) / (2 * h), rtol=1e-5, atol=1e-9)


def test_both_sds_are_shares_of_the_value(arm: Experiment) -> None:
    """An estimate far above its initial value: the total share is not below that of the noise."""
    fit = identify(arm, positions(arm, small_plan(arm, 6), np.zeros(4)), options=LINEAR)
    i = fit.names.index(SPRINGS[2])
    estimates = list(fit.estimates)
    estimates[i] = replace(estimates[i], value=4.0 * estimates[i].initial)
    row = next(r for r in fit_table(replace(fit, estimates=tuple(estimates))).rows if r[0].endswith("[elbow]"))
    assert f"{100 * fit.sd_total[i] / estimates[i].value:.1f} %" in row
    estimates[i] = replace(estimates[i], value=1e-30)
    row = next(r for r in fit_table(replace(fit, estimates=tuple(estimates))).rows if r[0].endswith("[elbow]"))
    assert "> 999 %" in row, "shares of next to nothing have no digits"
