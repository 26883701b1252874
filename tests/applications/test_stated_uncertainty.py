"""Stated expanded uncertainties hold at targets and reflectors that nobody measured, by an arm of another code; what a
fit holds at nominal values counts with its stated sd, and what nobody states as arms are delivered."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from stated_uncertainty import KINDS, Kind, drawn, fresh, measured

from qsframework.experiment import load_experiment, read_readings
from qsframework.fits import identify, read_fit, write_fit
from qsframework.uses import certificate, compensate, joint_targets


@pytest.mark.parametrize("kind", KINDS[::2], ids=[k.name for k in KINDS[::2]])
def test_the_stated_uncertainty_covers_what_it_speaks_of(kind: Kind, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four campaigns and 30 targets of each: U is neither too small nor many times too large. Whether the readings name
    a cause, which no U depends on, is not looked at (proof/test_independent.py: nothing is named of such an arm)."""
    monkeypatch.setattr(certificate, "_looked", lambda *_: "not looked at")
    for errors, stated in measured(kind, range(4)):
        assert np.mean(errors <= stated) > 0.88
        assert np.mean(errors <= 0.5 * stated) < 0.95, "half of it would do"
        assert 0.6 < np.sqrt(np.mean(errors**2) / np.mean((0.5 * stated) ** 2)) < 1.3


def test_an_error_of_what_was_held_moves_the_fit_as_the_fit_says(tmp_path: Path) -> None:
    """Its nominal value is changed by its sd, and the readings are fitted again."""
    one = drawn(KINDS[0], 3, tmp_path)
    fit = one.fit
    readings = read_readings(one.experiment.data, one.experiment)
    assert {h.name for h in fit.held} == {p.name for p in one.experiment.parameters if p.name not in fit.names}
    held = next(h for h in fit.held if h.name == "joint_offset[j2]")
    for sign in (1.0, -1.0):
        parameters = tuple(
            replace(p, nominal=sign * held.sd) if p.name == held.name else p for p in one.experiment.parameters
        )
        again = identify(replace(one.experiment, parameters=parameters), readings)
        np.testing.assert_allclose(
            again.values - fit.values, -sign * held.sd * held.moved, atol=0.05 * held.sd * np.abs(held.moved).max()
        )
    again = read_fit(write_fit(fit, tmp_path / "fit.json"))
    np.testing.assert_allclose(again.held_covariance, fit.held_covariance, rtol=1e-12)


def test_what_nobody_states_counts_as_arms_are_delivered(tmp_path: Path) -> None:
    """The files state .5 mrad, .3 mm and .3 mrad; arms are delivered with 1 mrad, .5 mm and .5 mrad."""
    one = drawn(KINDS[2], 1, tmp_path)
    there = fresh(one)
    wrench = np.concatenate([there.force, np.zeros_like(there.force)], axis=1)
    targets = joint_targets(one.experiment, there.shown, wrench)
    stated = compensate(one.experiment, one.fit, targets)
    assert np.all(stated.sds["base"] > 2e-4)
    assert f"in the base frame up to {1e3 * stated.sds['base'].max():.3f} mm" in " ".join(stated.notes)
    (tmp_path / "known.yaml").write_text("{}\n")
    experiment = load_experiment(one.experiment.path)
    fit = identify(experiment, read_readings(experiment.data, experiment))
    plain = compensate(experiment, fit, targets)
    assert 1.4 < np.sqrt(np.mean(plain.sds["base"] ** 2) / np.mean(stated.sds["base"] ** 2)) < 2.0
    assert {h.name for h in fit.held} == {entry.name for entry in fit.not_estimated}
