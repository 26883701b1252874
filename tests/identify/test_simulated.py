"""Fits of simulated readings: unbiased, with standard deviations that are true."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Plan, make_plan, read_readings, simulate, write_readings
from qsframework.fits import identify, validate_halves
from qsframework.information import predicted_sd
from qsframework.plugin import Poses

KEEP = FitOptions(keep_all=True)
LINEAR = FitOptions(linear=True, keep_all=True)


@pytest.fixture(scope="module")
def plan(m900ib: Experiment) -> Plan:
    rng = np.random.default_rng(0)
    controller = m900ib.robot.controller
    pendant = rng.uniform(controller.lower, controller.upper, (10, 6)) * 0.8
    wrench = np.tile(m900ib.loads[1].wrench, (10, 1))
    return make_plan(Poses(pendant, controller.to_joints(pendant), wrench), ["pull"] * 10)


def test_the_fit_reaches_the_promised_sd(m900ib: Experiment, plan: Plan) -> None:
    fit = identify(m900ib, simulate(m900ib, plan).readings, options=KEEP)
    assert np.allclose([e.sd for e in fit.estimates], predicted_sd(m900ib, plan), rtol=2e-3)


def test_without_noise_the_truth_is_found(m900ib: Experiment, plan: Plan) -> None:
    quiet = m900ib.with_(noise=replace(m900ib.noise, sigma=1e-12))
    simulation = simulate(quiet, plan, truth="drawn", seed=5)
    fit = identify(quiet, simulation.readings, options=KEEP)
    assert np.allclose(fit.x, simulation.x, rtol=1e-7)


def test_a_file_carries_the_readings_without_loss(m900ib: Experiment, plan: Plan, tmp_path: Path) -> None:
    simulation = simulate(m900ib, plan, seed=2)
    write_readings(tmp_path / "r.csv", simulation.readings, m900ib)
    direct, filed = (
        identify(m900ib, r, options=KEEP) for r in (simulation.readings, read_readings(tmp_path / "r.csv", m900ib))
    )
    assert np.allclose(direct.x, filed.x, rtol=1e-11)
    assert [len(one) for one in filed.account.hashes] == [64]
    assert direct.account.simulated


def test_repeats_of_a_pose_are_left_out_together(m900ib: Experiment, plan: Plan) -> None:
    """Leave-one-pose-out: a refit without a pose must not see the pose's repeats."""
    twice = replace(plan, repeats=tuple(2 for _ in plan.pose))
    readings = simulate(m900ib, twice, seed=6).readings
    fit = identify(m900ib, readings, options=LINEAR)
    use = np.array([name != plan.pose[3] for name in readings.pose])
    without = identify(m900ib, replace(readings, use=use), options=LINEAR)
    predicted, value = without.predict(readings)
    assert np.allclose((value - predicted)[~use], fit.left_out[~use], rtol=1e-6, atol=1e-12)


def test_weights_matter(m900ib: Experiment, plan: Plan) -> None:
    """Rows ten times noisier, and said so, cost little; the sds of the fit follow the stated ones."""
    simulation = simulate(m900ib, plan, seed=3)
    sigma = np.array(simulation.readings.sigma)
    sigma[::2] *= 10
    fit = identify(m900ib, replace(simulation.readings, sigma=sigma), options=KEEP)
    equal = identify(m900ib, simulation.readings, options=KEEP)
    assert all(a.sd > b.sd for a, b in zip(fit.estimates, equal.estimates, strict=True))


def test_units_of_the_scale_do_not_matter(m900ib: Experiment, plan: Plan) -> None:
    """Other nominal values give the same estimates: least squares is about the readings."""
    simulation = simulate(m900ib, plan, seed=4)
    fit = identify(m900ib, simulation.readings, options=LINEAR)
    robot = m900ib.robot
    other = replace(
        robot,
        parameters=tuple(
            replace(p, nominal=p.nominal * 3) if p.name.startswith("joint_compliance") else p for p in robot.parameters
        ),
    )
    again = identify(m900ib.with_(robot=other), simulation.readings, options=LINEAR)
    assert np.allclose(fit.x, again.x, rtol=1e-9)
    assert np.allclose(fit.covariance, again.covariance, rtol=1e-7)


def test_halves_identify_what_the_whole_does(m900ib: Experiment) -> None:
    """One pose in five is pulled sideways, so that a random half may tell nothing of joint 1: no error of the model."""
    rng = np.random.default_rng(3)
    controller = m900ib.robot.controller
    pendant = rng.uniform(controller.lower, controller.upper, (12, 6)) * 0.8
    wrench = np.tile(m900ib.loads[0].wrench, (12, 1))
    wrench[[2, 7]] = m900ib.loads[1].wrench
    sparse = make_plan(Poses(pendant, controller.to_joints(pendant), wrench), ["weight"] * 12)
    readings = simulate(m900ib, sparse, truth="drawn", seed=1).readings
    fit = identify(m900ib, readings)
    assert "joint_compliance[joint_1]" in fit.names
    halves = validate_halves(m900ib, readings, fit, 20)
    assert halves.spread.max() < 3.0 * np.sqrt(3.0) * fit.sigma
    assert halves.notes == ()
