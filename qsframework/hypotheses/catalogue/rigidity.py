"""Markers on one link keep their distances: the tool's shape from all states, and states that do not have it.

No robot model and no tracker frame is needed; the shape is that of the readings themselves, robustly.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, permutations

import numpy as np
import numpy.typing as npt

from qsframework.errors import listed
from qsframework.estimation import Independent, LinearFit
from qsframework.estimation.linear_fit import chance
from qsframework.estimation.tails import chi2_isf, chi2_sf, f_sf
from qsframework.experiment import Experiment, Readings
from qsframework.hypotheses.catalogue.rows import LEVEL, WrongRows, lines, wrong_rows
from qsframework.hypotheses.linearized import Linearized
from qsframework.plugin import Array, Indices

Mask = npt.NDArray[np.bool_]

_ROUNDS = 10
_LEAST = 4
"""States with all markers below which there is no shape to compare with."""
_LOOSE = 1.5
"""A typical state this many times worse than the stated noise: its own noise is taken, the verdict tells of it."""
_WILD = 10.0
"""Times the stated noise that the distances scatter by, beyond which a unit, a sign or an axis is wrong, no name."""
_THIN = 20.0
"""Markers whose shape is thinner than so many sigmas lie on one line."""
_MENDED = 1e-3
"""Level at which what is left of a state, or an exchange of its markers, is right."""
_CLEAR = 5.0
"""An order of the markers is told from another where it fits so many times better, and by more than _FAR."""
_FAR = 2e-3
"""m: how well the places of markers on the tool are known."""
_FEW = 4
"""Up to so many markers all orders are tried, above it exchanges of two and of three."""


@dataclass(frozen=True, eq=False)
class MarkerTool:
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

    def take(self, states: Mask | Indices) -> MarkerTool:
        """Some of the states."""
        return replace(self, rows=self.rows[states], points=self.points[states], weight=self.weight[states])

    def ordered(self, state: int, order: Indices) -> MarkerTool:
        """One state whose markers are read in another order."""
        one = self.take(np.array([state]))
        return replace(one, points=one.points[:, order], weight=one.weight[:, order])

    def without(self, state: int, marker: int) -> MarkerTool:
        """One state without one of its markers."""
        one = self.take(np.array([state]))
        rows, weight = one.rows.copy(), one.weight.copy()
        rows[0, marker], weight[0, marker] = -1, 0.0
        return replace(one, rows=rows, weight=weight)


def tools(experiment: Experiment, readings: Readings) -> Iterator[MarkerTool]:
    """Two or more markers of one link in each series, from the rows of positions in use."""
    link = np.array([m.link for m in experiment.markers])
    use = readings.use & readings.is_position & ~readings.is_gauge & np.isfinite(readings.value).all(axis=1)
    sigma = np.where(np.isfinite(readings.sigma).all(axis=1), readings.sigma.max(axis=1), np.nan)
    for f in range(len(readings.frames)):
        for body in dict.fromkeys(link.tolist()):
            marker = np.flatnonzero(link == body)
            rows = np.full((len(readings.states), len(marker)), -1, dtype=np.intp)
            for i in np.flatnonzero(use & np.isin(readings.marker, marker) & (readings.frame == f)):
                rows[readings.plus[i], np.searchsorted(marker, readings.marker[i])] = i
            rows = rows[np.flatnonzero((rows >= 0).sum(axis=1) >= 2)]
            if len(marker) < 2 or (rows >= 0).all(axis=1).sum() < _LEAST:
                continue
            read = rows >= 0
            weight = np.where(read, 1.0 / np.square(sigma[rows]) if readings.stated else 1.0, 0.0)
            points = np.where(read[..., None], readings.value[rows], 0.0)
            yield MarkerTool(marker, rows, points, weight, readings.stated)


def misfits(tool: MarkerTool, shape: Array) -> Array:
    """Weighted sums of squares (S,) that no rigid motion of the shape (K, 3) explains."""
    return (tool.weight[..., None] * np.square(tool.points - _laid(tool, shape))).sum(axis=(1, 2))


def _laid(tool: MarkerTool, shape: Array) -> Array:
    """The shape (K, 3), or one of each state, laid on the points (S, K, 3) by weighted least squares (Kabsch)."""
    w = tool.weight[..., None] / tool.weight.sum(axis=1)[:, None, None]
    a, b = (w * shape).sum(axis=1), (w * tool.points).sum(axis=1)
    da, db = shape - a[:, None], tool.points - b[:, None]
    U, _, Vt = np.linalg.svd(np.einsum("ski,skj->sij", w * da, db))
    V = Vt.transpose(0, 2, 1)
    V[:, :, 2] *= np.sign(np.linalg.det(V @ U.transpose(0, 2, 1)))[:, None]
    return np.einsum("sij,skj->ski", V @ U.transpose(0, 2, 1), da) + b[:, None]


def first_shape(tool: MarkerTool) -> Array:
    """A shape (K, 3) that most states have: medians, begun at the state whose distances are the most usual."""
    whole = tool.take(np.flatnonzero(tool.read.all(axis=1)))
    pairs = np.array(list(combinations(range(len(tool.marker)), 2)))
    distances = np.linalg.norm(whole.points[:, pairs[:, 0]] - whole.points[:, pairs[:, 1]], axis=2)
    shape = whole.points[int(np.argmin(np.abs(distances - np.median(distances, axis=0)).max(axis=1)))]
    for _ in range(3):
        shape = np.median(_brought(whole, shape), axis=0)
    return shape


def _brought(tool: MarkerTool, shape: Array) -> Array:
    """The points of each state, of which all markers were read, brought to the shape."""
    even = replace(tool, weight=np.ones_like(tool.weight))
    back = replace(even, points=np.broadcast_to(shape, tool.points.shape))
    return _laid(back, tool.points)


@dataclass(frozen=True, eq=False)
class RigidShape:
    """The tool's shape (K, 3) as the good states have it: how many they are, their unit variance and its degrees."""

    points: Array
    count: int
    unit: float
    free: float

    def p_values(self, tool: MarkerTool, inside: bool = True) -> Array:
        """Probability (S,) that states misfit so badly; 1 for those that no distance can test.

        inside: whether the states are among those that the shape was made of; `free` inf means a stated noise
        """
        n = float(self.count)
        square = misfits(tool, self.points) * (n / (n - 1.0) if inside else n / (n + 1.0))
        dof = self.dof(tool)
        safe = np.maximum(dof, 1)
        if np.isinf(self.free):
            p = chi2_sf(square / self.unit, safe)
        else:
            rest = np.maximum(self.free - safe, 1.0) if inside else np.full(len(dof), self.free)
            total = self.unit * self.free
            other = (total - square) / rest if inside else np.full(len(dof), self.unit)
            p = f_sf(square / safe / np.maximum(other, 1e-300), safe, rest)
        return np.where(dof > 0, p, 1.0)

    def dof(self, tool: MarkerTool) -> Indices:
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


