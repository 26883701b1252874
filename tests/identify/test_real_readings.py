"""The R-2000iC's 43 readings: the numbers of independent code."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qsframework.cli.demo import read_as_relative, with_offaxis
from qsframework.errors import InputError
from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Readings, make_rows
from qsframework.fits import EstimateState, identify

LINEAR = FitOptions(linear=True, keep_all=True)
"""The independent code that these numbers are from balances the load at the undeflected pose."""


def mm(value: float) -> float:
    return round(value * 1e3, 3)


def test_joint_springs(r2000ic: Experiment, real: Readings) -> None:
    fit = identify(r2000ic, real, options=LINEAR)
    assert mm(fit.rms_readings) == 0.996
    assert mm(fit.rms) == 0.215
    assert mm(fit.rms_left_out) == 0.234
    compliances = [round(e.value * 1e6, 3) for e in fit.estimates]
    assert compliances == [1.162, 0.368, 0.510, 3.692, 2.355, 4.854]
    assert fit.sigma_source == "estimated"
    assert fit.dof == 3 * 43 - 6


def test_the_wrong_convention_shows_itself(r2000ic: Experiment, real: Readings) -> None:
    fit = identify(read_as_relative(r2000ic, "joint_3"), real, options=LINEAR)
    assert mm(fit.rms) == 0.286
    assert mm(fit.rms_left_out) == 0.309
    assert [e.name for e in fit.estimates if e.state is EstimateState.BEYOND_BOUND] == ["joint_compliance[joint_5]"]


def test_one_offaxis_spring_explains_a_part(r2000ic: Experiment, real: Readings) -> None:
    fit = identify(with_offaxis(r2000ic, "joint_3", "x"), real, options=LINEAR)
    assert mm(fit.rms_left_out) <= 0.182
    assert all(e.value > 0 for e in fit.estimates)


def test_left_out_errors_are_those_of_refits(r2000ic: Experiment, real: Readings) -> None:
    fit = identify(r2000ic, real, options=LINEAR)
    for row in (0, 10, 16, 42):
        use = real.use.copy()
        use[row] = False
        without = identify(r2000ic, replace(real, use=use), options=LINEAR)
        predicted, value = without.predict(real)
        assert np.allclose(value[row] - predicted[row], fit.left_out[row], rtol=1e-9, atol=1e-13)


def test_studentised_residuals_are_those_of_refits(r2000ic: Experiment, real: Readings) -> None:
    """Dropping one coordinate: its prediction error over its sd, both from the fit without it."""
    fit = identify(r2000ic, real, options=LINEAR)
    model = r2000ic.model()
    A = make_rows(real).rates(model, model.nominal, (), fit.names, linear=True)[1].reshape(-1, 6)
    y = real.value.ravel()
    for i in (0, 33, 100):
        keep = np.arange(len(y)) != i
        c, *_ = np.linalg.lstsq(A[keep], y[keep], rcond=None)
        s2 = ((y[keep] - A[keep] @ c) ** 2).sum() / (keep.sum() - 6)
        spread = s2 * (1 + A[i] @ np.linalg.solve(A[keep].T @ A[keep], A[i]))
        assert np.isclose(fit.studentised.ravel()[i], (y[i] - A[i] @ c) / np.sqrt(spread), rtol=1e-8)


def test_masked_rows_do_not_count(r2000ic: Experiment, real: Readings) -> None:
    use = np.ones(43, dtype=bool)
    use[[10, 16]] = False
    fit = identify(r2000ic, replace(real, use=use), options=LINEAR)
    assert len(fit.lines) == 41
    assert not set(real.line[[10, 16]]) & set(fit.lines)


def test_nothing_left_to_use(r2000ic: Experiment, real: Readings) -> None:
    with pytest.raises(InputError, match="every reading is masked"):
        identify(r2000ic, replace(real, use=np.zeros(43, dtype=bool)))


def test_too_few_readings(r2000ic: Experiment, real: Readings) -> None:
    use = np.zeros(43, dtype=bool)
    use[:2] = True
    with pytest.raises(InputError, match="too few for 6 parameters"):
        identify(r2000ic, replace(real, use=use))


def test_parameters_that_cannot_be_told_are_left_aside_by_name(r2000ic: Experiment, real: Readings) -> None:
    """With J5 = 0, axes 4 and 6 are one line: a spring about joint_5's x is joint 4's spring again."""
    fit = identify(with_offaxis(r2000ic, "joint_5", "x"), real, options=LINEAR)
    (one,) = fit.not_estimated
    pair = {"joint_compliance[joint_4]", "offaxis_compliance[joint_5/x]"}
    assert {one.name, *one.correlated_with} == pair
    assert len(pair & set(fit.names)) == 1
    assert fit.rank.full


def test_unknown_parameter(r2000ic: Experiment, real: Readings) -> None:
    with pytest.raises(InputError, match=r"Did you mean 'joint_compliance\[joint_3\]'"):
        identify(r2000ic, real, fit=["joint_complience[joint_3]"])


def test_an_effect_stands_for_all_its_parameters(r2000ic: Experiment, real: Readings) -> None:
    assert identify(r2000ic, real, ["joint_compliance"], LINEAR).names == identify(r2000ic, real, options=LINEAR).names


def test_the_full_equilibrium_says_nearly_the_same(r2000ic: Experiment, real: Readings) -> None:
    """The default: these loads bend the arm so little that no compliance moves by a tenth of its sd."""
    linear, exact = (identify(r2000ic, real, options=FitOptions(linear=flag, keep_all=True)) for flag in (True, False))
    for a, b in zip(linear.estimates, exact.estimates, strict=True):
        assert abs(a.value - b.value) < 0.1 * a.sd, a.name
    assert exact.rms == pytest.approx(linear.rms, rel=0.01)
