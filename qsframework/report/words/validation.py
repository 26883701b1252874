"""A validation in words."""

from __future__ import annotations

import numpy as np

from qsframework.estimation import rms
from qsframework.identify.validate import Validation
from qsframework.report.blocks import Mark, Verdict
from qsframework.report.words.sizes import mm


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


def validation_verdict(found: Validation) -> Verdict:
    """Whether the fit is better than the nominal arm at these readings, and how large the errors are."""
    mean, most, largest = found.whole.summary()
    nominal = found.whole.summary(before=True)[0]
    what = "mean 3D error"
    if not np.isfinite(mean):
        mean, nominal, what = rms(found.whole.errors), rms(found.whole.before), "error, RMS per axis"
    mark, word = Mark.GOOD, "Holds at held-out readings"
    if found.seen:
        mark, word = Mark.LOOK, "No test: the fit has seen these readings"
    if not mean < nominal:
        mark, word = Mark.BAD, "No better than the nominal model"
    return Verdict(
        mark,
        word,
        validation_words(found),
        (
            (f"{mm(mean)} mm", what),
            (f"{mm(most)} mm", "95 % are below"),
            (f"{mm(largest)} mm", "largest"),
            (f"{mm(nominal)} mm", f"{what} before the fit"),
        ),
    )
