"""Sobol points: those of SciPy to the bit."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
from scipy.stats import qmc

from qsframework.design.sobol import MOST, sobol
from qsframework.errors import InputError


@pytest.mark.parametrize(("dimensions", "seed"), [(1, 0), (6, 0), (6, 7), (MOST, 3)])
def test_the_points_are_scipys(dimensions: int, seed: int) -> None:
    theirs = qmc.Sobol(dimensions, scramble=True, rng=np.random.default_rng(seed))
    for block in islice(sobol(dimensions, 4096, seed), 3):
        np.testing.assert_array_equal(block, theirs.random(4096))


def test_more_joints_than_directions_are_refused() -> None:
    with pytest.raises(InputError, match=f"at most {MOST} joints"):
        next(sobol(MOST + 1, 4096, 0))
