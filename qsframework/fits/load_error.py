"""The load's own error, which no residual shows: one scale and one small rotation for all readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics import Model, make_model
from qsframework.experiment import Experiment, ObservationModel
from qsframework.plugin import Array, Context, Load, Loads, LoadTerm, Parameter, RobotFacts, cross_matrix

ERRORS = ("scale", "rx", "ry", "rz")


@dataclass(frozen=True)
class LoadError(Load):
    """The wrench that acts is (1 + k) times the stated one, turned by a small rotation vector; all loads alike."""

    order = -1
    source = "the calibration of the load cell, or of the scales; the plumb line or the cable's angle"

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        units = ("", "rad", "rad", "rad")
        return tuple(Parameter(f"{self.name}.{e}", u, typical=0.01) for e, u in zip(ERRORS, units, strict=True))

    def apply(self, loads: Loads, x: Array, context: Context) -> LoadTerm:
        k, turn = x[0], np.eye(3) + cross_matrix(x[1:])
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


def load_sds(experiment: Experiment, model: Model, fitted: Sequence[str]) -> Array:
    """sd (4,) of the load's scale and rotations; what the fit estimates itself counts as known here."""
    stated = experiment.load_uncertainty
    sd = np.array([stated.scale, *[stated.direction] * 3])
    if set(fitted) & set(model.of_role("load scale")):
        sd[0] = 0.0
    if set(fitted) & set(model.of_role("load direction")):
        sd[1:] = 0.0
    return sd


def load_columns(seen: ObservationModel, x: Array) -> Array:
    """d reading (m, 4) per unit of the load's scale and of its rotations about x, y, z of the base, at all values x."""
    wide = load_model(seen.model)
    at = dict(zip(seen.model.names, x, strict=True))
    whole = np.array([at.get(p.name, 0.0) for p in wide.parameters])
    names = [p.name for p in LoadError().parameters(seen.model.facts)]
    return seen.rows.flat(seen.rows.rates(wide, whole, seen.frames, names, seen.linear)[1][..., -len(names) :])
