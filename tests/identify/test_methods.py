"""One step and two steps on the same readings of a whole arm with a balancer; bounds, priors, losses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qsframework.cli.demo import read_as_relative
from qsframework.errors import InputError, NotConverged
from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Plan, Readings, make_plan, make_rows, observation_model, simulate
from qsframework.fits import EstimateState, Fit, identify
from qsframework.fits.fit import Found
from qsframework.fits.two_step import _StepOne, distinct_angles, find_balanced, two_step  # pyright: ignore[reportPrivateUsage]
from qsframework.plugin import Array, Poses, build_effects
from tests.identify.arm import shared_unloaded, spoilt, with_sigma

ONE, TWO = (FitOptions(method=m, linear=True, keep_all=True) for m in ("one-step", "two-step"))
EXACT = FitOptions(keep_all=True)
K2, KC, S0 = (
    "joint_compliance[joint_2]",
    "compensator_stiffness[joint_2].stiffness",
    ("compensator_stiffness[joint_2].free_length"),
)
TRUTH = {KC: 2.0e7, S0: 0.70}
"""A balancer that stiffens joint 2 by some 40 %: one that readings can tell."""


@pytest.fixture(scope="module")
def arm(m900ib: Experiment) -> Experiment:
    """The M-900iB whose balancer's equivalent stiffness is to be found, with a nominal that is off."""
    known = {KC: {"nominal": 1.5e7, "sd": 5e6}, S0: {"nominal": 0.6, "sd": 0.1}}
    robot = replace(
        m900ib.robot,
        parameters=tuple(replace(p, **known[p.name]) if p.name in known else p for p in m900ib.robot.parameters),
    )
    return m900ib.with_(robot=robot, fit=("joint_compliance", "compensator_stiffness"))


def planned(arm: Experiment, elevations: tuple[float, ...], per_angle: int, seed: int = 0, load: int = 1) -> Plan:
    """Poses at the given angles of joint 2 (deg), a side pull on some."""
    rng = np.random.default_rng(seed)
    controller = arm.robot.controller
    count = per_angle * len(elevations)
    pendant = np.deg2rad(rng.uniform([-170, 0, -60, -150, 30, -150], [170, 0, 20, 150, 100, 150], (count, 6)))
    pendant[:, 1] = np.deg2rad(np.repeat(elevations, per_angle))
    wrench = np.tile(arm.loads[load].wrench, (count, 1))
    return make_plan(Poses(pendant, controller.to_joints(pendant), wrench), ["pull"] * count)


def truth(arm: Experiment) -> Array:
    x = arm.model().nominal
    x[arm.model().index(list(TRUTH))] = list(TRUTH.values())
    return x


def measured(arm: Experiment, plan: Plan, seed: int, sigma: float = 0.03e-3) -> Readings:
    return simulate(arm.with_(noise=replace(arm.noise, sigma=sigma)), plan, truth(arm), seed=seed, linear=True).readings


def values(fit: Fit) -> Array:
    return np.array([e.value for e in fit.estimates])


def test_without_noise_all_methods_find_the_truth(arm: Experiment) -> None:
    plan = planned(arm, (-50.0, 10.0, 80.0), 5)
    quiet = arm.with_(noise=replace(arm.noise, sigma=1e-12))
    for linear in (True, False):
        readings = simulate(quiet, plan, truth(arm), linear=linear).readings
        for options in (ONE, TWO):
            fit = identify(quiet, readings, options=replace(options, linear=linear))
            assert np.allclose(fit.x, truth(arm), rtol=1e-4), (options.method, linear)


def test_with_three_angles_one_step_is_two_steps(arm: Experiment) -> None:
    """Same estimates and covariance, where readings are good enough that a parabola fits the sum of squares."""
    plan = planned(arm, (-50.0, 10.0, 80.0), 6)
    readings = with_sigma(measured(arm, plan, 3, 1e-6), 1e-6)
    one, two = (identify(arm, readings, options=o) for o in (ONE, TWO))
    sd = np.array([e.sd for e in one.estimates])
    assert np.all(np.abs(values(one) - values(two)) < 1e-3 * sd)
    assert np.allclose(one.covariance, two.covariance, rtol=1e-3, atol=0.0)


