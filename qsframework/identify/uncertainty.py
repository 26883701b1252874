"""Total uncertainty: what the load's own error adds, which no residual shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.elastostatics import Model, make_model
from qsframework.errors import InputError
from qsframework.experiment import Experiment, Readings
from qsframework.identify.fit import Fit
from qsframework.identify.frames import Frame
from qsframework.identify.noise import readings_noise
from qsframework.identify.observations import Noise
from qsframework.identify.positions import Positions
from qsframework.plugin import Array, Indices, Load, Loads, LoadTerm, Parameter, RobotFacts

ERRORS = ("scale", "rx", "ry", "rz")
_FITTED = ("load_scale", "load_direction")
_TIED = 1e-13
"""Share of the largest eigenvalue of a correlation matrix that is rounding: the parameters of a group are tied."""


@dataclass(frozen=True)
class LoadError(Load):
    """The wrench that acts is (1 + k) times the stated one, turned by a small rotation vector; all loads alike."""

    order = -1
    source = "the calibration of the load cell, or of the scales; the plumb line or the cable's angle"

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        units = ("", "rad", "rad", "rad")
        return tuple(Parameter(f"{self.name}.{e}", u, typical=0.01) for e, u in zip(ERRORS, units, strict=True))

    def apply(self, loads: Loads, x: Array, robot: RobotFacts) -> LoadTerm:
        k, (rx, ry, rz) = x[0], x[1:]
        turn = np.eye(3) + np.array([[0.0, -rz, ry], [rz, 0.0, -rx], [-ry, rx, 0.0]])
        slope = (1.0 + k) * np.kron(np.eye(2), turn)
        halves = loads.wrench.reshape(-1, 2, 3)
        dx = [(halves @ turn.T).reshape(-1, 6)]
        dx += [(1.0 + k) * np.cross(axis, halves).reshape(-1, 6) for axis in np.eye(3)]
        return LoadTerm(loads.wrench @ slope.T, np.broadcast_to(slope, (len(halves), 6, 6)), np.stack(dx, axis=-1))


def load_model(model: Model) -> Model:
    """The same model with the load's error, nominal zero, beside its own parameters."""
    effects = (*model.effects, LoadError())
    markers = list(zip(model.marker_names, model.markers, strict=True))
    return make_model(model.facts, effects, model.parameters, model.tip, markers, model.gravity)


def _widened(model: Model, x: Array) -> tuple[Model, Array, list[str]]:
    """The model with the load's error, its parameters at x with no error, and the names of the error."""
    wide = load_model(model)
    at = dict(zip(model.names, x, strict=True))
    whole = np.array([at.get(p.name, 0.0) for p in wide.parameters])
    return wide, whole, [p.name for p in LoadError().parameters(model.facts)]


def load_columns(model: Model, readings: Readings, x: Array) -> Array:
    """d displacement (N, K, 3, 4) per unit of the load's scale and of its rotations about x, y, z of the base."""
    wide, whole, names = _widened(model, x)
    return wide.sensitivity(readings.poses, whole, names)


def position_columns(positions: Positions, frames: Sequence[Frame], x: Array) -> Array:
    """d position (R, 3, 4) per unit of the load's scale and of its rotations; zero where no load acts."""
    wide, whole, names = _widened(positions.model, x)
    return replace(positions, model=wide).rates(whole, frames, names)[1][..., -len(names) :]


def load_sds(experiment: Experiment, fitted: Sequence[str]) -> Array:
    """sd (4,) of the load's scale and rotations; what the fit estimates itself counts as known here."""
    stated = experiment.load_uncertainty
    sd = np.array([stated.scale, *[stated.direction] * 3])
    if any(name.startswith(_FITTED[0]) for name in fitted):
        sd[0] = 0.0
    if any(name.startswith(_FITTED[1]) for name in fitted):
        sd[1:] = 0.0
    return sd


def load_shift(fit: Fit, experiment: Experiment, readings: Readings, noise: Noise | None = None) -> Array:
    """How much each estimate moves (p, 4) per sd of the load's scale and rotations: through the estimator.

    noise: the one that the fit was made with, the readings' own if None; its common factor does not matter
    """
    keep = _rows(fit, readings)
    if noise is None:
        stated = np.where(np.isnan(readings.sigma[keep]), experiment.noise.sigma or 1.0, readings.sigma[keep])
        noise = readings_noise(readings, keep, stated)
    at = readings.measurement[keep], readings.marker[keep]
    A = noise.whiten(fit.model.sensitivity(readings.poses, fit.x, fit.names)[at].reshape(3 * len(keep), -1))
    sd = load_sds(experiment, fit.names)
    J = noise.whiten((load_columns(fit.model, readings, fit.x)[at] * sd).reshape(3 * len(keep), -1))
    U = _free_directions(fit.covariance)
    rows = A @ U
    size = np.linalg.norm(rows, axis=0)
    moved = np.asarray(np.linalg.lstsq(rows / size, J, rcond=None)[0], dtype=np.float64)
    return U @ (moved / size[:, None])


def _free_directions(covariance: Array) -> Array:
    """Directions (p, f) in which a fit with this covariance (p, p) can move: tied parameters move together."""
    sd = np.sqrt(np.diag(covariance))
    free = np.flatnonzero(sd > 0.0)
    values, vectors = np.linalg.eigh(covariance[np.ix_(free, free)] / np.outer(sd[free], sd[free]))
    kept = values > _TIED * values[-1]
    U = np.zeros((len(sd), int(kept.sum())))
    U[free] = sd[free, None] * vectors[:, kept]
    return U


def _rows(fit: Fit, readings: Readings) -> Indices:
    where = {int(row): i for i, row in enumerate(readings.rows)}
    if not all(int(row) in where for row in fit.rows):
        raise InputError("the fit is of other readings than these")
    return np.array([where[int(row)] for row in fit.rows])


def total_covariance(fit: Fit, experiment: Experiment, readings: Readings, noise: Noise | None = None) -> Array:
    """Covariance (p, p) of the estimates with the load's uncertainty, as the GUM asks: noise plus propagated prior.

    The load's error is one for all readings (one load cell, one set of weights): it does not average out.
    """
    G = load_shift(fit, experiment, readings, noise)
    return fit.covariance + G @ G.T
