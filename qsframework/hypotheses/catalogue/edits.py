"""Edits of a few cells of a table: what a slip of the hand or of a logger may have made of them, kind by kind."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from qsframework.estimation.projection import Flags
from qsframework.experiment import Experiment, Readings
from qsframework.hypotheses.standing_out import Standing
from qsframework.plugin import Array, Indices
from qsframework.units import TURNS, JointUnit

KGF, LBF, INCH = 9.80665, 4.4482216, 25.4
SIGN, DECIMAL, UNIT, MISSING, OTHER, OFF = "sign", "decimal", "unit", "missing", "another load", "off"
"""What leads from the number that was meant to the one in the file; OFF: nothing known."""
_JOINTS = ((-1.0, SIGN), (10.0, DECIMAL), (0.1, DECIMAL))
_DIGITS = ((-1.0, SIGN), *((10.0**k, DECIMAL) for k in (-1, 1, -2, 2, -3, 3)))
_FORCES = (*_DIGITS, (KGF, UNIT), (1.0 / KGF, UNIT), (LBF, UNIT))
VALUES = (*_DIGITS, (INCH, UNIT), (1.0 / INCH, UNIT))
"""Factors of the number in the file that may make the one that was meant, each with its slip."""
_LOADS = 40
"""Loads of a file that are tried in the place of one, the most frequent first."""
SAYS = 49.0
"""By how much smaller readings must fit better than none at all, in squares of the noise: s = 7."""
_SAME = 1e-9
"""m: readings that differ by less are copies."""
_MANY = 5
"""Markers of a state up to which all exchanges are tried."""


@dataclass(frozen=True, eq=False)
class PoseVisits:
    """Rows (k,) and states (s,) of the readings that a mistake may have touched together: visits of one pose."""

    visits: tuple[int, ...]
    rows: Indices
    states: Indices


@dataclass(frozen=True, eq=False, kw_only=True)
class Edit:
    """Other cells at some rows. kind: as `docs/diagnose.md` lists them; slip: what happened, if it is known.

    rows (k,), states (s,): of the readings; pendant (s, m) rad, wrench (s, 6), value (k, 3) m: what they become;
    free: numbers that were fitted to the readings; masked: the rows tell nothing any more; column: its name in the
    file without its unit, and unit of a joint's; found, meant: SI, of the column, NaN where several are changed;
    single: rows of one marker
    """

    kind: str
    slip: str
    visits: tuple[int, ...]
    rows: Indices
    states: Indices
    pendant: Array
    wrench: Array
    value: Array
    free: int = 0
    masked: bool = False
    column: str = ""
    unit: JointUnit = TURNS
    found: float = float("nan")
    meant: float = float("nan")
    other: str = ""
    touched: Indices | None = None

    def shrunk(self, readings: Readings) -> float:
        """Log of how much smaller it makes what was read, and the noise in it."""
        if self.kind != "value" or self.slip not in (DECIMAL, UNIT):
            return 0.0
        before = readings.value[self.rows]
        changed = np.isfinite(before) & (before != self.value)
        return -float(np.log(np.abs(self.value[changed] / before[changed])).sum())

    def apply(self, experiment: Experiment, readings: Readings) -> Readings:
        """The readings with it, where it changes cells alone."""
        poses = readings.poses
        pendant, q, wrench, value = (np.array(v) for v in (poses.pendant, poses.q, poses.wrench, readings.value))
        pendant[self.states], wrench[self.states] = self.pendant, self.wrench
        q[self.states] = experiment.robot.controller.to_joints(self.pendant)
        value[self.rows] = self.value
        changed = readings.with_poses(replace(poses, pendant=pendant, q=q, wrench=wrench)).with_values(value)
        wrong = np.zeros(len(readings), dtype=bool)
        wrong[self.rows] = self.masked
        return changed.masked(wrong)


def groups(standing: Standing, most: int) -> list[PoseVisits]:
    """The visits that stand out most, one by one, and with the others of their pose."""
    worst = np.argsort(-np.where(standing.wrong, standing.misfit, -1.0))[: min(most, int(standing.wrong.sum()))]
    out = [group_of(standing, (v,)) for v in worst.tolist()]
    pose = np.zeros(len(standing.visits), dtype=np.intp)
    pose[standing.visits.of] = standing.rows.pose
    for p in dict.fromkeys(pose[worst].tolist()):
        both = tuple(np.flatnonzero(pose == p).tolist())
        if len(both) > 1:
            out.append(group_of(standing, both))
    return out


def group_of(standing: Standing, visits: tuple[int, ...]) -> PoseVisits:
    """Rows and states of some visits."""
    rows = standing.rows.keep[np.isin(standing.visits.of, visits)]
    return PoseVisits(visits, rows, np.array([s for v in visits for s in standing.visits.states[v]], dtype=np.intp))


def plain(readings: Readings, group: PoseVisits, kind: str, slip: str = OFF) -> Edit:
    """The edit that changes nothing, to start from."""
    poses = readings.poses
    return Edit(
        kind=kind,
        slip=slip,
        visits=group.visits,
        rows=group.rows,
        states=group.states,
        pendant=poses.pendant[group.states],
        wrench=poses.wrench[group.states],
        value=readings.value[group.rows],
    )


def angle_edits(experiment: Experiment, readings: Readings, group: PoseVisits) -> Iterator[Edit]:
    """One angle, or travel, of the pose with another sign, decimal or unit, within what the controller can show."""
    start = plain(readings, group, "angle")
    for k in range(start.pendant.shape[1]):
        unit = experiment.robot.controller.units[k]
        for factor, slip in (*_JOINTS, (unit.per, UNIT), (unit.factor, UNIT)):
            edit = with_angle(start, k, start.pendant[0, k] * (factor - 1.0), slip, unit)
            moved = abs(edit.meant - edit.found) > 1e-9
            if moved and not experiment.robot.controller.outside(edit.pendant).any():
                yield edit


def with_angle(start: Edit, k: int, shift: float, slip: str, unit: JointUnit) -> Edit:
    """Angle or travel k of the pose, of this unit, moved by `shift` rad or m."""
    pendant = start.pendant.copy()
    pendant[:, k] += shift
    found = float(start.pendant[0, k])
    return replace(start, slip=slip, pendant=pendant, column=f"q{k + 1}", unit=unit, found=found, meant=found + shift)


def force_edits(readings: Readings, group: PoseVisits) -> Iterator[Edit]:
    """The pose's force with another sign, decimal or unit, along one axis or as a whole, or another load's."""
    start = plain(readings, group, "force")
    loaded = readings.states.loaded[group.states]
    if not loaded.any():
        return
    own = start.wrench[loaded][0]
    for factor, slip in _FORCES:
        yield with_force(start, loaded, own * factor, slip)
        for i in map(int, np.flatnonzero(own)):
            if np.count_nonzero(own) > 1:
                one = np.eye(6)[i] * own[i]
                yield with_force(start, loaded, own + (factor - 1.0) * one, slip)
    every, counts = np.unique(readings.poses.wrench[readings.states.loaded], axis=0, return_counts=True)
    for other in every[np.argsort(-counts)][:_LOADS]:
        if not np.array_equal(other, own):
            yield with_force(start, loaded, other, OTHER if own[other != 0.0].all() else MISSING)


def with_force(start: Edit, loaded: Flags, wrench: Array, slip: str) -> Edit:
    """Another wrench (6,) at the loaded states."""
    own = start.wrench[loaded][0]
    changed = np.flatnonzero(~np.isclose(own, wrench))
    one = len(changed) == 1
    at = int(changed[0]) if one else 0
    return replace(
        start,
        slip=slip,
        wrench=np.where(loaded[:, None], wrench, start.wrench),
        column=("fx", "fy", "fz", "mx", "my", "mz")[at] if one else "force",
        found=float(own[at] if one else np.linalg.norm(own)),
        meant=float(wrench[at] if one else np.linalg.norm(wrench)),
    )


def value_edits(readings: Readings, group: PoseVisits) -> Iterator[Edit]:
    """All readings of the pose, or of one of its markers, with another sign, decimal or unit."""
    start = plain(readings, group, "value")
    gauge = readings.is_gauge[group.rows]
    axes = _axes(readings, group)
    for factor, slip in VALUES:
        everything = replace(start, slip=slip, value=start.value * factor, column=", ".join(axes))
        yield replace(everything, kind="states_exchanged") if slip == SIGN and axes != "xyz" else everything
        if len(start.rows) > 1:
            for r in range(len(start.rows)):
                value = start.value.copy()
                value[r] *= factor
                yield replace(everything, value=value, touched=start.rows[[r]])
        for r, i in np.argwhere(np.isfinite(start.value) & ~gauge[:, None]).tolist():
            value = start.value.copy()
            value[r, i] *= factor
            found, meant, touched = float(start.value[r, i]), float(value[r, i]), start.rows[[r]]
            yield replace(
                start,
                slip=slip,
                value=value,
                column=axes[i],
                found=found,
                meant=meant,
                touched=touched,
            )


def _axes(readings: Readings, group: PoseVisits) -> Sequence[str]:
    """Columns of the file, without their unit, of displacements or positions."""
    return ("dx", "dy", "dz") if (readings.minus[group.rows] >= 0).all() else "xyz"


def marker_edits(readings: Readings, group: PoseVisits) -> Iterator[Edit]:
    """Two or three markers of one state exchanged."""
    start = plain(readings, group, "swapped_markers")
    whole = np.isfinite(start.value).all(axis=1) & ~readings.is_gauge[group.rows]
    rows = np.flatnonzero(whole)
    if len(group.visits) > 1 or not 2 <= len(rows) <= _MANY:
        return
    orders = [{a: b, b: a} for a, b in combinations(rows.tolist(), 2)]
    for a, b, c in combinations(rows.tolist(), 3):
        orders += [{a: b, b: c, c: a}, {a: c, c: b, b: a}]
    for order in orders:
        value = start.value.copy()
        value[list(order)] = start.value[list(order.values())]
        yield replace(start, value=value, column="marker", touched=start.rows[list(order)])


def state_edits(readings: Readings, group: PoseVisits) -> Iterator[Edit]:
    """Positions of the loaded and of the unloaded state of a pose exchanged."""
    start = plain(readings, group, "states_exchanged")
    if len(group.visits) != 2 or (readings.minus[group.rows] >= 0).any():
        return
    loaded = readings.states.loaded[readings.plus[group.rows]]
    value = start.value.copy()
    for m in np.unique(readings.marker[group.rows]):
        both = np.flatnonzero(readings.marker[group.rows] == m)
        if len(both) == 2 and loaded[both].sum() == 1:
            value[both] = start.value[both[::-1]]
    yield replace(start, value=value, column="state")


def repeated_readings(readings: Readings, group: PoseVisits, keep: Indices) -> Iterator[Edit]:
    """The readings of the pose are copies of those of another pose, to the last digit: what was measured is lost."""
    start = plain(readings, group, "repeated_readings")
    if len(group.visits) > 1 or not np.isfinite(start.value).all():
        return
    others = keep[~np.isin(readings.plus[keep], readings.plus[group.rows])]
    same = (np.abs(readings.value[others][:, None] - start.value[None]) < _SAME).all(axis=2)
    same &= readings.marker[others][:, None] == readings.marker[group.rows][None]
    for state in map(int, np.unique(readings.plus[others][same.any(axis=1)])):
        if same[readings.plus[others] == state].any(axis=0).all():
            other = readings.states.pose[state]
            yield replace(start, masked=True, other=other, column=", ".join(_axes(readings, group)))
            return


def exchanges(readings: Readings, one: PoseVisits, two: PoseVisits) -> Iterator[tuple[Edit, Edit]]:
    """The readings of two poses stand at each other's angles, under each other's force or their own, or at their own
    angles under each other's force."""
    loaded, wrench = readings.states.loaded, readings.poses.wrench
    if len(one.rows) != len(two.rows) or not np.array_equal(loaded[one.states], loaded[two.states]):
        return
    same = np.array_equal(wrench[one.states], wrench[two.states])
    for what in ("q",) if same else ("pose", "q", "force"):
        yield (_taken(readings, one, two, what), _taken(readings, two, one, what))


