"""Profile intervals: the textbook's interval in a linear model, a brute-force grid in a bent one."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2, t
from typer.testing import CliRunner

from qsframework.cli.main import app
from qsframework.errors import InputError
from qsframework.experiment import Experiment, Readings, example, make_plan, simulate
from qsframework.identify import identify
from qsframework.identify.observations import Independent, Observations
from qsframework.identify.profile import profile_interval
from qsframework.identify.solve import solve
from qsframework.plugin import Array, Parameter
from tests.identify.arm import random_poses


def linear(rng: np.random.Generator) -> Observations:
    A = rng.normal(size=(20, 3))
    y = A @ [1.0, 2.0, -1.0] + 0.1 * rng.normal(size=20)
    parameters = tuple(Parameter(n, "", nominal=1.0, typical=1.0) for n in "abc")
    return Observations(
        y, lambda x: A @ x, lambda x: A, parameters, Independent(np.full(20, 0.1)), np.arange(20), np.arange(20)
    )


@pytest.mark.parametrize("level", [0.68, 0.95])
def test_a_linear_model_has_the_interval_of_the_textbook(level: float) -> None:
    observations = linear(np.random.default_rng(0))
    solution = solve(observations)
    sd = np.sqrt(np.diag(solution.covariance))
    for i, name in enumerate("abc"):
        stated = profile_interval(observations, solution, name, level)
        k = np.sqrt(chi2.ppf(level, 1))
        assert np.allclose([stated.lower, stated.upper], solution.x[i] + np.array([-k, k]) * sd[i], rtol=1e-6)
        estimated = profile_interval(observations, solution, name, level, stated=False)
        s = np.sqrt(2.0 * solution.cost / 17)
        k = t.ppf(0.5 + level / 2, 17) * s
        assert np.allclose([estimated.lower, estimated.upper], solution.x[i] + np.array([-k, k]) * sd[i], rtol=1e-6)
        assert np.allclose(estimated.linear, [estimated.lower, estimated.upper], rtol=1e-6)


def bent(lower: float = 0.0) -> Observations:
    """A saturating law a (1 - exp(-b u)) with noise so large that the interval of b is far from symmetric."""
    u = np.linspace(0.1, 1.5, 12)
    rng = np.random.default_rng(2)

    def predict(x: Array) -> Array:
        return x[0] * (1.0 - np.exp(-x[1] * u))

    def jacobian(x: Array) -> Array:
        return np.stack([1.0 - np.exp(-x[1] * u), x[0] * u * np.exp(-x[1] * u)], axis=1)

    parameters = (Parameter("a", "", nominal=1.0, typical=1.0, lower=0.0, upper=50.0),
                  Parameter("b", "", nominal=1.0, typical=1.0, lower=lower, upper=50.0))  # fmt: skip
    y = predict(np.array([1.0, 1.2])) + 0.09 * rng.normal(size=12)
    return Observations(y, predict, jacobian, parameters, Independent(np.full(12, 0.09)), np.arange(12), np.arange(12))


def test_a_bent_model_has_the_interval_of_a_grid() -> None:
    observations = bent()
    solution = solve(observations)
    found = profile_interval(observations, solution, "b")
    b = np.linspace(0.001, 8.0, 40_001)
    u = np.linspace(0.1, 1.5, 12)
    law = 1.0 - np.exp(-np.outer(b, u))
    a = (law @ observations.measured) / np.square(law).sum(axis=1)  # the best a for each b, in closed form
    square = np.square((observations.measured - a[:, None] * law) / 0.09).sum(axis=1)
    inside = b[square - square.min() <= chi2.ppf(0.95, 1)]
    assert np.allclose([found.lower, found.upper], [inside[0], inside[-1]], atol=3e-4)
    low, high = found.linear
    assert abs(found.lower - low) > 0.05 * (high - low)  # and the linear one is not it
    assert found.upper - solution.x[1] > solution.x[1] - found.lower


def test_an_interval_ends_at_a_bound() -> None:
    observations = bent(lower=1.0)
    solution = solve(observations)
    assert solution.x[1] > 1.0
    assert profile_interval(observations, solution, "b", 0.9999).lower == 1.0
    with pytest.raises(InputError, match="no parameter"):
        profile_interval(observations, solution, "c")
    fixed = solve(observations, fixed=("b",))
    with pytest.raises(InputError, match="is fixed"):
        profile_interval(observations, fixed, "b")


BALANCER = "gravity_compensator[joint_2].stiffness"


@pytest.fixture(scope="module")
def simulated(m900ib: Experiment) -> tuple[Experiment, Readings]:
    """Ten poses under the side pull; the balancer's spring is hardly told."""
    poses = random_poses(m900ib, 1, 10, seed=5)
    return m900ib, simulate(m900ib, make_plan(poses, ["pull"] * 10), seed=2).readings


