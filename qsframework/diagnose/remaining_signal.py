"""The test for remaining signal: what the names leave, and whether a law that nobody has written does as well in the
place of one.

With all names fitted, a generic block that is still significant says that they are not the whole truth. And a name
stands only where no generic block explains the readings nearly as well in its place, the other names given: of blocks
that cannot do what the name does, the odds together must be small; of those that can, none may beat it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from qsframework.diagnose.result import Leftover
from qsframework.estimation.projection import Flags
from qsframework.estimation.visit_noise import Reml
from qsframework.hypotheses.catalogue.generic_laws import Block, single_axes
from qsframework.hypotheses.catalogue.law import Law
from qsframework.hypotheses.exact_refit import SettledFit
from qsframework.hypotheses.search.evidence import DRAWS, evidence
from qsframework.plugin import Array, RobotFacts

_HOLDS = 0.9
"""Share of a name's effect that a block must be able to do to count as one that holds it."""
_ODDS = 0.1
"""Of all blocks that do not hold a name together, against it."""
_LEAST = 6.2
"""Nats from which on something is left, whatever the draws of plain noise say: real noise has tails and grows."""
BEATS = 3.0
"""Nats by which a block that holds a name may be better; beyond them any block may stand in its place."""
_NEAR = 6.0
"""Nats below the likeliest law within which one axis of a place may be likelier still."""


@dataclass(frozen=True, eq=False)
class NamedEffect:
    """A name in an exact fit: columns (m, k) m of its parameters, effect (m,) m: what they did as fitted."""

    name: str
    columns: Array
    effect: Array


@dataclass(frozen=True, eq=False)
class Likely:
    """A block, about one axis alone where that is likelier than `whole`, its law about all; evidence: nats."""

    whole: Law
    block: Block
    evidence: float


def named_in(fit: SettledFit, causes: Mapping[str, Sequence[str]], colour: Array) -> tuple[NamedEffect, ...]:
    """The causes, by the names of their parameters; colour (m, q): the fit's columns in m."""
    first = colour.shape[1] - len(fit.names)
    nominal = fit.model.nominal
    out: list[NamedEffect] = []
    for name, parameters in causes.items():
        at = [first + fit.names.index(p) for p in parameters]
        index = fit.model.index(list(parameters))
        out.append(NamedEffect(name, colour[:, at], colour[:, at] @ (fit.x[index] - nominal[index])))
    return tuple(out)


def remaining_signal(
    blocks: Sequence[Block], fits: Reml, values: Array, level: float, seed: int, measured: Flags
) -> tuple[tuple[Leftover, ...], Array]:
    """Blocks that are significant in readings (m,) m beside all that a model fits, the strongest first, and the
    evidence (G,) of all blocks.

    The noise is drawn where the strongest is neither too weak to count nor beyond what draws can tell.
    """
    found = evidence((b.columns for b in blocks), fits, values, draws=0)
    if (found.e >= _LEAST).any() and found.p_values.min() > 1.0 / DRAWS:
        found = evidence((b.columns for b in blocks), fits, values, seed=seed, measured=measured)
    p = found.p_values
    left = tuple(
        Leftover(blocks[i].law, float(p[i]), float(found.e[i]))
        for i in map(int, np.argsort(-found.e))
        if p[i] <= level and found.e[i] >= _LEAST
    )
    return left, found.e


def on_one_axis(blocks: Sequence[Block], e: Array, fits: Reml, values: Array, facts: RobotFacts) -> list[Likely]:
    """The blocks near the likeliest, each about one axis of its place alone where that is likelier; e (G,): of all.

    Most parts give about one axis, and a law of all three pays for those about which nothing moves. An axis is one of
    several, which its evidence pays for.
    """
    near = [i for i in range(len(blocks)) if e[i] > e.max() - _NEAR]
    single = {i: list(single_axes(blocks[i], facts)) for i in near}
    every = [b for some in single.values() for b in some]
    finer = iter(evidence((b.columns for b in every), fits, values, draws=0).e)
    out: list[Likely] = []
    for i in near:
        own = [Likely(blocks[i].law, b, float(next(finer) - np.log(len(single[i])))) for b in single[i]]
        out.append(max([Likely(blocks[i].law, blocks[i], float(e[i])), *own], key=lambda x: x.evidence))
    return out


def finest(left: Sequence[Leftover], likely: Sequence[Likely]) -> tuple[Leftover, ...]:
    """What is left, by the axes about which it moves, the likeliest first."""
    finer = {x.whole: x for x in likely}
    found = [Leftover(finer[x.law].block.law, x.p_value, finer[x.law].evidence) if x.law in finer else x for x in left]
    return tuple(sorted(found, key=lambda x: -x.evidence))


def open_alternative(
    blocks: Sequence[Block], fits: Reml, values: Array, name: NamedEffect
) -> tuple[Leftover, bool] | None:
    """The generic block that stands in the place of a name best, where one does, and whether it is so far ahead that
    the name cannot stand beside it; fits: of all but the name."""
    columns = chain([name.columns], (b.columns for b in blocks))
    found = evidence(columns, fits, values + name.effect, effects=name.effect[:, None], draws=0)
    ahead, holds = found.e[1:] - found.e[0], found.held[1:, 0] >= _HOLDS
    odds = np.where(holds, 0.0, np.exp(np.minimum(ahead, 50.0)))
    beaten = np.max(ahead, where=holds, initial=-np.inf) > BEATS
    if odds.sum() < _ODDS and not beaten:
        return None
    margin: Array = ahead - np.where(holds, BEATS, np.log(_ODDS))
    best = int(np.argmax(margin))
    return Leftover(blocks[best].law, float("nan"), float(ahead[best])), bool(ahead[best] > BEATS)
