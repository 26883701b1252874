"""The two-step method's mathematics, against computations of their own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from paper_steps import balancer_length, link_deflection, loss_range, planar_rows, step_one_covariance, stiffness_rows

from qsf_plugins.spring_triangle import SpringTriangle, spring
from qsframework.fits.two_step import (
    distinct_angles,
    step_two,
    step_two_information,
    stiffness_covariance,
)
from qsframework.plugin import Array

K2, KC, S0 = 7e6, 6e6, 0.46
UNKNOWNS = np.array([K2, KC, S0 * KC])
DEG = np.pi / 180.0


@pytest.mark.parametrize(("lc", "l2"), [(0.4722, 0.8609), (0.235, 1.12), (1.3, 0.7)])
def test_rows_are_the_slope_of_the_balancers_moment(lc: float, l2: float) -> None:
    """By differences of the energy Kc (s - s0)^2 / 2 twice, and by the effects' own triangle."""
    b, h = np.linspace(-2.9, 2.9, 41), 1e-4
    energy = lambda a: 0.5 * KC * (np.sqrt(lc**2 + l2**2 - 2 * lc * l2 * np.cos(a)) - S0) ** 2  # noqa: E731
    numeric = K2 + (energy(b + h) - 2.0 * energy(b) + energy(b - h)) / h**2
    assert np.allclose(stiffness_rows(b, lc, l2) @ UNKNOWNS, numeric, rtol=0, atol=2e-6 * np.abs(numeric).max())
    triangle = SpringTriangle(lc, l2)
    slope = -triangle.torque(b, spring(KC, S0)).dq[:, 0, 0]
    assert np.allclose(stiffness_rows(b, lc, l2) @ UNKNOWNS, K2 + slope, rtol=1e-12)
    assert np.allclose(balancer_length(b, lc, l2), triangle.length(b), rtol=1e-14)


def test_angles_that_repeat_are_one() -> None:
    angles, group = distinct_angles([0.3, 1.0, 0.3 + 1e-9, -0.2, 1.0])
    assert np.allclose(angles, [-0.2, 0.3, 1.0], atol=1e-8)
    assert group.tolist() == [1, 2, 1, 0, 2]
    assert len(distinct_angles([0.3, 0.3 + 1e-3])[0]) == 2


@pytest.mark.parametrize("elevation", [-1.2, 0.0, 0.5, 2.0])
def test_a_link_turned_by_its_spring_ends_where_the_row_says(elevation: float) -> None:
    length, k, force = 1.12, 2e-10, -3000.0
    end = lambda angle: length * np.array([np.cos(angle), np.sin(angle)])  # noqa: E731
    h = 1e-6
    torque = force * (end(elevation + h)[1] - end(elevation - h)[1]) / (2 * h)
    moved = end(elevation + k * torque) - end(elevation)
    assert np.allclose(link_deflection(np.array(elevation), length) * k * force, moved, rtol=1e-5, atol=1e-12)


def test_step_one_finds_the_compliances_and_scatters_as_promised() -> None:
    """Least squares of simulated displacements, 4,000 times: unbiased, and the covariance of (20)."""
    q2, q3 = (
        a.ravel() for a in np.meshgrid(DEG * np.array([0.0, 35, 120]), DEG * np.array([-30.0, 30]), indexing="ij")
    )
    rows, first, second = planar_rows(q2, q3, 1.12, 1.285)
    assert np.allclose(first, DEG * np.array([0, 35, 120]))
    assert np.allclose(second, DEG * np.array([-30, 30]))
    true, force, sigma = np.array([1.4, 1.3, 1.5, 2.0, 2.1]) * 1e-7, 4000.0, 3e-5
    flat = rows.reshape(-1, 5) * force
    noise = np.random.default_rng(3).normal(0.0, sigma, (len(flat), 4000))
    found = np.linalg.lstsq(flat, (flat @ true)[:, None] + noise, rcond=None)[0]
    promised = step_one_covariance(rows, sigma / force)
    sd = np.sqrt(np.diag(promised))
    assert np.all(np.abs(found.mean(axis=1) - true) < 5.0 * sd / np.sqrt(4000))
    assert np.abs(np.cov(found) - promised).max() < 0.08 * np.outer(sd, sd).max()


