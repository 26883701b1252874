"""What people and loggers do to readings: angles logged late, markers exchanged, a tool that was touched.

Two readings of one file are compared by their likelihood: where the file is right, another reading of it is better by
a factor of c in at most 1 of c cases, so n alternatives at a level a need a factor of n / a.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from qsframework.identify.trial import Trial, left
from qsframework.information import scales
from qsframework.plugin import Array, Indices, Poses

Found = list[tuple[Indices, str]]
_SLACK = 16.0
"""How much worse, in squares of the noise, an exchange may fit than leaving out the worse of its two rows."""


def _gain(fit: Trial, before: float, after: float) -> float:
    """2 log of how much likelier the readings are with a sum of squares `after` than `before`."""
    if fit.stated:
        return before - after
    return fit.dof * float(np.log(max(before, 1e-300) / max(after, 1e-300)))


def _square(A: Array, target: Array) -> float:
    Q = np.linalg.qr(A.reshape(-1, A.shape[-1]))[0]
    return float(np.square(left(Q, target)).sum())


def swapped_markers(fit: Trial, level: float) -> Found:
    """Pairs of markers of one measurement, or of all measurements, that fit much better exchanged."""
    of = fit.readings.measurement[fit.keep]
    marker = fit.readings.marker[fit.keep]
    pairs = [np.array([[i, j]]) for m in np.unique(of) for i, j in _pairs(np.flatnonzero(of == m))]
    everywhere: dict[tuple[int, int], list[Indices]] = {}
    for pair in pairs:
        a, b = sorted(pair[0], key=lambda i: int(marker[i]))
        everywhere.setdefault((int(marker[a]), int(marker[b])), []).append(np.array([[a, b]]))
    whole = [np.concatenate(group) for group in everywhere.values() if len(group) > 1]
    candidates = [*pairs, *whole]
    need = 2.0 * np.log(max(len(candidates), 1) / level)
    out: Found = []
    while candidates:
        Q, r0 = fit.Q, left(fit.Q, fit.target)
        before = float(np.square(r0).sum())
        after = [before + _exchange(fit, Q, r0, pair) for pair in candidates]
        alone = fit.row_squares()
        for c, pair in enumerate(candidates):
            if len(pair) == 1 and after[c] > before - alone[pair[0]].max() + _SLACK * fit.unit(after[c]):
                after[c] = before  # one gross reading explains it as well
        best = int(np.argmin(after))
        if _gain(fit, before, after[best]) <= need:
            break
        chosen = candidates[best]
        out.append((fit.keep[np.unique(chosen)], _swap_words(fit, chosen)))
        fit = replace(fit, target=fit.target + _change(fit, chosen))
        taken = set(chosen.ravel().tolist())
        candidates = [c for c in candidates if not taken & set(c.ravel().tolist())]
    return out


def _pairs(rows: Indices) -> list[tuple[int, int]]:
    return [(int(a), int(b)) for n, a in enumerate(rows) for b in rows[n + 1 :]]


def _change(fit: Trial, pairs: Indices) -> Array:
    """What exchanging pairs of rows (n, 2) adds to the target (R, 3)."""
    d = np.zeros_like(fit.target)
    measured = fit.readings.displacement[fit.keep]
    a, b = pairs.T
    d[a] = (measured[b] - measured[a]) / fit.sigma[a, None]
    d[b] = (measured[a] - measured[b]) / fit.sigma[b, None]
    return d


def _exchange(fit: Trial, Q: Array, r: Array, pairs: Indices) -> float:
    """How much the sum of squares changes when pairs of rows are exchanged."""
    d = _change(fit, pairs).ravel()
    rows = np.flatnonzero(d)
    d = d[rows]
    return float(2.0 * r.ravel()[rows] @ d + d @ d - np.square(Q[rows].T @ d).sum())


def _swap_words(fit: Trial, pairs: Indices) -> str:
    readings = fit.readings
    a, b = (fit.experiment.markers[readings.marker[fit.keep[i]]].name for i in pairs[0])
    where = f"pose {readings.pose[readings.measurement[fit.keep[pairs[0, 0]]]]}" if len(pairs) == 1 else "all poses"
    rows = ", ".join(str(readings.rows[i]) for i in fit.keep[np.unique(pairs)][:6])
    return f"markers {a} and {b} are exchanged at {where} (rows {rows}): the readings fit far better if exchanged"


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
        if told.sum() * 3 <= fit.A.shape[-1]:
            continue
        A = np.where(late[:, None, None], shifted.A[told], fit.A[told])
        target = np.where(late[:, None], shifted.target[told], fit.target[told])
        after = _square(A, target)
        gain = _gain(fit, _square(fit.A[told], fit.target[told]), after)
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
    A = model.sensitivity(there, model.nominal, names)[at] * size / fit.sigma[:, None, None]
    predicted = model.predict(there, model.nominal)[at]
    measured = fit.readings.displacement[fit.keep]
    return replace(fit, A=A, target=(measured - predicted) / fit.sigma[:, None])


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
    r = left(fit.Q, fit.target).ravel()
    without = float(r @ r)
    for m in stuck:
        rows = np.flatnonzero(of == m)
        at = (3 * rows[:, None] + np.arange(3)).ravel()
        q = fit.Q[at]
        rest = np.eye(len(at)) - q @ q.T
        if not len(rows) or np.linalg.cond(rest) > 1e10:
            continue
        square = float(r[at] @ np.linalg.solve(rest, r[at]))
        free = max(fit.dof - len(at), 1)
        spread = max(float(r @ r) - square, 1e-300) / free
        p = chi2.sf(square, len(at)) if fit.stated else f.sf(square / len(at) / spread, len(at), free)
        if p * len(stuck) < level:
            without -= square
            pose = fit.readings.pose[m]
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
