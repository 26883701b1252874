"""Corrected targets in words."""

from __future__ import annotations

import numpy as np

from qsframework.report.blocks import Mark, Verdict
from qsframework.report.words.sizes import mm
from qsframework.uses.compensate import Compensation

_HARDLY = 0.5
"""Share of the uncorrected distance above which what is left says that the fit is too uncertain there."""


def own_cause(result: Compensation) -> str:
    """What moves the tip without a load."""
    return "own weight and geometry" if result.account.positions else "own weight"


def compensation_verdict(result: Compensation) -> Verdict:
    """The largest distance without the correction and the one to be expected with it."""
    worst, names = result.worst, result.targets.name
    weak = [n for n, size, sd in zip(names, result.uncorrected, result.sd, strict=True) if sd > _HARDLY * size]
    moved = len(names) - int(result.kept.sum())
    mark, word = Mark.GOOD, "Corrected"
    if result.notes:
        mark, word = Mark.LOOK, "Corrected, with notes"
    before = mm(result.uncorrected.max())
    said = (
        f"{moved} of {len(names)} target{'s' if len(names) > 1 else ''} corrected: {before} \u2192 "
        f"{mm(result.sd[worst])} mm (largest, predicted{result.at_level}; before: {mm(result.of_load.max())} by the "
        f"load, {mm(result.of_own.max())} by {own_cause(result)}; after: target {names[worst]})"
    )
    if weak:
        mark, word = Mark.LOOK, "Corrected, but the fit is too uncertain for some"
        said += f"; at {', '.join(weak[:3])} the correction gains less than half"
    return Verdict(
        mark,
        word,
        f"{said}.",
        (
            (f"{before} mm", "uncorrected, largest"),
            (f"{mm(result.sd[worst])} mm", "expected after, largest"),
            (f"{mm(float(np.sqrt(np.mean(result.sd**2))))} mm", "expected after, RMS"),
            (str(len(names)), "targets"),
        ),
    )
