"""Fits by the full equilibrium: what the linear model leaves out is taken off the readings, and they are fitted again.

The linear model balances the load at the undeflected pose. A real arm balances it where it has gone to, which under a
heavy load differs by more than a tracker's noise. The difference of the two models hardly depends on the parameters,
so that a few rounds settle on the least squares of the equilibrium itself, by any method.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from qsframework.elastostatics import Model, exact_readings
from qsframework.errors import NotConverged, QsfError
from qsframework.experiment import Readings
from qsframework.identify.fit import Fit
from qsframework.plugin import Array, Poses

Refit = Callable[[Readings], Fit]
_ROUNDS = 40
_STILL = 1e-4
"""Change of the estimates, in their sds, at which the rounds have settled."""
_TOLD = 0.5
"""Shift of an estimate by the linear model, in sds, from which on it is said."""


def fit_exactly(model: Model, readings: Readings, refit: Refit) -> Fit:
    """The fit of the full equilibrium; `refit` is the fit of the linear model to any readings.

    Raises NotConverged where the rounds do not settle, and what `refit` and the equilibrium raise.
    """
    found, change = refit(readings), np.inf
    for _ in range(_ROUNDS):
        new = refit(linearised(model, readings, found.x))
        change = float(np.abs(_shift(new, found)).max(initial=0.0))
        found = new
        if change <= _STILL:
            return _of(found, model, readings)
    raise NotConverged(
        f"the fit by the full equilibrium did not settle in {_ROUNDS} rounds (an estimate still moves by "
        f"{change:.2g} sd): look at the units of readings and loads, or fit less"
    )


def with_shift(found: Fit, model: Model, readings: Readings, refit: Refit) -> Fit:
    """The fit of the linear model with a note where the full equilibrium would move an estimate noticeably."""
    try:
        shift = _shift(refit(linearised(model, readings, found.x)), found)
    except QsfError as error:
        note = f"How far the linear model is off cannot be said; the full equilibrium fails: {error}"
        return replace(found, notes=(*found.notes, note))
    off = [i for i in np.argsort(-np.abs(shift)).tolist() if abs(shift[i]) > _TOLD]
    if not off:
        return found
    moved = ", ".join(f"{found.names[i]} by {shift[i]:+.1f} sd" for i in off[:4])
    note = (
        f"A real arm balances the load where it has moved to, the linear model at the undeflected pose; fitted with "
        f"--exact (exact=True), estimates move: {moved}. Readings of qsf simulate are linear unless it has --exact."
    )
    return replace(found, notes=(*found.notes, note))


def linearised(model: Model, readings: Readings, x: Array) -> Readings:
    """The readings without what the equilibrium adds to the linear model at the parameters x."""
    displacement = readings.displacement.copy()
    displacement[readings.use] -= _at_rows(readings, lambda p: exact_readings(model, p, x) - model.predict(p, x))
    return replace(readings, displacement=displacement)


def _at_rows(readings: Readings, displacements: Callable[[Poses], Array]) -> Array:
    """What a model says at the used rows (R, 3); poses whose rows are all masked are not asked for."""
    used, where = np.unique(readings.measurement[readings.use], return_inverse=True)
    return displacements(readings.poses.take(used))[where, readings.marker[readings.use]]


def _shift(new: Fit, old: Fit) -> Array:
    """Differences of the estimates in sds (p,); zero where none is quoted."""
    sd = np.array([e.sd for e in old.estimates])
    off = np.array([a.value - b.value for a, b in zip(new.estimates, old.estimates, strict=True)])
    return np.where(np.isfinite(sd) & (sd > 0.0), off / np.where(sd > 0.0, sd, 1.0), 0.0)


def _of(found: Fit, model: Model, readings: Readings) -> Fit:
    """The fit as one of the readings themselves: measured, predicted and nominal by the equilibrium."""
    measured = readings.displacement[readings.use]
    nominal = _at_rows(readings, lambda poses: exact_readings(model, poses, model.nominal))
    return replace(
        found, method=f"{found.method}, full equilibrium", measured=measured, predicted=measured - found.residuals,
        nominal=nominal,
    )  # fmt: skip