def test_an_upright_link_is_not_seen() -> None:
    rows, _, _ = planar_rows(DEG * np.array([0.0, 90.0, 0.0, 90.0]), DEG * np.array([-30.0, -30, 30, 30]), 1.12, 1.285)
    sd = np.sqrt(np.diag(step_one_covariance(rows)))
    assert sd[1] > 1e12 * sd[0]


def test_the_stiffnesss_covariance_is_that_of_its_reciprocal() -> None:
    k, h = np.array([1.4e-7, 1.1e-7, 1.8e-7]), 1e-12
    slope = np.diag((1.0 / (k + h) - 1.0 / (k - h)) / (2.0 * h))
    compliance = 1e-18 * np.array([[1.0, 0.3, -0.1], [0.3, 2.0, 0.2], [-0.1, 0.2, 0.5]])
    assert np.allclose(stiffness_covariance(compliance, 1.0 / k), slope @ compliance @ slope.T, rtol=1e-6)
    assert np.allclose(stiffness_covariance(compliance, 5e6), 5e6**4 * compliance)


@pytest.fixture(scope="module")
def four() -> tuple[Array, Array]:
    """Rows at four angles and an unequal, correlated covariance of the stiffnesses."""
    rows = stiffness_rows(DEG * np.array([0.0, 35.0, 70.0, 120.0]), 0.4722, 0.8609)
    root = np.diag([1e4, 2e4, 9e4, 3e4]) @ (np.eye(4) + 0.3)
    return rows, root @ root.T


@pytest.mark.parametrize("weighted", [True, False])
def test_step_two_finds_the_truth_and_scatters_as_promised(four: tuple[Array, Array], weighted: bool) -> None:
    rows, covariance = four
    values, promised = step_two(rows, rows @ UNKNOWNS, covariance, weighted)
    assert np.allclose(values, UNKNOWNS, rtol=1e-9)
    draws = np.random.default_rng(5).multivariate_normal(rows @ UNKNOWNS, covariance, 4000)
    found = np.array([step_two(rows, draw, covariance, weighted)[0] for draw in draws])
    sd = np.sqrt(np.diag(promised))
    assert np.abs(np.cov(found.T) / np.outer(sd, sd) - promised / np.outer(sd, sd)).max() < 0.08


def test_weights_help_with_more_angles_than_unknowns_only(four: tuple[Array, Array]) -> None:
    rows, covariance = four
    best, plain = (step_two(rows, rows @ UNKNOWNS, covariance, weighted)[1] for weighted in (True, False))
    assert np.linalg.eigvalsh(plain - best).min() > -1e-9 * np.abs(plain).max()
    assert np.trace(plain) > 1.2 * np.trace(best)
    three = rows[:3], rows[:3] @ UNKNOWNS, covariance[:3, :3]
    same, alike = (step_two(*three, weighted)[1] for weighted in (True, False))
    assert np.allclose(same, alike, rtol=1e-7)
    assert np.allclose(step_two_information(rows[:3], covariance[:3, :3]) @ same, np.eye(3), atol=1e-6)


def test_without_a_covariance_all_stiffnesses_weigh_alike(four: tuple[Array, Array]) -> None:
    rows, _ = four
    assert np.allclose(step_two_information(rows), step_two_information(rows, np.eye(4)), rtol=1e-12)


@pytest.mark.parametrize(
    ("value", "range_"),
    [
        (lambda a: 1.0 + np.abs(a - 40.0) / 100.0, (20.0, 60.0)),
        (lambda a: 1.0 + a / 100.0, (0.0, 20.0)),
        (lambda a: 2.0 - a / 100.0, (100.0 - 20.0, 100.0)),
        (lambda a: np.where(np.abs(a - 40.0) <= 3.0, 1.0, np.inf), (37.0, 43.0)),
        (lambda a: 1.0 + np.minimum(np.abs(a - 20.0), np.abs(a - 80.0)) / 20.0, (16.0, 24.0)),
    ],
)
def test_the_range_of_a_loss(value: object, range_: Sequence[float]) -> None:
    """Around the best angle alone: a second valley does not count."""
    angle = np.arange(0.0, 101.0, 1.0)
    assert np.allclose(loss_range(angle, value(angle), 0.2), range_, atol=1e-9)  # type: ignore[operator]