def judged(tool: MarkerTool, level: float) -> tuple[RigidShape, Mask]:
    """The shape, and the states (S,) that do not have it; `level` is that of all of them together."""
    shape = RigidShape(first_shape(tool), len(tool.rows), 1.0, np.inf)
    dof = np.maximum(shape.dof(tool), 1)
    ratio = misfits(tool, shape.points) / np.maximum(chi2_isf(0.5, dof), 1e-300)
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
        shape = RigidShape(points, len(good.rows), max(unit, 1e-300) if robust else 1.0, free if robust else np.inf)
        p = np.ones(len(bad))
        p[~bad], p[bad] = shape.p_values(rest), shape.p_values(tool.take(bad), inside=False)
        now = p * len(tool.rows) < level
        if np.array_equal(now, bad):
            break
        bad = now
    return shape, bad


def orders(tool: MarkerTool, state: int) -> list[Indices]:
    """Other orders (K,) of the markers that were read in a state."""
    read = np.flatnonzero(tool.read[state])
    out: list[Indices] = []
    for chosen in permutations(read.tolist()) if len(read) <= _FEW else _exchanges(read.tolist()):
        order = np.arange(len(tool.marker))
        order[read] = chosen
        if not np.array_equal(order[read], read):
            out.append(order)
    return out