def _taken(readings: Readings, own: PoseVisits, other: PoseVisits, what: str) -> Edit:
    """Rows with the angles ("q"), the force, or both ("pose") of another pose."""
    start = plain(readings, own, "loads_exchanged" if what == "force" else "poses_exchanged")
    poses, name = readings.poses, readings.states.pose[int(other.states[0])]
    wrench = start.wrench if what == "q" else poses.wrench[other.states]
    pendant = start.pendant if what == "force" else poses.pendant[other.states]
    return replace(start, pendant=pendant, wrench=wrench, other=name, column=what)


def misfits(standing: Standing, edits: Sequence[Edit]) -> Array:
    """Misfit (E,) of the rows of each edit against the fit to the visits that agree, in squares of the noise."""
    return np.array([float(e @ e) for e in residuals(standing, edits)])


def vanishes(standing: Standing, edit: Edit, misfit: float) -> bool:
    """Whether an edit of this misfit makes readings so small that none at all would fit as well: where nothing is
    foretold to move, whatever makes readings smaller fits."""
    own = standing.readings.value[edit.rows]
    smaller = np.abs(np.nan_to_num(edit.value)) < np.abs(np.nan_to_num(own))
    if not smaller.any():
        return False
    nothing = replace(edit, value=np.where(smaller, 0.0, edit.value))
    return float(misfits(standing, [nothing])[0]) - misfit < SAYS


