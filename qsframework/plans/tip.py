"""What a plan is to tell of the tip: how it moves with the parameters at the test poses, beside what a frame and a tool
that nobody states take up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from qsframework.elastostatics import Site, equilibrium
from qsframework.estimation import scales
from qsframework.experiment import Experiment
from qsframework.experiment.observations import start_values
from qsframework.information.absorbed import FRAME, TOOL, absorbed, tip_motions
from qsframework.plans.reading import unknown_frames
from qsframework.plugin import Array, Poses, Sensor

_ROUNDING = 1e-9
"""Of the largest slope: what is left where frame and tool take up all of it."""
_POSES = 200
"""Candidates that stand for the work, and over which frame and tool suit."""


def unstated(experiment: Experiment, names: Sequence[str]) -> tuple[int, ...]:
    """The motions of frame and tool that the readings of a plan for these parameters are to give, and hence do not
    measure: those of the base where it is known in no station's frame, those of the tool where markers are placed."""
    if not experiment.plans_positions:
        return ()
    frame = FRAME if len(unknown_frames(experiment)) == max(len(experiment.stations), 1) else ()
    return frame + (TOOL if experiment.model().names_of(Sensor) & {*names} else ())


def tip_rows(
    experiment: Experiment,
    poses: Poses | None,
    candidates: Array,
    names: Sequence[str],
    site: Site | None = None,
    beside: Sequence[int] = (),
) -> Array:
    """Sensitivity (J, 3, p) of the tip at test poses, m per unit of each scaled parameter: of its position where
    positions are planned, else of how far a load moves it.

    poses None: the first candidates under every load of the experiment stand for the work; site: the tip, where the
    poses' wrenches act, the load point if None; beside: the motions of frame and tool that are taken out of it as they
    suit best over the candidates
    """
    few, point = candidates[:_POSES], site or experiment.load_site
    if poses is None:
        cases = experiment.cases
        pendant = np.tile(few, (len(cases), 1))
        wrench = np.repeat(np.stack([load.wrench for load in cases]), len(few), axis=0)
        poses = Poses(pendant, experiment.robot.controller.to_joints(pendant), wrench)
    slope = _slope(experiment, poses, names, point)
    if not beside:
        return slope
    work = Poses(few, experiment.robot.controller.to_joints(few), np.resize(poses.wrench, (len(few), 6)))
    suited = absorbed(_slope(experiment, work, names, point), _moved(experiment, work, point), beside)
    left = suited.left(slope, _moved(experiment, poses, point))
    return np.where(np.abs(left) > _ROUNDING * np.abs(slope).max(), left, 0.0)


def _slope(experiment: Experiment, poses: Poses, names: Sequence[str], point: Site) -> Array:
    """How far the tip goes (N, 3, p) per unit of each scaled parameter."""
    model, x = experiment.model(), start_values(experiment, names)
    tip = replace(model, tip=point, markers=(*model.markers, point), marker_names=(*model.marker_names, "load point"))
    sensors = model.names_of(Sensor)  # of markers and the instrument, which move no tip
    size = scales([model.parameters[i] for i in model.index(names)]) * [name not in sensors for name in names]
    positions = experiment.plans_positions
    slope = tip.position_sensitivity(poses, x, names, loaded=True) if positions else tip.sensitivity(poses, x, names)
    return slope[:, -1] * size


def _moved(experiment: Experiment, poses: Poses, point: Site) -> Array:
    """How far frame and tool move the tip (N, 3, 9)."""
    found = equilibrium(replace(experiment.model(), tip=point), poses)
    return tip_motions(found.tip, found.tip_rotation)[:, :3]