def _exchanges(read: list[int]) -> Iterator[list[int]]:
    """Orders in which two or three change places."""
    for some in (*combinations(read, 2), *combinations(read, 3)):
        for turn in range(1, len(some)):
            places = dict(zip(some, some[turn:] + some[:turn], strict=True))
            yield [places.get(i, i) for i in read]


def mended(tool: MarkerTool, shape: RigidShape, state: int) -> Indices | None:
    """The order of a bad state's markers that the shape allows, None where there is none."""
    every = orders(tool, state)
    p = [float(shape.p_values(tool.ordered(state, order), inside=False)[0]) for order in every]
    return every[int(np.argmax(p))] if max(p, default=0.0) > _MENDED else None


def one_wrong(tool: MarkerTool, shape: RigidShape, state: int) -> int | None:
    """The marker without which a bad state has the shape, None where several would do, or none."""
    rests = {k: tool.without(state, k) for k in np.flatnonzero(tool.read[state]).tolist()}
    able = [k for k, t in rests.items() if shape.dof(t)[0] > 0 and shape.p_values(t, inside=False)[0] > _MENDED]
    return able[0] if len(able) == 1 else None


def marker_rigidity(experiment: Experiment, readings: Readings, level: float = LEVEL) -> list[WrongRows]:
    """Markers exchanged everywhere, and states of positions whose marker distances are not those of the rigid tool.

    Distances are compared between the states of a series, so that they need no model and no tracker frame. `level` is
    that of all distances together.
    """
    found = _exchanged_everywhere(experiment, readings)
    for one in found:
        readings = one.applied(readings)
    for tool in tools(experiment, readings):
        found += _distances(experiment, readings, tool, level)
    return found


def _names(experiment: Experiment, marker: Indices) -> str:
    return listed([experiment.markers[int(m)].name for m in marker])


def _moved(order: Indices) -> Indices:
    """Where an order has another marker."""
    return np.flatnonzero(order != np.arange(len(order)))


def _exchanged_everywhere(experiment: Experiment, readings: Readings) -> list[WrongRows]:
    """Markers whose shape is that of the experiment in another order."""
    found: list[WrongRows] = []
    for tool in tools(experiment, readings):
        nominal = np.array([experiment.markers[int(m)].xyz for m in tool.marker])
        shape, _ = judged(tool, LEVEL)
        one = MarkerTool(
            tool.marker, np.arange(len(nominal))[None], shape.points[None], np.ones((1, len(nominal))), False
        )
        here = _apart(one, nominal)
        best, order = min(
            ((_apart(one.ordered(0, o), nominal), o) for o in orders(one, 0)), key=lambda t: t[0], default=(here, None)
        )
        if order is None or here < max(_CLEAR * best, _FAR):
            continue
        words = (
            f"markers {_names(experiment, tool.marker[_moved(order)])} are exchanged in all states: their distances "
            f"are {here * 1e3:.1f} mm off the experiment's, and {best * 1e3:.1f} mm if exchanged. Change the names"
        )
        found.append(_exchanged(readings, tool, slice(None), order, words))
    return found


def _apart(tool: MarkerTool, shape: Array) -> float:
    """RMS distance of one state's markers from the shape, m."""
    return float(np.sqrt(misfits(tool, shape)[0] / len(shape)))


def _distances(experiment: Experiment, readings: Readings, tool: MarkerTool, level: float) -> list[WrongRows]:
    """States that do not have the tool's shape: by exchanged markers, by one wrong marker, or by several."""
    shape, bad = judged(tool, level)
    wild = tool.stated and shape.unit > _WILD**2
    found: list[WrongRows] = []
    for s in np.flatnonzero(bad).tolist():
        order = None if wild else mended(tool, shape, s)
        if order is not None:
            moved = _moved(order)
            said = f"markers {_names(experiment, tool.marker[moved])} are exchanged: the distances are right then"
            words = f"{lines(readings, np.sort(tool.rows[s, moved]))}: {said}"
            found.append(_exchanged(readings, tool, slice(s, s + 1), order, words))
            continue
        k = one_wrong(tool, shape, s)
        rows = tool.rows[s, tool.read[s]] if k is None else tool.rows[s, [k]]
        name = "" if k is None else experiment.markers[int(tool.marker[k])].name
        who = f"marker {name} is not where it was on the tool: " if name else ""
        words = f"{lines(readings, rows)}: {who}{_wrong_distances(experiment, tool, shape, s)}"
        found.append(wrong_rows("tool", readings, rows, words))
    return found