def residuals(standing: Standing, edits: Sequence[Edit]) -> list[Array]:
    """Errors (3 k,) of the rows of each edit, whitened by what predicts them.

    Edits are copies of their rows and states, asked of the model at once; those of values alone share one copy.
    """
    keys = [(e.visits, e.rows.tobytes()) if _still(standing.readings, e) else n for n, e in enumerate(edits)]
    asked: dict[object, Edit] = {}
    for key, e in zip(keys, edits, strict=True):
        asked.setdefault(key, e)
    readings = copied(standing, list(asked.values()))
    error, P = standing.foretold(readings, np.arange(len(readings)))
    ends = np.cumsum([len(e.rows) for e in asked.values()])[:-1]
    known = {
        key: (e.value, error_there, _whitening(p))
        for (key, e), error_there, p in zip(asked.items(), np.split(error, ends), np.split(P, ends), strict=True)
    }
    out: list[Array] = []
    for key, e in zip(keys, edits, strict=True):
        value, error_there, whitened = known[key]
        more = np.nan_to_num(e.value - value) / (standing.unit * standing.readings.sigma[e.rows])
        out.append(whitened @ (error_there + more).ravel())
    return out


def factor(standing: Standing, e: Edit) -> Array:
    """What whitens (3 k, 3 k) the errors of the rows of an edit by what predicts them."""
    readings = copied(standing, [e])
    return _whitening(standing.foretold(readings, np.arange(len(readings)))[1])


