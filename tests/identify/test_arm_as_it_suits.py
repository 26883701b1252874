"""The arm before its readings is seen in the frame and the nests that suit it best, where these are estimated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from qsframework.experiment import load_experiment, make_rows
from qsframework.experiment.before import errors_before
from qsframework.experiment.simulate import planned_readings
from qsframework.fits import identify, validate
from qsframework.plugin import Array
from tests.calibration.small_arm import SIGMA, positions, small_arm, small_plan

NESTS = "effects: [{effect: marker_offset, markers: all}]\nfit: [joint_compliance, marker_offset]"


def test_a_nest_that_was_guessed_is_no_error_of_the_arm(tmp_path: Path) -> None:
    """The arm is nominal and its first nest 40 mm beside where the file says: before and after are noise."""
    arm = small_arm(tmp_path, "{position_sigma_mm: 0.03}", NESTS)
    plan = small_plan(arm, 8)
    readings = positions(arm, plan, np.zeros(4))
    noise = SIGMA * np.random.default_rng(8).normal(size=readings.value.shape)
    readings = readings.with_values(readings.value + noise)
    arm.path.write_text(arm.path.read_text().replace("[150, 200, 200]", "[170, 215, 170]"))
    guessed = load_experiment(arm.path)

    def size(errors: Array) -> float:
        return float(np.sqrt(np.mean(np.square(errors))))

    rows = make_rows(readings)
    names = guessed.fit_names()
    assert size(errors_before(guessed, rows, names)) == pytest.approx(SIGMA, rel=0.15)
    springs = [n for n in names if n.startswith("joint_compliance")]
    assert size(errors_before(guessed, rows, springs)) > 5e-3, (
        "where the nest is not estimated, the file's place counts"
    )
    fit = identify(guessed, readings)
    assert fit.held_out_nominal < 1.5 * fit.held_out_error
    shown = validate(guessed, readings, fit).whole
    assert shown.summary(before=True)[0] < 1.5 * shown.summary()[0]


def test_of_displacements_no_nest_is_moved(tmp_path: Path) -> None:
    """What they tell of it is less than their noise."""
    arm = small_arm(tmp_path, more=NESTS)
    exact = planned_readings(arm, small_plan(arm, 5))
    doubled = exact.with_values(2.0 * exact.value)
    rows = make_rows(doubled)
    own = rows.measured - rows.predict(arm.model(), arm.model().nominal)
    assert np.array_equal(errors_before(arm, rows, arm.fit_names()), own)
