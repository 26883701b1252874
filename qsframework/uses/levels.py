"""What is left of errors of the tip in the base frame, after the frame that suits best, and after that and the tool.

The base frame holds only what the model contains: what turns the whole arm moves it all. Where the instrument's frame
was estimated, that part was not measured; where the places of markers were, neither was the tool. Both are taken out
of an error as they suit the arm best at its work, over the angles that were measured and under the loads of the
targets, by least squares.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics import Model, equilibrium
from qsframework.experiment import Experiment
from qsframework.experiment.account import Account
from qsframework.fits import FitRecord
from qsframework.information.absorbed import FRAME, TOOL, Absorbed, absorbed, tip_motions
from qsframework.plugin import Array, Load
from qsframework.uses.inverse import TipPose, pose_error, poses_at, rigid_tip

_POSES = 32
"""Poses over which frame and tool suit: nine numbers of 96."""
LEVELS = "in the base frame", "after the best frame", "after the best frame and tool"
_STEP = 1e-2
"""Of a parameter's size."""


@dataclass(frozen=True, eq=False)
class Levels:
    """What the best frame, and the best frame and tool, take up of the parameters and, the last column, of the error of
    the unloaded arm."""

    frame: Absorbed
    both: Absorbed

    def of(self, slope: Array, tip: TipPose) -> tuple[Array, Array, Array]:
        """What is left at the three levels of columns (N, 6, p + 1): d tip / d parameters, and that error."""
        moved = tip_motions(tip.position, tip.rotation)
        return slope, self.frame.left(slope, moved), self.both.left(slope, moved)


def levels_of(experiment: Experiment, account: Account, names: Sequence[str], x: Array, wrench: Array) -> Levels:
    """What frame and tool take up of the parameters of these names, at values x of all (q,), under wrenches (N, 6), and
    of the error of the unloaded arm."""
    robot, model = experiment.robot, experiment.model()
    low, high = np.array(account.angles).reshape(-1, 2).T
    pendant = np.random.default_rng(0).uniform(low, high, (_POSES, len(low)))
    poses = poses_at(robot, pendant, np.resize(wrench, (len(pendant), 6)))

    def stand(values: Array) -> TipPose:
        found = equilibrium(model, poses, values, loaded=True)
        return TipPose(found.tip, found.tip_rotation)

    tip, off = stand(x), equilibrium(model, poses, x, loaded=False).tip
    off = off - rigid_tip(robot, experiment.load_site, poses.q).position
    slope = np.concatenate([tip_slope(model, names, x, stand)[:, :3], off[:, :, None]], axis=2)
    moved = tip_motions(tip.position, tip.rotation)[:, :3]
    return Levels(absorbed(slope, moved, FRAME), absorbed(slope, moved, FRAME + TOOL))


def own_load(experiment: Experiment) -> list[str]:
    """Names of the errors of the campaign's own load, which the work does not bring."""
    model, own = experiment.model(), {e.name for e in experiment.effects if isinstance(e, Load)}
    parts = zip(model.effects, model.slices, strict=True)
    return [name for effect, part in parts if effect.name in own for name in model.names[part]]


def moving(experiment: Experiment, fit: FitRecord) -> list[str]:
    """Names of what was estimated and held, "" of what moves no tip of the work."""
    names, still = (*fit.names, *(h.name for h in fit.held)), own_load(experiment)
    return ["" if name in still else name for name in names]


def tip_slope(model: Model, names: Sequence[str], x: Array, stand: Callable[[Array], TipPose]) -> Array:
    """d tip / d parameters of these names (N, 6, p), by central differences of the full equilibrium.

    Parameters that are not the model's, such as the tracker's frame, move no tip.
    """
    out = np.zeros((len(stand(x)), 6, len(names)))
    for k, name in enumerate(names):
        if name in model.names:
            i = model.index([name])[0]
            step = np.zeros(len(x))
            step[i] = _STEP * max(model.parameters[i].scale, abs(x[i]))
            out[:, :, k] = pose_error(stand(x + step), stand(x - step)) / (2.0 * step[i])
    return out