def _whitening(P: Array) -> Array:
    """Whitens by the covariance I + P P' of what is foretold, P (k, 3, f)."""
    p = P.reshape(-1, P.shape[-1])
    return np.asarray(np.linalg.inv(np.linalg.cholesky(np.eye(len(p)) + p @ p.T)), dtype=np.float64)


def _still(readings: Readings, e: Edit) -> bool:
    """Whether an edit leaves angles and forces as they are."""
    poses = readings.poses
    return np.array_equal(e.pendant, poses.pendant[e.states]) and np.array_equal(e.wrench, poses.wrench[e.states])


def _shared(readings: Readings, e: Edit) -> tuple[Indices, Indices, Indices]:
    """The states that the rows of an edit need beside its own, which it shares with others; the places (k,) of both
    states of its rows among its own and these, -1: none."""
    plus, minus = readings.plus[e.rows], readings.minus[e.rows]
    need = np.unique(np.concatenate([plus, minus[minus >= 0]]))
    more = need[~np.isin(need, e.states)]
    place = np.full(len(readings.states) + 1, -1, dtype=np.intp)
    place[np.concatenate([e.states, more])] = np.arange(len(e.states) + len(more))
    return more, place[plus], place[minus]


def copied(standing: Standing, edits: Sequence[Edit]) -> Readings:
    """One table with the rows of every edit, as it has them, after each other."""
    readings = standing.readings
    own, poses = readings.states, readings.poses
    parts: list[tuple[Array | Indices, ...]] = []
    known: dict[tuple[int, int], tuple[Indices, Indices, Indices]] = {}
    first = 0
    for e in edits:
        same = (id(e.rows), id(e.states))  # many edits of one call are of the same rows
        if same not in known:
            known[same] = _shared(readings, e)
        more, later, earlier = known[same]
        states = np.concatenate([e.states, more])
        pendant, wrench = (
            np.concatenate([a, b[more]]) for a, b in ((e.pendant, poses.pendant), (e.wrench, poses.wrench))
        )
        parts.append((states, first + later, np.where(earlier >= 0, first + earlier, -1), pendant, wrench))
        first += len(states)
    at, plus, minus, shown, wrench = (np.concatenate(column) for column in zip(*parts, strict=True))
    texts = {name: tuple(getattr(own, name)[i] for i in at.tolist()) for name in ("pose", "load_id", "series")}
    numbers = {name: getattr(own, name)[at] for name in ("loaded", "repeat", "cycle")}
    q = standing.experiment.robot.controller.to_joints(shown)
    rows = np.concatenate([e.rows for e in edits])
    return replace(
        readings.of_rows(rows),
        states=replace(own, poses=replace(poses.take(at), pendant=shown, q=q, wrench=wrench), **texts, **numbers),
        plus=plus,
        minus=minus,
        value=np.concatenate([e.value for e in edits]),
        use=np.ones(len(rows), dtype=bool),
        drive_state=None,
        reads=None,
    )
