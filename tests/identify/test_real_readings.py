"""The R-2000iC's 43 readings: the numbers of independent code."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qsframework.cli.demo import read_as_relative, with_offaxis
from qsframework.errors import InputError, NotIdentifiable
from qsframework.experiment import Experiment, Readings
from qsframework.identify import identify


def mm(value: float) -> float:
    return round(value * 1e3, 3)


def test_joint_springs(r2000ic: Experiment, real: Readings) -> None:
    fit = identify(r2000ic, real)
    assert mm(fit.rms_readings) == 0.996
    assert mm(fit.rms) == 0.215
    assert mm(fit.rms_left_out) == 0.234
    compliances = [round(e.value * 1e6, 3) for e in fit.estimates]
    assert compliances == [1.162, 0.368, 0.510, 3.692, 2.355, 4.854]
    assert fit.sigma_source == "estimated"
    assert fit.dof == 3 * 43 - 6


def test_the_wrong_convention_shows_itself(r2000ic: Experiment, real: Readings) -> None:
    fit = identify(read_as_relative(r2000ic, "joint_3"), real)
    assert mm(fit.rms) == 0.286
    assert mm(fit.rms_left_out) == 0.309
    assert [e.name for e in fit.estimates if e.value < e.lower] == ["joint_compliance[joint_5]"]


def test_one_offaxis_spring_explains_a_part(r2000ic: Experiment, real: Readings) -> None:
    fit = identify(with_offaxis(r2000ic, "joint_3", "x"), real)
    assert mm(fit.rms_left_out) <= 0.182
    assert all(e.value > 0 for e in fit.estimates)


def test_left_out_errors_are_those_of_refits(r2000ic: Experiment, real: Readings) -> None:
    fit = identify(r2000ic, real)
    for row in (0, 10, 16, 42):
        use = real.use.copy()
        use[row] = False
        without = identify(r2000ic, replace(real, use=use))
        predicted = without.model.predict(real.poses, without.x)[real.measurement[row], real.marker[row]]
        assert np.allclose(real.displacement[row] - predicted, fit.left_out[row], rtol=1e-9, atol=1e-15)


def test_studentised_residuals_are_those_of_refits(r2000ic: Experiment, real: Readings) -> None:
    """Dropping one coordinate: its prediction error over its sd, both from the fit without it."""
    fit = identify(r2000ic, real)
    A = fit.model.sensitivity(real.poses, names=fit.names)[:, 0].reshape(-1, 6)
    y = real.displacement.ravel()
    for i in (0, 33, 100):
        keep = np.arange(len(y)) != i
        c, *_ = np.linalg.lstsq(A[keep], y[keep], rcond=None)
        s2 = ((y[keep] - A[keep] @ c) ** 2).sum() / (keep.sum() - 6)
        spread = s2 * (1 + A[i] @ np.linalg.solve(A[keep].T @ A[keep], A[i]))
        assert np.isclose(fit.studentised.ravel()[i], (y[i] - A[i] @ c) / np.sqrt(spread), rtol=1e-8)


def test_masked_rows_do_not_count(r2000ic: Experiment, real: Readings) -> None:
    use = np.ones(43, dtype=bool)
    use[[10, 16]] = False
    fit = identify(r2000ic, replace(real, use=use))
    assert len(fit.rows) == 41
    assert not set(real.rows[[10, 16]]) & set(fit.rows)


def test_nothing_left_to_use(r2000ic: Experiment, real: Readings) -> None:
    with pytest.raises(InputError, match="every reading is masked"):
        identify(r2000ic, replace(real, use=np.zeros(43, dtype=bool)))


def test_too_few_readings(r2000ic: Experiment, real: Readings) -> None:
    use = np.zeros(43, dtype=bool)
    use[:2] = True
    with pytest.raises(InputError, match="too few for 6 parameters"):
        identify(r2000ic, replace(real, use=use))


def test_parameters_that_cannot_be_told_are_named(r2000ic: Experiment, real: Readings) -> None:
    """With J5 = 0, axes 4 and 6 are one line: a spring about joint_5's x is joint 4's spring again."""
    with pytest.raises(NotIdentifiable, match=r"joint_compliance\[joint_4\], offaxis_compliance\[joint_5/x\]"):
        identify(with_offaxis(r2000ic, "joint_5", "x"), real)


def test_unknown_parameter(r2000ic: Experiment, real: Readings) -> None:
    with pytest.raises(InputError, match=r"Did you mean 'joint_compliance\[joint_3\]'"):
        identify(r2000ic, real, fit=["joint_complience[joint_3]"])


def test_an_effect_stands_for_all_its_parameters(r2000ic: Experiment, real: Readings) -> None:
    assert identify(r2000ic, real, fit=["joint_compliance"]).names == identify(r2000ic, real).names
