"""Conventions to try: other readings of the same file, other angles of the same controller, other structures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain, combinations, permutations, product

import numpy as np

from qsframework.elastostatics.so3 import cross_matrix, exponential
from qsframework.errors import InputError, listed
from qsframework.estimation.projection import least_squares
from qsframework.experiment import Experiment, Readings, as_shown, on_robot
from qsframework.hypotheses.catalogue.rows import as_series
from qsframework.hypotheses.hypothesis import Hypothesis
from qsframework.hypotheses.linearized import linear_model, of_observations
from qsframework.plugin import Array, Indices
from qsframework.plugin.registry import with_role
from qsframework.robot import StructuralChange, alternatives


def couplings(experiment: Experiment, readings: Readings) -> Iterator[Hypothesis]:
    """An angle that is absolute where the file says relative, or the reverse, at every joint that moves."""
    robot, model = experiment.robot, experiment.model()
    moves = dict(zip(robot.facts.driven, readings.moves, strict=True))
    held = dict(zip(model.names, model.nominal, strict=True))
    markers = tuple(m.name for m in experiment.markers)
    for effect in (e for kind in with_role("shown angle") for e in kind.places(robot.facts, markers)):
        if not moves[effect.where]:
            continue
        (own,) = effect.parameters(robot.facts)
        here = experiment.with_effects([effect])
        others = tuple(p for p in experiment.parameters if p.name != own.name)
        for value in (1.0, -1.0):
            fixed = replace(own, nominal=held.get(own.name, 0.0) + value)
            sign = "plus" if value > 0 else "minus"
            words = (
                f"{own.name} = {value:+g}: the true angle of {effect.where} is the file's {sign} the shown angle of "
                "the joint before it; an absolute angle was read as relative, or the reverse"
            )
            yield Hypothesis(own.name, value, words, here.with_(parameters=(*others, fixed)), readings=readings)


def joint_signs(experiment: Experiment, readings: Readings, together: Sequence[int] = (1,)) -> Iterator[Hypothesis]:
    """Every angle of a joint that moves reversed, or those of so many joints together."""
    moving = np.flatnonzero(readings.moves).tolist()
    for turned in chain.from_iterable(combinations(moving, count) for count in together):
        joints = [experiment.robot.facts.driven[k] for k in turned]
        pendant = np.array(readings.poses.pendant)
        pendant[:, turned] *= -1.0
        what = "travel" if experiment.robot.facts.slides(joints[0]) else "angle"
        words = f"the {what} of {joints[0]} counts the other way round"
        if len(joints) > 1:
            words = f"the values of {listed(joints)} count the other way round"
        changed = _shown(experiment, readings, pendant)
        yield Hypothesis(f"joint_sign[{', '.join(joints)}]", -1.0, words, experiment, readings=changed)


_WITHOUT = "this arm does not behave as if it had {}"
_STRUCTURES = {
    StructuralChange.LOOP_ABSENT: _WITHOUT,
    StructuralChange.COUPLING_ABSENT: _WITHOUT,
    StructuralChange.BALANCER_ABSENT: _WITHOUT,
    StructuralChange.LOOP_PRESENT: "this arm behaves as if it had {}",
}


def structures(experiment: Experiment, readings: Readings) -> Iterator[Hypothesis]:
    """Loops, couplings and balancers that the file has and the arm has not, or the reverse; `couplings` has angles."""
    for other in alternatives(experiment.robot):
        if other.kind in _STRUCTURES:
            try:
                campaign = on_robot(experiment, other.robot)
                shown = as_shown(readings, campaign)
            except InputError:  # the campaign cannot be had on this structure
                continue
            words = f"{_STRUCTURES[other.kind].format(' and '.join(other.subjects))}, against its file"
            yield Hypothesis(other.id, 1.0, words, campaign, readings=shown)


def _orientations() -> list[Array]:
    """The 47 signed permutations of three axes that are not the identity."""
    out = [
        np.diag(signs) @ np.eye(3)[list(order)]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    return [P for P in out if not np.array_equal(P, np.eye(3))]


def _axes(P: Array, what: str) -> str:
    """`dx = -dy of the file` for each axis that changes."""
    said: list[str] = []
    for row, axis in zip(P, "xyz", strict=True):
        source = int(np.argmax(np.abs(row)))
        if row[source] != 1.0 or "xyz"[source] != axis:
            said.append(f"{what}{axis} is {'-' if row[source] < 0 else ''}{what}{'xyz'[source]} of the file")
    return ", ".join(said)


def displacement_axes(experiment: Experiment, readings: Readings) -> Iterator[Hypothesis]:
    """Signed permutations of the axes of the displacements; their reversal is a sign convention."""
    base = ~readings.is_position & (readings.frame < 0) & ~readings.is_gauge
    if not (base & readings.use).any():  # the axes of a series are found, whatever they are
        return
    for P in _orientations():
        name, value, words = "displacement_axes", 1.0, f"axes of the displacements: {_axes(P, 'd')}"
        if np.array_equal(P, -np.eye(3)):
            name, value = "displacement_sign", -1.0
            words = (
                "displacements are unloaded minus loaded, or the force is the one that the robot exerts: the sign of "
                "one of them is reversed"
            )
        changed = readings.with_values(np.where(base[:, None], readings.value @ P.T, readings.value))
        yield Hypothesis(name, value, words, experiment, readings=changed)


def force_axes(experiment: Experiment, readings: Readings) -> Iterator[Hypothesis]:
    """Axes of the load cell. Its reversal is that of the displacements, and moments turn as axial vectors do."""
    wrench = readings.poses.wrench
    if not wrench.any():
        return
    few = np.unique(np.argmax(np.abs(wrench), axis=0))  # where most differs, so that all loads are seldom compared
    seen = [wrench, -wrench]
    for P in _orientations():
        turned = np.hstack([wrench[:, :3] @ P.T, np.linalg.det(P) * wrench[:, 3:] @ P.T])
        alike = np.isclose(turned[few], np.stack([w[few] for w in seen])).all(axis=(1, 2))
        if any(np.allclose(turned, seen[i]) for i in np.flatnonzero(alike)):
            continue
        seen.append(turned)
        words = f"axes of the force: {_axes(P, 'f')}"
        changed = readings.with_poses(replace(readings.poses, wrench=turned))
        yield Hypothesis("force_axes", 1.0, words, experiment, readings=changed)


_FEW = {"rad": 2.0 * np.pi, "m": 20.0}
"""Numbers of a column that all stay below it, in deg, or mm, as the file has them, may be radians, or metres."""
_FORCE = ("fx", "fy", "fz")
_MOVED = 1e-3
"""rad or m: a joint whose angles differ by less in all poses tells nothing of its column."""


def angle_units(experiment: Experiment, readings: Readings) -> Iterator[Hypothesis]:
    """Columns of angles in radians under headers of degrees, of travels in m under mm, or the reverse: one, or all."""
    pendant, joints = readings.poses.pendant, experiment.robot.controller.units
    largest = np.abs(pendant).max(axis=0)
    units = [joints[k] for k in range(len(joints))]
    most = np.array([_FEW[u.si] for u in units])
    few, many = largest * [u.per for u in units] <= most, largest > most
    moved = readings.moves & (largest >= _MOVED)
    single = [(k,) for k in np.flatnonzero(moved & (few | many)).tolist()]
    turning = moved & ~np.array(joints.sliding)
    every = [tuple(np.flatnonzero(turning).tolist())] if turning.sum() > 1 and few[turning].all() else []
    for columns in (*every, *single):
        unit, small = joints[columns[0]], bool(few[columns[0]])
        there, here, factor = (unit.si, unit.shown, unit.per) if small else (unit.shown, unit.si, unit.factor)
        angles = pendant.copy()
        angles[:, columns] *= factor
        if not experiment.robot.controller.outside(angles).any():
            names = [f"q{k + 1}" for k in columns]
            changed = _shown(experiment, readings, angles)
            yield _in_unit(experiment, changed, names, factor, f"{there}, not in {here}")


def _in_unit(
    experiment: Experiment, changed: Readings, columns: Sequence[str], factor: float, unit: str, shrunk: float = 0.0
) -> Hypothesis:
    """Columns of the file in another unit than their headers'."""
    names = ", ".join(columns)
    words = f"the columns {names} are in {unit}" if len(columns) > 1 else f"the column {names} is in {unit}"
    return Hypothesis(
        "column_unit",
        factor,
        words,
        experiment,
        readings=changed,
        column=names,
        shrunk=shrunk,
    )


