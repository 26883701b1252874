"""The error that all markers of a pose share: both models take it, and the command prints it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.cli.identify import FitFiles, run_identify
from qsframework.errors import InputError
from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Readings, make_plan, simulate, write_readings
from qsframework.fits import identify
from qsframework.plugin import Array, Poses

POSES = 14
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
