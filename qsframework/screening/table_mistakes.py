"""Which edit of a few cells mends a pose that stands out: slips of the hand, each beyond doubt or not said at all.

Three things must hold. The mended rows fit as others do; the readings get likelier by far more than the edits tried
give by chance; and what is mended stands out from whatever else misfits, so that outliers, heavy tails and an effect
that is there at all poses make no mistake of one of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.hypotheses.catalogue.blocks import block
from qsframework.hypotheses.catalogue.edits import (
    MISSING,
    OFF,
    Edit,
    PoseVisits,
    angle_edits,
    copied,
    exchanges,
    factor,
    force_edits,
    group_of,
    groups,
    marker_edits,
    misfits,
    plain,
    repeated_readings,
    state_edits,
    value_edits,
    vanishes,
    with_angle,
    with_force,
)
from qsframework.hypotheses.standing_out import Standing
from qsframework.plugin import Array

_LEAST = 49.0
"""Fall of the sum of squares, in squares of the noise, below which no mistake is called: s = 7."""
_STANDS = 2.0
"""By how much the fall must exceed the largest misfit that no edit mends, where all readings of a pose are mended."""
_ONE = 6.0
"""The same where it is one reading or one cell, as outliers are; or an angle that no slip leads to."""
_PLAIN = 4.0
_BELOW = 0.1
"""Of the stated noise: readings that scatter less are in another unit, before any row is wrong."""
_GROSS = 16.0
"""How much worse a gross reading, or a gear that gives, may explain a pose and still be the likelier cause."""
_GIVES = 5e-3
"""rad: what a drive may give at one pose under its load, unlike at others: a clearance, a stop."""
_FREE = 12.0
"""How much better a number that was fitted must be than a slip that leads to it."""
_AS_GOOD = 6.0
"""How much worse another edit may fit and still be what was meant."""
_STEPS = 8
_DIFFERENCE = 1e-5
_STARTS = (0.0, 0.5, -0.5, 1.57, -1.57, 3.1)
"""rad off the angle in the file, from where the angle that fits is looked for."""
_LARGEST = 0.6
"""rad: of one step."""
_GROUPS = 12
"""Visits that are looked at, the worst first."""
_MOST = 400
"""Edits that are asked of the model at once."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Mend:
    """An edit that mends rows, of two poses where they were exchanged. gain: fall of the sum of squares in squares of
    the noise; tried: edits it was among; others: edits that fit about as well; single: whether one reading shows it."""

    edits: tuple[Edit, ...]
    gain: float
    tried: int
    others: tuple[Edit, ...] = ()
    single: bool = False

    @property
    def visits(self) -> tuple[int, ...]:
        return tuple(v for e in self.edits for v in e.visits)

    @property
    def need(self) -> float:
        """By how much it must stand out."""
        if any(e.masked for e in self.edits):
            return 0.0
        if self.single:
            return _ONE
        return _PLAIN if any(e.slip == OFF and e.free for e in self.edits) else _STANDS


def table_mistakes(standing: Standing) -> tuple[Mend, ...]:
    """Mistakes in single rows and poses, the plainest first; none is the rule."""
    if not standing.wrong.any() or (standing.readings.stated and standing.unit < _BELOW):
        return ()
    run = block(standing)
    if run is not None:
        whole = Mend(edits=(run[0],), gain=run[1], tried=len(standing.visits) ** 2)
        if whole.gain >= whole.need * _elsewhere(standing, whole.visits):
            return (whole,)
    found: list[Mend] = []
    every = groups(standing, _GROUPS)
    for group in every:
        best = _best(standing, group)
        if best is not None:
            found.append(best)
    found += _exchanged(standing, every)
    found.sort(key=lambda m: -(m.gain - 2.0 * len(m.visits) - 2.0 * np.log(m.tried)))
    chosen: list[Mend] = []
    for m in found:
        if not any(set(c.visits) & set(m.visits) or _copies(standing, c, m) for c in chosen):
            chosen.append(m)
    while chosen:
        rest = _elsewhere(standing, [v for m in chosen for v in m.visits])
        kept = [m for m in chosen if m.gain >= m.need * rest]
        if len(kept) == len(chosen):
            break
        chosen = [m for m in chosen if m is not min(chosen, key=lambda m: m.gain / max(m.need, 1e-9))]
    return tuple(chosen)


