"""Fits of the exact model: the full equilibrium and every stage at its place, settled by least squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.elastostatics import Model, full_displacement, make_model
from qsframework.errors import NotConverged
from qsframework.experiment import Readings
from qsframework.identify.linear import Rows
from qsframework.identify.observations import Noise, Observations
from qsframework.identify.solve import Solution, solve
from qsframework.plugin import Array, Sensor

_ROUNDS = 8
_STILL = 0.01
"""Change of the whitened residuals' norm, in units of noise, at which the equilibrium's part counts as settled."""


@dataclass(frozen=True, eq=False)
class Settled:
    """A fit of the exact model: x (q,) all parameters, SI; names (f,) those fitted, with covariance (f, f).

    residuals (R, 3) m, white (3R,) whitened, chi2 their squares' sum; jacobian (3R, f) whitened, per SI
    """

    model: Model
    names: tuple[str, ...]
    x: Array
    covariance: Array
    residuals: Array
    white: Array
    jacobian: Array
    chi2: float
    exact: bool

    def value(self, name: str) -> float:
        return float(self.x[self.model.names.index(name)])

    def sd(self, name: str) -> float:
        i = self.names.index(name)
        return float(np.sqrt(self.covariance[i, i]))

    def by_name(self) -> dict[str, float]:
        return dict(zip(self.model.names, (float(v) for v in self.x), strict=True))


def exact_displacement(model: Model, readings: Readings, x: Array) -> Array:
    """Displacement readings (N, K, 3) m by the full equilibrium; sensors act as in the linear model."""
    plain = [(e, s) for e, s in zip(model.effects, model.slices, strict=True) if not isinstance(e, Sensor)]
    index = [i for _, s in plain for i in range(s.start, s.stop)]
    markers = list(zip(model.marker_names, model.markers, strict=True))
    bare = make_model(
        model.facts, [e for e, _ in plain], [model.parameters[i] for i in index], model.tip, markers, model.gravity
    )
    own = x[index]
    defect = full_displacement(bare, readings.poses, own) - bare.predict(readings.poses, own)
    return model.predict(readings.poses, x) + defect


def settle_fit(
    model: Model, readings: Readings, rows: Rows, noise: Noise, names: Sequence[str], start: Array,
    priors: Sequence[tuple[str, float]] = (), bounded: bool = False,
) -> Settled:  # fmt: skip
    """Fit `names` from `start` (q,), all others held there.

    The equilibrium is what a linear fit is corrected by until nothing changes. priors: (name, sd) of parameters that
    are pulled to their start, so that directions which no reading shows stay there.
    """
    index = model.index(names)
    sd = dict(priors)
    free = tuple(
        replace(model.parameters[i], nominal=float(start[i]), sd=sd.get(model.parameters[i].name),
                lower=model.parameters[i].lower if bounded else -np.inf,
                upper=model.parameters[i].upper if bounded else np.inf)
        for i in index
    )  # fmt: skip
    x = start.copy()
    exact = True
    block = np.repeat(rows.pose, 3)

    def full(z: Array) -> Array:
        every = x.copy()
        every[index] = z
        return every

    last: Array | None = None
    z = start[index]
    for _ in range(_ROUNDS):
        defect, exact = _defect(model, readings, rows, full(z))
        observations = Observations(
            (rows.measured - defect).ravel(),
            lambda v: rows.of(model.predict(readings.poses, full(v))).ravel(),
            lambda v: rows.of(model.sensitivity(readings.poses, full(v), names)).reshape(-1, len(names)),
            free, noise, block, np.repeat(rows.keep, 3),
        )  # fmt: skip
        solution = solve(observations, start=z, priors=bool(priors), starts=0)
        z = solution.x
        if last is not None and float(np.linalg.norm(solution.residuals - last)) <= _STILL:
            break
        last = solution.residuals
    return _settled(model, rows, tuple(names), full(z), solution, defect, readings, exact)


def _defect(model: Model, readings: Readings, rows: Rows, x: Array) -> tuple[Array, bool]:
    """Exact minus linear prediction of the rows (R, 3) m; zero where the equilibrium does not settle."""
    try:
        return rows.of(exact_displacement(model, readings, x) - model.predict(readings.poses, x)), True
    except NotConverged:
        return np.zeros_like(rows.measured), False


def _settled(
    model: Model, rows: Rows, names: tuple[str, ...], x: Array, solution: Solution, defect: Array,
    readings: Readings, exact: bool,
) -> Settled:  # fmt: skip
    residuals = rows.measured - defect - rows.of(model.predict(readings.poses, x))
    white = solution.residuals
    return Settled(
        model, names, x, solution.covariance, residuals, white, solution.jacobian, float(white @ white), exact
    )
