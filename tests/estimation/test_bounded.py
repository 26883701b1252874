"""Linear least squares within bounds: SciPy's solution, by the same active sets."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from qsframework.estimation.bounded import bounded
from qsframework.estimation.noise import connected


@pytest.mark.parametrize("seed", range(40))
def test_the_solution_is_scipys(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = int(rng.integers(1, 12))
    A, b = rng.normal(size=(30, q)) @ np.diag(10.0 ** rng.uniform(-2, 2, q)), rng.normal(size=30)
    lower = rng.normal(size=q) - 0.3
    upper = np.where(rng.random(q) < 0.3, np.inf, lower + rng.random(q))
    theirs = lsq_linear(A, b, (lower, upper), method="bvls", tol=1e-14, max_iter=500)
    x, at = bounded(A, b, lower, upper, 1e-14, 500)
    np.testing.assert_allclose(x, theirs.x, rtol=1e-12, atol=1e-14)
    np.testing.assert_array_equal(at, theirs.active_mask)


@pytest.mark.parametrize("seed", range(20))
def test_blocks_are_connected_components(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 60))
    labels = [rng.integers(-1, count, count) for _ in range(2)]
    i, j = np.nonzero(sum(((one[:, None] == one) & (one >= 0)[:, None]).astype(int) for one in labels))
    graph = coo_array((np.ones(len(i)), (i, j)), shape=(count, count))
    expected = connected_components(graph, directed=False)[1]
    np.testing.assert_array_equal(connected(count, [(one, np.zeros(count)) for one in labels]), expected)


def test_a_long_chain_is_one_block() -> None:
    count = 20_000
    order = np.random.default_rng(0).permutation(count)
    labels = [np.empty(count, dtype=int), np.empty(count, dtype=int)]
    labels[0][order], labels[1][order] = np.arange(count) // 2, (np.arange(count) + 1) // 2
    assert not connected(count, [(one, np.zeros(count)) for one in labels]).any()
