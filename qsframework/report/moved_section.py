"""Two campaigns of one arm side by side: what has moved, in words and as a table."""

from __future__ import annotations

from pathlib import Path

from qsframework.fits import Fit, FitRecord
from qsframework.fits.moved import LEVEL, moved, same_readings, together
from qsframework.report.blocks import ReportTable
from qsframework.report.words.sizes import number, shown_with_sd, unit_shown


def moved_words(fit: Fit, before: FitRecord) -> str:
    """Which parameters moved beyond their uncertainty between two campaigns."""
    if same_readings(fit, before):
        return "Both fits rest on the same readings, so their difference says nothing of the arm."
    found = moved(fit, before)
    gone = [f"{m.name} ({m.apart:+.1f} sd)" for m in found if m.beyond]
    if not found:
        return "The two campaigns have no parameter in common."
    if gone:
        agree = len(found) - len(gone)
        rest = "" if not agree else "; the other one agrees" if agree == 1 else f"; the other {agree} agree"
        return f"Moved beyond its uncertainty: {', '.join(gone)}{rest}. Look for a repair, a crash, or another load."
    if together(fit, before) < LEVEL:
        return "The arm has moved: no parameter alone, but all together. Look for a repair, a crash, or another load."
    return f"No parameter moved beyond its uncertainty: all {len(found)} agree in both campaigns."


def moved_table(fit: Fit, before: FitRecord) -> ReportTable:
    """Two fits of one robot, parameter by parameter, and how far apart they are in the sd of their difference."""
    rows = tuple(
        (
            m.name,
            shown_with_sd(m.value, m.sd, m.unit),
            shown_with_sd(m.before, m.sd_before, m.unit),
            unit_shown(m.unit),
            number(m.apart, "+.1f"),
            "moved" if m.beyond else "",
        )
        for m in moved(fit, before)
    )
    only = sorted({*fit.names} ^ {*before.names}, key=[*fit.names, *before.names].index)
    said = f" In one of them only: {', '.join(only)}." if only else ""
    return ReportTable(
        (
            "parameter",
            "this fit ± sd",
            f"{Path(before.path).name or 'the other fit'} ± sd",
            "unit",
            "change / its sd",
            "",
        ),
        rows,
        f"Moved: further than both uncertainties explain, at 1 % for all parameters together.{said}",
    )
