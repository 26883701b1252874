"""The small problem of a relaxed design: a primal-dual interior point method on some hundred candidates.

minimise log psi(M0 + sum w_i M_i)   with   sum of w_i over each group = its share,  0 <= w_i <= cap
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from qsframework.information import Allowed, bound_of
from qsframework.information.rows import root
from qsframework.plans.criteria import Expansion, Mean
from qsframework.plugin import Array, Indices

_ITERATIONS = 80


@dataclass(frozen=True, eq=False)
class Small:
    """m candidates: rows (m, S, k, p), the group of each (m,), shares (g,), cap, information M0 (S, p, p)."""

    block: Array
    label: Indices
    shares: Array
    cap: float
    prior: Array

    @cached_property
    def moments(self) -> Array:
        """M_i (m, S, p, p)."""
        return moments_of(self.block)

    def information(self, weights: Array) -> Array:
        """M0 + sum w_i M_i, (S, p, p)."""
        return self.prior + np.tensordot(weights, self.moments, 1)

    def scores(self, slope: Array) -> Array:
        """<G, M_i> (m,)."""
        return self.moments.reshape(len(self.moments), -1) @ slope.ravel()

    def used(self) -> Indices:
        """The groups that carry a share."""
        return np.flatnonzero(self.shares > 0.0)

    def membership(self) -> Array:
        """1 where a candidate is of a used group, (groups, m)."""
        return (self.label[None, :] == self.used()[:, None]).astype(float)

    def multipliers(self, nu: Array) -> Array:
        """One for every group; nothing would enter a group without a share."""
        out = np.full(len(self.shares), np.inf)
        out[self.used()] = nu
        return out

    def allowed(self) -> Allowed:
        """The designs over the m candidates."""
        groups = tuple(np.flatnonzero(self.label == g) for g in range(len(self.shares)))
        return Allowed(groups, tuple(self.shares), self.cap)

    def uniform(self) -> Array:
        counts = np.bincount(self.label, minlength=len(self.shares))
        return self.shares[self.label] / counts[self.label]


@dataclass(frozen=True, eq=False)
class Solved:
    """Weights (m,), the multiplier of each group, and the expansion there.

    A candidate outside with a score above the multiplier of its group would improve the design.
    """

    weights: Array
    multipliers: Array
    expansion: Expansion
    scores: Array


def moments_of(block: Array) -> Array:
    """M_i = A_i' A_i (m, S, p, p) of rows (m, S, k, p)."""
    return np.swapaxes(block, -1, -2) @ block


def curvature(small: Small, expansion: Expansion) -> Array:
    """Second derivatives (m, m) of log psi in the weights."""
    count, scenarios = small.block.shape[:2]
    H = np.zeros((count, count))
    for c, P, Q in expansion.pairs:
        for s in range(scenarios):
            if P[s].any() and Q[s].any():
                Y = _turned(small.block[:, s], P[s], None if Q is P else Q[s])
                H += c * (Y @ Y.T)
    if expansion.ranks:
        flat = small.moments.reshape(count, -1)
        V = flat @ np.stack([v.ravel() for _, v in expansion.ranks]).T
        H += (V * np.array([c for c, _ in expansion.ranks])) @ V.T
    return 0.5 * (H + H.T)


def _turned(block: Array, P: Array, Q: Array | None) -> Array:
    """Y (m, r) with Y_i . Y_j = tr(P M_i Q M_j) of rows (m, k, p); where Q is P, of upper halves."""
    count, k, p = block.shape

    def by(matrix: Array) -> Array:
        return (block.reshape(-1, p) @ root(matrix)).reshape(count, k, -1)  # one product, not many

    left = by(P)
    if Q is not None:
        return (np.swapaxes(left, -1, -2) @ by(Q)).reshape(count, -1)
    rows, columns = np.triu_indices(left.shape[-1])
    whole = moments_of(left).reshape(count, -1)
    return np.take(whole, rows * left.shape[-1] + columns, axis=1) * np.where(rows == columns, 1.0, np.sqrt(2.0))


@dataclass(eq=False)
class _Point:
    """Primal and dual variables of the method; changed in place by its steps."""

    w: Array
    z: Array
    y: Array
    nu: Array
    mu: float


def solve_small(small: Small, criterion: Mean, gap: float, start: Array | None = None) -> Solved:
    """Weights whose relative gap over the m candidates is at most `gap`, or as near as float64 gets.

    start (m,) are weights to begin near; a share of the uniform design is mixed in.
    """
    point = _start(small, start)
    best: Solved | None = None
    best_gap = np.inf
    for _ in range(_ITERATIONS):
        expansion = criterion.expansion(small.information(point.w))
        scores = small.scores(expansion.slope)
        reached = _gap(small, expansion, scores)
        if best is None or reached < best_gap:
            best, best_gap = Solved(point.w.copy(), small.multipliers(point.nu), expansion, scores), reached
        if best_gap <= gap or point.mu < 1e-15:
            break
        if not _step(small, point, scores, curvature(small, expansion)):
            break
    assert best is not None
    return best


