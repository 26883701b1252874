"""One pose is no campaign: it fits, and says nothing of the arm elsewhere."""

from __future__ import annotations

import numpy as np

from qsframework.errors import NotIdentifiable
from qsframework.plugin import Array

_SAME = 1e-3
"""rad: poses whose joint angles all differ by less are one pose, visited again."""


def single_pose(q: Array, free: int, beside: str = "") -> tuple[str, ...]:
    """What to say of a fit of `free` parameters from measurements at joint angles q (N, n): nothing where poses differ.

    Several parameters from one pose alone are refused (NotIdentifiable): how they share what was measured rests on one
    geometry, and no second pose can contradict it. One parameter is fitted, with a note.
    beside: words on what else the fit estimates
    """
    if not len(q) or float(np.ptp(q, axis=0).max()) > _SAME:
        return ()
    if free <= 1:
        return ("Only one pose was measured: nothing says whether this fit holds at another one.",)
    count = "the only measurement is" if len(q) == 1 else f"all {len(q)} measurements are"
    instead = "fit one parameter only (--fit)"
    if not beside:
        instead += ", or hold the others (--fixed) or add stated values (--priors), both with --method one-step"
    raise NotIdentifiable(
        f"{count} of one pose: {free} parameters{beside} would rest on a single geometry, and no other pose could "
        f"contradict them. Measure more poses, spread over the work space (`qsf design` proposes them); or {instead}"
    )
