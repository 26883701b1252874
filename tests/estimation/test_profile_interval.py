"""Profile intervals: the textbook's interval in a linear model, a brute-force grid in a bent one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, t

from qsframework.errors import InputError, NotConverged
from qsframework.estimation import PLAIN, FitOptions, Independent, Observations, profile_interval, settle, solve
from qsframework.plugin import Array, Parameter

BOUNDS = FitOptions(bounds=True)


def linear(rng: np.random.Generator) -> Observations:
    A = rng.normal(size=(20, 3))
    y = A @ [1.0, 2.0, -1.0] + 0.1 * rng.normal(size=20)
    parameters = tuple(Parameter(n, "", nominal=1.0, typical=1.0) for n in "abc")
    return Observations(
        measured=y,
        predict=lambda x: A @ x,
        jacobian=lambda x: A,
        parameters=parameters,
        noise=Independent(np.full(20, 0.1)),
        block=np.arange(20),
        row=np.arange(20),
    )


@pytest.mark.parametrize("level", [0.68, 0.95])
def test_a_linear_model_has_the_interval_of_the_textbook(level: float) -> None:
    observations = linear(np.random.default_rng(0))
    solution = solve(observations)
    sd = np.sqrt(np.diag(solution.covariance))
    for i, name in enumerate("abc"):
        stated = profile_interval(observations, solution, name, PLAIN, level)
        k = np.sqrt(chi2.ppf(level, 1))
        assert np.allclose([stated.lower, stated.upper], solution.x[i] + np.array([-k, k]) * sd[i], rtol=1e-6)
        estimated = profile_interval(replace(observations, stated=False), solution, name, PLAIN, level)
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

    parameters = (
        Parameter("a", "", nominal=1.0, typical=1.0, lower=0.0, upper=50.0),
        Parameter("b", "", nominal=1.0, typical=1.0, lower=lower, upper=50.0),
    )
    y = predict(np.array([1.0, 1.2])) + 0.09 * rng.normal(size=12)
    return Observations(
        measured=y,
        predict=predict,
        jacobian=jacobian,
        parameters=parameters,
        noise=Independent(np.full(12, 0.09)),
        block=np.arange(12),
        row=np.arange(12),
    )


def test_a_bent_model_has_the_interval_of_a_grid() -> None:
    observations = bent()
    solution = solve(observations)
    found = profile_interval(observations, solution, "b", PLAIN)
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


def test_an_interval_ends_at_a_bound_where_bounds_are_kept() -> None:
    observations = bent(lower=1.0)
    solution = solve(observations, BOUNDS)
    assert solution.x[1] > 1.0
    assert profile_interval(observations, solution, "b", BOUNDS, 0.9999).lower == 1.0
    assert profile_interval(observations, solve(observations), "b", PLAIN, 0.99).lower < 1.0
    with pytest.raises(InputError, match="no parameter 'c' in this fit"):
        profile_interval(observations, solution, "c", BOUNDS)
    held = FitOptions(fixed=("b",))
    with pytest.raises(InputError, match="is fixed"):
        profile_interval(observations, solve(observations, held), "b", held)


def one(y: Array) -> Observations:
    """y = a + noise of 0.1: one parameter."""
    p = (Parameter("a", "", nominal=1.0, typical=1.0),)
    return Observations(
        measured=y,
        predict=lambda x: np.full(len(y), x[0]),
        jacobian=lambda x: np.ones((len(y), 1)),
        parameters=p,
        noise=Independent(np.full(len(y), 0.1)),
        block=np.arange(len(y)),
        row=np.arange(len(y)),
    )


def test_the_interval_of_a_single_parameter() -> None:
    y = np.random.default_rng(0).normal(2.0, 0.1, 8)
    observations = one(y)
    solution = solve(observations)
    interval = profile_interval(observations, solution, "a", PLAIN, 0.95)
    assert interval.upper - solution.x[0] == pytest.approx(1.959964 * 0.1 / np.sqrt(8), rel=1e-6)


def test_a_parameter_without_end_is_not_converged() -> None:
    """A law that saturates: beyond, no value is worse than another."""
    p = (Parameter("a", "", nominal=1.0, typical=1.0),)
    flat = Observations(
        measured=np.full(6, 0.7),
        predict=lambda x: np.full(6, np.tanh(x[0])),
        jacobian=lambda x: np.full((6, 1), 1.0 / np.cosh(x[0]) ** 2),
        parameters=p,
        noise=Independent(np.ones(6)),
        block=np.arange(6),
        row=np.arange(6),
    )
    with pytest.raises(NotConverged, match=r"a: no end of its interval within .* the readings do not identify it"):
        profile_interval(flat, solve(flat), "a", PLAIN, 0.95)


def test_priors_and_losses_count_as_in_the_fit() -> None:
    """With priors the linear model's interval is value +- k sd of the fit with them; Huber's lies apart from both."""
    plain = linear(np.random.default_rng(0))
    known = replace(plain, prior_sd=np.full(3, 0.02))
    solution = solve(known)
    found = profile_interval(known, solution, "a", PLAIN)
    sd = float(np.sqrt(solution.covariance[0, 0]))
    k = np.sqrt(chi2.ppf(0.95, 1))
    assert np.allclose([found.lower, found.upper], solution.x[0] + np.array([-k, k]) * sd, rtol=1e-6)
    assert found.upper - found.lower < 1.9 * k * float(np.sqrt(solve(plain).covariance[0, 0]))
    unstated = replace(known, prior=np.array([1.0, 1.9, -1.1]), prior_sd=np.full(3, 0.02), stated=False)
    solution = settle(unstated)
    assert solution.unit == pytest.approx(1.0, abs=0.3)
    found = profile_interval(unstated, solution, "a", PLAIN)
    sd = solution.unit * float(np.sqrt(solution.covariance[0, 0]))
    k = t.ppf(0.975, 20)  # as many readings as parameters that are known before
    assert (found.upper - found.lower) / (2.0 * sd) == pytest.approx(k, rel=0.01)
    robust = FitOptions(loss="huber")
    gross = replace(plain, measured=plain.measured + 2.0 * (np.arange(20) == 3))
    found = profile_interval(gross, solve(gross, robust), "a", robust)
    assert found.lower < solve(gross, robust).x[0] < found.upper
    with pytest.raises(InputError, match="a is tied"):
        profile_interval(plain, solve(plain), "a", FitOptions(tied=(("a", "b"),)))
