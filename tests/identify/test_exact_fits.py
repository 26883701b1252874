"""Fits by the full equilibrium: unbiased under loads under which the linear model is not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.cli.identify import FitFiles, run_identify
from qsframework.errors import InputError, NotConverged
from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Plan, load_experiment, make_plan, simulate, write_readings
from qsframework.fits import Fit, identify, read_fit
from qsframework.plugin import Array, Poses
from tests.identify.arm import arm_text

HEAVY = arm_text("0.03", robot="kuka_kr500_r2800_2")
WEIGHT = 4000.0
EXACT, LINEAR = FitOptions(keep_all=True), FitOptions(linear=True, keep_all=True)


@pytest.fixture(scope="module")
def heavy(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    """A KR500 under 80 % of its payload."""
    path = tmp_path_factory.mktemp("heavy") / "experiment.yaml"
    path.write_text(HEAVY)
    return load_experiment(path)


def planned(experiment: Experiment, count: int = 24) -> Plan:
    rng = np.random.default_rng(2)
    controller = experiment.robot.controller
    pendant = 0.5 * (controller.lower + controller.upper) + 0.3 * (controller.upper - controller.lower) * rng.uniform(
        -1, 1, (count, 6)
    )
    wrench = np.zeros((count, 6))
    wrench[:, 2], wrench[::2, 1] = -WEIGHT, 0.4 * WEIGHT
    return make_plan(Poses(pendant, controller.to_joints(pendant), wrench), ["weight"] * count)


def offs(fit: Fit, truth: Array) -> Array:
    """Errors of the estimates in their sds."""
    index = fit.model.index(fit.names)
    return np.array([(e.value - t) / e.sd for e, t in zip(fit.estimates, truth[index], strict=True)])


def test_readings_without_noise_give_the_truth(heavy: Experiment) -> None:
    quiet = heavy.with_(noise=replace(heavy.noise, sigma=1e-9))
    made = simulate(quiet, planned(quiet), truth="drawn", seed=4)
    exact, linear = identify(quiet, made.readings, options=EXACT), identify(quiet, made.readings, options=LINEAR)
    index = exact.model.index(exact.names)
    values = np.array([e.value for e in exact.estimates])
    assert values == pytest.approx(made.x[index], rel=1e-5)
    biased = np.array([e.value for e in linear.estimates])
    assert np.abs(biased / made.x[index] - 1.0).max() > 1e-3
    assert (exact.method, exact.linear, linear.linear) == ("one-step", False, True)
    assert exact.measured == pytest.approx(made.readings.value)
    assert exact.measured - exact.predicted == pytest.approx(exact.residuals)
    assert exact.rms < 1e-2 * linear.rms


def test_estimates_are_unbiased_where_those_of_the_linear_model_are_not(heavy: Experiment) -> None:
    """Over 10 campaigns the mean error of each estimate is zero within its standard error; chi-square is right."""
    plan, runs = planned(heavy), 10
    exact, linear, ratio, dof = [], [], [], 0
    for seed in range(runs):
        made = simulate(heavy, plan, truth="drawn", seed=seed)
        fit = identify(heavy, made.readings, options=EXACT)
        exact.append(offs(fit, made.x))
        linear.append(offs(identify(heavy, made.readings, options=LINEAR), made.x))
        ratio.append(fit.chi2 / fit.dof)
        dof = fit.dof
    means = np.mean(exact, axis=0)
    assert np.all(np.abs(means) < 3.3 / np.sqrt(runs))
    assert 0.7 < np.std(exact) < 1.3
    assert np.abs(np.mean(linear, axis=0)).max() > 1.0
    assert abs(np.mean(ratio) - 1.0) < 4.0 * np.sqrt(2.0 / dof / runs)


def test_masked_rows_do_not_matter(heavy: Experiment) -> None:
    """Even where their values are no numbers."""
    made = simulate(heavy, planned(heavy), seed=1)
    value = np.array(made.readings.value)
    value[:3] = np.nan
    wrong = replace(made.readings, value=value).masked(np.arange(len(value)) < 3)
    kept = identify(heavy, wrong)
    assert np.isfinite(kept.residuals).all()
    assert len(kept.measured) == len(value) - 3
    assert np.abs(offs(kept, made.x)).max() < 4.5


def test_the_command_fits_the_equilibrium_unless_told_otherwise(heavy: Experiment, tmp_path: Path) -> None:
    made = simulate(heavy, planned(heavy), seed=1)
    write_readings(tmp_path / "r.csv", made.readings, heavy)
    files = FitFiles(
        experiment=heavy.path, data=(tmp_path / "r.csv",), json=tmp_path / "fit.json", report=tmp_path / "fit.html"
    )
    run_identify(files, None, EXACT, False)
    assert not read_fit(tmp_path / "fit.json").linear
    assert "Newton" in (tmp_path / "fit.html").read_text()
    run_identify(files, None, LINEAR, False)
    assert read_fit(tmp_path / "fit.json").linear


def test_a_load_that_the_arm_cannot_bear_is_an_error_with_a_reason(heavy: Experiment) -> None:
    """A weight in N that is read as kN: there is no equilibrium at the start of the fit."""
    made = simulate(heavy, planned(heavy), seed=1).readings
    crushed = made.with_poses(replace(made.poses, wrench=1e4 * made.poses.wrench))
    with pytest.raises((NotConverged, InputError), match=r"no finite prediction|did not settle|does not settle"):
        identify(heavy, crushed, options=EXACT)
