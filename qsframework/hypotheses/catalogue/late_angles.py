"""Angles that were logged one visit too late or too early.

Two readings of one file are compared by their likelihood, as exchanged markers are; a run of visits has the angles of
the visit before or after each.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from qsframework.experiment import Readings
from qsframework.hypotheses.hypothesis import Hypothesis
from qsframework.hypotheses.linearized import (
    Linearized,
    Visits,
    linear_model,
    of_observations,
    stops_of,
    visits_of,
)
from qsframework.plugin import Array, Indices, Poses

_FALL = 0.8
"""How far the sum of squares must fall at least where angles are late; what the model misses makes smaller ones."""
_RUNS = 64
"""Runs of late angles tried at once."""
_HELD = 1e-10
"""Share of the weight of all visits with which directions are held that hardly any visit tells."""


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


def late_angles(fit: Linearized, level: float) -> Hypothesis | None:
    """A run of visits that have the angles of the one before, or of the one after, so that their own stand one visit
    later, or earlier; None where no run fits far better."""
    run = _slipped(fit, level)
    if run is None:
        return None
    changed, tried = _realigned(fit, run), len(fit.readings.states)
    change = Hypothesis("late_angles", 1.0, run.described(fit), fit.experiment, readings=changed, tried=tried)
    return change.at(run.rows(fit))


def _slipped(fit: Linearized, level: float) -> Slipped | None:
    """The run that leaves least."""
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
    return min(found, key=lambda one: one[0])[1] if found else None


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
    ends = np.cumsum(np.bincount(visit, minlength=len(seen)))
    for v, part in enumerate(np.split(both[np.argsort(visit, kind="stable")], ends[:-1])):
        out[v + 1] = out[v]
        out[v + 1, :-1, :-1] += part.T @ part
        out[v + 1, -1, -1] += len(part)
    return out


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
    poses = _moved_up(fit.readings.poses, seen, range(len(seen) - 1))
    rows = replace(fit.rows, readings=fit.readings.with_poses(poses))
    return of_observations(fit.experiment, linear_model(fit.experiment, rows.readings, rows))


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


def _realigned(fit: Linearized, run: Slipped) -> Readings:
    """The angles of a run of visits moved by one, up where each has those of the visit before, else down. One visit's
    are then missing, so it is masked."""
    seen, first, last = run.seen, run.first, run.last
    if run.by < 0:
        seen, first, last = seen.reversed(), len(seen) - 1 - last, len(seen) - 1 - first
    poses = _moved_up(fit.readings.poses, seen, range(first, last))
    lost = np.zeros(len(fit.readings), dtype=bool)
    lost[fit.keep[run.seen.of == run.lost]] = True
    return fit.readings.with_poses(poses).masked(lost)


def _moved_up(poses: Poses, seen: Visits, run: range) -> Poses:
    """The poses of states with the angles of a run of visits taken from the visit after each."""
    pendant, q = poses.pendant.copy(), poses.q.copy()
    for v in run:
        for s in seen.states[v]:
            pendant[s], q[s] = poses.pendant[seen.states[v + 1][0]], poses.q[seen.states[v + 1][0]]
    return replace(poses, pendant=pendant, q=q)
