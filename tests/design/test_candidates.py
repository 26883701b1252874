"""Candidates fill the joint ranges by a Sobol sequence, which goes on from block to block."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
from scipy.stats import qmc

from qsframework import load_experiment
from qsframework.errors import InputError
from qsframework.plans import generate_candidates
from qsframework.plans.candidates import sobol_blocks


@pytest.mark.parametrize("axes", [1, 2, 6, 7, 16])
@pytest.mark.parametrize("seed", [0, 11])
def test_the_points_are_those_of_scipy(axes: int, seed: int) -> None:
    whole = qmc.Sobol(axes, scramble=True, rng=np.random.default_rng(seed)).random(4096)
    assert np.array_equal(np.concatenate(list(islice(sobol_blocks(axes, 1024, seed), 4))), whole)


def test_an_arm_of_more_joints_is_refused_with_their_number() -> None:
    with pytest.raises(InputError, match="at most 16 joints, found 17"):
        next(sobol_blocks(17, 8, 0))


def test_more_candidates_of_a_seed_begin_with_the_fewer() -> None:
    experiment = load_experiment("examples/m900ib/experiment.yaml")
    few, many = (generate_candidates(experiment, count, seed=4).pendant for count in (50, 120))
    assert np.array_equal(few, many[:50])
    assert not np.array_equal(few, generate_candidates(experiment, 50, seed=5).pendant)