def joint_columns(experiment: Experiment, readings: Readings) -> Iterator[Hypothesis]:
    """The angles, or the travels, of two joints exchanged; or those of all joints each in the next one's column, as
    where a log counts them from zero or leaves the first one out."""
    pendant, sliding = readings.poses.pendant, experiment.robot.controller.units.sliding
    count = pendant.shape[1]
    every = np.arange(count, dtype=np.intp)
    orders: list[tuple[Indices, str, str]] = []
    for a, b in combinations(range(count), 2):
        if sliding[a] == sliding[b] and readings.moves[a] and readings.moves[b]:
            order = every.copy()
            order[[a, b]] = b, a
            orders.append((order, f"the columns q{a + 1} and q{b + 1} are exchanged", f"q{a + 1}, q{b + 1}"))
    for by, where in ((1, "after"), (-1, "before")) if count > 2 and readings.moves.all() and not any(sliding) else ():
        words = f"each column of angles holds the joint {where} its own, as where a log counts them from zero"
        orders.append((np.roll(every, by), words, f"q1 to q{count}"))
    for order, words, column in orders:
        angles = pendant[:, order]
        if not experiment.robot.controller.outside(angles).any():
            changed = _shown(experiment, readings, angles)
            yield Hypothesis("joint_columns", 1.0, words, experiment, readings=changed, column=column)


