"""Markers on one link keep their distances: the tool's shape from all states, and states that do not have it.

No robot model and no tracker frame is needed; the shape is that of the readings themselves, robustly.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, permutations

import numpy as np

from qsframework.experiment import Experiment, StateReadings
from qsframework.identify.positions import Mask
from qsframework.plugin import Array, Indices

_ROUNDS = 10
_LEAST = 4
"""States with all markers below which there is no shape to compare with."""
_LOOSE = 1.5
"""A typical state this many times worse than the stated noise: its own noise is taken, the verdict tells of it."""
_THIN = 20.0
"""Markers whose shape is thinner than so many sigmas lie on one line."""
_MENDED = 1e-3
"""Level at which what is left of a state, or an exchange of its markers, is right."""
_FEW = 4
"""Up to so many markers all orders are tried, above it exchanges of two and of three."""


@dataclass(frozen=True, eq=False)
class Tool:
    """S states of K markers of one link in one series: rows (S, K) of the readings, -1 where a marker was not read.

    points (S, K, 3) m, zero where not read; weight (S, K) 1 / sigma^2, zero where not read; stated: whether sigma is
    """

    marker: Indices
    rows: Indices
    points: Array
    weight: Array
    stated: bool

    @property
    def read(self) -> Mask:
        """(S, K)."""
        return self.rows >= 0

    def take(self, states: Mask | Indices) -> Tool:
        """Some of the states."""
        return replace(self, rows=self.rows[states], points=self.points[states], weight=self.weight[states])

    def ordered(self, state: int, order: Indices) -> Tool:
        """One state whose markers are read in another order."""
        one = self.take(np.array([state]))
        return replace(one, points=one.points[:, order], weight=one.weight[:, order])

    def without(self, state: int, marker: int) -> Tool:
        """One state without one of its markers."""
        one = self.take(np.array([state]))
        rows, weight = one.rows.copy(), one.weight.copy()
        rows[0, marker], weight[0, marker] = -1, 0.0
        return replace(one, rows=rows, weight=weight)


def tools(experiment: Experiment, states: StateReadings) -> Iterator[Tool]:
    """Two or more markers of one link in each series, from the rows in use."""
    link = np.array([m.link for m in experiment.markers])
    series = np.array(states.series)
    sigma = np.where(np.isnan(states.sigma), experiment.noise.sigma or np.nan, states.sigma)
    stated = bool(np.isfinite(sigma[states.use]).all())
    for name in dict.fromkeys(states.series):
        for body in dict.fromkeys(link.tolist()):
            marker = np.flatnonzero(link == body)
            at = np.flatnonzero(series == name)
            rows = np.full((len(series), len(marker)), -1, dtype=np.intp)
            for i in np.flatnonzero(states.use & np.isin(states.marker, marker) & np.isin(states.measurement, at)):
                rows[states.measurement[i], np.searchsorted(marker, states.marker[i])] = i
            rows = rows[np.flatnonzero((rows >= 0).sum(axis=1) >= 2)]
            if len(marker) < 2 or (rows >= 0).all(axis=1).sum() < _LEAST:
                continue
            read = rows >= 0
            weight = np.where(read, 1.0 / np.square(sigma[rows]) if stated else 1.0, 0.0)
            yield Tool(marker, rows, np.where(read[..., None], states.position[rows], 0.0), weight, stated)


def misfits(tool: Tool, shape: Array) -> Array:
    """Weighted sums of squares (S,) that no rigid motion of the shape (K, 3) explains."""
    return (tool.weight[..., None] * np.square(tool.points - _laid(tool, shape))).sum(axis=(1, 2))


def _laid(tool: Tool, shape: Array) -> Array:
    """The shape (K, 3), or one of each state, laid on the points (S, K, 3) by weighted least squares (Kabsch)."""
    w = tool.weight[..., None] / tool.weight.sum(axis=1)[:, None, None]
    a, b = (w * shape).sum(axis=1), (w * tool.points).sum(axis=1)
    da, db = shape - a[:, None], tool.points - b[:, None]
    U, _, Vt = np.linalg.svd(np.einsum("ski,skj->sij", w * da, db))
    V = Vt.transpose(0, 2, 1)
    V[:, :, 2] *= np.sign(np.linalg.det(V @ U.transpose(0, 2, 1)))[:, None]
    return np.einsum("sij,skj->ski", V @ U.transpose(0, 2, 1), da) + b[:, None]


def first_shape(tool: Tool) -> Array:
    """A shape (K, 3) that most states have: medians, begun at the state whose distances are the most usual."""
    whole = tool.take(np.flatnonzero(tool.read.all(axis=1)))
    pairs = np.array(list(combinations(range(len(tool.marker)), 2)))
    distances = np.linalg.norm(whole.points[:, pairs[:, 0]] - whole.points[:, pairs[:, 1]], axis=2)
    shape = whole.points[int(np.argmin(np.abs(distances - np.median(distances, axis=0)).max(axis=1)))]
    for _ in range(3):
        shape = np.median(_brought(whole, shape), axis=0)
    return shape


def _brought(tool: Tool, shape: Array) -> Array:
    """The points of each state, of which all markers were read, brought to the shape."""
    even = replace(tool, weight=np.ones_like(tool.weight))
    back = replace(even, points=np.broadcast_to(shape, tool.points.shape))
    return _laid(back, tool.points)


@dataclass(frozen=True, eq=False)
class Shape:
    """The tool's shape (K, 3) as the good states have it: how many they are, their unit variance and its degrees."""

    points: Array
    count: int
    unit: float
    free: float

    def p_values(self, tool: Tool, inside: bool = True) -> Array:
        """Probability (S,) that states misfit so badly; 1 for those that no distance can test.

        inside: whether the states are among those that the shape was made of; `free` inf means a stated noise
        """
        from scipy.stats import chi2, f

        n = float(self.count)
        square = misfits(tool, self.points) * (n / (n - 1.0) if inside else n / (n + 1.0))
        dof = self.dof(tool)
        safe = np.maximum(dof, 1)
        if np.isinf(self.free):
            p = chi2.sf(square / self.unit, safe)
        else:
            rest = np.maximum(self.free - safe, 1.0) if inside else np.full(len(dof), self.free)
            total = self.unit * self.free
            other = (total - square) / rest if inside else np.full(len(dof), self.unit)
            p = f.sf(square / safe / np.maximum(other, 1e-300), safe, rest)
        return np.where(dof > 0, p, 1.0)

    def dof(self, tool: Tool) -> Indices:
        """Numbers (S,) of each state that no rigid motion changes."""
        out = np.zeros(len(tool.rows), dtype=np.intp)
        for pattern in np.unique(tool.read, axis=0):
            rows = (tool.read == pattern).all(axis=1)
            part = self.points[pattern]
            if len(part) < 2:
                continue
            wide = np.linalg.svd(part - part.mean(axis=0), compute_uv=False)
            noise = np.sqrt(self.unit / tool.weight[rows][:, pattern].min())
            line = len(part) == 2 or wide[1] < _THIN * noise
            out[rows] = 3 * len(part) - (5 if line else 6)
        return out


