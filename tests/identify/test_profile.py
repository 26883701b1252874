"""Profile intervals: the textbook's interval in a linear model, a brute-force grid in a bent one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, t

from qsframework.errors import InputError
from qsframework.identify.observations import Independent, Observations
from qsframework.identify.profile import profile_interval
from qsframework.identify.solve import solve
from qsframework.plugin import Array, Parameter


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
    with pytest.raises(InputError, match="fixed, tied or at its bound"):
        profile_interval(observations, fixed, "b")
