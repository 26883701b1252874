"""A validation in words."""

from __future__ import annotations

import numpy as np

from qsframework.estimation import rms
from qsframework.fits.validate import Validation
from qsframework.report.blocks import Mark, Verdict
from qsframework.report.words.sizes import mm


def validation_words(found: Validation) -> str:
    """The errors of a fit at readings in one sentence: before, after, and how they are distributed."""
    before, (after, _, most, largest) = _rms(found, before=True), (_rms(found), *found.whole.summary()[1:])
    more = f"; 95 % {mm(most)}, max {mm(largest)} mm" if np.isfinite(most) else ""
    where = f"{found.whole.count} held-out readings"
    if found.halves:
        where = f"the held-out halves, {found.halves} random halves"
    elif found.seen:
        where = "the readings of the fit"
    return f"{mm(before)} \u2192 {mm(after)} mm ({_metric(found)} at {where}){more}."


def _metric(found: Validation) -> str:
    return "3D RMS" if np.isfinite(found.whole.summary()[0]) else "RMS per axis"


def _rms(found: Validation, before: bool = False) -> float:
    """3D RMS of the errors, m; per axis where no reading has three."""
    size = found.whole.summary(before)[0]
    return size if np.isfinite(size) else rms(found.whole.before if before else found.whole.errors)


def validation_verdict(found: Validation) -> Verdict:
    """Whether the fit is better than the nominal model at these readings, and how large the errors are."""
    after, nominal = _rms(found), _rms(found, before=True)
    _, _, most, largest = found.whole.summary()
    mark, word = Mark.GOOD, "Validated on held-out data"
    if found.seen:
        mark, word = Mark.LOOK, "Not a validation: these readings were used in the fit"
    if found.refuted:
        mark, word = Mark.BAD, f"Refuted: held-out poses of the fit's own are missed by {mm(found.own_error)} mm"
    if not after < nominal:
        mark, word = Mark.BAD, "No better than the nominal model"
    return Verdict(
        mark,
        word,
        validation_words(found),
        (
            (f"{mm(after)} mm", f"held-out error, {_metric(found)}"),
            (f"{mm(nominal)} mm", "the same by the nominal model"),
            (f"{mm(most)} mm", "95 % are below"),
            (f"{mm(largest)} mm", "largest"),
        ),
    )
