"""What is to be shown: a robot by itself as a campaign, one pose as a plan, readings as a plan with their residuals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsframework.errors import InputError, Problem
from qsframework.experiment import (
    Constraints,
    Experiment,
    Frame,
    LoadCase,
    NoiseModel,
    Plan,
    ReadingRows,
    Readings,
    make_plan,
    make_rows,
)
from qsframework.plugin import Array, Indices, Poses
from qsframework.plugin.facts import frozen
from qsframework.robot import Robot
from qsframework.viz.show_scene import Residuals, place_poses

MOST = 40
"""Poses of readings that become steps: those with the largest residuals."""


def robot_alone(robot: Robot, point: Array) -> Experiment:
    """A campaign with a robot and nothing else: a load point (3,) m of the flange, its stated payload as the load."""
    loads = ()
    if robot.payload is not None:
        weight = np.concatenate([robot.payload * robot.gravity, np.zeros(3)])
        loads = (LoadCase("payload", frozen(weight), None),)
    file = robot.folder / "robot.yaml"
    return Experiment(
        path=file,
        robot=robot,
        load_point=frozen(point),
        markers=(),
        noise=NoiseModel(None),
        loads=loads,
        effects=(),
        parameters=(),
        fit=None,
        constraints=Constraints(),
        data=(),
    )


def one_pose(experiment: Experiment, pendant: Array | None, load: Array | None) -> Plan:
    """One pose: pendant angles (n,) rad, zero or the nearest allowed unless said; a wrench (6,), the first load."""
    robot = experiment.robot
    controller, facts = robot.controller, robot.facts
    if pendant is None:
        pendant = np.clip(np.zeros(controller.axes), controller.lower, controller.upper)
    if pendant.shape != (controller.axes,):
        raise InputError(f"a pose of {robot.name} has {controller.axes} angles, found {pendant.size}")
    outside = np.flatnonzero(controller.outside(pendant[None])[0])
    if len(outside):
        raise InputError(
            [
                Problem(
                    f"{facts.driven[k]} is outside its limits",
                    found=controller.units[k].text(pendant[k]),
                    allowed=controller.units[k].between(*controller.range_of(k)),
                    argument=("pose", ""),
                )
                for k in outside.tolist()
            ]
        )
    name = ""
    if load is None:
        load, name = (experiment.loads[0].wrench, experiment.loads[0].name) if experiment.loads else (np.zeros(6), "")
    words = ", ".join(f"{value:.4g}" for value in controller.units.shown(pendant))
    poses = Poses(pendant[None], controller.to_joints(pendant[None]), np.asarray(load)[None])
    return make_plan(poses, [name], names=[f"{words} {controller.units.one}"])


def residuals(
    experiment: Experiment, readings: Readings, x: Array, frames: Sequence[Frame] = (), linear: bool = False
) -> tuple[ReadingRows, Array]:
    """Rows that are used, and measured minus predicted (R, 3) m in the base's axes, at parameters x.

    frames: of the series that nobody knows, as a fit found them; those that it does not hold are found anew
    """
    rows, model = make_rows(readings), experiment.model()
    held = {f.series: f for f in frames}
    names = [readings.frames[f] for f in rows.estimated]
    own = [held[n] for n in names] if set(names) <= set(held) else rows.start(model, x)
    missed = rows.padded(np.nan_to_num(rows.measured) - rows.predict(model, x, own, linear))
    if readings.axes is not None:
        missed = np.einsum("rji,rj->ri", readings.axes[rows.keep], missed)
    known = dict(zip(rows.estimated, own, strict=True))
    for f, frame in enumerate(readings.known):
        at = rows.frame == f
        if at.any():
            missed[at] = missed[at] @ (frame or known[f]).rotation
    return rows, missed


def measured(
    experiment: Experiment, readings: Readings, x: Array, frames: Sequence[Frame] = ()
) -> tuple[Plan, Residuals]:
    """The poses with the largest residuals at parameters x, in the order of the readings, and all residuals on them."""
    rows, missed = residuals(experiment, readings, x, frames)
    measurement = rows.plus
    chosen, worst = largest_residuals(readings, measurement, missed)
    chosen = np.sort(chosen[:MOST])
    names = [f"{readings.states.pose[m]}, residual up to {1e3 * worst[m]:.3f} mm" for m in chosen]
    plan = make_plan(readings.poses.take(chosen), [""] * len(chosen), names=names)
    shown = np.isin(measurement, chosen)
    step = np.searchsorted(chosen, measurement[shown])
    return plan, _placed(experiment, rows.take(shown), missed[shown], step)


def largest_residuals(readings: Readings, state: Indices, missed: Array) -> tuple[Indices, Array]:
    """The states that residuals (R, 3) m are of, by row (R,), the largest first; and the largest residual of each of
    all states (S,) m."""
    worst = np.zeros(len(readings.poses))
    np.maximum.at(worst, state, np.linalg.norm(missed, axis=1))
    there = np.unique(state)
    return there[np.argsort(-worst[there], kind="stable")], worst


def floating(experiment: Experiment, readings: Readings, x: Array, frames: Sequence[Frame] = ()) -> Residuals:
    """All residuals at parameters x where their markers were, beside the poses of another plan."""
    rows, missed = residuals(experiment, readings, x, frames)
    return _placed(experiment, rows, missed, np.full(len(missed), -1))


def _placed(experiment: Experiment, rows: ReadingRows, missed: Array, pose: Indices) -> Residuals:
    state = place_poses(experiment, rows.readings.poses.q)
    positions = np.stack([marker.position for marker in state.markers])
    start = positions[rows.marker, :, rows.plus]
    return Residuals(start, missed, pose)
