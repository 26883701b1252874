"""The error that all markers of a pose share: with it intervals cover, without it they do not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from scipy.stats import t

from qsframework.cli.identify import FitFiles, run_identify
from qsframework.errors import InputError
from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Readings, make_plan, simulate, write_readings
from qsframework.identify import Fit, identify
from qsframework.plugin import Array, Poses
from tests.identify.arm import with_sigma

POSES = 14
COUNT = 32
SIGMA, WITHIN = 0.03e-3, 0.04e-3
SHARED, PLAIN = (FitOptions(shared=s, linear=True, keep_all=True) for s in ("pose", ""))


def template(experiment: Experiment) -> tuple[Readings, Array]:
    """Readings of 14 poses and their exact values (R, 3)."""
    controller = experiment.robot.controller
    rng = np.random.default_rng(11)
    pendant = rng.uniform(controller.lower, controller.upper, (POSES, 6)) * 0.75
    wrench = np.tile([0.0, 1500.0, -4000.0, 0, 0, 0], (POSES, 1))
    plan = make_plan(Poses(pendant, controller.to_joints(pendant), wrench), ["pull"] * POSES)
    quiet = experiment.with_(noise=replace(experiment.noise, sigma=0.0))
    return simulate(experiment, plan, linear=True).readings, simulate(quiet, plan, linear=True).readings.value


def campaign(given: tuple[Readings, Array], seed: int, within: float = WITHIN) -> Readings:
    readings, exact = given
    rng = np.random.default_rng([5, seed])
    common = within * rng.standard_normal((len(readings.states) // 2, 3))[readings.plus]
    return readings.with_values(exact + SIGMA * rng.standard_normal(exact.shape) + common)


def inside(fit: Fit, dof: float) -> npt.NDArray[np.bool_]:
    """Whether each 95 % interval covers the truth."""
    z = np.array([(e.value - e.initial) / e.sd for e in fit.estimates])
    return np.abs(z) < t.ppf(0.975, dof)


@pytest.fixture(scope="module", params=["stated", "estimated"])
def fits(request: pytest.FixtureRequest, m900ib: Experiment) -> tuple[list[Fit], list[Fit]]:
    """Fits of the same campaigns with the shared error and without."""
    given = template(m900ib)
    stated = request.param == "stated"
    experiment = m900ib if stated else m900ib.with_(noise=replace(m900ib.noise, sigma=None))
    if not stated:
        given = with_sigma(given[0], None), given[1]
    made = [campaign(given, seed) for seed in range(COUNT)]
    return [identify(experiment, r, options=SHARED) for r in made], [
        identify(experiment, r, options=PLAIN) for r in made
    ]


def test_intervals_cover_with_it_and_not_without(fits: tuple[list[Fit], list[Fit]]) -> None:
    """The shared error is told from one number for each pose and axis: so many degrees of freedom less the fit's."""
    on, off = fits
    dof = 3 * POSES - len(on[0].names)
    good = np.array([inside(f, dof) for f in on]).mean(axis=1)
    bad = np.array([inside(f, off[0].dof) for f in off]).mean(axis=1)
    assert abs(good.mean() - 0.95) < 0.015 + 3.0 * good.std() / np.sqrt(COUNT)
    lost = good - bad  # of the same campaigns
    assert lost.mean() > 3.0 * lost.std() / np.sqrt(COUNT)
    assert bad.mean() < 0.92


def test_both_components_are_found(fits: tuple[list[Fit], list[Fit]]) -> None:
    shared = np.array([f.shared_sd**2 for f in fits[0]])
    assert shared.mean() == pytest.approx(WITHIN**2, abs=4.0 * shared.std() / np.sqrt(COUNT))
    own = np.array([f.sigma**2 for f in fits[0]])
    assert own.mean() == pytest.approx(SIGMA**2, abs=max(4.0 * own.std() / np.sqrt(COUNT), 1e-9 * SIGMA**2))
    ratio = np.array([f.chi2 / f.dof for f in fits[0]])
    assert abs(ratio.mean() - 1.0) < 0.03
    r = np.array([f.studentised for f in fits[0]])
    assert np.mean(r**2) == pytest.approx(1.0, abs=0.04)
    assert np.mean([f.shared_sd == 0.0 for f in fits[1]]) == 1.0


def test_without_a_shared_error_nothing_is_invented(m900ib: Experiment) -> None:
    given = template(m900ib)
    fits = [identify(m900ib, campaign(given, seed, 0.0), options=SHARED) for seed in range(20)]
    p = np.array([f.shared_p for f in fits])
    assert np.mean(p < 0.01) < 0.01 + 3.0 * np.sqrt(0.01 * 0.99 / 20)
    assert np.mean([f.shared_sd == 0.0 for f in fits]) > 0.25


@pytest.mark.parametrize("linear", [True, False])
def test_both_models_take_it(m900ib: Experiment, linear: bool) -> None:
    readings = campaign(template(m900ib), 3)
    shared, plain = (identify(m900ib, readings, options=replace(o, linear=linear)) for o in (SHARED, PLAIN))
    assert shared.shared_sd > 0.01e-3
    assert np.mean(np.diag(shared.covariance) / np.diag(plain.covariance)) > 1.5
    assert shared.as_json()["shared_sd_m"] == shared.shared_sd


def test_the_command_prints_both_components(
    m900ib: Experiment, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    readings = campaign(template(m900ib), 3)
    write_readings(tmp_path / "r.csv", readings, m900ib)
    run_identify(FitFiles(experiment=m900ib.path, data=(tmp_path / "r.csv",)), None, SHARED, False)
    said = capsys.readouterr().out
    fit = identify(m900ib, readings, options=SHARED)
    assert "Noise of one coordinate: 0.0300 mm, stated" in said
    assert f"shared by all markers of a pose: {fit.shared_sd * 1e3:.4f} mm, estimated" in said


def test_words_where_it_cannot_be_told(m900ib: Experiment) -> None:
    readings = campaign(template(m900ib), 3)
    with pytest.raises(InputError, match="every measurement has one marker only"):
        identify(m900ib, replace(readings, use=readings.marker == 0), options=SHARED)
    with pytest.raises(InputError, match="unknown shared error 'poses'"):
        FitOptions(shared="poses")