@pytest.mark.parametrize("exact", [False, True])
def test_outside_the_interval_of_a_fit_the_best_of_the_others_is_worse(
    simulated: tuple[Experiment, Readings], exact: bool
) -> None:
    """Held at the ends of its interval, the fit of all others has the chi-square that the quantile allows."""
    experiment, readings = simulated
    names = ("joint_compliance[joint_2]", "joint_compliance[joint_3]")
    fit = identify(experiment, readings, method="one-step", exact=exact, profile=names)
    assert tuple(i.name for i in fit.intervals) == names
    for interval in fit.intervals:
        estimate = next(e for e in fit.estimates if e.name == interval.name)
        assert interval.lower < estimate.value < interval.upper
        np.testing.assert_allclose(
            interval.linear, estimate.value + np.array([-1, 1]) * 1.959964 * estimate.sd, rtol=1e-6
        )
        for end in (interval.lower, interval.upper):
            held = at(experiment, interval.name, end)
            worse = identify(held, readings, fit.names, method="one-step", fixed=(interval.name,), exact=exact)
            # the equilibrium's share is taken at the best fit, and hardly changes up to the end
            assert worse.chi2 - fit.chi2 == pytest.approx(3.841459, abs=0.05 if exact else 1e-3)


def at(experiment: Experiment, name: str, value: float) -> Experiment:
    """The experiment with another nominal value of one parameter of its robot."""
    robot = experiment.robot
    parameters = tuple(replace(p, nominal=value) if p.name == name else p for p in robot.parameters)
    return experiment.with_(robot=replace(robot, parameters=parameters))


def test_an_interval_that_reaches_a_bound_in_a_fit(simulated: tuple[Experiment, Readings]) -> None:
    """These readings do not tell the balancer's spring: its interval reaches down to its bound, where no spring is."""
    experiment, readings = simulated
    fit = identify(experiment, readings, ("joint_compliance", BALANCER), method="one-step", profile=(BALANCER,))
    (interval,) = fit.intervals
    assert interval.lower == 0.0
    assert interval.upper > experiment.model().nominal[experiment.model().index([BALANCER])[0]]
    assert interval.linear[0] < 0.0


def test_what_profiles_are_for(simulated: tuple[Experiment, Readings]) -> None:
    experiment, readings = simulated
    name = "joint_compliance[joint_2]"
    for more in ({"method": "linear"}, {"method": "one-step", "loss": "huber"}, {"method": "one-step", "priors": True}):
        with pytest.raises(InputError, match="profile is for method one-step without priors, loss and tied"):
            identify(experiment, readings, profile=(name,), **more)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="no parameter 'joint_compliance'"):
        identify(experiment, readings, method="one-step", profile=("joint_compliance",))
    with pytest.raises(InputError, match="is fixed"):
        identify(experiment, readings, method="one-step", fixed=(name,), profile=(name,))


def test_the_command_gives_the_intervals_that_are_asked_for(tmp_path: Path) -> None:
    """In a nearly linear model with estimated noise they are value +- t sd; positions have none."""
    asked = ["--method", "one-step", "--profile", "joint_compliance[joint_4]"]
    written = ["--json", str(tmp_path / "fit.json"), "--report", str(tmp_path / "fit.html")]
    done = CliRunner().invoke(app, ["identify", str(example("r2000ic") / "experiment.yaml"), *asked, *written])
    assert done.exit_code == 0, done.output
    fit = json.loads((tmp_path / "fit.json").read_text())
    (found,) = fit["intervals"].values()
    estimate = fit["estimates"]["joint_compliance[joint_4]"]
    sides = np.array([-1, 1]) * t.ppf(0.975, fit["dof"]) * estimate["sd"]
    np.testing.assert_allclose([found["lower"], found["upper"]], estimate["value"] + sides, rtol=1e-4)
    assert "Profile intervals: within them" in done.output
    assert "Profile intervals: within them" in (tmp_path / "fit.html").read_text()
    refused = CliRunner().invoke(app, ["identify", str(example("ur10") / "experiment.yaml"), *asked])
    assert "--profile is for displacement readings alone" in str(refused.exception)
