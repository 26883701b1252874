"""Corners of the fits: what is refused and said, and cases with next to nothing to work on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qsframework.errors import InputError
from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Readings, make_plan, simulate
from qsframework.experiment.setup import LoadUncertainty
from qsframework.fits import EstimateState, identify
from qsframework.fits.load_error import load_sds
from qsframework.fits.two_step import find_balanced
from qsframework.plugin import Poses, build_effects
from tests.identify.arm import with_sigma


def test_tied_parameters_have_all_or_none_a_nominal_value(r2000ic: Experiment, real: Readings) -> None:
    robot = replace(
        r2000ic.robot,
        parameters=tuple(
            replace(p, nominal=0.0) if p.name.endswith("joint_2]") else p for p in r2000ic.robot.parameters
        ),
    )
    pair = ("joint_compliance[joint_2]", "joint_compliance[joint_3]")
    with pytest.raises(InputError, match=r"joint_2\], joint_compliance\[joint_3\] cannot be tied: tied parameters"):
        identify(r2000ic.with_(robot=robot), real, options=FitOptions(tied=(pair,)))


def test_an_empty_or_unknown_wish(r2000ic: Experiment, real: Readings) -> None:
    with pytest.raises(InputError, match=r"unknown method 'one-stop'.*one-step"):
        FitOptions(method="one-stop")
    with pytest.raises(InputError, match="are for method one-step"):
        FitOptions(method="two-step", fixed=("joint_compliance[joint_1]",))
    with pytest.raises(InputError, match="unknown shared error 'robot'"):
        FitOptions(shared="robot")
    with pytest.raises(InputError, match="every measurement has one marker only"):
        identify(r2000ic, real, options=FitOptions(shared="pose"))
    with pytest.raises(InputError, match="these readings are displacements"):
        identify(r2000ic, real, fit=["geometry"])
    every = tuple(r2000ic.fit_names())
    with pytest.raises(InputError, match="every parameter is fixed"):
        identify(r2000ic, real, options=FitOptions(fixed=every))


def test_readings_that_cannot_be_fitted(r2000ic: Experiment, real: Readings) -> None:
    none = replace(real, use=np.zeros_like(real.use))
    with pytest.raises(InputError, match=r"every reading is masked \(use = 0\)"):
        identify(r2000ic, none)
    few = replace(real, use=np.arange(len(real.use)) < 2)
    with pytest.raises(InputError, match="2 readings give 6 numbers: too few for 6 parameters"):
        identify(r2000ic, few)


def test_what_the_fit_estimates_is_no_prior_of_the_load(r2000ic: Experiment) -> None:
    stated = r2000ic.with_(load_uncertainty=LoadUncertainty(0.01, 0.02))
    facts = r2000ic.robot.facts
    loads = tuple(e for n in ("load_scale", "load_direction") for e in build_effects({"effect": n}, facts))
    model = r2000ic.with_(effects=loads, parameters=tuple(p for e in loads for p in e.parameters(facts))).model()
    assert load_sds(stated, model, ()).tolist() == [0.01, 0.02, 0.02, 0.02]
    assert load_sds(stated, model, ("load_scale",)).tolist() == [0.0, 0.02, 0.02, 0.02]
    assert load_sds(stated, model, ("load_direction.rx",)).tolist() == [0.01, 0.0, 0.0, 0.0]


def test_the_two_step_method_knows_its_arm(m900ib: Experiment, r2000ic: Experiment) -> None:
    facts, model = m900ib.robot.facts, m900ib.model()
    with pytest.raises(InputError, match="for an arm with a balancer"):
        find_balanced(r2000ic.model())

    def wider(**entry: object) -> Experiment:
        effects = build_effects(entry, facts)
        return m900ib.with_(effects=effects, parameters=tuple(p for e in effects for p in e.parameters(facts)))

    second = wider(effect="compensator_stiffness", joint="joint_3", lc_m=0.3, l2_m=1.0)
    with pytest.raises(InputError, match=r"one balancer; .*\[joint_2\], .*\[joint_3\]\. Use method one-step"):
        find_balanced(second.model())
    beside = wider(effect="compensator_stiffness", joint="joint_2", lc_m=0.3, l2_m=1.0, label="left")
    with pytest.raises(InputError, match=r"one balancer; .*\[joint_2\], .*\[joint_2/left\]\. Use method one-step"):
        find_balanced(beside.model())
    hard = wider(effect="joint_hardening", joint="joint_4")
    with pytest.raises(InputError, match="needs springs that are linear in their torque"):
        find_balanced(hard.model())
    assert find_balanced(model).joint == 1


def test_a_hung_arm_whose_readings_say_nothing(m900ib: Experiment) -> None:
    """Readings of zero: the compliances come out as zero, and each is said to be not told from it."""
    q = np.random.default_rng(3).uniform(-0.5, 0.5, (20, 6))
    wrench = np.tile([0.0, 900.0, -4000.0, 0.0, 0.0, 0.0], (20, 1))
    poses = Poses(q, m900ib.robot.controller.to_joints(q), wrench)
    data = simulate(m900ib, make_plan(poses, ["w"] * 20)).readings
    still = data.with_values(np.zeros_like(data.value))
    fit = identify(m900ib, still, options=FitOptions(keep_all=True))
    assert all(abs(e.value) < 1e-9 for e in fit.estimates)
    for e in fit.estimates:
        assert (e.state is EstimateState.UPPER_LIMIT) or e.value < 0.0, e
        assert e.limit is not None
        assert e.limit == pytest.approx(abs(e.value) + 1.96 * e.sd)


def test_a_noise_that_nobody_states_is_estimated_whatever_stands_for_it(r2000ic: Experiment, real: Readings) -> None:
    """Sigma only weighs the rows then: another one for all of them changes nothing."""
    options = FitOptions(keep_all=True)
    fit = identify(r2000ic, real, options=options)
    again = identify(r2000ic, replace(with_sigma(real, 5e-5), stated=False), options=options)
    assert fit.sigma == pytest.approx(again.sigma, rel=1e-6)
    assert np.allclose([e.sd for e in fit.estimates], [e.sd for e in again.estimates], rtol=1e-4)
