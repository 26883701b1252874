"""Whether what is stated of errors agrees with errors that are drawn: a p wrong by 1.5, an sd by 1.15 is noticed.

Seeds are fixed, so that a test that passes passes always; sizes are such that another seed would pass too.
"""

from __future__ import annotations

import numpy as np

from qsframework.plugin import Array

LEVELS = np.array([0.05, 0.2, 0.5])
_SDS = 3.5
"""Sds of a frequency that draws may lie off."""


def check_p_values(p: Array, levels: Array = LEVELS) -> None:
    """p-values (n,) of readings of which the hypothesis holds: below each level as often as the level says."""
    assert len(p) * levels.max() >= 60, "too few draws would notice nothing"
    share = (p[:, None] < levels).mean(axis=0)
    allowed = _SDS * np.sqrt(levels * (1.0 - levels) / len(p))
    assert np.all(np.abs(share - levels) < allowed), (share, levels, allowed)


def check_coverage(inside: Array, level: float) -> None:
    """Whether intervals (n,), independent of each other, hold the truth as often as their level says."""
    assert len(inside) * (1.0 - level) >= 60
    assert abs(inside.mean() - level) < _SDS * np.sqrt(level * (1.0 - level) / len(inside)), inside.mean()


def check_sds(errors: Array, sds: Array, allowed: float = 0.05) -> None:
    """Errors (n, p) in any unit, of which the sds (p,) or (n, p) are stated: their ratio is 1 up to `allowed`."""
    assert allowed <= 0.12, "a factor of 1.15 must not pass"
    ratio = np.sqrt(np.mean(np.square(errors / sds), axis=0))
    assert np.all(np.abs(ratio - 1.0) < allowed), ratio


def balanced(size: int, rng: np.random.Generator) -> Array:
    """Draws (size, size) of as many unit errors, whose mean square is the unit matrix exactly: what a linear estimate
    makes of all of them has the covariance of its formula to the last digit, with no chance of its own."""
    return np.sqrt(size) * np.linalg.qr(rng.standard_normal((size, size)))[0]
