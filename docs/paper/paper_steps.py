"""The two steps in the plane, as the source paper's Tables 1 to 4 have them: equations (7), (19), (20) and (22).

Step one: an aggregated compliance k2_i of joint 2 for each distinct elevation q2_i of link 2, beside the forearm's.
Step two: K_2i = 1 / k2_i is linear in K2, Kc and s0 Kc. The angle b of (22) is the one at the shoulder between the
balancer's base line and link 2; where that line is upright, b = pi/2 - q2. A whole arm takes its rows from the
balancer's effect: `qsframework.fits.two_step`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsframework.fits.two_step import distinct_angles
from qsframework.plugin import Array


def balancer_length(b: Array, lc: float, l2: float) -> Array:
    """s(b) in m, equation (7): s^2 = lc^2 + l2^2 - 2 lc l2 cos b; b in rad, lc and l2 in m."""
    return np.sqrt(lc**2 + l2**2 - 2.0 * lc * l2 * np.cos(b))


def stiffness_rows(b: Array | Sequence[float], lc: float, l2: float) -> Array:
    """Rows (..., 3) of (22), corrected: K2 + d M_c / d b is row @ [K2, Kc, s0 Kc].

    [1, L cos b, L (L sin^2 b / s^3 - cos b / s)], L = lc l2; units 1, m^2, m.
    """
    b = np.asarray(b, dtype=float)
    L, s = lc * l2, balancer_length(b, lc, l2)
    return np.stack([np.ones_like(b), L * np.cos(b), L * (L * np.sin(b) ** 2 / s**3 - np.cos(b) / s)], axis=-1)


def planar_rows(q2: Array, q3: Array, l2: float, l3: float) -> tuple[Array, Array, Array]:
    """Step one in the plane, (19): rows (N, 2, n2 + n3) of horizontal and vertical displacement per N of load.

    Poses by the elevations (N,) rad of link 2 and forearm, an aggregated compliance for each distinct one; also
    returned: the n2 and the n3 distinct elevations. A unit vertical force at the forearm's end; l2, l3 in m. The
    parallelogram lets each compliance turn its own link alone, so the sign of the force does not matter here.
    """
    first, i = distinct_angles(q2)
    second, j = distinct_angles(q3)
    rows = np.zeros((len(i), 2, len(first) + len(second)))
    n = np.arange(len(i))
    rows[n, :, i] = link_deflection(first, l2)[i]
    rows[n, :, len(first) + j] = link_deflection(second, l3)[j]
    return rows, first, second


def link_deflection(elevation: Array, length: float) -> Array:
    """Displacement (..., 2) of a link's end per unit of its compliance and of a vertical force, m^2.

    The lever l cos q turns the link by k l cos q, its end goes l (-sin q, cos q) for each rad: |.| = l^2 |cos q|.
    """
    lever = length * np.cos(elevation)
    return (lever * length)[..., None] * np.stack([-np.sin(elevation), np.cos(elevation)], axis=-1)


def step_one_covariance(rows: Array, noise_over_force: float = 1e-6) -> Array:
    """Least squares of (20): covariance (p, p) of the compliances, (rad/(N m))^2, from rows of `planar_rows`.

    noise_over_force: sd of one coordinate of one displacement over the force, m/N. LinAlgError where a compliance is
    not seen, as at an upright link.
    """
    flat = rows.reshape(-1, rows.shape[-1])
    return noise_over_force**2 * _inverse(flat.T @ flat)


def loss_range(angle: Array, value: Array, loss: float) -> tuple[float, float]:
    """Around the best angle, between which angles (ascending) a criterion is at most `loss` above its best.

    Linear between the given angles; an end of the list stands for itself.
    """
    limit, best = value.min() * (1.0 + loss), int(value.argmin())
    over = np.flatnonzero(value > limit)
    low, high = over[over < best], over[over > best]

    def crossing(out: int, inside: int) -> float:
        share = (limit - value[inside]) / (value[out] - value[inside])
        return float(angle[inside] + share * (angle[out] - angle[inside]))

    return (
        crossing(low[-1], low[-1] + 1) if len(low) else float(angle[0]),
        crossing(high[0], high[0] - 1) if len(high) else float(angle[-1]),
    )


def _inverse(M: Array) -> Array:
    """Inverse of a symmetric positive definite matrix, its size taken out first."""
    size = np.sqrt(np.diag(M))
    inverse = np.linalg.inv(M / size / size[:, None]) / size / size[:, None]
    return 0.5 * (inverse + inverse.T)
