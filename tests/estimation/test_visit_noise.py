"""The error that a visit shares: its size by REML, its freedom, and what repeats say of it."""

from __future__ import annotations

import numpy as np
import pytest

from qsframework.estimation import Independent, Noise, grouped, shared_error
from qsframework.estimation.visit_noise import RHOS, VisitNoise, reml
from qsframework.plugin import Array

VISITS, MARKERS = 40, 3
COUNT = 3 * VISITS * MARKERS
SIGMA = 2e-5
LABEL = (3 * np.repeat(np.arange(VISITS), MARKERS)[:, None] + np.arange(3)).ravel()


def noises() -> VisitNoise:
    own = np.full(COUNT, SIGMA)
    made = [grouped(own, [(LABEL, np.full(COUNT, rho * SIGMA))]) for rho in RHOS]
    return VisitNoise(np.array(RHOS), tuple(made), 3 * VISITS, float(MARKERS))


def drawn(rng: np.random.Generator, rho: float, many: int = 1) -> Array:
    own = rng.standard_normal((COUNT, many))
    return SIGMA * (own + rho * rng.standard_normal((3 * VISITS, many))[LABEL])


@pytest.mark.parametrize("rho", [0.0, 1.0, 3.2])
def test_the_grid_has_its_best_place_where_reml_has(rho: float) -> None:
    """Within one place of the estimate on the line, which another routine finds."""
    rng = np.random.default_rng(1)
    A = rng.standard_normal((COUNT, 12))
    fits, y = reml(noises(), A, COUNT), drawn(rng, rho, 20)
    places = fits.choose(y)
    for k, one in zip(places.tolist(), y.T, strict=True):
        found = shared_error(one, A, np.full(COUNT, SIGMA), LABEL, stated=False)
        ratio = found.sd / (found.unit * SIGMA)
        near = int(np.argmin(np.abs(np.array(RHOS) - ratio)))
        assert abs(k - near) <= 1
    assert np.median(np.array(RHOS)[places]) == pytest.approx(rho, abs=0.25 + 0.2 * rho)


def test_the_size_of_the_noise_is_free() -> None:
    rng = np.random.default_rng(2)
    fits = reml(noises(), rng.standard_normal((COUNT, 12)), COUNT)
    y = drawn(rng, 1.0)
    assert fits.choose(y).tolist() == fits.choose(50.0 * y).tolist()
    k = int(fits.choose(y)[0])
    assert fits.unit(k, 50.0 * y[:, 0]) == pytest.approx(50.0 * fits.unit(k, y[:, 0]))


def test_the_freedom_is_that_of_readings_or_of_visits() -> None:
    """1/nu = h^2/(visits - f) + (1 - h^2)/free at both ends: own errors alone, and what visits share alone."""
    noise = noises()
    assert noise.freedom(0, 12, COUNT - 12) == pytest.approx(COUNT - 12)
    h = MARKERS * 81.0 / (1.0 + MARKERS * 81.0)
    expected = 1.0 / (h**2 / (3 * VISITS - 12) + (1.0 - h**2) / (COUNT - 12))
    assert noise.freedom(len(RHOS) - 1, 12, COUNT - 12) == pytest.approx(expected)
    assert expected < 1.02 * (3 * VISITS - 12)


def test_what_repeats_agree_on_is_no_noise() -> None:
    """Each pose twice, an error that both visits share: beside the fit it passes for noise, between repeats not."""
    rng = np.random.default_rng(3)
    A = np.tile(rng.standard_normal((COUNT // 2, 12)), (2, 1))
    repeat = np.tile(np.eye(COUNT // 2), (2, 1)) / np.sqrt(2.0)
    missing = 3.0 * SIGMA * rng.standard_normal((3 * VISITS // 2, 1))[LABEL[: COUNT // 2]]
    y = np.tile(missing, (2, 1)) + drawn(rng, 0.0)
    alone, repeated = reml(noises(), A, COUNT), reml(noises(), A, COUNT, repeat)
    assert RHOS[int(alone.choose(y)[0])] > 1.5
    assert RHOS[int(repeated.choose(y)[0])] < 0.6


def test_colour_undoes_whiten_for_columns_too() -> None:
    rng = np.random.default_rng(4)
    values = rng.standard_normal((COUNT, 4))
    every: tuple[Noise, ...] = (Independent(rng.uniform(1.0, 2.0, COUNT)), noises().noises[4])
    for one in every:
        np.testing.assert_allclose(one.colour(one.whiten(values)), values, atol=1e-12)
