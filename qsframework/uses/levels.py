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
from qsframework.information.absorbed import FRAME, TOOL, Absorbed, absorbed, tip_motions
from qsframework.plugin import Array
from qsframework.robot.agreement import spread_poses
from qsframework.uses.inverse import TipPose, pose_error, poses_at

_POSES = 32
"""Poses over which frame and tool suit: nine numbers of 96."""
_STEP = 1e-2
"""Of a parameter's size."""


@dataclass(frozen=True, eq=False)
class Levels:
    """What the best frame, and the best frame and tool, take up of the parameters."""

    frame: Absorbed
    both: Absorbed

    def of(self, slope: Array, tip: TipPose) -> tuple[Array, Array, Array]:
        """Slopes (N, 6, p) of the tip by the parameters, at the three levels."""
        moved = tip_motions(tip.position, tip.rotation)
        return slope, self.frame.left(slope, moved), self.both.left(slope, moved)


def levels_of(experiment: Experiment, account: Account, names: Sequence[str], x: Array, wrench: Array) -> Levels:
    """What frame and tool take up of the parameters of these names, at values x of all (q,), under wrenches (N, 6)."""
    robot, model = experiment.robot, experiment.model()
    low, high = np.array(account.angles).reshape(-1, 2).T
    pendant = spread_poses(low, high, _POSES)
    poses = poses_at(robot, pendant, np.resize(wrench, (len(pendant), 6)))

    def stand(values: Array) -> TipPose:
        found = equilibrium(model, poses, values, loaded=True)
        return TipPose(found.tip, found.tip_rotation)

    slope, tip = tip_slope(model, names, x, stand)[:, :3], stand(x)
    moved = tip_motions(tip.position, tip.rotation)[:, :3]
    return Levels(absorbed(slope, moved, FRAME), absorbed(slope, moved, FRAME + TOOL))


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
