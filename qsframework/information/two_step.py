"""The two-step method's arithmetic: stiffnesses from aggregated compliances, a balancer's parameters from these.

Equations (19) to (21) of the source paper. Step one finds an aggregated compliance of the balanced joint for each of
its distinct angles; the stiffness K_i = 1 / k_i at an angle is linear in the joint's own, Kc and s0 Kc, and step two
solves for them. Whoever calls it brings the rows, equation (22), from the balancer's own effect.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsframework.estimation.projection import least_squares
from qsframework.plugin import Array, Indices


def distinct_angles(q2: Array | Sequence[float], tolerance: float = 1e-6) -> tuple[Array, Indices]:
    """The distinct angles (n,) rad, ascending, and for each given one (N,) which of them it is.

    Angles within `tolerance` of their neighbour count as one, their mean.
    """
    q2 = np.asarray(q2, dtype=float)
    order = np.argsort(q2, kind="stable")
    new = np.diff(q2[order], prepend=-np.inf) > tolerance
    group = np.empty(len(q2), dtype=np.intp)
    group[order] = np.cumsum(new) - 1
    return np.bincount(group, q2) / np.bincount(group), group


def stiffness_covariance(compliance: Array, stiffness: Array | float) -> Array:
    """Covariance (n, n) of K_i = 1 / k_i from that of the compliances k_i: d K / d k = -K^2."""
    slope = np.broadcast_to(np.square(stiffness), compliance.shape[-1:])
    return slope[:, None] * compliance * slope


def step_two_information(rows: Array, covariance: Array | None = None) -> Array:
    """Information (3, 3) on K2, Kc, s0 Kc of aggregated stiffnesses: rows (n, 3) of (22), covariance (n, n) of (20).

    Without a covariance every stiffness weighs alike with unit variance.
    """
    white = rows if covariance is None else np.linalg.solve(np.linalg.cholesky(covariance), rows)
    return white.T @ white


def step_two_gain(rows: Array, covariance: Array, weighted: bool = True) -> Array:
    """d K2, Kc, s0 Kc (3, n) / d stiffness: least squares of aggregated stiffnesses, weighted by their covariance."""
    L = np.linalg.cholesky(covariance) if weighted else np.eye(len(rows))
    return least_squares(np.linalg.solve(L, rows), np.linalg.inv(L))


def step_two_covariance(rows: Array, covariance: Array, weighted: bool = True) -> Array:
    """Covariance (3, 3) of step two's result, where the stiffnesses have the covariance (n, n).

    weighted False: that of plain least squares of the same stiffnesses, never smaller.
    """
    gain = step_two_gain(rows, covariance, weighted)
    return gain @ covariance @ gain.T


def step_two(rows: Array, stiffness: Array, covariance: Array, weighted: bool = True) -> tuple[Array, Array]:
    """Solve (21): K2, Kc, s0 Kc (3,) and their covariance from aggregated stiffnesses (n,), N m/rad."""
    gain = step_two_gain(rows, covariance, weighted)
    return gain @ stiffness, gain @ covariance @ gain.T