def judged(tool: Tool, level: float) -> tuple[Shape, Mask]:
    """The shape, and the states (S,) that do not have it; `level` is that of all of them together."""
    from scipy.stats import chi2

    shape = Shape(first_shape(tool), len(tool.rows), 1.0, np.inf)
    dof = np.maximum(shape.dof(tool), 1)
    ratio = misfits(tool, shape.points) / np.maximum(chi2.median(dof), 1e-300)
    typical = float(np.median(ratio))
    robust = not tool.stated or typical > _LOOSE**2
    shape = replace(shape, unit=max(typical, 1e-300) if robust else 1.0)
    bad = shape.p_values(tool) * len(tool.rows) < level
    for _ in range(_ROUNDS):
        good = tool.take(~bad & tool.read.all(axis=1))
        if len(good.rows) < _LEAST:
            break
        points = _brought(good, shape.points).mean(axis=0)
        rest = tool.take(~bad)
        free = float(shape.dof(rest).sum() - shape.dof(good)[:1].sum())
        unit = float(misfits(rest, points).sum() / max(free, 1.0))
        shape = Shape(points, len(good.rows), max(unit, 1e-300) if robust else 1.0, free if robust else np.inf)
        p = np.ones(len(bad))
        p[~bad], p[bad] = shape.p_values(rest), shape.p_values(tool.take(bad), inside=False)
        now = p * len(tool.rows) < level
        if np.array_equal(now, bad):
            break
        bad = now
    return shape, bad


def orders(tool: Tool, state: int) -> list[Indices]:
    """Other orders (K,) of the markers that were read in a state."""
    read = np.flatnonzero(tool.read[state])
    out: list[Indices] = []
    tried = permutations(read.tolist()) if len(read) <= _FEW else _exchanges(read.tolist())
    for chosen in tried:
        order = np.arange(len(tool.marker))
        order[read] = chosen
        if not np.array_equal(order, np.arange(len(order))):
            out.append(order)
    return out


def _exchanges(read: list[int]) -> Iterator[list[int]]:
    """Orders in which two or three change places."""
    for count in (2, 3):
        for some in combinations(range(len(read)), count):
            for turn in range(1, count):
                order = list(read)
                for k, i in enumerate(some):
                    order[i] = read[some[(k + turn) % count]]
                yield order


def mended(tool: Tool, shape: Shape, state: int) -> Indices | None:
    """The order of a bad state's markers that the shape allows, None where there is none."""
    best: tuple[float, Indices] | None = None
    for order in orders(tool, state):
        p = float(shape.p_values(tool.ordered(state, order), inside=False)[0])
        if p > _MENDED and (best is None or p > best[0]):
            best = p, order
    return None if best is None else best[1]


def one_wrong(tool: Tool, shape: Shape, state: int) -> int | None:
    """The marker without which a bad state has the shape, None where several would do, or none."""
    able: list[int] = []
    for k in np.flatnonzero(tool.read[state]).tolist():
        rest = tool.without(state, k)
        if shape.dof(rest)[0] > 0 and float(shape.p_values(rest, inside=False)[0]) > _MENDED:
            able.append(k)
    return able[0] if len(able) == 1 else None
