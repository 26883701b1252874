"""Corners of the fits: what is refused and said, and cases with next to nothing to work on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qsframework.errors import InputError, NotConverged, NotIdentifiable
from qsframework.experiment import Experiment, Readings
from qsframework.experiment.setup import LoadUncertainty, Noise
from qsframework.identify import identify
from qsframework.identify.hygiene import check_readings
from qsframework.identify.mistakes import late_angles
from qsframework.identify.noise import grouped
from qsframework.identify.observations import Independent, Observations
from qsframework.identify.profile import profile_interval
from qsframework.identify.robust import Loss
from qsframework.identify.solve import solve
from qsframework.identify.trial import trial
from qsframework.identify.two_step import find_balanced
from qsframework.identify.uncertainty import load_sds, load_shift
from qsframework.plugin import Array, Parameter, build_effects
from qsframework.plugin.facts import frozen


def one(y: Array, typical: float = 1.0, lower: float = -np.inf) -> Observations:
    """y = a + noise of 0.1: one parameter."""
    p = (Parameter("a", "", nominal=1.0, typical=typical, lower=lower),)
    return Observations(y, lambda x: np.full(len(y), x[0]), lambda x: np.ones((len(y), 1)), p,
                        Independent(np.full(len(y), 0.1)), np.arange(len(y)), np.arange(len(y)))  # fmt: skip


def test_the_interval_of_a_single_parameter() -> None:
    y = np.random.default_rng(0).normal(2.0, 0.1, 8)
    observations = one(y)
    solution = solve(observations)
    interval = profile_interval(observations, solution, "a", 0.95)
    assert interval.upper - solution.x[0] == pytest.approx(1.959964 * 0.1 / np.sqrt(8), rel=1e-6)


def test_a_parameter_without_end_is_not_converged() -> None:
    """A law that saturates: beyond, no value is worse than another."""
    y = np.full(6, 1.0)
    p = (Parameter("a", "", nominal=1.0, typical=1.0),)
    flat = Observations(y, lambda x: np.full(6, np.tanh(x[0])), lambda x: np.full((6, 1), 1.0 / np.cosh(x[0]) ** 2),
                        p, Independent(np.ones(6)), np.arange(6), np.arange(6))  # fmt: skip
    start = solve(replace(flat, measured=np.full(6, 0.7)))
    with pytest.raises(NotConverged, match=r"a: no end of its interval within .* the readings do not tell it"):
        profile_interval(replace(flat, measured=np.full(6, 0.7)), start, "a", 0.95)


@pytest.mark.parametrize("name", ["huber", "soft_l1", "linear"])
def test_losses_are_the_integrals_of_their_weights(name: str) -> None:
    """rho' = 2 w r, and the slope is that of w r: by differences, below and beyond the corner."""
    loss = Loss(name, 0.7)
    r = np.array([-5.0, -0.8, -0.1, 0.2, 0.9, 3.0])
    h = 1e-6
    np.testing.assert_allclose((loss.rho(r + h) - loss.rho(r - h)) / (2 * h), 2 * loss.weights(r) * r, rtol=1e-6)
    psi = [loss.weights(s) * s for s in (r + h, r - h)]
    np.testing.assert_allclose((psi[0] - psi[1]) / (2 * h), loss.slope(r), atol=1e-6)


@pytest.mark.parametrize("sigma", [[0.1, 0.0], [0.1, np.nan], [0.1, -1.0]])
def test_shared_errors_need_a_noise_of_their_own(sigma: list[float]) -> None:
    with pytest.raises(InputError, match="the noise of every reading must be a positive number"):
        grouped(np.array(sigma), [(np.zeros(2, dtype=np.intp), np.full(2, 0.1))])


def test_tied_parameters_have_one_unit() -> None:
    two = replace(one(np.ones(4)), parameters=(Parameter("a", "m"), Parameter("b", "rad")))
    with pytest.raises(InputError, match="a, b cannot be tied: tied parameters have one unit"):
        solve(two, tied=(("a", "b"),))


def test_an_empty_or_unknown_wish(r2000ic: Experiment, real: Readings) -> None:
    with pytest.raises(InputError, match=r"unknown method 'linaer'.*linear"):
        identify(r2000ic, real, method="linaer")
    with pytest.raises(InputError, match="are for method one-step, not for linear"):
        identify(r2000ic, real, fixed=("joint_compliance[joint_1]",))
    with pytest.raises(InputError, match="unknown shared error 'robot'"):
        identify(r2000ic, real, shared="robot")
    with pytest.raises(InputError, match="every measurement has one marker only"):
        identify(r2000ic, real, shared="pose")
    with pytest.raises(InputError, match="these readings are displacements"):
        identify(r2000ic, real, fit=["geometry"])