def _copies(standing: Standing, one: Mend, other: Mend) -> bool:
    """Whether each is said to be a copy of the other's pose: one of them was read."""
    (a, *_), (b, *_) = one.edits, other.edits
    pose = standing.readings.states.pose
    there = [{pose[int(s)] for s in e.states} for e in (a, b)]
    return a.masked and b.masked and a.other in there[1] and b.other in there[0]


def _elsewhere(standing: Standing, mended: Sequence[int]) -> float:
    """The largest misfit that is not mended, in whose light mistakes must stand out."""
    return float(np.delete(standing.misfit, list(mended)).max(initial=0.0)) * _doubt(standing)


def _doubt(standing: Standing) -> float:
    """How much plainer a mistake must be where even the visits that agree do so worse than the stated noise: something
    else acts, and may act at one pose more than at others."""
    return max(standing.unit**2, 1.0) if standing.readings.stated else 1.0


def _best(standing: Standing, group: PoseVisits) -> Mend | None:
    """The edit that mends a group of rows, None where none does."""
    readings, experiment = standing.readings, standing.experiment
    edits = [
        *angle_edits(experiment, readings, group),
        *force_edits(readings, group),
        *value_edits(readings, group),
        *marker_edits(readings, group),
        *state_edits(readings, group),
    ]
    edits += _fitted(standing, group)
    start = plain(readings, group, "")
    before = float(misfits(standing, [start])[0])
    copies = next(repeated_readings(readings, group, standing.rows.keep), None)
    count = int(np.isfinite(start.value).sum())
    if copies is not None and before > standing.usual(count):
        return Mend(edits=(copies,), gain=before, tried=len(standing.visits))
    after = _in_parts(standing, edits)
    score = after + np.array([_FREE * e.free + 2.0 * e.shrunk(readings) for e in edits])
    score[after > standing.usual(count)] = np.inf
    order = np.argsort(score)
    best, left = edits[int(order[0])], float(after[order[0]])
    gain = before - left
    if left > standing.usual(count) or gain < _LEAST * _doubt(standing) + 2.0 * np.log(len(edits)):
        return None
    if vanishes(standing, best, left):
        return None
    others = tuple(edits[int(i)] for i in order[1:4] if score[i] - score[order[0]] < _AS_GOOD)
    single = best.touched is not None and len(best.touched) == 1
    single = single or _without_one(standing, start) < left + _GROSS
    if _moved(standing, start) < left + _GROSS:
        return None
    return Mend(edits=(best,), gain=gain, tried=len(edits), others=others, single=single)


def _in_parts(standing: Standing, edits: Sequence[Edit]) -> Array:
    return np.concatenate([misfits(standing, edits[i : i + _MOST]) for i in range(0, len(edits), _MOST)])


def _without_one(standing: Standing, start: Edit) -> float:
    """The least misfit of the rows without one of them: what a gross reading would explain."""
    if len(start.rows) == 1:
        return 0.0
    out: list[float] = []
    for r in range(len(start.rows)):
        rest = np.arange(len(start.rows)) != r
        out.append(float(misfits(standing, [replace(start, rows=start.rows[rest], value=start.value[rest])])[0]))
    return min(out)


def _moved(standing: Standing, start: Edit) -> float:
    """The least misfit of the rows if one drive gives in their loaded states."""
    controller = standing.experiment.robot.controller
    loaded = standing.readings.states.loaded[start.states]
    if not loaded.any():
        return np.inf

    shown = np.linalg.inv(controller.matrix[list(controller.driven)]).T

    def moved(turn: Array) -> Callable[[float], Edit]:
        by = loaded[:, None] * turn
        return lambda t: replace(start, pendant=start.pendant + np.clip(t, -_GIVES, _GIVES) * by)

    makers = [(moved(turn), 0.0) for turn in shown]
    return float(misfits(standing, _converged(standing, makers, start)).min())


