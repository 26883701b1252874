"""Principal angles between causes, alias classes, and the chance to mistake one cause for another."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import subspace_angles

from qsframework.hypotheses.search.principal_angles import (
    alias_classes,
    angle_matrix,
    mistaken,
    named_from,
    smallest_angles,
)


def fake(Q, one_sided=False):
    """What the angles look at of a subspace."""
    Q = np.asarray(Q, dtype=float).reshape(len(Q), -1)
    return SimpleNamespace(Q=Q, one_sided=one_sided, visible=Q.shape[1] > 0)


def random_subspaces(sizes, m=60, seed=0):
    rng = np.random.default_rng(seed)
    return [fake(np.linalg.qr(rng.standard_normal((m, k)))[0]) for k in sizes]


def at_angle(angle, m=40, sided=False):
    """Two directions at a known angle."""
    e = np.eye(m)
    return [fake(e[:, 0], sided), fake(np.cos(angle) * e[:, 0] + np.sin(angle) * e[:, 1], sided)]


def test_agrees_with_scipy_for_every_pair_of_sizes():
    sizes = [1, 2, 3, 1, 0, 3, 6, 1]
    spaces = random_subspaces(sizes)
    found, widest = angle_matrix(spaces), angle_matrix(spaces, largest=True)
    for i, a in enumerate(sizes):
        for j, b in enumerate(sizes):
            if i == j or not a or not b:
                assert np.isnan(found[i, j])
            else:
                expected = subspace_angles(spaces[i].Q, spaces[j].Q)
                assert found[i, j] == pytest.approx(expected.min(), rel=1e-9)
                assert widest[i, j] == pytest.approx(expected.max(), rel=1e-9)
    assert np.allclose(smallest_angles(spaces, 2), found[2], equal_nan=True)


@pytest.mark.parametrize("angle", [1e-10, 1e-6, 1e-3, 0.3, 1.5])
def test_small_angles_keep_their_digits(angle):
    assert angle_matrix(at_angle(angle))[0, 1] == pytest.approx(angle, rel=1e-5)


def test_causes_that_can_only_grow_may_point_apart():
    assert angle_matrix(at_angle(3.0, sided=True))[0, 1] == pytest.approx(3.0)
    assert angle_matrix(at_angle(3.0))[0, 1] == pytest.approx(np.pi - 3.0)
    assert alias_classes(at_angle(np.pi, sided=True)) == ((0,), (1,))
    assert alias_classes(at_angle(np.pi)) == ((0, 1),)


def test_aliases_need_all_directions_in_common():
    rng = np.random.default_rng(1)
    Q = np.linalg.qr(rng.standard_normal((50, 4)))[0]
    turned = Q[:, :2] @ np.array([[0.6, -0.8], [0.8, 0.6]])
    spaces = [fake(Q[:, :2]), fake(Q[:, 0]), fake(turned), fake(Q[:, [0, 2]]), fake(Q[:, 3]), fake(Q[:, :0])]
    assert alias_classes(spaces) == ((0, 2), (1,), (3,), (4,))
    angles = angle_matrix(spaces)
    assert angles[0, 1] == pytest.approx(0.0, abs=1e-12)
    assert np.isfinite(angles[4, :4]).all()
    assert np.isnan(angles[5]).all(), "a cause that nothing shows has no rival"


def test_a_single_cause_has_no_rival():
    assert np.isnan(angle_matrix(random_subspaces([2]))).all()
    assert angle_matrix([]).shape == (0, 0)


def test_mistakes_of_simulated_readings_are_as_frequent_as_promised():
    """The cause with the larger fall of chi-square is named."""
    angle = np.deg2rad(30.0)
    a, b = at_angle(angle)
    s = named_from(angle)
    assert mistaken(s, angle) == pytest.approx(0.05)
    rng = np.random.default_rng(2)
    y = s * a.Q[:, 0] + rng.standard_normal((20_000, len(a.Q)))
    wrong = np.mean(np.abs(y @ b.Q[:, 0]) > np.abs(y @ a.Q[:, 0]))
    assert wrong == pytest.approx(0.05, abs=0.006)
