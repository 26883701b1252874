"""Before measuring: where the readings of a plan would place an effect that no library holds.

Every place moves by some plain laws in turn, with weights drawn at random and scaled so that what no fitted parameter
explains of it has the size s. A rival law k would fit to these readings C_h theta what leaves

    delta^2_hk = theta' C_h' (I - C_k (C_k' C_k + diag(0, 1 / sd^2))^-1 C_k') C_h theta,

by which repeated measurements are won by one place or another.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.diagnoses.explanations import Foretold, Suspect, foretold, motions_at, seen_evidence, winners
from qsframework.diagnoses.mounts import Mount, mounted, mounts_of, of_gauges
from qsframework.estimation import left, orthonormal
from qsframework.estimation.projection import Flags
from qsframework.experiment import Experiment, Plan, make_rows
from qsframework.experiment.simulate import planned_readings
from qsframework.experiment.stations import station_frame
from qsframework.hypotheses.catalogue.generic_laws import Motions
from qsframework.hypotheses.catalogue.law import Law
from qsframework.hypotheses.catalogue.place_motions import law_columns, places_of, variables
from qsframework.hypotheses.search.places import PlaceMotion
from qsframework.plugin import Array

SIZE = 10.0
"""s of the effects."""
_WEIGHTS, _DRAWS = 3, 100
"""Times that the weights of a law are drawn, and measurements of each."""
_LEAST = 1e-3
"""Share of what a law does that the fitted parameters must leave, else these readings do not show it."""


@dataclass(frozen=True)
class PlaceOutlook:
    """A place, without a law. chance: that it would be told first; instead: the place that is told in its stead most
    often, and how often; shown: whether the readings show anything of it."""

    place: Law
    chance: float
    instead: Law | None
    instead_chance: float
    shown: bool


@dataclass(frozen=True, eq=False)
class UnknownOutlook:
    """Of all places that the readings show something of; mounts: what could be mounted for more, the best first."""

    places: tuple[PlaceOutlook, ...]
    mounts: tuple[Mount, ...]

    @property
    def chance(self) -> float:
        """That the right place is told first, on average over the places."""
        shown = [p.chance for p in self.places if p.shown]
        return float(np.mean(shown)) if shown else 0.0


def unknown_outlook(experiment: Experiment, plan: Plan, fitted: Sequence[str], seed: int = 0) -> UnknownOutlook:
    """Where the readings of a plan would place effects of size s = 10 that no library holds. fitted: parameters."""
    mounts = mounts_of(experiment)
    wider, count = mounted(experiment, mounts), len(experiment.markers)
    rows = make_rows(of_gauges(planned_readings(wider, plan), mounts, count))
    frames = [station_frame(wider, rows.readings.frames[f]) for f in rows.estimated]
    model = wider.model()
    x = dict(zip(fitted, model.nominal[model.index(list(fitted))].tolist(), strict=True))
    moved = motions_at(wider, rows, x, frames)
    there = {m.marker.name for m in mounts}
    laws = [law for law in _laws(moved) if law.place.law.place not in there]
    home = {where: i for i, where in enumerate(dict.fromkeys(law.law.where for law in laws))}
    suspects = [Suspect(law, 1.0 / len(laws), home[law.law.where]) for law in laws]
    told = foretold(wider, moved, x, np.zeros_like(rows.measured), suspects)
    own = rows.marker < count
    places = _outlook(told, own, seed)
    better = [
        replace(m, chance=UnknownOutlook(_outlook(told, own | (rows.marker == count + i), seed), ()).chance)
        for i, m in enumerate(mounts)
    ]
    return UnknownOutlook(places, tuple(sorted(better, key=lambda m: -m.chance)))


def _laws(moved: Motions) -> Iterator[PlaceMotion]:
    """Plain laws of every place: a constant once a load hangs, its torque, by the order and by its own angle."""
    by = {v.name: v for v in variables(moved)}
    for place in places_of(moved):
        at = tuple(range(len(place.axes)))
        joint = moved.facts.joint_of(place.law.place) if place.torque is not None else ""
        some = [by[name] for name in dict.fromkeys(("", "order", joint)) if name in by]
        for factors in dict.fromkeys(factors for factors, _ in law_columns(place, at, moved, some)):
            yield PlaceMotion(place, at, replace(place.law, by=factors), 0.0, 1.0)


def _outlook(told: Foretold, rows: Flags, seed: int) -> tuple[PlaceOutlook, ...]:
    """Of each place, by the readings of some rows (R,)."""
    C, _ = told.whitened(rows)
    free = told.fitted.shape[1]
    Q = orthonormal(C[0][:, :free])
    size = np.array([np.linalg.norm(left(Q, c[:, free:])) for c in C])
    whole = np.array([np.linalg.norm(c[:, free:]) for c in C])
    shown = np.flatnonzero(size > _LEAST * np.maximum(whole, 1e-300))
    rng = np.random.default_rng(seed)
    first = {s.place: s.law.law for s in reversed(told.suspects) if isinstance(s.law, PlaceMotion)}
    label = np.array([told.suspects[i].place for i in shown.tolist()])
    Z = [C[i][:, free:] * (SIZE / size[i]) for i in shown.tolist()]
    drawn = [_drawn(z, Q, rng) for z in Z]
    square = _squares(Q, Z, np.concatenate(drawn, axis=1)) if Z else np.zeros((0, 0))
    won = np.zeros((len(first), len(first)))
    for h in range(len(Z)):
        for d in range(_WEIGHTS):
            own = square[:, _WEIGHTS * h + d]
            won[label[h]] += winners(seen_evidence(np.ones(len(Z)), own, h, rng, _DRAWS), label, len(first))
    won /= np.maximum(won.sum(axis=1, keepdims=True), 1e-300)
    out: list[PlaceOutlook] = []
    for place, law in sorted(first.items()):
        other = int(np.argmax(np.where(np.arange(len(first)) == place, -1.0, won[place])))
        instead = replace(first[other], by=()) if won[place, other] > 0.0 else None
        chance = float(won[place, place])
        out.append(PlaceOutlook(replace(law, by=()), chance, instead, float(won[place, other]), place in label))
    return tuple(out)


def _drawn(Z: Array, Q: Array, rng: np.random.Generator) -> Array:
    """What a law does to the readings (m, draws), with random weights, of size s beside the fitted columns Q."""
    out = Z @ rng.standard_normal((Z.shape[1], _WEIGHTS))
    return out * (SIZE / np.linalg.norm(left(Q, out), axis=0))


def _squares(Q: Array, Z: Sequence[Array], readings: Array) -> Array:
    """delta^2 (H, n) that each law leaves of readings (m, n), the fitted columns Q refitted with it."""
    rest = left(Q, readings)
    total, out = np.square(rest).sum(axis=0), list[Array]()
    for columns in (left(Q, z) for z in Z):
        seen = columns.T @ rest
        fit = np.linalg.solve(columns.T @ columns + np.eye(columns.shape[1]), seen)
        out.append(np.maximum(total - (seen * fit).sum(axis=0), 0.0))
    return np.array(out)
