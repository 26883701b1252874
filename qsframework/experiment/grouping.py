"""Rows of a readings table: their markers, their errors, and the measurements that they belong to."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np
import numpy.typing as npt

from qsframework.errors import InputError, Problem, nearest
from qsframework.experiment.columns import MOST_PROBLEMS, Table
from qsframework.experiment.setup import Experiment
from qsframework.plugin import Array, Indices


def at(table: Table, i: int, stem: str, message: str, found: str = "", allowed: str | None = None,
       hint: str | None = None) -> Problem:  # fmt: skip
    """A problem in row i of a table, in the column of this stem."""
    return Problem(message, str(table.path), table.rows[i], table.names.get(stem, stem), found or None, allowed, hint)


def no_load(table: Table, experiment: Experiment) -> None:
    """InputError where the readings are of a load but the experiment does not say where it acts."""
    if not experiment.has_load:
        message = f"holds readings under load, but {experiment.path.name} does not say where the load acts"
        raise InputError(Problem(message, str(table.path), hint="Add for example load: {point_mm: [150, 0, 200]}."))


def marker_index(table: Table, experiment: Experiment, problems: list[Problem]) -> Indices:
    """Place of each row's marker in the experiment."""
    names = [m.name for m in experiment.markers]
    index = np.zeros(len(table.rows), dtype=np.intp)
    for i, name in enumerate(table.texts["marker"]):
        if name in names:
            index[i] = names.index(name)
        elif name and len(problems) <= MOST_PROBLEMS:
            message = "the experiment has no such marker"
            problems.append(at(table, i, "marker", message, repr(name), ", ".join(names), nearest(name, names)))
    return index


def read_sigma(table: Table, use: npt.NDArray[np.bool_], problems: list[Problem]) -> Array:
    """Standard deviations (R,) m, NaN where not stated; those in use must be positive."""
    sigma = table.numbers.get("sigma", np.full(len(table.rows), np.nan))
    for i in np.flatnonzero((sigma <= 0) & use)[:MOST_PROBLEMS]:
        problems.append(at(table, int(i), "sigma", "must be positive", f"{sigma[i]:g} m"))
    return sigma


def counts(table: Table, stem: str) -> list[int]:
    """A column of whole numbers, 1 where it is missing."""
    values = table.numbers.get(stem, np.ones(len(table.rows)))
    return np.nan_to_num(values, nan=1.0).astype(int).tolist()


def group(
    table: Table, keys: Sequence[Hashable], labels: Sequence[str], marker: Indices, constant: Array,
    problems: list[Problem],
) -> tuple[Indices, Indices]:  # fmt: skip
    """First row of each measurement, and the measurement of each row; its rows must agree in `constant`."""
    number: dict[Hashable, int] = {}
    first: list[int] = []
    seen: dict[tuple[int, int], int] = {}
    measurement = np.zeros(len(keys), dtype=np.intp)
    for i, key in enumerate(keys):
        m = number.setdefault(key, len(number))
        if m == len(first):
            first.append(i)
        measurement[i] = m
        if len(problems) > MOST_PROBLEMS:
            break
        if (m, int(marker[i])) in seen:
            other = table.rows[seen[m, int(marker[i])]]
            what = f"{labels[i]}, marker {table.texts['marker'][i]!r}"
            hint = "Delete the row if it is a copy; a second reading has a number of its own in the column repeat."
            problems.append(at(table, i, "pose", f"{what} stands here twice; first in line {other}", hint=hint))
        seen[m, int(marker[i])] = i
        if not np.array_equal(constant[i], constant[first[m]], equal_nan=True):
            pose, line = table.texts["pose"][i], table.rows[first[m]]
            message = f"pose {pose!r} has other angles, times or another load than in line {line}"
            problems.append(at(table, i, "pose", message + "; give it another pose name, repeat or cycle"))
    return np.array(first, dtype=np.intp), measurement