def _shown(experiment: Experiment, readings: Readings, pendant: Array) -> Readings:
    q = experiment.robot.controller.to_joints(pendant)
    return readings.with_poses(replace(readings.poses, pendant=pendant, q=q))


_LENGTHS = ((10.0, "cm"), (1e3, "m"), (25.4, "inches"))
"""Factor of a number of millimetres that a file holds in another unit."""
_WEIGHTS = ((9.80665, "kgf (or daN)"), (4.4482216, "lbf"), (1e3, "kN"))


def value_units(experiment: Experiment, readings: Readings) -> Iterator[Hypothesis]:
    """A column of displacements or positions in another unit than its header's; all columns of positions."""
    for position in (False, True):
        rows = (readings.is_position == position) & ~readings.is_gauge
        if not (rows & readings.use).any():
            continue
        names = "xyz" if position else ("dx", "dy", "dz")
        for axes in ([0], [1], [2], *([[0, 1, 2]] if position else [])):
            for factor, unit in _both(_LENGTHS, "mm"):
                value = readings.value.copy()
                value[np.ix_(rows, axes)] *= factor
                changed, smaller = readings.with_values(value), min(float(np.log(factor)), 0.0)
                yield _in_unit(experiment, changed, [names[i] for i in axes], factor, unit, smaller)


def force_units(experiment: Experiment, readings: Readings) -> Iterator[Hypothesis]:
    """A column of forces in another unit than its header's, where another column keeps its own."""
    wrench = readings.poses.wrench
    used = [i for i in range(3) if wrench[:, i].any()]
    for i in used if len(used) > 1 else ():
        for factor, unit in _both(_WEIGHTS, "N"):
            scaled = wrench.copy()
            scaled[:, i] *= factor
            changed = readings.with_poses(replace(readings.poses, wrench=scaled))
            yield _in_unit(experiment, changed, [_FORCE[i]], factor, unit)


def _both(units: Sequence[tuple[float, str]], own: str) -> Iterator[tuple[float, str]]:
    for factor, name in units:
        yield factor, f"{name}, not in {own}"
        yield 1.0 / factor, f"{own}, not in {name}"


