"""Which of many parameters readings can tell, and what absorbs the others."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from qsframework.elastostatics import Model
from qsframework.estimation import PLAIN, FitOptions, Observations, scales
from qsframework.experiment import ObservationModel
from qsframework.files import FileRecord, null
from qsframework.plugin import Array, Geometry, ParallelSpring, Parameter, Sensor, Spring

REDUNDANT = 1e-5
"""Share of a column that must be new, seen from the columns chosen before it."""
_NOTHING = 1e-6
"""Scaled size of a column below which readings tell nothing of its parameter, not even a million natural sizes."""
_SHARE = 0.2
_NAMED = 5
_TOLD = 10.0
"""A parameter of the geometry that is told only to more than so many natural sizes is left aside; markers never are."""
_LOOSE, _BROAD = 5.0, 20.0
"""Natural sizes by which parameters of the geometry, and those of markers, are held to their nominal values."""


@dataclass(frozen=True)
class LeftAside(FileRecord):
    """A parameter that is not estimated; `sd` in its natural sizes if it were, inf where it makes no difference."""

    name: str
    absorbed_by: tuple[str, ...]
    sd: Annotated[float, null(math.inf)]

    def words(self) -> str:
        """Why, in one sentence."""
        if not self.absorbed_by and np.isinf(self.sd):
            return f"{self.name}: no reading depends on it"
        others = ", ".join(self.absorbed_by)
        if np.isinf(self.sd):
            return f"{self.name}: absorbed by {others}"
        told = f"{self.name}: told only to {self.sd:.2g} times its natural size"
        return f"{told}; it looks like {others}" if others else told


def choose(rows: Array, names: Sequence[str], limits: Array) -> tuple[list[int], tuple[LeftAside, ...]]:
    """Take columns of rows (m, p), whitened and scaled by natural sizes, in their order.

    A column is left aside where those taken before leave less than REDUNDANT of it, or where its
    parameter would be told only to more than `limits` (p,) of its natural sizes; beyond a million of them it is not
    told at all.
    """
    R: Array = np.asarray(np.linalg.qr(rows, mode="r")) if len(rows) > rows.shape[1] else rows
    basis = np.zeros((len(R), 0))
    taken: list[int] = []
    left: list[LeftAside] = []
    largest = float(np.linalg.norm(R, axis=0).max(initial=0.0))
    for c in range(R.shape[1]):
        column, size = R[:, c], float(np.linalg.norm(R[:, c]))
        fresh = column - basis @ (basis.T @ column)
        fresh -= basis @ (basis.T @ fresh)
        new = float(np.linalg.norm(fresh))
        redundant = new <= REDUNDANT * size or size <= 1e-12 * largest
        if not redundant and new >= _NOTHING and new * limits[c] >= 1.0:
            taken.append(c)
            basis = np.column_stack([basis, fresh / new])
            continue
        sd = np.inf if redundant or new < _NOTHING else 1.0 / new
        seen = size > max(_NOTHING, 1e-12 * largest)
        left.append(LeftAside(names[c], _absorbers(R, taken, column, names) if seen else (), sd))
    return taken, tuple(left)


def _absorbers(R: Array, taken: Sequence[int], column: Array, names: Sequence[str]) -> tuple[str, ...]:
    """The taken columns that make up most of a column, largest share first."""
    if not taken:
        return ()
    chosen = R[:, list(taken)]
    share = np.abs(np.linalg.lstsq(chosen, column, rcond=None)[0]) * np.linalg.norm(chosen, axis=0)
    order = [i for i in np.argsort(-share, kind="stable")[:_NAMED] if share[i] >= _SHARE * np.linalg.norm(column)]
    return tuple(names[taken[int(i)]] for i in order)


def in_order(model: Model, names: Sequence[str]) -> list[str]:
    """The names to fit, physically simple ones first: markers, zeros and sag, springs, placements, others."""
    rank: dict[str, int] = {}
    for effect, part in zip(model.effects, model.slices, strict=True):
        place = 4
        if isinstance(effect, Sensor):
            place = 0
        elif isinstance(effect, Geometry):
            place = 3 if effect.moves_placements else 1
        elif isinstance(effect, Spring):
            place = 2
        rank |= dict.fromkeys(model.names[part], place)
    wanted = set(names)
    return sorted((n for n in model.names if n in wanted), key=lambda n: rank[n])


def told_names(
    seen: ObservationModel, options: FitOptions = PLAIN, *, weakly: bool = False
) -> tuple[list[str], tuple[LeftAside, ...], float]:
    """The names that the readings, with the priors, can tell; what is left aside; the nominal arm's error in sds.

    weakly: also what they tell to no use, but might be seen to be wrong by
    """
    o = seen.observations()
    z = seen.start
    scale = np.concatenate([np.full(seen.motions, 1e-2), scales(list(seen.parameters[seen.motions :]))])
    white = o.noise.whiten(o.measured - seen.rows.flat(seen.rows.predict(seen.model, seen.x, seen.frames, seen.linear)))
    error = float(np.sqrt((white**2).sum() / max(len(white) - seen.motions, 1)))
    unit = max(error, o.least)  # readings that are exactly the nominal arm have no error at all
    rows = o.noise.whiten(o.jacobian(z)) * (scale / unit)
    group = {n: g for g in options.tied for n in g}
    names = [p.name for p in o.parameters]
    if options.priors:
        known = [i for i, p in enumerate(o.parameters) if p.sd is not None]
        stated = np.zeros((len(known), len(names)))
        stated[np.arange(len(known)), known] = [scale[i] / (o.parameters[i].sd or 1.0) for i in known]
        rows = np.vstack([rows, stated])
    pulled = [i for i, p in enumerate(o.parameters) if p.pull is not None]
    if pulled:
        own = np.zeros((len(pulled), len(names)))
        own[np.arange(len(pulled)), pulled] = [scale[i] / (o.parameters[i].pull or 1.0) for i in pulled]
        rows = np.vstack([rows, own])
    if group:
        rows, names = _tied_columns(rows, names, o, scale, options)
    limits = np.concatenate([np.full(seen.motions, np.inf), _limits_of(seen.model, names[seen.motions :])])
    if weakly or options.priors or np.all(seen.rows.minus >= 0):  # differences that tell little still tell it honestly
        limits = np.full(len(limits), np.inf)
    taken, left = choose(rows, names, limits)
    chosen = {names[i] for i in taken}
    chosen |= {n for g in options.tied if g[0] in chosen for n in g}
    return [n for n in seen.names if n in chosen], left, unit


def _tied_columns(
    rows: Array, names: list[str], o: Observations, scale: Array, options: FitOptions
) -> tuple[Array, list[str]]:
    """The columns with those of tied groups added up, at the place of the first."""
    rows = rows.copy()
    drop: list[int] = []
    for group in options.tied:
        index = [names.index(n) for n in group]
        nominal = np.array([o.parameters[i].nominal for i in index])
        ratio = nominal / nominal[0] if nominal[0] != 0.0 else np.ones(len(index))
        rows[:, index[0]] = (rows[:, index] / scale[index]) @ ratio * scale[index[0]]
        drop += index[1:]
    kept = [i for i in range(len(names)) if i not in drop]
    return rows[:, kept], [names[i] for i in kept]


def kinds_of(model: Model, kind: type) -> set[str]:
    """Names of the parameters of all effects of a kind."""
    effects = zip(model.effects, model.slices, strict=True)
    return {n for e, part in effects if isinstance(e, kind) for n in model.names[part]}


def _limits_of(model: Model, names: Sequence[str]) -> Array:
    """How many natural sizes a parameter (p,) may be uncertain by before it is left aside."""
    geometry = kinds_of(model, Geometry)
    return np.array([_TOLD if n in geometry else np.inf for n in names])


def held_of(model: Model, names: Sequence[str]) -> Array:
    """sd (p,) of the weak hold on each parameter, per unit of its scale; inf for springs, loads and all else that
    nothing pulls. Where a balancer is fixed is geometry too."""
    geometry, sensors = kinds_of(model, Geometry), kinds_of(model, Sensor)
    geometry |= {n for n in kinds_of(model, ParallelSpring) if model.parameters[model.names.index(n)].by_name}

    def hold(p: Parameter) -> float:
        if p.pull is not None:
            return p.pull / float(scales([p])[0])
        if p.name in geometry:
            return _LOOSE * min(p.typical / float(scales([p])[0]), 1.0) if p.by_name else _LOOSE
        return _BROAD if p.name in sensors else np.inf

    return np.array([hold(model.parameters[i]) for i in model.index(names)])
