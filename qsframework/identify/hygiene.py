"""Readings that cannot be right: found, named with their rows, masked and said; nothing is deleted.

The level is that of all tests together: clean readings give any false finding in at most `level` of cases.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from qsframework.errors import InputError, NotConverged, NotIdentifiable
from qsframework.experiment import Experiment, Readings, StateReadings
from qsframework.identify.fit import Masked
from qsframework.identify.mistakes import late_angles, swapped_markers, tool_misfit
from qsframework.identify.trial import Trial, trial
from qsframework.plugin import Array, Indices

Given = TypeVar("Given", Readings, StateReadings)
LEVEL = 0.01
KINDS = ("zero", "duplicate", "late angles", "swapped markers", "gross", "tool")
_TESTED = 4
"""Kinds that share the level; the first two are no matter of chance."""
_COARSE = 5e-6
"""m: repeats written no finer than this may be equal by chance."""
_MOST = 20
"""Gross readings that are taken out one after the other."""


@dataclass(frozen=True, eq=False)
class Finding:
    """What is wrong with some readings: rows are lines of the file, mask (R,) True where a row should not be used."""

    kind: str
    rows: tuple[int, ...]
    words: str
    mask: Array


def check_readings(experiment: Experiment, readings: Readings, level: float = LEVEL) -> tuple[Finding, ...]:
    """Look for zero readings, duplicated rows, angles logged late, swapped markers, gross errors, and poses that the
    rigid tool does not allow, in this order: what one test explains, the next ones do not see.

    The first two need no model; the others compare with a fit of the experiment's parameters, and are left out where
    the readings cannot tell these. Findings of late angles and of swapped markers mask the rows they name.
    """
    found = unread(readings, readings.displacement, "displacement")
    share = level / _TESTED
    for kind, look in (("late angles", late_angles), ("swapped markers", swapped_markers)):
        found += _looked(experiment, readings, found, kind, look, share)
    found += _gross(experiment, readings, found, share)
    found += _looked(experiment, readings, found, "tool", tool_misfit, share)
    return tuple(found)


def _looked(
    experiment: Experiment, readings: Readings, found: list[Finding], kind: str,
    look: Callable[[Trial, float], list[tuple[Indices, str]]], level: float,
) -> list[Finding]:  # fmt: skip
    fit = _trial(experiment, masked(readings, found))
    return [] if fit is None else [finding(kind, readings, rows, words) for rows, words in look(fit, level)]


def masked(readings: Given, findings: list[Finding] | tuple[Finding, ...]) -> Given:
    """The same readings with `use` False where a finding says so."""
    use = np.array(readings.use, dtype=bool)
    for one in findings:
        use[one.mask.astype(bool)] = False
    return replace(readings, use=use)


def said_of(findings: Sequence[Finding], readings: Readings | StateReadings) -> tuple[Masked, ...]:
    """The findings as a fit of the masked readings keeps them: `replace(fit, cleaned=...)`."""
    what = "displacements" if isinstance(readings, Readings) else "positions"
    return tuple(Masked(one.kind, tuple(sorted(one.rows)), one.words, what) for one in findings)


def finding(kind: str, readings: Readings | StateReadings, index: Indices, words: str) -> Finding:
    """What is wrong with the rows at `index` (k,) of the readings."""
    mask = np.zeros(len(readings.use), dtype=bool)
    mask[index] = True
    return Finding(kind, tuple(int(r) for r in readings.rows[index]), words, mask)


def _trial(experiment: Experiment, readings: Readings) -> Trial | None:
    try:
        return trial(experiment, readings)
    except (InputError, NotIdentifiable, NotConverged, np.linalg.LinAlgError):
        return None


def unread(readings: Readings | StateReadings, values: Array, what: str) -> list[Finding]:
    """Values (R, 3) m that are zero to the last digit, where the instrument did not read; and copies of other rows, of
    which the first one stays."""
    found: list[Finding] = []
    rows = np.flatnonzero(readings.use & ~np.any(values, axis=1))
    if len(rows):
        words = f"{lines(readings, rows)}: the {what} is exactly zero: nothing was read"
        found.append(finding("zero", readings, rows, words))
    seen: dict[object, int] = {}
    coarse = bool(np.allclose(values / _COARSE, np.round(values / _COARSE), atol=1e-6))
    copies: dict[int, list[int]] = {}
    for i in np.flatnonzero(readings.use & np.any(values, axis=1)).tolist():
        first = seen.setdefault(np.round(np.asarray(values[i]), 12).tobytes(), i)
        if coarse and readings.pose[readings.measurement[i]] == readings.pose[readings.measurement[first]]:
            continue
        if first != i and np.count_nonzero(values[i]) == 3:
            copies.setdefault(first, []).append(i)
    for first, more in copies.items():
        words = f"{lines(readings, np.array(more))}: the same {what} to the last digit as in row {readings.rows[first]}"
        found.append(finding("duplicate", readings, np.array(more), f"{words}: a row was copied"))
    return found


def _gross(
    experiment: Experiment, readings: Readings, found: list[Finding], level: float
) -> tuple[Finding, ...]:  # fmt: skip
    """Data snooping: the row whose three coordinates fit worst is taken out while it is beyond its level."""
    out: list[Finding] = []
    for _ in range(min(_MOST, max(1, len(readings.use) // 5))):
        fit = _trial(experiment, masked(readings, [*found, *out]))
        if fit is None:
            break
        p = fit.row_p_values()
        worst = int(np.argmin(p))
        if p[worst] * len(p) >= level:
            break
        i = fit.keep[worst]
        size = float(np.linalg.norm(fit.residuals[worst]) * 1e3)
        words = f"{lines(readings, np.array([i]))}: {size:.3f} mm off what the other readings say (p = {p[worst]:.1g})"
        out.append(finding("gross", readings, np.array([i]), words))
    return tuple(out)


def lines(readings: Readings | StateReadings, rows: Indices) -> str:
    """Rows with their poses: `row 7 (pose 3)`."""
    told = [f"{readings.rows[i]} (pose {readings.pose[readings.measurement[i]]})" for i in rows[:5]]
    more = f" and {len(rows) - 5} more" if len(rows) > 5 else ""
    return f"row{'s' if len(rows) > 1 else ''} {', '.join(told)}{more}"
