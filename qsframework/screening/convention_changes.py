"""Conventions to try: other readings of the same file, other angles of the same controller, other structures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np

from qsframework.errors import InputError
from qsframework.experiment import Experiment, Readings, as_shown, on_robot
from qsframework.plugin import Array, Indices, Poses
from qsframework.plugin.registry import with_role
from qsframework.robot import StructuralChange, alternatives
from qsframework.screening.linearized_fit import LinearizedFit
from qsframework.screening.logging_faults import moved_up, visits


@dataclass(frozen=True, eq=False)
class Change:
    """A convention before it is judged; name and value as in `Convention`."""

    name: str
    value: float
    words: str
    experiment: Experiment
    readings: Readings


def couplings(experiment: Experiment, readings: Readings) -> Iterator[Change]:
    """An angle that is absolute where the file says relative, or the reverse, at every joint."""
    robot, model = experiment.robot, experiment.model()
    held = dict(zip(model.names, model.nominal, strict=True))
    markers = tuple(m.name for m in experiment.markers)
    for effect in (e for kind in with_role("shown angle") for e in kind.places(robot.facts, markers)):
        (own,) = effect.parameters(robot.facts)
        here = experiment if own.name in held else experiment.with_(effects=(*experiment.effects, effect))
        others = tuple(p for p in experiment.parameters if p.name != own.name)
        for value in (1.0, -1.0):
            fixed = replace(own, nominal=held.get(own.name, 0.0) + value)
            sign = "plus" if value > 0 else "minus"
            words = (
                f"{own.name} = {value:+g}: the true angle of {effect.where} is the file's {sign} the shown angle of "
                "the joint before it; an absolute angle was read as relative, or the reverse"
            )
            yield Change(own.name, value, words, here.with_(parameters=(*others, fixed)), readings)


def joint_signs(experiment: Experiment, readings: Readings) -> Iterator[Change]:
    """Every joint angle reversed."""
    for k, joint in enumerate(experiment.robot.facts.driven):
        pendant = np.array(readings.poses.pendant)
        pendant[:, k] *= -1.0
        q = experiment.robot.controller.to_joints(pendant)
        poses = replace(readings.poses, pendant=pendant, q=q)
        words = f"the angle of {joint} counts the other way round"
        yield Change(f"joint_sign[{joint}]", -1.0, words, experiment, readings.with_poses(poses))


_WITHOUT = "this arm does not behave as if it had {}"
_STRUCTURES = {
    StructuralChange.LOOP_ABSENT: _WITHOUT,
    StructuralChange.COUPLING_ABSENT: _WITHOUT,
    StructuralChange.BALANCER_ABSENT: _WITHOUT,
    StructuralChange.LOOP_PRESENT: "this arm behaves as if it had {}",
}


def structures(experiment: Experiment, readings: Readings) -> Iterator[Change]:
    """Loops, couplings and balancers that the file has and the arm has not, or the reverse; `couplings` has angles."""
    for other in alternatives(experiment.robot):
        if other.kind in _STRUCTURES:
            try:
                campaign = on_robot(experiment, other.robot)
                shown = as_shown(readings, campaign)
            except InputError:  # the campaign cannot be had on this structure
                continue
            words = f"{_STRUCTURES[other.kind].format(' and '.join(other.subjects))}, against its file"
            yield Change(other.id, 1.0, words, campaign, shown)


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


def displacement_axes(experiment: Experiment, readings: Readings) -> Iterator[Change]:
    """Signed permutations of the axes of the displacements; their reversal is a sign convention."""
    base = readings.use & ~readings.is_position & (readings.frame < 0) & ~readings.is_gauge
    if not base.any():  # the axes of a series are found, whatever they are
        return
    for P in _orientations():
        reversed_ = np.array_equal(P, -np.eye(3))
        name = "displacement_sign" if reversed_ else "displacement_axes"
        words = (
            "displacements are unloaded minus loaded, or the force is the one that the robot exerts: the sign of one "
            "of them is reversed"
            if reversed_
            else f"axes of the displacements: {_axes(P, 'd')}"
        )
        yield Change(
            name,
            -1.0 if reversed_ else 1.0,
            words,
            experiment,
            readings.with_values(np.where(base[:, None], readings.value @ P.T, readings.value)),
        )


def force_axes(experiment: Experiment, readings: Readings) -> Iterator[Change]:
    """Axes of the load cell. Its reversal is that of the displacements, and moments turn as axial vectors do."""
    wrench = readings.poses.wrench
    if not wrench.any():
        return
    seen = [wrench, -wrench]
    for P in _orientations():
        turned = np.hstack([wrench[:, :3] @ P.T, np.linalg.det(P) * wrench[:, 3:] @ P.T])
        if any(np.allclose(turned, w) for w in seen):
            continue
        seen.append(turned)
        poses: Poses = replace(readings.poses, wrench=turned)
        yield Change("force_axes", 1.0, f"axes of the force: {_axes(P, 'f')}", experiment, readings.with_poses(poses))


def earlier(fit: LinearizedFit, rows: Indices) -> Readings:
    """The angles of a run of visits moved up by one; the last one's are missing, so it is masked."""
    seen = visits(fit)
    run = np.unique(seen.of[np.isin(fit.keep, rows)])
    poses = moved_up(fit.readings.poses, seen, range(int(run[0]), int(run[-1])))
    last = np.zeros(len(fit.readings), dtype=bool)
    last[fit.keep[seen.of == run[-1]]] = True
    return fit.readings.with_poses(poses).masked(last)
