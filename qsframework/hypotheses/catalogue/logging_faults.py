"""What people and loggers do to readings: angles logged late, markers exchanged, a tool that was touched.

Two readings of one file are compared by their likelihood: where the file is right, another reading of it is better by
a factor of c in at most 1 of c cases, so n alternatives at a level a need a factor of n / a.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np

from qsframework.estimation import Independent, LinearFit
from qsframework.estimation.linear_fit import chance
from qsframework.experiment import ReadingRows, observation_model
from qsframework.hypotheses.linearized import Linearized, of_observations
from qsframework.plugin import Array, Indices, Poses

Found = list[tuple[Indices, str]]


_SLACK = 16.0
"""How much worse, in squares of the noise, an exchange may fit than leaving out the worst of its rows."""
_FALL = 0.8
"""How far the sum of squares must fall at least where angles are late; what the model misses makes smaller ones."""
_AT_ONCE, _NUMBERS = 500, 20_000_000
"""Exchanges tried in one product, and numbers in it: long files take fewer exchanges at once, and no more memory."""
_RUNS = 64
"""Runs of late angles tried at once."""
_HELD = 1e-10
"""Share of the weight of all visits with which directions are held that hardly any visit tells."""


def _gain(fit: Linearized, before: float, after: float) -> float:
    """2 log of how much likelier the readings are with a sum of squares `after` than `before`."""
    if fit.stated:
        return before - after
    return fit.fit.dof * float(np.log(max(before, 1e-300) / max(after, 1e-300)))


def exchanges(fit: Linearized, level: float) -> Found:
    """Two or three markers of one state, or of all states, that fit much better exchanged, as orders (k, 2): a row of
    the readings, and the row whose value it should have."""
    of, marker = fit.rows.plus, fit.rows.marker
    kind = 2 * fit.rows.frame + (fit.rows.minus < 0)
    gauge = fit.readings.is_gauge[fit.keep]
    whole = np.isfinite(fit.rows.measured).all(axis=1) & ~gauge
    parts = [
        np.flatnonzero((of == m) & (kind == k) & whole)
        for m, k in sorted(set(zip(of.tolist(), kind.tolist(), strict=True)))
    ]
    orders = [order for rows in parts for order in _orders(rows)]
    everywhere: dict[bytes, list[Indices]] = {}
    for order in orders:
        key = marker[order]
        everywhere.setdefault(key[np.argsort(key[:, 0])].tobytes(), []).append(order)
    candidates = [*orders, *(np.concatenate(group) for group in everywhere.values() if len(group) > 1)]
    single = len(orders)
    need = 2.0 * np.log(max(len(candidates), 1) / level)
    out: Found = []
    able = np.ones(len(candidates), dtype=bool)
    while able.any():
        before = fit.fit.chi2
        after = np.full(len(candidates), before)
        after[able] += _changes(fit, [candidates[c] for c in np.flatnonzero(able)])
        alone = fit.fit.misfits(fit.row, len(fit.keep))
        for c in np.flatnonzero(able[:single]):
            if after[c] > before - alone[candidates[c][:, 0]].max() + _SLACK * fit.fit.unit(float(after[c])):
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


def _change(fit: Linearized, order: Indices) -> Array:
    """What an exchange (k, 2) adds to the errors (m,), m."""
    measured = np.nan_to_num(fit.rows.measured)
    d = np.zeros_like(measured)
    d[order[:, 0]] = measured[order[:, 1]] - measured[order[:, 0]]
    return fit.rows.flat(d)


def _changes(fit: Linearized, orders: Sequence[Indices]) -> Array:
    """How much the sum of squares changes with each exchange."""
    r = fit.fit.white
    at_once = max(1, min(_AT_ONCE, _NUMBERS // r.size))
    out: list[Array] = []
    for k in range(0, len(orders), at_once):
        d = fit.noise.whiten(np.stack([_change(fit, o) for o in orders[k : k + at_once]], axis=1))
        out.append(2.0 * r @ d + np.square(d).sum(axis=0) - np.square(fit.fit.Q.T @ d).sum(axis=0))
    return np.concatenate(out)


def _swap_words(fit: Linearized, order: Indices, single: bool) -> str:
    readings = fit.readings
    at = [fit.keep[i] for i in order[:, 0]]
    names = [fit.experiment.markers[int(m)].name for m in np.unique(readings.marker[at])]
    said = " and ".join(names) if len(names) == 2 else f"{', '.join(names[:-1])} and {names[-1]}"
    where = f"pose {readings.states.pose[readings.plus[at[0]]]}" if single else "all poses"
    rows = ", ".join(str(readings.line[i]) for i in fit.keep[np.unique(order)][:6])
    return f"markers {said} are exchanged at {where} (rows {rows}): the readings fit far better if exchanged"


@dataclass(frozen=True, eq=False)
class Visits:
    """The visits of the arm in the order of the file: the states of each, and the visit (R,) of each row of a fit."""

    states: tuple[tuple[int, ...], ...]
    of: Indices

    def __len__(self) -> int:
        return len(self.states)

    def reversed(self) -> Visits:
        """The same, the last one first."""
        return Visits(self.states[::-1], len(self) - 1 - self.of)


@dataclass(frozen=True, eq=False)
class Slipped:
    """Visits `first` to `last` of `seen` that have the angles of the visit before (by = 1) or after (-1)."""

    seen: Visits
    first: int
    last: int
    by: int

    @property
    def lost(self) -> int:
        """The visit whose own angles stand nowhere."""
        return self.last if self.by > 0 else self.first

    def rows(self, fit: Linearized) -> Indices:
        """Places of its rows in the readings of a fit."""
        return fit.keep[(self.seen.of >= self.first) & (self.seen.of <= self.last)]

    def described(self, fit: Linearized) -> str:
        """In words: which rows, and what to do."""
        readings = fit.readings
        lines, pose = readings.line[self.rows(fit)], readings.states.pose[self.seen.states[self.lost][0]]
        if self.first == self.last:
            return (
                f"rows {', '.join(map(str, lines))} (pose {pose}): the angles are those of the pose before, and the "
                "readings do not fit there: they were logged too early"
            )
        late = self.by > 0
        said = "late: with those of the pose after each" if late else "early: with those of the pose before"
        return (
            f"rows {lines[0]} to {lines[-1]}: the angles stand one pose {said}, the readings fit far better. Move the "
            f"angle columns {'up' if late else 'down'} by one pose; the angles of pose {pose} are then missing"
        )


def visits_of(rows: ReadingRows) -> Visits:
    """Rows of one `plus` are one visit, with the unloaded states that no other visit shares."""
    order = list(dict.fromkeys(rows.plus.tolist()))
    before: dict[int, set[int]] = {s: set() for s in order}
    shared: dict[int, set[int]] = {}
    for s, m in zip(rows.plus.tolist(), rows.minus.tolist(), strict=True):
        if m >= 0:
            before[s].add(m)
            shared.setdefault(m, set()).add(s)
    states = tuple((s, *(m for m in sorted(before[s]) if len(shared[m]) == 1)) for s in order)
    number = {s: i for i, s in enumerate(order)}
    return Visits(states, np.array([number[s] for s in rows.plus.tolist()]))


def moved_up(poses: Poses, seen: Visits, run: range) -> Poses:
    """The poses of states with the angles of a run of visits taken from the visit after each."""
    pendant, q = poses.pendant.copy(), poses.q.copy()
    for v in run:
        for s in seen.states[v]:
            pendant[s], q[s] = poses.pendant[seen.states[v + 1][0]], poses.q[seen.states[v + 1][0]]
    return replace(poses, pendant=pendant, q=q)


def stops_of(rows: ReadingRows) -> Visits:
    """The same with all states of one pose after each other as one visit."""
    seen = visits_of(rows)
    names = [rows.readings.states.pose[s[0]] for s in seen.states]
    stop = np.cumsum([False, *(a != b for a, b in pairwise(names))])
    states = [tuple(s for v in np.flatnonzero(stop == k) for s in seen.states[v]) for k in range(int(stop[-1]) + 1)]
    return Visits(tuple(states), stop[seen.of])


def late_angles(fit: Linearized, level: float) -> list[Slipped]:
    """Runs of visits that have the angles of the one before, or of the one after, so that their own stand one visit
    later, or earlier."""
    every = [visits_of(fit.rows), stops_of(fit.rows)]
    poses, names = fit.readings.poses, fit.readings.states.pose
    found: list[tuple[float, Slipped]] = []
    for seen in every[: 1 if len(every[0]) == len(every[1]) else 2]:
        if len(seen) < 3:
            continue
        first = np.array([s[0] for s in seen.states])
        same = np.flatnonzero(np.all(poses.q[first[1:]] == poses.q[first[:-1]], axis=1)) + 1
        stuck = np.array([v for v in same if names[first[v]] != names[first[v - 1]]], dtype=np.intp)
        alone, rest = _stuck(fit, seen, stuck, level)
        found += [(rest, one) for one in alone[:1]]
        for way, starts, by in ((seen, stuck, 1), (seen.reversed(), len(seen) - stuck, -1)):
            left, run = _run(fit, way, starts, level)
            if left < np.inf:
                k, j = run if by > 0 else (len(seen) - run[1], len(seen) - run[0])
                found.append((left, Slipped(seen, k, j - 1, by)))
    if not found:
        return []
    return [min(found, key=lambda one: one[0])[1]]


def _run(fit: Linearized, seen: Visits, stuck: Indices, level: float) -> tuple[float, tuple[int, int]]:
    """The run [k, j) of visits that have the angles of the one before, and the sum of squares with their own; infinite
    where none fits far better."""
    count = len(seen)
    runs = np.array([(int(k), j) for k in {0, *stuck.tolist()} for j in range(k + 2, count + 1)])
    here, there = _sums(fit, fit, seen), _sums(_shifted(fit, seen), fit, seen)
    turn = _turn(here[-1])
    need = 2.0 * np.log(2.0 * max(len(runs), 1) / level)
    best: tuple[float, tuple[int, int]] = np.inf, (0, 0)
    for some in np.array_split(runs, max(len(runs) // _RUNS, 1)):
        k, j = some.T
        rest = here[-1] - (here[j] - here[j - 1])
        before, free = _squares_of(rest, turn)
        after, _ = _squares_of(rest - (here[j - 1] - here[k]) + (there[j - 1] - there[k]), turn)
        gain = before - after if fit.stated else free * np.log(np.maximum(before, 1e-300) / np.maximum(after, 1e-300))
        after[(free <= 0) | (gain <= need) | (after >= _FALL * before)] = np.inf
        i = int(np.argmin(after))
        if after[i] < best[0]:
            best = float(after[i]), (int(k[i]), int(j[i]))
    return best


def _sums(fit: Linearized, given: Linearized, seen: Visits) -> Array:
    """Sums over the first v visits (v + 1, p + 2, p + 2) of products of whitened columns, errors, and of ones."""
    both = given.noise.whiten(np.column_stack([fit.slopes, fit.errors]))
    visit = seen.of[fit.row]
    out = np.zeros((len(seen) + 1, both.shape[1] + 1, both.shape[1] + 1))
    for v in range(len(seen)):
        part = both[visit == v]
        out[v + 1, :-1, :-1] = part.T @ part
        out[v + 1, -1, -1] = len(part)
    return np.cumsum(out, axis=0)


def _turn(total: Array) -> Array:
    """(p, d): of the columns that all visits tell, combinations whose products over all visits are one."""
    p = len(total) - 2
    size = np.sqrt(np.maximum(np.diag(total)[:p], 1e-300))
    values, vectors = np.linalg.eigh(total[:p, :p] / np.outer(size, size))
    told = values > 1e-12 * max(float(values[-1]), 1e-300)
    return vectors[:, told] / np.sqrt(values[told]) / size[:, None]


def _squares_of(totals: Array, turn: Array) -> tuple[Array, Indices]:
    """Sums of squares (J,) that least squares leaves, from products (J, p + 2, p + 2) of columns and errors, and their
    degrees of freedom (J,)."""
    p, d = turn.shape
    G = turn.T @ totals[:, :p, :p] @ turn
    c = turn.T @ totals[:, :p, p : p + 1]
    # what the visits of one choice do not tell is held by a weight that no other direction feels
    held = G + _HELD * np.eye(d)
    solved = np.linalg.solve(held, np.concatenate([c, G], axis=2))
    rank = np.rint(np.trace(solved[:, :, 1:], axis1=1, axis2=2))
    square = totals[:, p, p] - np.einsum("ja,ja->j", c[..., 0], solved[..., 0])
    return np.maximum(square, 0.0), np.rint(totals[:, -1, -1] - rank).astype(np.intp)


def _shifted(fit: Linearized, seen: Visits) -> Linearized:
    """The same readings at the angles of the visit after each (the last one keeps its own)."""
    poses = moved_up(fit.readings.poses, seen, range(len(seen) - 1))
    rows = replace(fit.rows, readings=fit.readings.with_poses(poses))
    names = fit.experiment.fit_names()
    return of_observations(
        fit.experiment, observation_model(fit.experiment, rows.readings, names, linear=True, rows=rows)
    )


def _stuck(fit: Linearized, seen: Visits, stuck: Indices, level: float) -> tuple[list[Slipped], float]:
    """Single visits with the angles of the one before that do not fit there; the sum of squares without them."""
    out: list[Slipped] = []
    without = fit.fit.chi2
    if not len(stuck):
        return out, without
    label = np.where(np.isin(seen.of, stuck), seen.of, -1)[fit.row]
    alone = fit.fit.held_out(label)
    every = fit.fit.p_values(alone.chi2_drop, alone.size)
    for drop, v, p in zip(alone.chi2_drop, alone.label, every, strict=True):
        if drop > 0.0 and p * len(stuck) < level:
            without -= float(drop)
            out.append(Slipped(seen, int(v), int(v), 1))
    return out, without


def tool_misfit(fit: Linearized, level: float) -> Found:
    """Visits whose markers on one link did not move as a rigid body does."""
    found = _tools(fit)
    chi2, free = sum(t.chi2 for _, t in found), sum(t.dof for _, t in found)
    out: Found = []
    for own, t in found:
        p = float(chance(t.chi2, t.dof, chi2, free, fit.stated))
        if p * len(found) < level:
            rows = fit.keep[own]
            pose = fit.readings.states.pose[fit.readings.plus[rows[0]]]
            told = ", ".join(str(fit.readings.line[i]) for i in rows)
            words = f"rows {told} (pose {pose}): no rigid motion of the tool moves its markers like this (p = {p:.1g})"
            out.append((rows, words))
    return out


def _tools(fit: Linearized) -> list[tuple[Indices, LinearFit]]:
    """Rows of displacements of three or more markers of one link at one visit, and the fit of a rigid motion."""
    readings, model, rows = fit.readings, fit.experiment.model(), fit.rows
    place = model.positions(readings.poses.take(rows.plus), linear=True)
    link = np.array([site.link for site in model.markers])
    whole = (rows.minus >= 0) & np.isfinite(rows.measured).all(axis=1) & ~readings.is_gauge[rows.keep]
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