def position_axes(experiment: Experiment, readings: Readings) -> Iterator[Hypothesis]:
    """Positions in a frame that is to be found, mirrored: one sign, or two axes exchanged, it is the same."""
    for f, name in enumerate(readings.frames):
        rows = readings.is_position & (readings.frame == f) & ~readings.is_gauge
        if not (rows & readings.use).any() or readings.known[f] is not None:
            continue
        value = np.where(rows[:, None], readings.value * [1.0, 1.0, -1.0], readings.value)
        where = f" of series {name}" if name else ""
        words = f"the positions{where} are mirror images: the sign of one axis is reversed, or two are exchanged"
        changed = readings.with_values(value)
        yield Hypothesis(
            "position_axes",
            -1.0,
            words,
            experiment,
            readings=changed,
            column="x, y, z",
        )


def exchanged_states(experiment: Experiment, readings: Readings) -> Iterator[Hypothesis]:
    """Positions of loaded states that stand where those of the unloaded ones should, at all poses."""
    loaded = readings.states.loaded[readings.plus]
    order = np.arange(len(readings))
    rows = np.flatnonzero(readings.is_position & ~readings.is_gauge)
    unloaded = {_who(readings, i): i for i in rows[~loaded[rows]].tolist()}
    for i in rows[loaded[rows]].tolist():
        other = unloaded.get(_who(readings, i))
        if other is not None:
            order[i], order[other] = other, i
    if (order != np.arange(len(readings))).any():
        words = "the readings of the loaded and of the unloaded states are exchanged"
        changed = readings.with_values(readings.value[order])
        yield Hypothesis("states_exchanged", 1.0, words, experiment, readings=changed, column="state")


def _who(readings: Readings, i: int) -> tuple[object, ...]:
    s, states = int(readings.plus[i]), readings.states
    return states.pose[s], int(states.repeat[s]), int(states.cycle[s]), int(readings.marker[i]), int(readings.frame[i])


def tracker_axes(experiment: Experiment, readings: Readings) -> Iterator[Hypothesis]:
    """Displacements along the axes of a tracker that nobody aligned: a frame is found for them."""
    base = ~readings.is_position & (readings.frame < 0) & ~readings.is_gauge
    if not (base & readings.use).any():
        return
    words = "the displacements are along the axes of the tracker, not of the base"
    changed = as_series(readings, base, TRACKER)
    try:
        turned = linear_model(experiment, changed).frames[-1].rotation
    except InputError:  # too few, or all along one line
        return
    if np.trace(turned) < 1.0 + 2.0 * np.cos(_ALIGNED):
        yield Hypothesis(
            "tracker_axes",
            1.0,
            words,
            experiment,
            readings=changed,
            column="dx, dy, dz",
            free=3,
        )


def aligned(experiment: Experiment, turned: Readings, given: Readings) -> Readings:
    """Displacements along the axes of a tracker turned to those of the base, by the rotation that fits best.

    turned: with the frame that `tracker_axes` gives them; given: the readings before
    """
    fit = of_observations(experiment, linear_model(experiment, given))
    rows = fit.rows
    at = turned.frame[rows.keep] == turned.frames.index(TRACKER)
    rotation = linear_model(experiment, turned).frames[-1].rotation.T
    predicted = rows.scalars - fit.errors
    for _ in range(_SETTLES):  # the readings are turned and not the model: springs and turns then do not mix
        value = np.where(at[:, None], rows.measured @ rotation.T, rows.measured)
        turn = rows.flat(np.where(at[:, None, None], cross_matrix(np.nan_to_num(value)), 0.0))
        A = fit.noise.whiten(np.column_stack([turn, fit.slopes]))
        z = least_squares(A, fit.noise.whiten(rows.flat(value) - predicted), 1e-9)
        rotation = exponential(z[:3]) @ rotation
    wrong = turned.frame == turned.frames.index(TRACKER)
    return given.with_values(np.where(wrong[:, None], given.value @ rotation.T, given.value))


_SETTLES = 20
"""Steps of Gauss and Newton."""
_ALIGNED = np.deg2rad(10.0)
"""Axes nearer to those of the base may be the tracker's alignment, which is a cause of its own."""
TRACKER = "tracker axes"
"""Name of the series that displacements along unknown axes are taken for."""
