"""What people and loggers do to readings: angles logged late, markers exchanged, a tool that was touched.

Two readings of one file are compared by their likelihood: where the file is right, another reading of it is better by
a factor of c in at most 1 of c cases, so n alternatives at a level a need a factor of n / a.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from qsframework.identify.trial import Trial, left
from qsframework.information import scales
from qsframework.plugin import Array, Indices, Poses

Found = list[tuple[Indices, str]]
_SLACK = 16.0
"""How much worse, in squares of the noise, an exchange may fit than leaving out the worst of its rows."""
_AT_ONCE = 500
"""Exchanges tried in one product."""


def _gain(fit: Trial, before: float, after: float) -> float:
    """2 log of how much likelier the readings are with a sum of squares `after` than `before`."""
    if fit.stated:
        return before - after
    return fit.dof * float(np.log(max(before, 1e-300) / max(after, 1e-300)))


def swapped_markers(fit: Trial, level: float) -> Found:
    """Two or three markers of one measurement, or of all measurements, that fit much better exchanged."""
    return [(np.unique(order), words) for order, words in exchanges(fit, level)]


def exchanges(fit: Trial, level: float) -> Found:
    """Such exchanges as orders (k, 2): a row of the readings, and the row whose displacement it should have."""
    of = fit.readings.measurement[fit.keep]
    marker = fit.readings.marker[fit.keep]
    orders = [order for m in np.unique(of) for order in _orders(np.flatnonzero(of == m))]
    everywhere: dict[bytes, list[Indices]] = {}
    for order in orders:
        key = marker[order]
        everywhere.setdefault(key[np.argsort(key[:, 0])].tobytes(), []).append(order)
    whole = [np.concatenate(group) for group in everywhere.values() if len(group) > 1]
    candidates = [*orders, *whole]
    single = len(orders)
    need = 2.0 * np.log(max(len(candidates), 1) / level)
    out: Found = []
    able = np.ones(len(candidates), dtype=bool)
    while able.any():
        before = fit.square()
        after = np.full(len(candidates), before)
        after[able] += _exchanges(fit, [candidates[c] for c in np.flatnonzero(able)])
        alone = fit.row_squares()
        for c in np.flatnonzero(able[:single]):
            if after[c] > before - alone[candidates[c][:, 0]].max() + _SLACK * fit.unit(float(after[c])):
                after[c] = before  # one gross reading explains it as well
        best = int(np.argmin(after))
        if _gain(fit, before, float(after[best])) <= need:
            break
        chosen = candidates[best]
        out.append((fit.keep[chosen], _swap_words(fit, chosen, best < single)))
        fit = replace(fit, errors=fit.errors + _change(fit, chosen))
        taken = set(chosen.ravel().tolist())
        able &= np.array([not taken & set(c.ravel().tolist()) for c in candidates])
    return out


def _orders(rows: Indices) -> list[Indices]:
    """Exchanges of two and of three rows: (k, 2), each row and the row whose reading it should have."""
    out = [np.array([[a, b], [b, a]]) for a, b in combinations(rows.tolist(), 2)]
    for a, b, c in combinations(rows.tolist(), 3):
        out += [np.array([[a, b], [b, c], [c, a]]), np.array([[a, c], [c, b], [b, a]])]
    return out


def _change(fit: Trial, order: Indices) -> Array:
    """What an exchange (k, 2) adds to the errors (R, 3), m."""
    d = np.zeros_like(fit.errors)
    measured = fit.readings.displacement[fit.keep]
    d[order[:, 0]] = measured[order[:, 1]] - measured[order[:, 0]]
    return d


def _exchanges(fit: Trial, orders: list[Indices]) -> Array:
    """How much the sum of squares changes with each exchange."""
    r = left(fit.Q, fit.target).ravel()
    out: list[Array] = []
    for k in range(0, len(orders), _AT_ONCE):
        d = fit.noise.whiten(np.stack([_change(fit, o).ravel() for o in orders[k : k + _AT_ONCE]], axis=1))
        out.append(2.0 * r @ d + np.square(d).sum(axis=0) - np.square(fit.Q.T @ d).sum(axis=0))
    return np.concatenate(out)


def _swap_words(fit: Trial, order: Indices, single: bool) -> str:
    readings = fit.readings
    at = [fit.keep[i] for i in order[:, 0]]
    names = [fit.experiment.markers[int(m)].name for m in np.unique(readings.marker[at])]
    said = " and ".join(names) if len(names) == 2 else f"{', '.join(names[:-1])} and {names[-1]}"
    where = f"pose {readings.pose[readings.measurement[at[0]]]}" if single else "all poses"
    rows = ", ".join(str(readings.rows[i]) for i in fit.keep[np.unique(order)][:6])
    return f"markers {said} are exchanged at {where} (rows {rows}): the readings fit far better if exchanged"


def late_angles(fit: Trial, level: float) -> Found:
    """Runs of measurements that have the angles of the one before, so that their own stand one measurement later."""
    readings, poses = fit.readings, fit.readings.poses
    count = len(poses)
    if count < 3:
        return []
    stuck = np.flatnonzero(np.all(poses.q[1:] == poses.q[:-1], axis=1)) + 1
    stuck = np.array([m for m in stuck if readings.pose[m] != readings.pose[m - 1]], dtype=np.intp)
    runs = [(int(k), j) for k in {0, *stuck.tolist()} for j in range(k + 2, count + 1)]
    shifted = _shifted(fit, poses)
    of = readings.measurement[fit.keep]
    need = 2.0 * np.log(max(len(runs), 1) / level)
    best: tuple[float, tuple[int, int]] | None = None
    for k, j in runs:
        told, late = of != j - 1, ((of >= k) & (of < j - 1))[of != j - 1]
        if told.sum() * 3 <= fit.slopes.shape[-1]:
            continue
        here = fit.take(told)
        slopes = np.where(late[:, None, None], shifted.slopes[told], here.slopes)
        errors = np.where(late[:, None], shifted.errors[told], here.errors)
        after = replace(here, slopes=slopes, errors=errors).square()
        gain = _gain(fit, here.square(), after)
        if gain > need and (best is None or after < best[0]):
            best = after, (k, j)
    alone, rest = _stuck(fit, stuck, level)
    return alone if best is None or (alone and rest <= best[0]) else [_late_words(fit, *best[1])]


def _shifted(fit: Trial, poses: Poses) -> Trial:
    """The same readings at the angles of the measurement after each (the last one keeps its own)."""
    after = np.minimum(np.arange(len(poses)) + 1, len(poses) - 1)
    model, names = fit.experiment.model(), fit.experiment.fit_names()
    there = replace(poses, pendant=poses.pendant[after], q=poses.q[after])
    at = fit.readings.measurement[fit.keep], fit.readings.marker[fit.keep]
    size = scales([model.parameters[i] for i in model.index(names)])
    slopes = model.sensitivity(there, model.nominal, names)[at] * size
    errors = fit.readings.displacement[fit.keep] - model.predict(there, model.nominal)[at]
    return replace(fit, slopes=slopes, errors=errors)


def _late_words(fit: Trial, k: int, j: int) -> tuple[Indices, str]:
    readings = fit.readings
    rows = fit.keep[(readings.measurement[fit.keep] >= k) & (readings.measurement[fit.keep] < j)]
    lines = f"rows {readings.rows[rows[0]]} to {readings.rows[rows[-1]]}"
    return rows, (
        f"{lines}: the angles were logged one pose late: with those of the pose after each, the readings fit far "
        f"better. Move the angle columns up by one pose; the angles of pose {readings.pose[j - 1]} are then missing"
    )


def _stuck(fit: Trial, stuck: Indices, level: float) -> tuple[Found, float]:
    """Single measurements with the angles of the one before that do not fit there; the sum of squares without them."""
    from scipy.stats import chi2, f

    out: Found = []
    of = fit.readings.measurement[fit.keep]
    t, columns = fit.shifts()
    whole = without = fit.square()
    for m in stuck:
        rows = np.flatnonzero(of == m)
        at = (3 * rows[:, None] + np.arange(3)).ravel()
        q = columns[at]
        rest = np.eye(len(at)) - q @ q.T
        if not len(rows) or np.linalg.cond(rest) > 1e10:
            continue
        square = float(t[at] @ np.linalg.solve(rest, t[at]))
        free = max(fit.dof - len(at), 1)
        spread = max(whole - square, 1e-300) / free
        p = chi2.sf(square, len(at)) if fit.stated else f.sf(square / len(at) / spread, len(at), free)
        if p * len(stuck) < level:
            without -= square
            pose = fit.readings.pose[int(m)]
            lines = ", ".join(str(fit.readings.rows[i]) for i in fit.keep[rows])
            out.append((fit.keep[rows], f"rows {lines} (pose {pose}): the angles are those of the pose before, and the "
                                        "readings do not fit there: they were logged too early"))  # fmt: skip
    return out, without


@dataclass(frozen=True, eq=False)
class _Tool:
    """Readings of three or more markers of one link in one measurement: what no rigid motion explains."""

    rows: Indices
    square: float
    dof: int


def tool_misfit(fit: Trial, level: float) -> Found:
    """Measurements whose markers on one link did not move as a rigid body does."""
    from scipy.stats import chi2, f

    tools = _tools(fit)
    total, free = sum(t.square for t in tools), sum(t.dof for t in tools)
    out: Found = []
    for t in tools:
        if fit.stated:
            p = float(chi2.sf(t.square, t.dof))
        else:
            other = max(free - t.dof, 1)
            p = float(f.sf(t.square / t.dof / max((total - t.square) / other, 1e-300), t.dof, other))
        if p * len(tools) < level:
            rows = fit.keep[t.rows]
            pose = fit.readings.pose[fit.readings.measurement[rows[0]]]
            lines = ", ".join(str(fit.readings.rows[i]) for i in rows)
            words = f"rows {lines} (pose {pose}): no rigid motion of the tool moves its markers like this (p = {p:.1g})"
            out.append((rows, words))
    return out


def _tools(fit: Trial) -> list[_Tool]:
    readings, model = fit.readings, fit.experiment.model()
    place = model.positions(readings.poses)
    link = np.array([site.link for site in model.markers])
    of, marker = readings.measurement[fit.keep], readings.marker[fit.keep]
    out: list[_Tool] = []
    for m, body in sorted({(int(a), int(link[b])) for a, b in zip(of, marker, strict=True)}):
        rows = np.flatnonzero((of == m) & (link[marker] == body))
        if len(rows) < 3:
            continue
        r = place[m, marker[rows]]
        r = r - r.mean(axis=0)
        turn = -np.cross(r[:, None, :], np.eye(3)).transpose(0, 2, 1)  # (k, axis of the reading, axis of rotation)
        motion = np.concatenate([np.broadcast_to(np.eye(3), turn.shape), turn], axis=2) / fit.sigma[rows, None, None]
        flat = motion.reshape(-1, 6)
        rank = int(np.linalg.matrix_rank(flat / np.maximum(np.linalg.norm(flat, axis=0), 1e-300)))
        U = np.linalg.svd(flat, full_matrices=False)[0][:, :rank]
        target = readings.displacement[fit.keep[rows]] / fit.sigma[rows, None]
        out.append(_Tool(rows, float(np.square(left(U, target)).sum()), target.size - rank))
    return [t for t in out if t.dof > 0]
