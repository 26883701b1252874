"""What is known of a model's parameters before any reading of a campaign: said once, used by every verb.

A value, and the sd (1 sigma) of what stands in the files about it. Nothing is known of the springs that a campaign is
there to tell, of nests and of what no effect declares: of these the readings alone decide.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics import Model
from qsframework.experiment.readings import Readings
from qsframework.plugin import Array, ParallelSpring, Parameter, Sensor

ADDED = 30.0
"""Natural sizes that a cause which a diagnosis added may have (1 sigma). A machined part of 1,040 kg that the files do
not know is 30 payload shares; without any prior such a mass runs along what no reading tells, by tons."""
STATED, DELIVERED, FOUND, LAW, READINGS = (
    "stated in the files",
    "as arms are delivered",
    f"added by a diagnosis: {ADDED:.0f} of its sizes",
    "a law held near zero",
    "the readings alone",
)
"""Where an sd is from."""


@dataclass(frozen=True, eq=False)
class Priors:
    """What is known of all q parameters of a model: value (q,), sd (q,), inf where nothing is, and where it is from."""

    value: Array
    sd: Array
    source: tuple[str, ...]


def priors_of(model: Model, readings: Readings | None = None) -> Priors:
    """What is known of each parameter before these readings: never what was fitted to them."""
    used = readings.hashes if readings is not None and any(p.earlier for p in model.parameters) else ()
    springs, sensors = springs_of(model), model.names_of(Sensor)
    found = [_prior(p, used, p.name in springs, p.name in sensors) for p in model.parameters]
    values, sds, sources = zip(*found, strict=True) if found else ((), (), ())
    return Priors(np.array(values, dtype=float), np.array(sds, dtype=float), tuple(sources))


def from_priors(model: Model, readings: Readings, names: Sequence[str], values: Array) -> dict[str, float]:
    """By how many sds values lie from what was known of them before the readings: the sds of the files, or of an arm as
    delivered where these are larger, for a zero that was known to a hair moves with a repair."""
    priors, index = priors_of(model, readings), model.index(names)
    sds = np.maximum(priors.sd[index], [model.parameters[i].nominal_sd or 0.0 for i in index])
    return dict(zip(names, (np.abs(values - priors.value[index]) / sds).tolist(), strict=True))


def springs_of(model: Model) -> set[str]:
    """Names of the springs of joints, links and balancers: what a campaign is there to tell."""
    balancers = model.names_of(ParallelSpring)
    compliances = {model.names[i] for i in model.compliance_rows}
    return compliances | {p.name for p in model.parameters if p.name in balancers and not p.by_name}


def families(model: Model, names: Sequence[str]) -> dict[str, tuple[str, str]]:
    """The family of each of some parameters: its effect, and its unit."""
    own = {name: e for e, part in zip(model.effects, model.slices, strict=True) for name in model.names[part]}
    return {n: (own[n].effect_name(), model.parameters[i].unit) for n, i in zip(names, model.index(names), strict=True)}


def _prior(p: Parameter, used: Collection[str], spring: bool, sensor: bool) -> tuple[float, float, str]:
    if p.pull is not None:
        return p.null or 0.0, p.pull, LAW
    if p.added:
        return p.null or 0.0, ADDED * p.typical, FOUND
    value, fitted = p.before(used), any(not set(used).isdisjoint(own) for _, own in p.earlier)
    if spring:
        return value, np.inf, READINGS
    if p.sd is not None and not fitted:  # the sd of a value that these readings gave says nothing before them
        return value, p.sd, STATED
    if p.nominal_sd is None or sensor:
        return value, np.inf, READINGS
    return value, p.nominal_sd, DELIVERED
