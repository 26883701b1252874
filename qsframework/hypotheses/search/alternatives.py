"""Causes that the readings cannot tell from a named one: test inversion at 95 %.

A cause stays in the set if, were it the true one with its own estimated size, the best other cause would win by as
much as it did in at least 5 % of repeated measurements. The angle between what two causes can do says why: of two
one-parameter causes at angle phi, readings of size s mistake one for the other in about Phi(-s sin(phi / 2)).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from qsframework.hypotheses.search.subsets import Gram
from qsframework.plugin import Array

CONFIDENCE = 0.95
_DRAWS = 400
_FAR = 60.0
"""Loss of chi-square beyond which a cause is no rival, without a simulation."""


def alternative_set(
    gram: Gram,
    named: int,
    given: Sequence[int],
    exact: Mapping[int, float],
    seed: int = 0,
    without: Sequence[int] = (),
) -> tuple[int, ...]:
    """Causes that may stand in the place of `named` beside the `given` ones, the likeliest first; never the named.

    exact: squares that the exact fit leaves with each cause in this place, where such a fit was made; without: causes
    that do not compete, such as all axes of a place of which one is named
    """
    race = gram.given(given, without)
    H, _ = race.whitening
    falls = race.squares(race.c[None] @ H)[0]
    left = race.total - falls
    for i, rss in exact.items():
        left[i] = rss
    others = [i for i in gram.visible if i not in {*given, *without, named} and left[i] - left[named] < _FAR]
    rng = np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(race.G)
    noise = rng.standard_normal((_DRAWS, len(values))) @ (vectors * np.sqrt(np.maximum(values, 0.0))).T @ H
    kept = [i for i in others if _possible(race, i, left[i] - left[named], noise, given)]
    return tuple(sorted(kept, key=lambda i: left[i]))


def _possible(race: Gram, i: int, behind: float, noise: Array, given: Sequence[int]) -> bool:
    """Whether cause i, were it true, would be as far behind the best in a fair share of repeated measurements."""
    H, owner = race.whitening
    own = H[:, owner == i]
    if not own.size:
        return False
    part = race.c @ own
    if race.sided[i] and race.sizes[i] == 1:
        part = np.maximum(part, 0.0)
    falls = race.squares(noise + race.G @ (own @ part) @ H)
    falls[:, list(given)] = 0.0
    lost = falls.max(axis=1) - falls[:, i]
    return bool(behind <= np.quantile(lost, CONFIDENCE) + 1e-9)
