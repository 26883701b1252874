"""Absolute positions that cannot be right: found, named with their rows, masked and said; nothing is deleted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from qsframework.errors import InputError, NotConverged, NotIdentifiable
from qsframework.experiment import Experiment, StateReadings
from qsframework.identify.absolute import GROSS, PositionFit, identify_positions
from qsframework.identify.hygiene import LEVEL, Finding, finding, lines, masked, unread
from qsframework.identify.tools import Shape, Tool, judged, mended, misfits, one_wrong, orders, tools
from qsframework.plugin import Array, Indices

_CLEAR = 5.0
"""An order of the markers is told from another where it fits so many times better, and by more than _FAR."""
_FAR = 2e-3
"""m: how well the places of markers on the tool are known."""


def check_positions(
    experiment: Experiment, states: StateReadings, fit: Sequence[str] | None = None, level: float = LEVEL
) -> tuple[Finding, ...]:
    """Look for zero readings, duplicated rows, swapped markers, states whose marker distances are not those of the
    rigid tool, and gross errors, in this order: what one test explains, the next ones do not see.

    Distances are compared between the states of a series, so that they need no model and no tracker frame. Gross errors
    are those that the fit of the positions masks; they are left out where it cannot be made. `level` is that of all
    distances together.
    """
    found = unread(states, states.position, "position")
    found += _exchanged_everywhere(experiment, masked(states, found))
    for tool in tools(experiment, masked(states, found)):
        found += _distances(experiment, states, tool, level)
    return tuple(found + _misplaced(experiment, states, found, fit))


def _names(experiment: Experiment, marker: Indices) -> str:
    names = [experiment.markers[int(m)].name for m in marker]
    return " and ".join(names) if len(names) < 3 else f"{', '.join(names[:-1])} and {names[-1]}"


def _exchanged_everywhere(experiment: Experiment, states: StateReadings) -> list[Finding]:
    """Markers whose shape is that of the experiment in another order."""
    found: list[Finding] = []
    for tool in tools(experiment, states):
        nominal = np.array([experiment.markers[int(m)].xyz for m in tool.marker])
        shape, _ = judged(tool, LEVEL)
        one = Tool(tool.marker, np.arange(len(nominal))[None], shape.points[None], np.ones((1, len(nominal))), False)
        here = _apart(one, nominal)
        best, order = min(
            ((_apart(one.ordered(0, o), nominal), o) for o in orders(one, 0)), key=lambda t: t[0], default=(here, None)
        )
        if order is None or here < max(_CLEAR * best, _FAR):
            continue
        moved = np.flatnonzero(order != np.arange(len(order)))
        rows = tool.rows[:, moved]
        words = (
            f"markers {_names(experiment, tool.marker[moved])} are exchanged in all states: their distances are "
            f"{here * 1e3:.1f} mm off the experiment's, and {best * 1e3:.1f} mm if exchanged. Change the names"
        )
        found.append(finding("swapped markers", states, np.sort(rows[rows >= 0]), words))
    return found


def _apart(tool: Tool, shape: Array) -> float:
    """RMS distance of one state's markers from the shape, m."""
    return float(np.sqrt(misfits(tool, shape)[0] / len(shape)))


def _distances(experiment: Experiment, states: StateReadings, tool: Tool, level: float) -> list[Finding]:
    """States that do not have the tool's shape: by exchanged markers, by one wrong marker, or by several."""
    shape, bad = judged(tool, level)
    found: list[Finding] = []
    for s in np.flatnonzero(bad).tolist():
        order = mended(tool, shape, s)
        if order is not None:
            moved = np.flatnonzero(order != np.arange(len(order)))
            found.append(_swapped(experiment, states, tool.rows[s, moved], tool.marker[moved], "the distances are"))
            continue
        k = one_wrong(tool, shape, s)
        rows = tool.rows[s, tool.read[s]] if k is None else tool.rows[s, [k]]
        name = "" if k is None else experiment.markers[int(tool.marker[k])].name
        who = f"marker {name} is not where it was on the tool: " if name else ""
        words = f"{lines(states, rows)}: {who}{_wrong_distances(experiment, tool, shape, s)}"
        found.append(finding("tool", states, rows, words))
    return found