def _fitted(standing: Standing, group: PoseVisits) -> list[Edit]:
    """Angles, and forces that are missing, as the readings tell them."""
    readings = standing.readings
    start = plain(readings, group, "angle")
    axes, joints = start.pendant.shape[1], standing.experiment.robot.controller.units

    def angle(k: int) -> Callable[[float], Edit]:
        return lambda t: replace(with_angle(start, k, t, OFF, joints[k]), free=1)

    makers = [(angle(k), first) for k in range(axes) for first in _STARTS]
    loaded = readings.states.loaded[group.states]
    if loaded.any():
        own = start.wrench[loaded][0]
        usual = np.abs(readings.poses.wrench[readings.states.loaded]).max(axis=0)
        blank = replace(start, kind="force")

        def force(i: int) -> Callable[[float], Edit]:
            one = np.eye(6)[i] * usual[i]
            return lambda t: replace(with_force(blank, loaded, own + t * one, MISSING), free=1)

        makers += [(force(i), 0.5) for i in np.flatnonzero((own == 0.0) & (usual > 0.0)).tolist()]
    found = _converged(standing, makers, start)
    controller = standing.experiment.robot.controller
    return [e for e in found if not controller.outside(e.pendant).any()]


def _converged(standing: Standing, makers: Sequence[tuple[Callable[[float], Edit], float]], start: Edit) -> list[Edit]:
    """Each edit at the number where its rows fit best, by Gauss and Newton, all at once."""
    whitened = factor(standing, start)
    at = np.array([first for _, first in makers])
    best, best_at = np.full(len(at), np.inf), at.copy()
    for _ in range(_STEPS):
        both = [m(float(t + d)) for (m, _), t in zip(makers, at, strict=True) for d in (0.0, _DIFFERENCE)]
        errors = (whitened @ standing.missed(copied(standing, both)).reshape(len(both), -1).T).T
        for i in range(len(at)):
            here, slope = errors[2 * i], (errors[2 * i + 1] - errors[2 * i]) / _DIFFERENCE
            square = float(here @ here)
            if square < best[i]:
                best[i], best_at[i] = square, at[i]
            step = -float(slope @ here) / max(float(slope @ slope), 1e-300)
            at[i] = (
                best_at[i] + 0.3 * (at[i] - best_at[i])
                if square > 4.0 * best[i]
                else at[i] + np.clip(step, -_LARGEST, _LARGEST)
            )
    return [m(float(t)) for (m, _), t in zip(makers, best_at, strict=True)]


def _exchanged(standing: Standing, every: Sequence[PoseVisits]) -> list[Mend]:
    """Pairs of poses that fit at each other's place."""
    readings = standing.readings
    out: list[Mend] = []
    single = [group_of(standing, (v,)) for v in range(len(standing.visits))]
    wide = [g for g in every if len(g.visits) > 1]
    for one in (g for g in every if len(g.visits) == 1):
        pairs = [p for two in single if two.visits != one.visits for p in exchanges(readings, one, two)]
        out += _pair(standing, pairs, one)
    for i, one in enumerate(wide):
        out += _pair(standing, [p for two in wide[i + 1 :] for p in exchanges(readings, one, two)], one)
    return out


def _pair(standing: Standing, pairs: Sequence[tuple[Edit, Edit]], one: PoseVisits) -> list[Mend]:
    """The exchange that mends both."""
    if not pairs:
        return []
    count = int(np.isfinite(standing.readings.value[one.rows]).sum())
    usual = standing.usual(count)
    first = _in_parts(standing, [a for a, _ in pairs])
    good = np.flatnonzero(first <= usual)
    if not len(good):
        return []
    chosen = [pairs[int(i)] for i in good]
    second = _in_parts(standing, [b for _, b in chosen])
    start = [replace(e, kind="", **_own(standing, e)) for pair in chosen for e in pair]
    before = _in_parts(standing, start).reshape(-1, 2).sum(axis=1)
    after = first[good] + second
    best = int(np.argmin(after - before))
    gain = float(before[best] - after[best])
    if second[best] > usual or gain < _LEAST * _doubt(standing) + 2.0 * np.log(len(standing.visits)):
        return []
    # an exchange within a pose of two states is that of the states
    if len({standing.readings.states.pose[int(e.states[0])] for e in chosen[best]}) < 2:
        return []
    return [Mend(edits=chosen[best], gain=gain, tried=len(pairs) * len(standing.visits))]


def _own(standing: Standing, e: Edit) -> dict[str, Array]:
    poses = standing.readings.poses
    return {"pendant": poses.pendant[e.states], "wrench": poses.wrench[e.states]}
