"""A validation in words."""

from __future__ import annotations

import numpy as np

from qsframework.estimation import rms
from qsframework.identify.validate import Validation


def validation_words(found: Validation) -> str:
    """The errors of a fit at readings in one sentence."""
    mean, most, largest = (1e3 * v for v in found.whole.summary())
    size = f"mean {mean:.3f}, 95 % {most:.3f}, at most {largest:.3f} mm"
    if not np.isfinite(mean):
        size = f"RMS {1e3 * rms(found.whole.errors):.3f} mm"
    if found.halves:
        return f"3D error at the halves that were not fitted, {found.halves} random halves: {size}."
    if found.seen:
        return f"These are the readings of the fit, which has seen them: 3D error {size}."
    return f"3D error at {found.whole.count} readings that the fit has not seen: {size}."
