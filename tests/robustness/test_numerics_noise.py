"""Readings without noise, with absurd noise, tiny and huge deflections, far frames and late clocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numerics import SIGMA, campaign, candidates, few, noisy, poses, readings, weighed, with_effects, with_forces

from qsframework.diagnoses import diagnose
from qsframework.errors import InputError, NotConverged
from qsframework.estimation import FitOptions
from qsframework.experiment import Readings, make_plan, simulate
from qsframework.experiment.readings import UNSTATED
from qsframework.experiment.simulate import displaced
from qsframework.fits import EstimateState, identify
from qsframework.plans import DesignOptions, design
from qsframework.plugin import Array, Conditions, build_effects
from qsframework.plugin.facts import frozen

WAYS = (
    FitOptions(linear=True),
    FitOptions(),
    FitOptions(loss="huber"),
    FitOptions(loss="soft_l1"),
    FitOptions(free=True),
    FitOptions(shared="pose"),
)


def off(seed: int) -> Array:
    """Parameters with compliances up to a half away from what the robot's files state."""
    model = campaign().model()
    x, rng = model.nominal, np.random.default_rng(seed)
    x[model.index(campaign().fit_names())] *= rng.uniform(0.5, 1.5, 6)
    return x


def silent(x: Array, count: int = 20, linear: bool = False) -> Readings:
    """Readings without noise."""
    plan = make_plan(poses(campaign(), count), ["load"] * count)
    return simulate(noisy(campaign(), 0.0), plan, x=x, linear=linear).readings


@few(12)
@given(seed=st.integers(0, 1000), way=st.sampled_from(WAYS))
def test_readings_without_noise_give_the_parameters_back(seed: int, way: FitOptions) -> None:
    x = off(seed)
    fit = identify(noisy(campaign(), 0.0), silent(x, linear=way.linear), options=way)
    truth = x[fit.model.index(fit.names)]
    assert [e.value for e in fit.estimates] == pytest.approx(truth, rel=1e-9)
    assert fit.sigma_source == "estimated"
    assert 0.0 < fit.sigma < 1e-15
    assert np.isfinite(fit.chi2)
    assert all(0.0 < e.sd < 1e-9 * e.value for e in fit.estimates)
    assert np.isfinite(fit.studentised).all()


@pytest.mark.parametrize("way", WAYS)
def test_readings_that_are_exactly_the_nominal_arm_have_no_residual_at_all(way: FitOptions) -> None:
    """Not even rounding is left: sigma is not zero and chi-square not 0 / 0."""
    fit = identify(noisy(campaign(), None), silent(campaign().model().nominal, linear=way.linear), options=way)
    assert np.abs(fit.residuals).max() < 1e-18
    assert [e.value for e in fit.estimates] == pytest.approx([e.initial for e in fit.estimates], rel=1e-12)
    assert 0.0 < fit.sigma < 1e-15
    assert 0.0 <= fit.chi2 <= fit.dof * 1.001
    assert any("no noise" in note for note in fit.notes)
    assert np.isfinite(fit.studentised).all()


@pytest.mark.parametrize("sigma", [None, SIGMA])
def test_exact_readings_accuse_nobody(sigma: float | None) -> None:
    """The diagnosis of readings without noise names no cause, whether a noise is stated or not."""
    found = diagnose(noisy(campaign(), sigma), weighed(silent(off(3)), sigma), repeats=1)
    assert found.verdict == "none"
    assert not found.findings


def test_a_noise_of_zero_in_the_readings_is_refused_with_advice() -> None:
    data = weighed(readings(campaign()), 0.0)
    with pytest.raises(InputError, match=r"positive number; leave it out"):
        identify(campaign(), data)


@few(5)
@given(power=st.floats(-12.0, 3.0))
def test_sds_are_in_proportion_to_the_stated_noise(power: float) -> None:
    """From 1e-12 m to 1e3 m: the values stay, sds and chi-square follow."""
    sigma = 10.0**power
    data = readings(campaign(), seed=2)
    wanted = identify(campaign(), data)
    found = identify(campaign(), weighed(data, sigma))
    assert [e.value for e in found.estimates] == pytest.approx([e.value for e in wanted.estimates], rel=1e-9)
    assert [e.sd for e in found.estimates] == pytest.approx([e.sd * sigma / SIGMA for e in wanted.estimates], rel=1e-9)
    assert found.chi2 == pytest.approx(wanted.chi2 * (SIGMA / sigma) ** 2, rel=1e-9)
    if sigma > 10.0:
        assert all(e.state is EstimateState.NOT_IDENTIFIABLE for e in found.estimates)


@pytest.mark.parametrize("sigma", [1e-12, 1e3])
@pytest.mark.parametrize("criterion", ["D", "A", "I", "O3"])
def test_plans_do_not_depend_on_the_stated_noise(sigma: float, criterion: str) -> None:
    options = DesignOptions(criterion=criterion, polish=False, starts=3)
    wanted = design(campaign(), 8, candidates=candidates(), options=options)
    found = design(noisy(campaign(), sigma), 8, candidates=candidates(), options=options)
    assert np.array_equal(found.pendant, wanted.pendant)
    assert found.certificate is not None
    assert wanted.certificate is not None
    assert found.certificate.efficiency == pytest.approx(wanted.certificate.efficiency, rel=1e-6)
    assert found.certificate.value == pytest.approx(wanted.certificate.value * (sigma / SIGMA) ** 2, rel=1e-9)