def _start(small: Small, start: Array | None) -> _Point:
    uniform = small.uniform()
    w = uniform if start is None else 0.7 * start + 0.3 * uniform
    w = np.minimum(w, 0.5 * (small.cap + np.minimum(uniform, small.cap))) if np.isfinite(small.cap) else w
    mu = 0.3 / len(w)
    z = mu / w
    y = mu / (small.cap - w) if np.isfinite(small.cap) else np.zeros(len(w))
    return _Point(w, z, y, np.ones(len(small.used())), mu)


def _gap(small: Small, expansion: Expansion, scores: Array) -> float:
    """1 - certified efficiency over the m candidates."""
    return 1.0 - bound_of(scores, small.allowed(), float((small.prior * expansion.slope).sum()))


@dataclass(frozen=True, eq=False, kw_only=True)
class _System:
    """The linear system of one step, factored: K = H + z / w + y / room, and the residuals."""

    point: _Point
    room: Array
    capped: bool
    factor: Any
    E: Array
    KE: Array
    stationarity: Array
    feasibility: Array

    def direction(self, target_w: Array, target_y: Array) -> tuple[Array, Array, Array, Array]:
        """Steps of w, nu, z, y towards w z = target_w and room y = target_y."""
        import scipy.linalg

        w, z, y = self.point.w, self.point.z, self.point.y
        rhs = -self.stationarity + target_w / w - z - ((target_y / self.room - y) if self.capped else 0.0)
        base = scipy.linalg.cho_solve(self.factor, rhs, check_finite=False)
        dnu = np.asarray(np.linalg.solve(self.E @ self.KE, self.E @ base + self.feasibility), dtype=np.float64)
        dw = base - self.KE @ dnu
        dz = (target_w - z * dw) / w - z
        dy = (target_y + y * dw) / self.room - y if self.capped else np.zeros(len(w))
        return dw, dnu, dz, dy


def _system(small: Small, point: _Point, scores: Array, H: Array) -> _System:
    import scipy.linalg

    capped = bool(np.isfinite(small.cap))
    room = small.cap - point.w if capped else np.ones(len(point.w))
    H[np.diag_indices_from(H)] += point.z / point.w + (point.y / room if capped else 0.0)
    E = small.membership()
    factor = scipy.linalg.cho_factor(H, lower=True, check_finite=False)
    KE = scipy.linalg.cho_solve(factor, E.T, check_finite=False)
    stationarity = -scores - point.z + point.y + E.T @ point.nu
    return _System(
        point=point,
        room=room,
        capped=capped,
        factor=factor,
        E=E,
        KE=KE,
        stationarity=stationarity,
        feasibility=E @ point.w - small.shares[small.used()],
    )


def _step(small: Small, point: _Point, scores: Array, H: Array) -> bool:
    """One predictor-corrector step; False where the linear system cannot be solved any more."""
    try:
        system = _system(small, point, scores, H)
    except (np.linalg.LinAlgError, ValueError):
        return False
    w, z, y, room, capped = point.w, point.z, point.y, system.room, system.capped
    zero = np.zeros(len(w))
    dw, dnu, dz, dy = system.direction(zero, zero)
    reach = _reach(point, room, dw, dz, dy, capped)
    pairs = 2 * len(w) if capped else len(w)
    after = float((w + reach * dw) @ (z + reach * dz))
    after += float((room - reach * dw) @ (y + reach * dy)) if capped else 0.0
    sigma = min(max((max(after / pairs, 0.0) / point.mu) ** 2, 1e-4), 0.5)
    target = sigma * point.mu
    dw, dnu, dz, dy = system.direction(target - dw * dz, target + dw * dy if capped else zero)
    reach = min(1.0, 0.99 * _reach(point, room, dw, dz, dy, capped))
    point.w, point.z, point.nu = w + reach * dw, z + reach * dz, point.nu + reach * dnu
    point.y = y + reach * dy if capped else y
    total = float(point.w @ point.z) + (float((small.cap - point.w) @ point.y) if capped else 0.0)
    point.mu = total / pairs
    return bool(np.isfinite(point.mu))


def _reach(point: _Point, room: Array, dw: Array, dz: Array, dy: Array, capped: bool) -> float:
    """Largest step in [0, 1] that keeps every variable positive."""
    limits = [1.0]
    for value, change in [(point.w, dw), (point.z, dz)] + ([(room, -dw), (point.y, dy)] if capped else []):
        falling = change < 0
        if falling.any():
            limits.append(float((-value[falling] / change[falling]).min()))
    return min(limits)
