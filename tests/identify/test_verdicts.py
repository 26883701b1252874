"""A fit says when its residuals do not fit the noise, and which poses carry a parameter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qsframework.design import design
from qsframework.experiment import Experiment, Plan, simulate
from qsframework.identify import identify
from qsframework.information import predicted_sd


@pytest.fixture(scope="module")
def plan(m900ib: Experiment) -> Plan:
    return design(m900ib, 12, "D", 300)


def test_a_good_fit_agrees_with_the_noise(m900ib: Experiment, plan: Plan) -> None:
    fit = identify(m900ib, simulate(m900ib, plan, seed=1).readings)
    assert fit.p_value is not None
    assert fit.p_value > 1e-3
    assert fit.verdict().startswith("The residuals agree with the stated noise")
    assert fit.carriers == ()


def test_one_gross_reading_is_told_and_named(m900ib: Experiment, plan: Plan) -> None:
    readings = simulate(m900ib, plan, seed=1).readings
    displacement = np.array(readings.displacement)
    displacement[7, 1] += 3e-3
    fit = identify(m900ib, replace(readings, displacement=displacement))
    assert "times the stated noise" in fit.verdict()
    assert f"rows {readings.rows[7]} (pose {readings.pose[readings.measurement[7]]})" in fit.verdict()
    assert fit.as_json()["p_value"] < 1e-6


def test_swapped_markers_and_a_wrong_load_unit_are_told(m900ib: Experiment, plan: Plan) -> None:
    readings = simulate(m900ib, plan, seed=1).readings
    swapped = np.where(readings.marker == 0, 1, np.where(readings.marker == 1, 0, readings.marker))
    assert "the model or a reading is wrong" in identify(m900ib, replace(readings, marker=swapped)).verdict()
    kilograms = replace(readings, poses=replace(readings.poses, wrench=readings.poses.wrench / 9.81))
    statuses = [e.status for e in identify(m900ib, kilograms).estimates]
    assert any("prior sds from its initial value" in s for s in statuses)


def test_a_pose_that_alone_carries_a_parameter_is_named(m900ib: Experiment) -> None:
    loads = (m900ib.loads[0], replace(m900ib.loads[1], poses=1))
    once = m900ib.with_(loads=loads)
    fit = identify(once, simulate(once, design(once, 12, "A", 300), seed=2).readings)
    assert len(fit.carriers) == 1
    assert np.isfinite(fit.rms_left_out)
    assert fit.as_json()["poses_that_cannot_be_left_out"] == list(fit.carriers)


def test_noise_that_is_to_be_estimated_is_estimated(m900ib: Experiment, plan: Plan) -> None:
    """Even where the readings' file states a sigma: it then only weighs the rows."""
    unknown = m900ib.with_(noise=replace(m900ib.noise, sigma=None))
    fit = identify(unknown, simulate(m900ib, plan, seed=3).readings)
    assert fit.sigma_source == "estimated"
    assert 0.8 < fit.sigma / 0.03e-3 < 1.2


def test_what_tied_parameters_share_is_not_taken_for_known(m900ib: Experiment) -> None:
    """Three columns, two of them equal, the third close to them: its sd is that of the estimable pair."""

    class Stub:
        """A model of three parameters whose sensitivities are given."""

        parameters = m900ib.model().parameters[:3]

        def index(self, names: list[str]) -> list[int]:
            return [0, 1, 2]

        def sensitivity(self, poses: object, x: object = None, names: object = None) -> np.ndarray:
            rng = np.random.default_rng(0)
            a = rng.normal(size=(40, 1, 3))
            c = a + 0.1 * rng.normal(size=(40, 1, 3))
            return np.stack([a, a, c], axis=-1) / np.array([p.sd or p.scale for p in self.parameters])

    model = Stub()
    names = [p.name for p in model.parameters]
    sd = predicted_sd(model, [None] * 40, names, 1.0)  # type: ignore[arg-type]
    A = model.sensitivity(None).reshape(-1, 3)[:, 1:]
    truth = np.sqrt(np.linalg.inv(A.T @ A)[1, 1])
    assert np.isinf(sd[:2]).all()
    assert np.isclose(sd[2], truth, rtol=1e-9)


def test_residuals_far_below_the_noise_are_said(m900ib: Experiment, plan: Plan) -> None:
    """A third of the stated noise, and readings in metres under a column of millimetres."""
    quiet = m900ib.with_(noise=replace(m900ib.noise, sigma=1e-5))
    readings = simulate(quiet, plan, seed=1).readings
    loud = replace(readings, sigma=3.0 * readings.sigma)
    assert "The residuals are only 0.29 of the stated noise" in identify(m900ib, loud).verdict()
    metres = simulate(m900ib, plan, seed=1).readings
    small = identify(m900ib, replace(metres, displacement=metres.displacement * 1e-3))
    assert "in a larger unit than their columns say" in small.verdict()
    assert "The residuals agree" in identify(m900ib, metres).verdict()
