"""Coverage of the intervals: a smaller version of docs/results.md, judged by the binomial's own spread."""

from __future__ import annotations

import numpy as np
import pytest
from make_statistics import CASES, Case, campaigns, condition, setting
from paper_steps import planar_rows, step_one_covariance, stiffness_rows
from statistics_methods import L2, L3, LC, NOISE, PLANS, TRUTH, Plan, squares

from qsframework.experiment import example, load_experiment
from qsframework.fits.two_step import step_two_information, stiffness_covariance

COUNT = 400
HOLDS = [c for c in CASES if c.covariance and c.modelled and c.nominal == 1.0]


def mean_coverage(case: Case, count: int) -> tuple[float, float]:
    """Coverage over all parameters, and its sd from campaign to campaign (the parameters of one are correlated)."""
    inside = campaigns(case, count)[0].mean(axis=1)
    return float(inside.mean()), float(inside.std() / np.sqrt(count))


@pytest.mark.parametrize("case", HOLDS, ids=lambda c: c.name)
def test_intervals_cover_what_they_say(case: Case) -> None:
    coverage, spread = mean_coverage(case, COUNT if not case.within else COUNT // 4)
    assert abs(coverage - 0.95) < 0.015 + 3.0 * spread
    assert spread < 0.02  # enough campaigns to mean it


def test_a_wrong_nominal_does_not_matter() -> None:
    case = next(c for c in CASES if c.nominal == 2.0)
    coverage, spread = mean_coverage(case, 40)
    assert abs(coverage - 0.95) < 0.015 + 3.0 * spread


def test_an_ignored_reference_costs_coverage() -> None:
    case = next(c for c in CASES if not c.covariance)
    coverage, spread = mean_coverage(case, COUNT)
    assert coverage + 3.0 * spread < 0.90


def test_an_ignored_error_within_a_pose_costs_coverage() -> None:
    case = next(c for c in CASES if not c.modelled)
    coverage, spread = mean_coverage(case, COUNT)
    assert coverage + 3.0 * spread < 0.92


def test_the_ill_conditioned_plan_is_one() -> None:
    well, ill = (next(c for c in CASES if c.plan == plan) for plan in ("well", "ill"))
    assert condition(ill) > 1e3
    assert condition(ill) > 20.0 * condition(well)
    assert campaigns(ill, 1)[1].max() > 0.5, "a sd above 50 % of its parameter"


def test_remembered_values_are_those_of_the_model() -> None:
    case = next(c for c in CASES if c.nominal == 2.0)
    _, readings, observations, truth, exact = setting(case)
    assert np.array_equal(observations.predict(truth), exact)
    x = 1.3 * truth
    for _ in range(2):
        found = observations.predict(x)
        plain = load_experiment(example("m900ib") / "experiment.yaml").model()
        values = plain.nominal
        values[plain.index(observations.names)] = x
        loaded = readings.poses.take(readings.states.loaded)
        assert np.allclose(found, plain.predict(loaded, values, linear=True).ravel(), rtol=1e-12)


@pytest.mark.parametrize("plan", PLANS, ids=lambda p: p.name)
def test_one_step_and_two(plan: Plan) -> None:
    """The same with three angles; with more, weighted within 2 %, unweighted worse, and linear far off."""
    one, weighted, plain, linear = squares(plan, NOISE[0], 60 if len(plan.q2) == 3 else 600, 1)
    if len(plan.q2) == 3:
        assert np.allclose(weighted, one, rtol=1e-6)
        assert np.allclose(plain, one, rtol=1e-6)
    else:
        assert np.all(np.abs(weighted / one - 1.0) < 0.02)
        assert np.all(plain > (5.0 if plan.unequal() > 20.0 else 1.05) * one)
    assert np.all(linear > 2.0 * one)


def test_the_errors_of_one_step_are_what_its_information_says() -> None:
    """An independent computation: the inverse of step two's weighted information, exact for small noise."""
    plan, noise = PLANS[1], 1e-4
    rows, angles, _ = planar_rows(*plan.poses(), L2, L3)
    R = stiffness_rows(np.pi / 2.0 - angles, LC, L2)
    K = R @ TRUTH
    first = step_one_covariance(rows, noise * L2**2 / K[0])[: len(K), : len(K)]
    sd = np.sqrt(np.diag(np.linalg.inv(step_two_information(R, stiffness_covariance(first, K))))) / TRUTH
    assert np.allclose(np.sqrt(squares(plan, noise, 1500, 2)[0]), sd, rtol=0.08)
