"""Rotations against SciPy's, and their derivatives by complex steps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from qsframework.elastostatics.so3 import from_quaternion, left_jacobian, rotation_vector
from qsframework.plugin import cross_matrix, exponential, turns
from qsframework.plugin.rotations import homogeneous

AXIS = np.array([2.0, -1.0, 2.0]) / 3.0


@pytest.mark.parametrize("size", [0.0, 1e-9, 9e-5, 1.1e-4, 0.3, 2.9, 7.0])
def test_rotation_vectors_are_those_of_scipy(size: float) -> None:
    v = size * np.array([AXIS, -AXIS[::-1]])
    R = exponential(v)
    np.testing.assert_allclose(R, Rotation.from_rotvec(v).as_matrix(), rtol=0, atol=2e-15)
    np.testing.assert_allclose(R[0], turns(AXIS, size), rtol=0, atol=2e-15)
    np.testing.assert_allclose(rotation_vector(R[0]), Rotation.from_matrix(R[0]).as_rotvec(), rtol=0, atol=1e-14)


def test_turns_take_angles_of_any_shape() -> None:
    angles = np.linspace(-7.0, 7.0, 6).reshape(2, 3)
    assert turns(AXIS, angles).shape == (2, 3, 3, 3)
    np.testing.assert_allclose(turns(AXIS, angles)[1, 2] @ AXIS, AXIS, atol=1e-15)


def test_derivatives_by_complex_steps() -> None:
    v, w = np.array([0.4, -0.2, 0.7]), np.array([1.0, 2.0, -3.0])
    np.testing.assert_allclose(cross_matrix(v) @ w, np.cross(v, w))
    for i, step in enumerate(np.eye(3)):
        slope = exponential(v + 1e-30j * step).imag / 1e-30
        np.testing.assert_allclose(slope, cross_matrix(left_jacobian(v)[:, i]) @ exponential(v), rtol=0, atol=1e-15)


def test_placements_and_quaternions() -> None:
    at = np.arange(6.0).reshape(2, 3)
    found = homogeneous(turns(AXIS, 0.7), at)
    np.testing.assert_allclose(found @ np.array([0.0, 0.0, 0.0, 1.0]), np.column_stack([at, np.ones(2)]))
    wxyz = np.array([0.2, -0.4, 0.1, 0.7])
    np.testing.assert_allclose(from_quaternion(wxyz), Rotation.from_quat(np.roll(wxyz, -1)).as_matrix(), atol=1e-15)
