"""The same rows of readings at several poses, under several loads or in several frames, by one call of the model.

A batch of a few dozen poses mostly costs the way through the model's stages, which a batch of thousands goes once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from qsframework.elastostatics import Model
from qsframework.experiment.frames import Frame
from qsframework.experiment.observations import ReadingRows
from qsframework.plugin import Array, Conditions, Poses


def positions_of(many: Sequence[ReadingRows], model: Model, x: Array) -> list[Array]:
    """`Rows.positions` of each, by the first step from rest."""
    return [
        found for (found,) in _of_states(many, lambda poses, loaded: (model.positions(poses, x, loaded, linear=True),))
    ]


def rates_of(
    many: Sequence[ReadingRows], model: Model, x: Array, frames: Sequence[Sequence[Frame]], names: Sequence[str]
) -> list[tuple[Array, Array]]:
    """`Rows.rates` of each, by the first step from rest, in its own frames."""
    pairs = [rows.pairs[0] for rows in many if rows.pairs is not None]
    if len(pairs) == len(many):
        found = _apart(model.rates(_stacked(pairs), x, names, linear=True), pairs)
        return [rows.of_pairs(*one) for rows, one in zip(many, found, strict=True)]
    both = _of_states(many, lambda poses, loaded: model.position_rates(poses, x, names, loaded, linear=True))
    return [rows.of_states(one[0], one[1], own) for rows, one, own in zip(many, both, frames, strict=True)]


def _of_states(many: Sequence[ReadingRows], ask: Callable[[Poses, bool], tuple[Array, ...]]) -> list[list[Array]]:
    """What is asked of the states that each needs, (S, ...) in their order; of states that several share, once."""
    distinct = {id(rows.readings.states): rows.split() for rows in many}
    out: dict[int, list[Array]] = {own: [] for own in distinct}
    for same in zip(*distinct.values(), strict=True):
        poses = [own for _, _, own in same]
        found = _apart(ask(_stacked(poses), same[0][0]), poses)
        for (own, parts), (_, which, _), values in zip(distinct.items(), same, found, strict=True):
            if not out[own]:
                out[own] = [np.empty((sum(len(w) for _, w, _ in parts), *v.shape[1:])) for v in values]
            for whole, value in zip(out[own], values, strict=True):
                whole[which] = value
    return [out[id(rows.readings.states)] for rows in many]


def _apart(found: Sequence[Array], poses: Sequence[Poses]) -> list[list[Array]]:
    """What is known of the stacked poses, for each of their batches."""
    ends = np.cumsum([len(p) for p in poses])[:-1]
    return [list(own) for own in zip(*(np.split(v, ends) for v in found), strict=True)]


def _stacked(poses: Sequence[Poses]) -> Poses:
    """Batches after each other, the same recorded of all."""

    def conditions(many: Sequence[Conditions]) -> Conditions:
        return Conditions.each(
            lambda name: None if getattr(many[0], name) is None else np.concatenate([getattr(c, name) for c in many])
        )

    return Poses(
        np.concatenate([p.pendant for p in poses]),
        np.concatenate([p.q for p in poses]),
        np.concatenate([p.wrench for p in poses]),
        conditions([p.unloaded for p in poses]),
        conditions([p.loaded for p in poses]),
    )
