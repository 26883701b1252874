"""Joint values of a table outside the limits: one problem for all rows of a column, with the convention that fits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations

import numpy as np
import numpy.typing as npt

from qsframework.errors import Problem
from qsframework.experiment.columns import WholeCheck
from qsframework.experiment.setup import Experiment
from qsframework.plugin import Array
from qsframework.robot import Controller

_ENOUGH = 3
"""Different values of a column that lets a convention be seen."""


def within_limits(experiment: Experiment, k: int) -> WholeCheck:
    """The check of the column of joint k."""
    controller, joint = experiment.robot.controller, experiment.robot.facts.driven[k]
    unit, (lower, upper) = controller.units[k], controller.range_of(k)

    def outside(values: Array) -> npt.NDArray[np.bool_]:
        return ~((values >= lower - controller.tolerance) & (values <= upper + controller.tolerance))

    def check(numbers: Mapping[str, Array], name: str) -> tuple[int, Problem] | None:
        values = numbers[f"q{k + 1}"]
        rows = np.flatnonzero(np.isfinite(values) & outside(values))
        if not len(rows):
            return None
        first, known = float(values[rows[0]]), np.isfinite(values)
        slip = abs(first) > 2.0 * np.pi and not outside(values[rows[:1]] * unit.factor).any()
        hint = _units_hint(name) if slip else None
        fits = [words for words, other in joint_conventions(controller, numbers, k) if not outside(other[known]).any()]
        if hint is None and fits and len(set(values.tolist())) >= _ENOUGH:
            hint = f"All rows are inside with {', or with '.join(fits)}. Compare a pose with what the pendant shows."
        many = f" in {len(rows)} of {len(values)} rows, of which this is the first" if len(rows) > 1 else ""
        message = f"{joint} is outside its limits{many}"
        found, allowed = unit.text(first, 4), unit.between(lower, upper)
        return int(rows[0]), Problem(message, found=found, allowed=allowed, hint=hint)

    return check


def joint_conventions(controller: Controller, numbers: Mapping[str, Array], k: int) -> Iterator[tuple[str, Array]]:
    """Values (R,) of joint k under other conventions of the table, each with its words."""
    own, sliding = numbers[f"q{k + 1}"], controller.units.sliding
    yield f"the sign of q{k + 1} reversed", -own
    for j in (k - 1, k + 1):
        other = numbers.get(f"q{j + 1}")
        if other is not None and not sliding[k] and not sliding[j]:
            for sign, values in (("-", own - other), ("+", own + other)):
                yield f"q{k + 1} {sign} q{j + 1} in place of q{k + 1} (the axes are coupled)", values
    if sliding[k]:
        return
    for zero in (90, -90, 180, -180):
        yield f"q{k + 1} {'+' if zero > 0 else '-'} {abs(zero)} deg (another zero)", own + np.deg2rad(zero)
    yield f"q{k + 1} counted from -180 to 180 deg", (own + np.pi) % (2.0 * np.pi) - np.pi


def other_angles(controller: Controller, pendant: Array) -> Iterator[tuple[str, Array]]:
    """Pendant values (N, n) under other conventions of the log, each with its words."""
    count = pendant.shape[1]
    turning = ~np.array(controller.units.sliding)
    yield "with angles in rad, not in deg", np.where(turning, np.rad2deg(pendant), pendant)
    yield "with angles in deg, not in rad", np.where(turning, np.deg2rad(pendant), pendant)
    numbers = {f"q{k + 1}": pendant[:, k] for k in range(count)}
    for k in range(count):
        for words, column in joint_conventions(controller, numbers, k):
            changed = pendant.copy()
            changed[:, k] = column
            yield f"with {words}", changed
    for a, b in combinations(range(count), 2):
        order = np.arange(count, dtype=np.intp)
        order[[a, b]] = b, a
        yield f"with the columns q{a + 1} and q{b + 1} exchanged", pendant[:, order]


def _units_hint(name: str) -> str | None:
    """Of a column whose numbers would be allowed in deg, or mm."""
    stem, _, unit = name.partition("_")
    words = {"rad": ("degrees", "deg"), "m": ("millimetres", "mm")}.get(unit)
    return f"The number looks like {words[0]}: call the column {stem}_{words[1]}." if words else None
