"""Factors of families, and single values that lie far off, against draws."""

from __future__ import annotations

import numpy as np
import pytest

from qsframework.estimation.families import Loosened, loosened
from qsframework.plugin import Array

COUNT, KNOWN, DRAWS = 240, 60, 40
FAMILY = np.repeat([0, 1], KNOWN // 2)


def drawn(seed: int, size: Array) -> Loosened:
    """What is found of readings with unit noise, of values (p,) so many sds from what was known of them."""
    rng = np.random.default_rng(seed)
    flat, known = rng.standard_normal((COUNT, 3)), 3.0 * rng.standard_normal((COUNT, KNOWN)) / np.sqrt(COUNT) * 3.0
    y = flat @ rng.standard_normal(3) + known @ size + rng.standard_normal(COUNT)
    return loosened(flat, known, y, FAMILY)


@pytest.mark.parametrize("true", [1.0, 3.0])
def test_the_factor_of_a_family_is_found(true: float) -> None:
    """Of the first family, by Student's t of 4 degrees of freedom; that of the other stays near 1."""
    found = []
    for seed in range(DRAWS):
        size = np.random.default_rng([seed, 1]).standard_t(4.0, KNOWN) * np.where(FAMILY == 0, true, 1.0)
        found.append(drawn(seed, size).factor)
    own, other = np.median(found, axis=0)

    assert own == pytest.approx(true, rel=0.25)
    assert other < 1.25


def test_one_value_far_off_is_no_size_of_its_family() -> None:
    """A zero that is 8 sds off among ordinary ones: its own sd grows, and the factor stays below 2."""
    for seed in range(10):
        size = np.random.default_rng([seed, 2]).standard_normal(KNOWN)
        size[3] = 8.0
        found = drawn(seed, size)
        assert found.by[3] > 2.0
        assert found.by[3] == found.by[FAMILY == 0].max()
        assert found.factor[0] < 2.0


def test_nothing_is_loosened_while_the_model_lacks_something() -> None:
    """Of readings that no value explains, 5 times the noise, all factors are 1."""
    rng = np.random.default_rng(0)
    flat, known = rng.standard_normal((COUNT, 3)), rng.standard_normal((COUNT, KNOWN))
    found = loosened(flat, known, 5.0 * rng.standard_normal(COUNT), FAMILY)
    assert (found.by == 1.0).all()
    assert (found.factor == 1.0).all()


def test_a_family_of_one_has_no_factor() -> None:
    """A single value far off has weight as such, whatever its family would say."""
    rng = np.random.default_rng(1)
    flat, known = rng.standard_normal((COUNT, 2)), rng.standard_normal((COUNT, 1))
    found = loosened(flat, known, 9.0 * known[:, 0] + rng.standard_normal(COUNT), np.zeros(1, dtype=np.intp))
    assert found.factor[0] == 1.0
    assert found.by[0] > 2.0


def test_the_interval_of_a_factor_covers() -> None:
    """Factors drawn from their prior, cut at 1: the 95 % interval holds most."""
    rng, held = np.random.default_rng(5), 0
    for seed in range(DRAWS):
        true = float(np.exp(abs(0.5 * rng.standard_normal())))
        size = rng.standard_t(4.0, KNOWN) * np.where(FAMILY == 0, true, 1.0)
        low, high = (end[0] for end in drawn(seed, size).interval)
        held += low <= true <= high
    assert held >= 0.87 * DRAWS
