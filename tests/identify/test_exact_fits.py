"""Fits by the full equilibrium: unbiased under loads under which the linear model is not, and said where it matters."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.cli.identify import FitFiles, How, run_identify
from qsframework.errors import InputError, NotConverged
from qsframework.experiment import Experiment, Plan, example, load_experiment, make_plan, simulate, write_readings
from qsframework.identify import Fit, identify
from qsframework.identify.equilibrium import fit_exactly
from qsframework.identify.fit_files import read_fit
from qsframework.plugin import Array, Poses
from tests.identify.arm import arm_text

HEAVY = arm_text("0.03", robot="kuka_kr500_r2800_2")
WEIGHT = 4000.0


@pytest.fixture(scope="module")
def heavy(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    """A KR500 under 80 % of its payload."""
    path = tmp_path_factory.mktemp("heavy") / "experiment.yaml"
    path.write_text(HEAVY)
    return load_experiment(path)


def planned(experiment: Experiment, count: int = 24, weight: float = WEIGHT) -> Plan:
    rng = np.random.default_rng(2)
    controller = experiment.robot.controller
    pendant = 0.5 * (controller.lower + controller.upper) + 0.3 * (controller.upper - controller.lower) * rng.uniform(
        -1, 1, (count, 6)
    )
    wrench = np.zeros((count, 6))
    wrench[:, 2], wrench[::2, 1] = -weight, 0.4 * weight
    return make_plan(Poses(pendant, controller.to_joints(pendant), wrench), ["weight"] * count)


def offs(fit: Fit, truth: Array) -> Array:
    """Errors of the estimates in their sds."""
    index = fit.model.index(fit.names)
    return np.array([(e.value - t) / e.sd for e, t in zip(fit.estimates, truth[index], strict=True)])


@pytest.mark.parametrize("method", ["linear", "one-step"])
def test_exact_readings_without_noise_give_the_truth(heavy: Experiment, method: str) -> None:
    quiet = heavy.with_(noise=replace(heavy.noise, sigma=1e-9))
    made = simulate(quiet, planned(quiet), truth="drawn", seed=4, exact=True)
    exact, linear = (identify(quiet, made.readings, method=method, exact=e) for e in (True, False))
    index = exact.model.index(exact.names)
    values = np.array([e.value for e in exact.estimates])
    assert values == pytest.approx(made.x[index], rel=1e-5)
    biased = np.array([e.value for e in linear.estimates])
    assert np.abs(biased / made.x[index] - 1.0).max() > 1e-3
    assert exact.method == f"{method}, full equilibrium"
    assert exact.measured == pytest.approx(made.readings.displacement)
    assert exact.measured - exact.predicted == pytest.approx(exact.residuals)
    assert exact.rms < 1e-2 * linear.rms


def test_estimates_are_unbiased_where_those_of_the_linear_model_are_not(heavy: Experiment) -> None:
    """Over 30 campaigns the mean error of each estimate is zero within its standard error; chi-square is right."""
    plan, runs = planned(heavy), 30
    exact, linear, ratio = [], [], []
    for seed in range(runs):
        made = simulate(heavy, plan, truth="drawn", seed=seed, exact=True)
        fit = identify(heavy, made.readings, exact=True)
        exact.append(offs(fit, made.x))
        linear.append(offs(identify(heavy, made.readings), made.x))
        ratio.append(fit.chi2 / fit.dof)
    means = np.mean(exact, axis=0)
    assert np.all(np.abs(means) < 3.3 / np.sqrt(runs))
    assert 0.7 < np.std(exact) < 1.3
    assert np.abs(np.mean(linear, axis=0)).max() > 1.0
    assert abs(np.mean(ratio) - 1.0) < 4.0 * np.sqrt(2.0 / fit.dof / runs)


def test_a_note_says_where_it_matters_and_only_there(heavy: Experiment) -> None:
    made = simulate(heavy, planned(heavy), seed=1, exact=True)
    notes = identify(heavy, made.readings).notes
    assert any("--exact" in n and "joint_compliance[joint_" in n and " sd" in n for n in notes)
    assert not any("--exact" in n for n in identify(heavy, made.readings, exact=True).notes)
    light = simulate(heavy, planned(heavy, weight=200.0), seed=1, exact=True)
    assert not any("--exact" in n for n in identify(heavy, light.readings).notes)


def test_masked_rows_do_not_matter(heavy: Experiment) -> None:
    made = simulate(heavy, planned(heavy), seed=1, exact=True)
    use = made.readings.use.copy()
    use[:3] = False
    wrong = made.readings.displacement.copy()
    wrong[:3] = np.nan
    masked = replace(made.readings, use=use, displacement=wrong)
    kept = identify(heavy, masked, exact=True)
    assert np.isfinite(kept.residuals).all()
    assert len(kept.measured) == len(use) - 3
    assert np.abs(offs(kept, made.x)).max() < 4.5


def test_rounds_that_do_not_settle_are_an_error_with_a_reason(heavy: Experiment) -> None:
    made = simulate(heavy, planned(heavy), seed=1, exact=True)
    found = identify(heavy, made.readings)
    turn = iter(range(10_000))

    def restless(_: object) -> Fit:
        first = found.estimates[0]
        value = first.value + (next(turn) % 2) * first.sd
        return replace(found, estimates=(replace(first, value=value), *found.estimates[1:]))

    with pytest.raises(NotConverged, match=r"did not settle.*still moves by 1 sd"):
        fit_exactly(found.model, made.readings, restless)


def test_the_command_fits_exactly_when_asked(heavy: Experiment, tmp_path: Path) -> None:
    made = simulate(heavy, planned(heavy), seed=1, exact=True)
    write_readings(tmp_path / "r.csv", made.readings, heavy)
    files = FitFiles(heavy.path, tmp_path / "r.csv", tmp_path / "fit.json", tmp_path / "fit.html")
    run_identify(files, How(exact=True))
    fit = read_fit(tmp_path / "fit.json")
    assert fit.method == "linear, full equilibrium"
    assert "Newton" in (tmp_path / "fit.html").read_text()


def test_positions_are_not_fitted_exactly() -> None:
    ur10 = example("ur10") / "experiment.yaml"
    with pytest.raises(InputError, match="--exact is for displacement readings"):
        run_identify(FitFiles(ur10), How(exact=True))
