"""The verb: readings that cannot be right are found and named with their rows; nothing is deleted.

The level is that of all tests together: clean readings give any false finding in at most `level` of cases.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from qsframework.errors import InputError, NotConverged, NotIdentifiable
from qsframework.experiment import Experiment, Readings, make_rows
from qsframework.plugin import Indices
from qsframework.screening.linearized import Linearized, linearized
from qsframework.screening.logging_faults import late_angles, swapped_markers, tool_misfit
from qsframework.screening.outliers import find_outliers, told_outliers
from qsframework.screening.rigidity import marker_rigidity
from qsframework.screening.rows import LEVEL, Finding, finding, lines, masked, unread

_TESTED = 4
"""Kinds that share the level; zeros and copies are no matter of chance."""
_MOST = 20
"""Gross displacements that are taken out one after the other."""


def screen(
    experiment: Experiment, readings: Readings, fit: Sequence[str] | None = None, level: float = LEVEL
) -> tuple[Finding, ...]:
    """Look for zero readings, duplicated rows, markers exchanged or touched, angles logged late, and gross errors, in
    this order: what one test explains, the next ones do not see.

    Tests that need a fit are left out where the readings cannot tell one. Findings of late angles and of swapped
    markers mask the rows they name.
    """
    experiment = experiment if fit is None else experiment.with_(fit=tuple(fit))
    found = unread(readings)
    share = level / _TESTED
    found += marker_rigidity(experiment, masked(readings, found), level)
    for kind, look in (("late angles", late_angles), ("swapped markers", swapped_markers)):
        found += _looked(experiment, readings, found, kind, look, share)
    found += _gross(experiment, readings, found, share)
    found += _looked(experiment, readings, found, "tool", tool_misfit, share)
    return tuple(found)


def _looked(
    experiment: Experiment,
    readings: Readings,
    found: list[Finding],
    kind: str,
    look: Callable[[Linearized, float], list[tuple[Indices, str]]],
    level: float,
) -> list[Finding]:
    fit = _fit(experiment, masked(readings, found))
    return [] if fit is None else [finding(kind, readings, rows, words) for rows, words in look(fit, level)]


def _fit(experiment: Experiment, readings: Readings) -> Linearized | None:
    try:
        return linearized(experiment, readings)
    except (InputError, NotIdentifiable, NotConverged, np.linalg.LinAlgError):
        return None


def _gross(experiment: Experiment, readings: Readings, found: list[Finding], level: float) -> list[Finding]:
    """Rows that belong under neither the fitted nor a richer model; of displacements also by data snooping: the row
    whose coordinates fit worst is taken out while it is beyond its level."""
    clean = masked(readings, found)
    try:
        rows = make_rows(clean)
    except InputError:
        return []
    outliers = find_outliers(experiment, clean)
    out = [] if outliers is None else told_outliers(clean, rows.keep, outliers)
    if clean.is_position[rows.keep].any():
        return out
    spoken = {r for one in out for r in one.rows}
    for _ in range(min(_MOST, max(1, len(readings) // 5))):
        fit = _fit(experiment, masked(readings, [*found, *out]))
        if fit is None:
            break
        alone = fit.fit.held_out(fit.row)
        p = np.ones(len(fit.keep))
        p[alone.label] = fit.fit.p_values(alone.chi2_drop, alone.size)
        worst = int(np.argmin(p))
        if p[worst] * len(p) >= level:
            break
        i = fit.keep[worst]
        off = fit.rows.spread(fit.fit.residuals)[worst]
        size = float(np.linalg.norm(off[np.isfinite(off)]) * 1e3)
        words = f"{lines(readings, np.array([i]))}: {size:.3f} mm off what the other readings say (p = {p[worst]:.1g})"
        if int(readings.line[i]) not in spoken:
            out.append(finding("gross", readings, np.array([i]), words))
    return out
