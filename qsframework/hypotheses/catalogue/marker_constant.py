"""A reflector whose constant nobody set: all readings of one marker are off along the line of sight."""

from __future__ import annotations

import numpy as np

from qsframework.estimation import LinearFit
from qsframework.estimation.projection import least_squares
from qsframework.experiment import observation_model
from qsframework.hypotheses.hypothesis import Hypothesis
from qsframework.hypotheses.linearized import Linearized
from qsframework.plugin import Array
from qsframework.plugin.build import build_effects
from qsframework.plugin.registry import with_role
from qsframework.plugin.settings import place_fields

_LEAST = 49.0
"""Fall of the sum of squares, in squares of the noise, below which no constant is called: s = 7."""
_FEWEST = 4
_BETTER = 12.0
"""By how much, in squares of the noise, a marker that sits elsewhere on its link must explain the readings worse."""
_RADII = (("0.5-inch", 6.35e-3), ("0.875-inch", 11.1125e-3), ("1.5-inch", 19.05e-3))
"""m: of the reflectors that laser trackers come with."""
_NEAR = 0.1e-3


def marker_constant(fit: Linearized) -> Hypothesis | None:
    """The marker whose positions fit far better with another constant, None where none does or where a marker that sits
    elsewhere on its link would do the same."""
    readings, rows = fit.readings, fit.rows
    sight = rows.measured / np.maximum(np.linalg.norm(rows.measured, axis=1, keepdims=True), 1e-300)
    able = (rows.minus < 0) & np.isin(rows.frame, rows.estimated) & np.isfinite(sight).all(axis=1)
    able &= ~readings.is_gauge[fit.keep]
    markers = [m for m in np.unique(rows.marker[able]).tolist() if (able & (rows.marker == m)).sum() >= _FEWEST]
    if len(markers) < 2:  # the constant of all markers is the frame's
        return None
    columns = (rows.flat(np.where((able & (rows.marker == m))[:, None], sight, 0.0)) for m in markers)
    falls = [_fall(fit.fit, column[:, None]) for column in columns]
    best = int(np.argmax([drop for drop, _ in falls]))
    marker, (drop, (off,)) = int(markers[best]), falls[best]
    own = able & (rows.marker == marker)
    name = fit.experiment.markers[marker].name
    elsewhere, _ = _fall(fit.fit, _moved(fit, name))
    unit = fit.fit.unit(fit.fit.chi2 - drop)
    if drop < (_LEAST + 2.0 * np.log(len(markers))) * unit or elsewhere > drop - _BETTER * unit:
        return None
    at = fit.keep[own]
    value = readings.value.copy()
    value[at] -= off * sight[own]
    words, changed, tried = _described(name, off), readings.with_values(value), len(markers)
    change = Hypothesis(
        "marker_constant",
        off,
        words,
        fit.experiment,
        readings=changed,
        free=1,
        tried=tried,
    )
    return change.at(at)


def _described(marker: str, off: float) -> str:
    """In words, with the reflectors whose constants differ by so much."""
    pairs = [(a, b) for a, ra in _RADII for b, rb in _RADII if a != b and abs(abs(off) - (ra - rb)) < _NEAR]
    way = "long" if off > 0.0 else "short"
    said = f"all positions of marker {marker} are {abs(off) * 1e3:.2f} mm too {way} along the line of sight"
    said += ": its reflector has another constant"
    return said + "".join(f", as between {a} and {b} ones" for a, b in pairs[:1])


def _fall(fit: LinearFit, columns: Array) -> tuple[float, list[float]]:
    """By how much the sum of squares falls with further columns (m, k), and their coefficients (k,)."""
    beside = fit.given(columns)
    x = least_squares(beside, fit.white, 1e-6)
    return float(fit.white @ (beside @ x)), x.tolist()


def _moved(fit: Linearized, marker: str) -> Array:
    """Columns (m, 3) of a marker that sits elsewhere on its link."""
    experiment, rows = fit.experiment, fit.rows
    (kind,) = with_role("marker offset")
    names = tuple(m.name for m in experiment.markers)
    effects = build_effects({field: marker for field in place_fields(kind)}, experiment.robot.facts, names, kind)
    wide = experiment.with_effects(effects)
    wanted = [p.name for e in effects for p in e.parameters(experiment.robot.facts)]
    seen = observation_model(wide, rows.readings, wanted, linear=True, rows=rows)
    return rows.flat(rows.rates(seen.model, seen.x, seen.frames, wanted, linear=True)[1])[:, seen.motions :]
