"""Which of many parameters readings can tell, and what absorbs the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from qsframework.elastostatics import Model
from qsframework.estimation import PLAIN, FitOptions, Observations, scales
from qsframework.experiment import ObservationModel
from qsframework.information.identifiable import NotEstimated, choose, limits_of
from qsframework.plugin import Array, Geometry, ParallelSpring, Parameter, Sensor

_LOOSE, _BROAD = 5.0, 20.0
"""Natural sizes by which parameters of the geometry, and those of markers, are held to their nominal values."""


def identifiable_names(
    seen: ObservationModel, options: FitOptions = PLAIN, *, weakly: bool = False
) -> tuple[list[str], tuple[NotEstimated, ...], float]:
    """The names that the readings, with the priors, can tell; what is not estimated; the nominal arm's error in sds.

    weakly: also what they tell to no use, but might be seen to be wrong by
    """
    o = seen.observations()
    z = seen.start
    scale = np.concatenate([np.full(seen.motions, 1e-2), scales(list(seen.parameters[seen.motions :]))])
    predicted, J = seen.rates(z)
    white = o.noise.whiten(o.measured - predicted)
    error = float(np.sqrt((white**2).sum() / max(len(white) - seen.motions, 1)))
    unit = max(error, o.least)  # readings that are exactly the nominal arm have no error at all
    rows = o.noise.whiten(J) * (scale / unit)
    names = [p.name for p in o.parameters]
    for sds in ([p.sd if options.priors else None for p in o.parameters], [p.pull for p in o.parameters]):
        pulls = {i: scale[i] / (sd or 1.0) for i, sd in enumerate(sds) if sd is not None}
        if pulls:
            rows = np.vstack([rows, np.eye(len(names))[[*pulls]] * np.array([*pulls.values()])[:, None]])
    if any(options.tied):
        rows, names = _tied_columns(rows, names, o, scale, options)
    limits = np.concatenate([np.full(seen.motions, np.inf), limits_of(seen.model, names[seen.motions :])])
    if weakly or options.priors or np.all(seen.rows.minus >= 0):  # differences that tell little still tell it honestly
        limits = np.full(len(limits), np.inf)
    taken, left = choose(rows, names, limits)
    chosen = {names[i] for i in taken}
    chosen |= {n for g in options.tied if g[0] in chosen for n in g}
    return [n for n in seen.names if n in chosen], left, unit


def at_found_markers(seen: ObservationModel, x: Array) -> ObservationModel | None:
    """The arm as it is in `seen`, with what the fitted parameters of markers and instrument are among values x (q,), in
    the frames that then suit it; None where there are none. About it a guess of where the markers are decides nothing.
    """
    own = [n for n in seen.names if n in seen.model.names_of(Sensor)]
    if not own or np.all(seen.rows.minus >= 0):  # what differences tell, they tell anywhere
        return None
    there, at = seen.x.copy(), seen.model.index(own)
    there[at] = x[at]
    return replace(seen, x=there, frames=seen.rows.start(seen.model, there) if seen.frames else ())


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


def held_of(model: Model, names: Sequence[str]) -> Array:
    """sd (p,) of the weak hold on each parameter, per unit of its scale; inf for springs, loads and all else that
    nothing pulls. Where a balancer is fixed is geometry too."""
    geometry, sensors = model.names_of(Geometry), model.names_of(Sensor)
    geometry |= {n for n in model.names_of(ParallelSpring) if model.parameters[model.names.index(n)].by_name}

    def hold(p: Parameter) -> float:
        if p.pull is not None:
            return p.pull / float(scales([p])[0])
        if p.name in geometry:
            return _LOOSE * min(p.typical / float(scales([p])[0]), 1.0) if p.by_name else _LOOSE
        return _BROAD if p.name in sensors else np.inf

    return np.array([hold(model.parameters[i]) for i in model.index(names)])