def _wrong_distances(experiment: Experiment, tool: MarkerTool, shape: RigidShape, s: int) -> str:
    """The distance that differs most from the tool's, in words."""
    here, usual = tool.points[s], shape.points
    off = {
        (a, b): float(np.linalg.norm(here[a] - here[b]) - np.linalg.norm(usual[a] - usual[b]))
        for a, b in combinations(np.flatnonzero(tool.read[s]).tolist(), 2)
    }
    a, b = max(off, key=lambda pair: abs(off[pair]))
    size = f"{abs(off[a, b]) * 1e3:.3f} mm {'longer' if off[a, b] > 0 else 'shorter'}"
    return f"the distance of {_names(experiment, tool.marker[[a, b]])} is {size} than in the other states"


def _exchanged(readings: Readings, tool: MarkerTool, states: slice, order: Indices, words: str) -> WrongRows:
    """Markers that stand under one another's names in some states: where `order` (K,) has a marker, k is meant."""
    marker = readings.marker.copy()
    moved = _moved(order)
    for k in moved.tolist():
        rows = tool.rows[states, order[k]]
        marker[rows[rows >= 0]] = tool.marker[k]
    rows = tool.rows[states][:, moved]
    return replace(wrong_rows("swapped_markers", readings, np.sort(rows[rows >= 0]), words), marker=marker)


def tool_misfit(fit: Linearized, level: float) -> list[WrongRows]:
    """Visits whose markers on one link did not move as a rigid body does."""
    found = _tools(fit)
    chi2, free = sum(t.chi2 for _, t in found), sum(t.dof for _, t in found)
    out: list[WrongRows] = []
    for own, t in found:
        p = float(chance(t.chi2, t.dof, chi2, free, fit.stated))
        if p * len(found) < level:
            rows = fit.keep[own]
            pose = fit.readings.states.pose[fit.readings.plus[rows[0]]]
            told = ", ".join(str(fit.readings.line[i]) for i in rows)
            words = f"rows {told} (pose {pose}): no rigid motion of the tool moves its markers like this (p = {p:.1g})"
            out.append(wrong_rows("tool", fit.readings, rows, words))
    return out


def _tools(fit: Linearized) -> list[tuple[Indices, LinearFit]]:
    """Rows of displacements on the base's axes of three or more markers of one link at one visit, and the fit of a
    rigid motion. On the axes of a series nobody knows yet how the markers lie."""
    readings, model, rows = fit.readings, fit.experiment.model(), fit.rows
    place = model.positions(readings.poses.take(rows.plus), linear=True)
    link = np.array([site.link for site in model.markers])
    whole = (rows.minus >= 0) & np.isfinite(rows.measured).all(axis=1) & ~readings.is_gauge[rows.keep]
    whole &= rows.frame < 0
    out: list[tuple[Indices, LinearFit]] = []
    for m, body in sorted({(int(a), int(link[b])) for a, b in zip(rows.plus[whole], rows.marker[whole], strict=True)}):
        some = np.flatnonzero((rows.plus == m) & (link[rows.marker] == body) & whole)
        if len(some) < 3:
            continue
        r = place[some, rows.marker[some]]
        r = r - r.mean(axis=0)
        turn = -np.cross(r[:, None, :], np.eye(3)).transpose(0, 2, 1)  # (k, axis of the reading, axis of rotation)
        motion = np.concatenate([np.broadcast_to(np.eye(3), turn.shape), turn], axis=2).reshape(-1, 6)
        out.append((some, LinearFit.of(motion, rows.measured[some].ravel(), Independent(rows.sigma[some].ravel()))))
    return [(some, t) for some, t in out if t.dof > 0]
