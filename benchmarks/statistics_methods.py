"""Linear, two-step and one-step estimates of a balanced joint over plans and noise: mean squared errors, simulated.

The arm bends in its plane: a vertical force at the forearm's end, a compliance of joint 2 that depends on the angle of
link 2 through the balancer, and one of joint 3. Step one and step two are the library's own functions.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "docs" / "paper"))
from paper_steps import planar_rows, step_one_covariance, stiffness_rows

from qsframework.fits.two_step import step_two, stiffness_covariance
from qsframework.plugin import Array

LC, L2, L3 = 0.4722, 0.8609, 1.0
"""m: the balancer's arm, link 2, forearm."""
TRUTH = np.array([6.0e6, 3.0e6, 1.5e6])
"""K2 N m/rad, Kc N/m, s0 Kc N."""
K3 = 2.0e-7
"""rad/(N m): the compliance of joint 3."""
OFF = 1.2
"""How wrong the nominal values are from which the linear method takes its slope."""
FOREARM = np.deg2rad([-30.0, 30.0])


@dataclass(frozen=True)
class Plan:
    """Elevations of link 2, degrees; each is measured with two elevations of the forearm."""

    name: str
    q2: tuple[float, ...]

    def poses(self) -> tuple[Array, Array]:
        """Elevations (N,) rad of link 2 and forearm."""
        q2 = np.deg2rad(np.array(self.q2))
        return np.repeat(q2, len(FOREARM)), np.tile(FOREARM, len(q2))

    def unequal(self) -> float:
        """Largest over smallest standard deviation of step one's compliances of joint 2."""
        sd = np.sqrt(np.diag(step_one_covariance(planar_rows(*self.poses(), L2, L3)[0])))[: len(self.q2)]
        return float(sd.max() / sd.min())


PLANS = (
    Plan("three angles", (0.0, 35.0, 120.0)),
    Plan("six angles", (0.0, 25.0, 50.0, 70.0, 110.0, 125.0)),
    Plan("six angles, one nearly upright", (0.0, 25.0, 50.0, 88.0, 110.0, 125.0)),
)
NOISE = (5e-4, 2e-3)
"""sd of one coordinate over the displacement that joint 2 makes of the stretched link."""


def squares(plan: Plan, noise: float, count: int, seed: int) -> Array:
    """Mean squared relative errors (4, 3) of K2, Kc, s0 Kc: one-step, two-step weighted and unweighted, linear."""
    rng = np.random.default_rng([seed, PLANS.index(plan), round(1e6 * noise)])
    q2, q3 = plan.poses()
    rows, angles, forearm = planar_rows(q2, q3, L2, L3)
    flat = rows.reshape(-1, rows.shape[-1])
    R = stiffness_rows(np.pi / 2.0 - angles, LC, L2)  # the balancer's angle where its base line is upright
    k = np.concatenate([1.0 / (R @ TRUTH), np.full(len(forearm), K3)])
    sigma = noise * L2**2 * float(k[0])
    covariance = step_one_covariance(rows, sigma)[: len(angles), : len(angles)]
    start = np.concatenate([OFF * TRUTH, np.full(len(forearm), K3)])
    total = np.zeros((4, 3))
    for _ in range(count):
        seen = flat @ k + sigma * rng.standard_normal(len(flat))
        stiffness = 1.0 / np.linalg.lstsq(flat, seen, rcond=None)[0][: len(angles)]
        C = stiffness_covariance(covariance, stiffness)
        found = (
            _one_step(flat, R, seen, start),
            step_two(R, stiffness, C)[0],
            step_two(R, stiffness, C, weighted=False)[0],
            _one_step(flat, R, seen, start, steps=1),
        )
        total += np.square(np.stack(found) / TRUTH - 1.0)
    return total / count


def _one_step(flat: Array, R: Array, seen: Array, start: Array, steps: int = 30) -> Array:
    """Least squares of the displacements themselves by Gauss-Newton: (3,); one step is the linear method."""
    x = start.copy()
    for _ in range(steps):
        K = R @ x[:3]
        slope = np.zeros((len(K) + len(x) - 3, len(x)))
        slope[: len(K), :3] = -R / K[:, None] ** 2
        slope[len(K) :, 3:] = np.eye(len(x) - 3)
        A = flat @ slope * start
        step = np.linalg.lstsq(A, seen - flat @ np.concatenate([1.0 / K, x[3:]]), rcond=None)[0]
        x = x + step * start
        if np.abs(step).max() < 1e-12:
            break
    return x[:3]


def table(count: int, seed: int) -> str:
    """The table of all plans and noises."""
    lines = [
        "| plan | sds of step one, largest / smallest | noise, % | one-step: RMS error, % | weighted / one-step "
        "| unweighted / one-step | linear / one-step |",
        "|---|---|---|---|---|---|---|",
    ]
    for plan in PLANS:
        for noise in NOISE:
            found = squares(plan, noise, count, seed)
            rms = ", ".join(f"{100 * v:.2g}" for v in np.sqrt(found[0]))
            ratios = [
                ", ".join(f"{v:.{d}f}" for v in row / found[0]) for row, d in zip(found[1:], (3, 2, 1), strict=True)
            ]
            lines.append(f"| {plan.name} | {plan.unequal():.0f} | {100 * noise:g} | {rms} | {' | '.join(ratios)} |")
    return "\n".join(lines)