def _wrong_distances(experiment: Experiment, tool: Tool, shape: Shape, s: int) -> str:
    """The distance that differs most from the tool's, in words."""
    here, usual = tool.points[s], shape.points
    off = {
        (a, b): float(np.linalg.norm(here[a] - here[b]) - np.linalg.norm(usual[a] - usual[b]))
        for a, b in combinations(np.flatnonzero(tool.read[s]).tolist(), 2)
    }
    a, b = max(off, key=lambda pair: abs(off[pair]))
    size = f"{abs(off[a, b]) * 1e3:.3f} mm {'longer' if off[a, b] > 0 else 'shorter'}"
    return f"the distance of {_names(experiment, tool.marker[[a, b]])} is {size} than in the other states"


def _swapped(
    experiment: Experiment, states: StateReadings, rows: Indices, marker: Indices, what: str
) -> Finding:  # fmt: skip
    order = np.argsort(rows)
    words = (
        f"{lines(states, rows[order])}: markers {_names(experiment, marker[order])} are exchanged: {what} right then"
    )
    return finding("swapped markers", states, rows, words)


def _misplaced(
    experiment: Experiment, states: StateReadings, found: list[Finding], names: Sequence[str] | None
) -> list[Finding]:
    """Gross errors of the fit of positions, and markers whose exchange mends them."""
    clean = masked(states, found)
    try:
        fit = identify_positions(experiment, clean, names)
        gross = np.flatnonzero(clean.use & np.isin(clean.rows, fit.masked))
        if not len(gross):
            return []
        errors = np.full(clean.position.shape, np.nan)
        predicted, measured = fit.predict(clean)
        errors[clean.use] = measured - predicted
        places = _Places(fit, clean, errors)
    except (InputError, NotIdentifiable, NotConverged, np.linalg.LinAlgError):
        return []
    out: list[Finding] = []
    for m in dict.fromkeys(clean.measurement[gross].tolist()):
        rows = gross[clean.measurement[gross] == m]
        moved = places.exchanged(rows)
        if moved is not None:
            out.append(_swapped(experiment, states, moved, states.marker[moved], "the positions are"))
            rows = np.setdiff1d(rows, moved)
        for i in rows.tolist():
            size = float(np.linalg.norm(places.errors[i])) * 1e3
            words = f"{lines(states, np.array([i]))}: {size:.3f} mm off where the fit of the other readings puts it"
            out.append(finding("gross", states, np.array([i]), words))
    return out


@dataclass(frozen=True, eq=False)
class _Places:
    """Where a fit puts the rows in use; errors (R, 3) m, NaN in rows that are not used."""

    fit: PositionFit
    states: StateReadings
    errors: Array

    @property
    def largest(self) -> float:
        """Beyond it a reading is a gross error."""
        return GROSS * float(np.median(np.linalg.norm(self.fit.residuals, axis=1))) / 1.538

    def exchanged(self, rows: Indices) -> Indices | None:
        """Rows of one state that are all right in another order; None where there is no such order."""
        states = self.states
        if len(rows) < 2:
            return None
        link = np.array([site.link for site in self.fit.model.markers])[states.marker[rows]]
        there = states.position[rows] - self.errors[rows]
        one = Tool(
            states.marker[rows], np.arange(len(rows))[None], states.position[rows][None], np.ones((1, len(rows))), False
        )
        best: tuple[float, Indices] | None = None
        for order in orders(one, 0):
            moved = order != np.arange(len(order))
            off = float(np.linalg.norm(states.position[rows][order] - there, axis=1)[moved].max())
            if off < self.largest and len(set(link[moved].tolist())) == 1 and (best is None or off < best[0]):
                best = off, rows[moved]
        return None if best is None else best[1]
