"""Which of many parameters readings can tell, and what absorbs the others."""

from __future__ import annotations

import numpy as np

from qsframework.estimation import PLAIN, FitOptions, Observations, scales
from qsframework.experiment import ObservationModel
from qsframework.information.identifiable import NotEstimated, choose
from qsframework.plugin import Array


def identifiable_names(
    seen: ObservationModel, options: FitOptions = PLAIN, *, known: bool = True
) -> tuple[list[str], tuple[NotEstimated, ...]]:
    """The names that a fit can tell: all of which something is known before the readings, and of the others those that
    these tell apart; and what is left.

    known: whether what is known before the readings counts; the laws that are held near zero always are
    """
    o = seen.observations()
    scale = np.concatenate([np.full(seen.motions, 1e-2), scales(list(seen.parameters[seen.motions :]))])
    rows = o.noise.whiten(seen.jacobian(seen.start)) * scale
    names = [p.name for p in o.parameters]
    held = [w > 0.0 and (known or p.pull is not None) for p, w in zip(o.parameters, o.known[0], strict=True)]
    if any(options.tied):
        rows, names = _tied_columns(rows, names, o, scale, options)
    before = {p.name for p, own in zip(o.parameters, held, strict=True) if own}
    open_ = [i for i, name in enumerate(names) if name not in before]
    taken, left = choose(rows[:, open_], [names[i] for i in open_])
    chosen = before | {names[open_[i]] for i in taken}
    chosen |= {n for g in options.tied if g[0] in chosen for n in g}
    return [n for n in seen.names if n in chosen], left


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
