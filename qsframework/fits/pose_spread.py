"""One pose is no campaign: it fits, and says nothing of the arm elsewhere."""

from __future__ import annotations

import numpy as np

from qsframework.errors import NotIdentifiable
from qsframework.plugin import Array

_SAME = 1e-3
"""rad: poses whose joint angles all differ by less are one pose, visited again."""


def check_pose_spread(q: Array, free: int, frames: bool = False) -> bool:
    """Whether a fit of `free` parameters is from one pose alone, by the states' joint angles q (N, n).

    Several parameters from one pose alone are refused (NotIdentifiable): how they share what was measured rests on one
    geometry, and no second pose can contradict it.
    frames: whether a tracker's frame is estimated beside them
    """
    if not len(q) or float(np.ptp(q, axis=0).max()) > _SAME:
        return False
    if free <= 1 and not frames:
        return True
    count = "the only measurement is" if len(q) == 1 else f"all {len(q)} measurements are"
    beside = " beside the tracker's frame" if frames else ""
    raise NotIdentifiable(
        f"{count} of one pose: {free} parameters{beside} would rest on a single geometry, and no other pose could "
        "contradict them. Measure more poses, spread over the work space (`qsf design` proposes them); or fit one "
        "parameter only, or hold the others fixed"
    )