def test_readings_that_cannot_be_fitted(r2000ic: Experiment, real: Readings) -> None:
    none = replace(real, use=np.zeros_like(real.use))
    with pytest.raises(InputError, match=r"every reading is masked \(use = 0\)"):
        identify(r2000ic, none)
    few = replace(real, use=np.arange(len(real.use)) < 2)
    with pytest.raises(InputError, match="2 readings give 6 numbers: too few for 6 parameters"):
        identify(r2000ic, few)
    some = np.where(np.arange(len(real.sigma)) < 3, 1e-4, np.nan)
    with pytest.raises(InputError, match="have no sigma_mm and the experiment states no noise"):
        identify(r2000ic.with_(noise=Noise(None)), replace(real, sigma=some))


def test_a_trial_of_what_is_not_told(m900ib: Experiment, real: Readings, r2000ic: Experiment) -> None:
    """The same parameter by two springs: a trial says so and hygiene goes on without it."""
    twin = build_effects({"effect": "offaxis_compliance", "joints": ["joint_2"], "axes": "all"}, r2000ic.robot.facts)
    added = tuple(p for e in twin for p in e.parameters(r2000ic.robot.facts))
    wide = r2000ic.with_(effects=twin, parameters=added, fit=("joint_compliance", "offaxis_compliance"))
    with pytest.raises(NotIdentifiable, match="joint_2"):
        trial(wide, real)
    assert isinstance(check_readings(wide, real), tuple)


def test_two_measurements_are_too_few_to_look_for_late_angles(r2000ic: Experiment, real: Readings) -> None:
    two = replace(real, poses=real.poses.take(slice(0, 2)), pose=real.pose[:2], repeat=real.repeat[:2],
                  cycle=real.cycle[:2], measurement=real.measurement[:2], marker=real.marker[:2],
                  displacement=real.displacement[:2], sigma=real.sigma[:2], use=real.use[:2],
                  rows=real.rows[:2])  # fmt: skip
    fit = trial(r2000ic.with_(fit=("joint_compliance[joint_2]",)), two)
    assert late_angles(fit, 0.01) == []


def test_what_the_fit_estimates_is_no_prior_of_the_load(r2000ic: Experiment) -> None:
    stated = r2000ic.with_(load_uncertainty=LoadUncertainty(0.01, 0.02))
    assert load_sds(stated, ()).tolist() == [0.01, 0.02, 0.02, 0.02]
    assert load_sds(stated, ("load_scale",)).tolist() == [0.0, 0.02, 0.02, 0.02]
    assert load_sds(stated, ("load_direction.rx",)).tolist() == [0.01, 0.0, 0.0, 0.0]


def test_the_loads_share_of_another_files_fit(r2000ic: Experiment, real: Readings) -> None:
    stated = r2000ic.with_(load_uncertainty=LoadUncertainty(0.01, 0.02))
    fit = identify(stated, real)
    assert fit.total_covariance is not None
    with pytest.raises(InputError, match="the fit is of other readings"):
        load_shift(fit, stated, replace(real, rows=real.rows + 1000))


def test_the_two_step_method_knows_its_arm(m900ib: Experiment, r2000ic: Experiment) -> None:
    facts, model = m900ib.robot.facts, m900ib.model()
    with pytest.raises(InputError, match="for an arm with a balancer"):
        find_balanced(r2000ic.model())

    def wider(**entry: object) -> Experiment:
        effects = build_effects(entry, facts)
        return m900ib.with_(effects=effects, parameters=tuple(p for e in effects for p in e.parameters(facts)))

    second = wider(effect="compensator_stiffness", joint="joint_3", lc_m=0.3, l2_m=1.0)
    with pytest.raises(InputError, match="knows one balanced joint"):
        find_balanced(second.model())
    hard = wider(effect="joint_hardening", joint="joint_4")
    with pytest.raises(InputError, match="needs springs that are linear in their torque"):
        find_balanced(hard.model())
    assert find_balanced(model).joint == 1


def test_a_hung_arm_whose_readings_say_nothing(m900ib: Experiment) -> None:
    """Readings of zero: the compliances come out as zero, and each is said to be not told from it."""
    from qsframework.experiment import make_plan, simulate
    from qsframework.plugin import Poses

    q = np.random.default_rng(3).uniform(-0.5, 0.5, (20, 6))
    wrench = np.tile([0.0, 900.0, -4000.0, 0.0, 0.0, 0.0], (20, 1))
    poses = Poses(q, m900ib.robot.controller.to_joints(q), wrench)
    data = simulate(m900ib, make_plan(poses, ["w"] * 20)).readings
    still = replace(data, displacement=frozen(np.zeros_like(data.displacement)))
    fit = identify(m900ib, still)
    assert all(abs(e.value) < 1e-9 for e in fit.estimates)
    assert all("hardly tell it from zero" in e.status for e in fit.estimates)
