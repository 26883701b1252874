"""The order in which things are written down changes nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numerics import campaign, candidates, few, poses, readings

from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Readings
from qsframework.experiment.readings import joined
from qsframework.fits import Fit, identify
from qsframework.plans import DesignOptions, design
from qsframework.plugin import Indices
from qsframework.plugin.facts import frozen

SEEDS = st.integers(0, 10_000)


def with_effects_in_order(experiment: Experiment, seed: int) -> Experiment:
    """The robot's effects and their parameters in another order, as robot.yaml could list them."""
    robot, rng = experiment.robot, np.random.default_rng(seed)
    order = rng.permutation(len(robot.effects))
    parameters = {p.name: p for p in robot.parameters}
    effects = tuple(robot.effects[i] for i in order)
    named = [p.name for e in effects for p in e.parameters(robot.facts)]
    return experiment.with_(robot=replace(robot, effects=effects, parameters=tuple(parameters[n] for n in named)))


def rows_in_order(one: Readings, seed: int) -> Readings:
    """The rows of a readings file in another order."""
    order = np.random.default_rng(seed).permutation(len(one))
    fields = ("plus", "minus", "marker", "frame", "value", "sigma", "minus_sigma", "use", "line", "file", "to")
    return replace(one, **{f: getattr(one, f)[order] for f in fields})


def poses_in_order(one: Readings, seed: int) -> Readings:
    """The states numbered in another order."""
    order = np.random.default_rng(seed).permutation(len(one.states))
    place: Indices = np.argsort(order)
    own = one.states
    named = {name: tuple(getattr(own, name)[i] for i in order) for name in ("pose", "load_id", "series")}
    states = replace(
        own,
        poses=own.poses.take(order),
        loaded=own.loaded[order],
        repeat=own.repeat[order],
        cycle=own.cycle[order],
        **named,
    )
    return replace(one, states=states, plus=place[one.plus], minus=place[one.minus])


def markers_in_order(experiment: Experiment, one: Readings, seed: int) -> tuple[Experiment, Readings]:
    """The markers of experiment.yaml in another order."""
    order = np.random.default_rng(seed).permutation(len(experiment.markers))
    place: Indices = np.argsort(order)
    other = experiment.with_(markers=tuple(experiment.markers[i] for i in order))
    return other, replace(one, marker=place[one.marker])


def parameters_in_order(experiment: Experiment, seed: int) -> Experiment:
    """`fit:` in another order."""
    names = experiment.fit_names()
    return experiment.with_(fit=tuple(names[i] for i in np.random.default_rng(seed).permutation(len(names))))


def all_in_order(experiment: Experiment, one: Readings, seed: int) -> tuple[Experiment, Readings]:
    other, data = markers_in_order(experiment, rows_in_order(poses_in_order(one, seed), seed + 1), seed)
    return parameters_in_order(with_effects_in_order(other, seed), seed), data


def same_fits(found: Fit, wanted: Fit) -> None:
    a, b = ({e.name: e for e in fit.estimates} for fit in (found, wanted))
    assert sorted(a) == sorted(b)
    for name, e in b.items():
        assert a[name].value == pytest.approx(e.value, rel=1e-9, abs=1e-9 * e.sd)
        assert a[name].sd == pytest.approx(e.sd, rel=1e-9)
        assert a[name].state is e.state
    assert found.chi2 == pytest.approx(wanted.chi2, rel=1e-9)
    order_a, order_b = (np.argsort(fit.lines) for fit in (found, wanted))
    np.testing.assert_array_equal(found.lines[order_a], wanted.lines[order_b])
    for field in ("residuals", "studentised", "left_out", "predicted"):
        x, y = getattr(found, field)[order_a], getattr(wanted, field)[order_b]
        np.testing.assert_allclose(x, y, rtol=1e-9, atol=1e-9 * np.abs(y).max())


@few(8)
@given(seed=SEEDS, linear=st.booleans())
def test_fits_do_not_depend_on_any_order(seed: int, linear: bool) -> None:
    data, options = readings(campaign(), seed=2), FitOptions(linear=linear)
    other, mixed = all_in_order(campaign(), data, seed)
    same_fits(identify(other, mixed, options=options), identify(campaign(), data, options=options))


@few(4)
@given(seed=SEEDS)
def test_shared_errors_do_not_depend_on_any_order(seed: int) -> None:
    data = readings(campaign(), seed=3)
    other, mixed = all_in_order(campaign(), data, seed)
    wanted = identify(campaign(), data, options=FitOptions(shared="pose"))
    found = identify(other, mixed, options=FitOptions(shared="pose"))
    assert found.shared_sd == pytest.approx(wanted.shared_sd, rel=1e-6, abs=1e-12)
    for a in found.estimates:
        b = next(e for e in wanted.estimates if e.name == a.name)
        assert a.value == pytest.approx(b.value, rel=1e-7)


@few(6)
@given(seed=SEEDS)
def test_predictions_do_not_depend_on_the_order_of_effects(seed: int) -> None:
    other = with_effects_in_order(campaign(), seed)
    batch = poses(campaign(), 10)
    np.testing.assert_allclose(other.model().predict(batch), campaign().model().predict(batch), rtol=1e-9)


@pytest.mark.parametrize(("criterion", "seed"), [("D", 1), ("A", 2), ("I", 3)])
def test_plans_do_not_depend_on_the_order_of_parameters_markers_and_effects(criterion: str, seed: int) -> None:
    options = DesignOptions(criterion=criterion, polish=False, starts=3)
    wanted = design(campaign(), 8, candidates=candidates(), options=options)
    order = np.random.default_rng(seed).permutation(3)
    other = campaign().with_(markers=tuple(campaign().markers[i] for i in order))
    other = parameters_in_order(with_effects_in_order(other, seed), seed)
    found = design(other, 8, candidates=candidates(), options=options)
    np.testing.assert_array_equal(found.pendant, wanted.pendant)
    np.testing.assert_array_equal(found.wrench, wanted.wrench)
    assert found.certificate is not None
    assert wanted.certificate is not None
    assert found.certificate.value == pytest.approx(wanted.certificate.value, rel=1e-9)
    assert found.certificate.efficiency == pytest.approx(wanted.certificate.efficiency, rel=1e-6)


def test_the_best_plan_does_not_depend_on_the_order_of_the_candidates() -> None:
    """The relaxed value to what both certificates leave open; the plan where the exchange has starts enough."""
    options = DesignOptions(criterion="D", polish=False, efficiency=0.999999)
    wanted = design(campaign(), 8, candidates=candidates(), options=options)
    mixed = frozen(candidates()[np.random.default_rng(5).permutation(60)])
    found = design(campaign(), 8, candidates=mixed, options=options)
    assert found.certificate is not None
    assert wanted.certificate is not None
    assert found.certificate.relaxed_value == pytest.approx(wanted.certificate.relaxed_value, rel=2e-6)
    np.testing.assert_array_equal(found.pendant, wanted.pendant)
    np.testing.assert_array_equal(found.wrench, wanted.wrench)


def test_repeated_rows_weigh_as_one_of_smaller_noise() -> None:
    """Each row given four times: the same values, half the sds."""
    data = readings(campaign(), seed=9)
    once = identify(campaign(), data)
    found = identify(campaign(), joined([data] * 4), options=FitOptions(keep_all=True))
    assert [e.value for e in found.estimates] == pytest.approx([e.value for e in once.estimates], rel=1e-9)
    assert [e.sd for e in found.estimates] == pytest.approx([e.sd / 2 for e in once.estimates], rel=1e-9)