def test_two_steps_weigh_errors_that_readings_share_as_one_step_does(arm: Experiment) -> None:
    """Two loads of a pose against one unloaded reading; errors within a pose."""
    single = planned(arm, (-50.0, 10.0, 80.0), 3).poses.take(np.repeat(np.arange(9), 2))
    wrench = np.tile([[0.0, 1500.0, -4000.0, 0, 0, 0], [0.0, -1500.0, -3000.0, 0, 0, 0]], (9, 1))
    plan = make_plan(replace(single, wrench=wrench), ["one", "other"] * 9)
    alone = with_sigma(measured(arm, plan, 3, 1e-6), 1e-6)
    together = shared_unloaded(alone, np.arange(18) // 2)
    one, two = (identify(arm, together, options=o) for o in (ONE, TWO))
    sd = np.array([e.sd for e in one.estimates])
    assert np.all(np.abs(values(one) - values(two)) < 1e-3 * sd)
    assert np.allclose(one.covariance, two.covariance, rtol=1e-3, atol=0.0)
    ignored = identify(arm, alone, options=TWO)
    assert not np.allclose(ignored.covariance, two.covariance, rtol=0.05, atol=0.0)
    rows = make_rows(together)
    within = [two_step(arm, rows.sharing(s), arm.fit_names(), TWO).covariance for s in (0.0, 2e-6)]
    assert np.all(np.diag(within[1]) > 1.02 * np.diag(within[0]))


def _x(found: Found) -> Array:
    return found.seen.values(found.solution.x)


def errors(arm: Experiment, plan: Plan, campaigns: int) -> dict[str, Array]:
    """Mean squared errors of K2 and of the balancer's stiffness at three angles, by method."""
    names = arm.fit_names()
    at = np.deg2rad([-50.0, 10.0, 80.0])
    balanced = find_balanced(arm.model())

    def told(x: Array) -> Array:
        c, kc, s0 = x[arm.model().index([K2, KC, S0])]
        return balanced.rows(at) @ [1.0 / c, kc, s0 * kc]

    out: dict[str, list[Array]] = {"one": [], "two": [], "plain": []}
    for seed in range(campaigns):
        rows = make_rows(measured(arm, plan, seed, 2e-6))
        found = {
            "one": identify(arm, rows.readings, options=ONE).x,
            **{name: _x(two_step(arm, rows, names, TWO, weighted=name == "two")) for name in ("two", "plain")},
        }
        for name, x in found.items():
            out[name].append(told(x) - told(truth(arm)))
    return {name: np.mean(np.square(all_), axis=0) for name, all_ in out.items()}


def test_weights_decide_between_the_methods(arm: Experiment) -> None:
    """Six angles, some hardly seen: one step and weighted two steps alike; plain step two loses (9 % in 150 runs)."""
    plan = planned(arm, (-55.0, -3.0, 3.0, 40.0, 60.0, 85.0), 2)
    mse = errors(arm, plan, 12)
    assert np.all(np.abs(mse["two"] / mse["one"] - 1.0) < 0.02)
    assert np.sum(mse["two"]) < 1.02 * np.sum(mse["one"])
    assert np.sum(mse["plain"]) > 1.05 * np.sum(mse["one"])


@pytest.mark.parametrize("which", ["one", "first of two"])
@pytest.mark.parametrize("linear", [True, False])
def test_derivatives_against_finite_differences(arm: Experiment, which: str, linear: bool) -> None:
    readings = measured(arm, planned(arm, (-50.0, 10.0, 80.0), 2), 1)
    seen = observation_model(arm, readings, linear=linear)
    o = seen.observations()
    if which == "first of two":
        angles, group = distinct_angles(readings.poses.q[:, 1], 1e-4)
        o = _StepOne(seen, find_balanced(arm.model()), angles, group[seen.rows.plus]).observations()
    J = o.jacobian(o.start)
    for i, v in enumerate(o.start):
        step = np.zeros(len(o.start))
        step[i] = 1e-4 * v
        slope = (o.predict(o.start + step) - o.predict(o.start - step)) / (2e-4 * v)
        assert np.allclose(J[:, i], slope, rtol=1e-5, atol=1e-6 * np.abs(slope).max()), o.names[i]


def test_a_bound_is_named_where_the_plain_fit_goes_beyond(r2000ic: Experiment, real: Readings) -> None:
    wrong = read_as_relative(r2000ic, "joint_3")
    one = identify(wrong, real, options=replace(ONE, bounds=True))
    (fifth,) = (e for e in one.estimates if np.isnan(e.sd))
    assert fifth.state in (EstimateState.AT_BOUND, EstimateState.NOT_IDENTIFIABLE)
    assert fifth.name == "joint_compliance[joint_5]"
    assert fifth.value == 0.0
    assert np.isnan(fifth.sd)
    assert one.as_json()["estimates"][fifth.name]["sd"] is None
    assert one.dof == 3 * 43 - 5
    assert "joint_5" in one.notes[0]
    beyond = {e.name for e in identify(wrong, real, options=ONE).estimates if e.state is EstimateState.BEYOND_BOUND}
    assert beyond == {fifth.name}


@pytest.mark.parametrize("loss", ["huber", "soft_l1"])
def test_a_gross_reading_hardly_moves_a_robust_fit(r2000ic: Experiment, real: Readings, loss: str) -> None:
    bad = spoilt(real, [7], np.array([0.01, -0.01, 0.01]))

    def moved(options: FitOptions) -> float:
        good, off = (identify(r2000ic, r, options=options) for r in (real, bad))
        return float(np.max(np.abs(values(off) - values(good)) / [e.sd for e in good.estimates]))

    assert moved(replace(ONE, loss=loss)) < 0.2 * moved(ONE)


PIVOT = "gravity_compensator[joint_2].lc"
"""Known before any reading, as arms are delivered."""


@pytest.mark.parametrize("stated", [True, False])
def test_a_spring_that_is_hardly_told_keeps_what_is_stated_of_it(m900ib: Experiment, stated: bool) -> None:
    """With loads that hardly reach joint 1, what its robot's file states is what is left of it; the readings tell the
    other springs, by themselves."""
    plan = planned(m900ib, (-50.0, 10.0, 80.0), 3, load=0)
    wrench = np.array(plan.poses.wrench)
    wrench[:, 1] = 0.1
    plan = make_plan(replace(plan.poses, wrench=wrench), ["pull"] * len(wrench))
    readings = simulate(m900ib, plan, seed=2).readings
    readings = readings if stated else with_sigma(readings, None)
    fit = identify(m900ib, readings, ["joint_compliance", PIVOT], EXACT)
    first, *others, pivot = fit.estimates
    assert first.name == "joint_compliance[joint_1]"
    assert first.state is EstimateState.NOT_IDENTIFIABLE
    assert first.value == pytest.approx(first.initial, rel=1e-3)
    assert first.sd == pytest.approx(0.3 * first.initial, rel=1e-3)
    assert any(
        f"{first.name}: its sd by the readings alone exceeds its own size; it takes its stated sd" in n
        for n in fit.notes
    )
    assert [e.name for e in others if e.state is not EstimateState.FINE or e.share is not None] == []
    assert pivot.share is not None
    assert fit.dof == 3 * len(readings) - len(others), "what is known before counts as a reading"


def test_estimated_noise_with_priors_settles(m900ib: Experiment) -> None:
    """And what is held elsewhere moves the estimates by as much as where the noise is stated."""
    readings = simulate(m900ib, planned(m900ib, (-50.0, 10.0, 80.0), 5), truth="drawn", seed=5).readings
    names = ["joint_compliance", PIVOT]
    fit = identify(m900ib, with_sigma(readings, None), names, EXACT)
    assert fit.sigma_source == "estimated"
    assert 0.8 < fit.sigma / 0.03e-3 < 1.2
    stated = identify(m900ib, readings, names, EXACT)
    assert np.allclose([e.sd for e in fit.estimates], [e.sd for e in stated.estimates], rtol=0.25)
    assert any(e.share is not None for e in fit.estimates)
    assert len(fit.held) == len(stated.held) > 0
    for one, other in zip(fit.held, stated.held, strict=True):
        assert np.abs(one.moved[:6] - other.moved[:6]).max() <= 0.01 * np.abs(other.moved[:6]).max(), one.name


def test_fixed_and_tied_joints(m900ib: Experiment) -> None:
    readings = simulate(m900ib, planned(m900ib, (-50.0, 10.0, 80.0), 5), seed=5).readings
    names = m900ib.fit_names()
    fit = identify(m900ib, readings, options=replace(EXACT, fixed=(names[0],), tied=(tuple(names[3:5]),)))
    assert fit.estimates[0].state is EstimateState.FIXED
    assert fit.estimates[0].value == fit.estimates[0].initial
    assert fit.x[fit.model.index(names[:1])] == fit.model.nominal[fit.model.index(names[:1])]
    assert f"Fixed: {names[0]}." in fit.notes
    x, nominal = (v[fit.model.index(names[3:5])] for v in (fit.x, fit.model.nominal))
    assert x[0] / x[1] == pytest.approx(nominal[0] / nominal[1])
    assert fit.dof == 3 * 45 - 4


def test_words_where_two_steps_cannot_be_taken(arm: Experiment, r2000ic: Experiment, real: Readings) -> None:
    with pytest.raises(InputError, match=r"this model has none\. Use method one-step"):
        identify(r2000ic, real, options=TWO)
    readings = measured(arm, planned(arm, (-50.0, 10.0), 4), 1)
    with pytest.raises(InputError, match=r"the readings have 2 \(-50\.0, 10\.0 deg\)"):
        identify(arm, readings, options=TWO)
    with pytest.raises(InputError, match=r"not in the fit: compensator_stiffness\[joint_2\]\.stiffness"):
        identify(arm, readings, ["joint_compliance"], TWO)


def test_two_steps_say_where_the_balancer_is_not_told(arm: Experiment) -> None:
    """Readings of an arm that a balancer makes softer: Kc would be negative."""
    quiet = arm.with_(noise=replace(arm.noise, sigma=1e-6))
    x = truth(arm)
    x[arm.model().index([KC])] = -1e7
    readings = simulate(quiet, planned(arm, (-50.0, 10.0, 80.0), 3), x, linear=True).readings
    with pytest.raises(NotConverged, match=r"do not identify the balancer\. Use one-step within bounds"):
        identify(quiet, readings, options=TWO)


def test_two_steps_end_where_an_angle_has_no_compliance(arm: Experiment) -> None:
    """All readings of one angle of joint 2 with their signs exchanged."""
    readings = measured(arm, planned(arm, (-50.0, 10.0, 80.0), 4), 2)
    at = np.isclose(readings.poses.pendant[:, 1], np.deg2rad(10.0))[readings.plus]
    turned = readings.with_values(np.where(at[:, None], -readings.value, readings.value))
    with pytest.raises(NotConverged, match=r"no positive compliance of joint_compliance\[joint_2\] at .* deg"):
        identify(arm, turned, options=TWO)


def test_two_steps_need_springs_without_a_law_of_their_own(arm: Experiment) -> None:
    effects = tuple(build_effects({"effect": "joint_hardening", "joint": "joint_3"}, arm.robot.facts))
    parameters = tuple(p for e in effects for p in e.parameters(arm.robot.facts))
    hard = arm.with_(effects=(*arm.effects, *effects), parameters=(*arm.parameters, *parameters))
    with pytest.raises(InputError, match="needs springs that are linear in their torque"):
        find_balanced(hard.model())