@few(5)
@given(power=st.floats(-9.0, 0.0))
def test_tiny_deflections_give_as_good_a_fit(power: float) -> None:
    """Loads so small that the arm gives by 1e-12 m, with noise to match: the same relative result.

    Of the linear model: only its deflections are in proportion to the load.
    """
    k, linear = 10.0**power, FitOptions(linear=True)
    data = readings(campaign(), seed=3, linear=True)
    wanted = identify(campaign(), data, options=linear)
    small = with_forces(weighed(data, SIGMA * k), k).with_values(data.value * k)
    found = identify(noisy(campaign(), SIGMA * k), small, options=linear)
    assert [e.value for e in found.estimates] == pytest.approx([e.value for e in wanted.estimates], rel=1e-9)
    assert found.chi2 == pytest.approx(wanted.chi2, rel=1e-9)


@pytest.mark.parametrize("factor", [1e-9, 3e3])
def test_deflections_of_another_arm_are_no_quiet_fit(factor: float) -> None:
    """1e-12 m or metres under the load of 4 kN: a fit that says that it is wrong, or an error that says what to do."""
    data = readings(campaign(), seed=4)
    spoilt = data.with_values(data.value * factor)
    if factor > 1.0:
        for options in (FitOptions(), FitOptions(linear=True)):
            with pytest.raises(NotConverged, match="Look at the units of readings and loads"):
                identify(campaign(), spoilt, options=options)
    else:
        fit = identify(campaign(), spoilt)
        assert all(e.state is not EstimateState.FINE for e in fit.estimates)


def test_a_single_marker_is_enough_or_it_is_said_what_is_not() -> None:
    """One reflector off all axes: every gear is told; one on axis 6: its gear is named."""
    one = campaign().with_(markers=campaign().markers[:1])
    x = off(5)
    data = simulate(noisy(one, 0.0), make_plan(poses(one, 20), ["load"] * 20), x=x).readings
    fit = identify(noisy(one, None), data)
    assert [e.value for e in fit.estimates] == pytest.approx(x[fit.model.index(fit.names)], rel=1e-9)
    plan = design(one, 6, candidates=candidates(), options=DesignOptions(criterion="D", polish=False, starts=2))
    assert plan.certificate is not None
    assert plan.certificate.efficiency > 0.5
    on_axis = one.with_(markers=(replace(one.markers[0], xyz=frozen([0.3, 0.0, 0.0])),), load_point=frozen([0.3, 0, 0]))
    blind = simulate(on_axis, make_plan(poses(on_axis, 20), ["load"] * 20), x=x).readings
    (left,) = identify(on_axis, blind).not_estimated
    assert left.name == "joint_compliance[joint_6]"


FRAME = {"effect": "tracker_frame"}
DRIFT = {"effect": "tracker_drift"}


@pytest.mark.parametrize("start", [0.0, 1.7e9, 1.7e12])
def test_late_clocks_tell_a_drift_as_well(start: float) -> None:
    """Seconds or milliseconds since 1970: only the time between two states counts."""
    effects = build_effects(DRIFT, campaign().robot.facts)
    names = ("joint_compliance", "tracker_drift")
    wide = with_effects(noisy(campaign(), 0.0), effects, names)
    batch = poses(campaign(), 20)
    at = start + 1000.0 * np.arange(20)
    timed = replace(batch, unloaded=Conditions(time=at), loaded=Conditions(time=at + 512.0))
    x = wide.model().nominal
    drift = [n for n in wide.model().names if "drift" in n]
    x[wide.model().index(drift)] = [1e-8, -2e-8, 3e-8]
    settled = wide.model().predict(timed, x)
    data = displaced(timed, settled, UNSTATED, [f"p{i}" for i in range(20)], stated=False)
    fit = identify(wide, data)
    found = fit.x[fit.model.index(drift)]
    # v t grows to kilometres, of which displacements are differences
    assert found == pytest.approx([1e-8, -2e-8, 3e-8], rel=1e-9 if start == 0.0 else 1e-6)


def test_readings_far_from_the_origin_lose_nothing() -> None:
    """Displacements, turned frames included, where the robot stands 100 m from the tracker's origin."""
    names = ("joint_compliance", "tracker_frame")
    wide = with_effects(noisy(campaign(), 0.0), build_effects(FRAME, campaign().robot.facts), names)
    x = wide.model().nominal
    x[wide.model().index([n for n in wide.model().names if "tracker" in n])] = [1e-3, -2e-3, 1.5]
    data = simulate(wide, make_plan(poses(campaign(), 20), ["load"] * 20), x=x).readings
    fit = identify(wide, data)
    assert fit.x[fit.model.index(fit.names)] == pytest.approx(x[fit.model.index(fit.names)], rel=1e-8)
