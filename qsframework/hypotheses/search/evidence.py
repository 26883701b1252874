"""One evidence for causes and for laws that nobody has written, in nats, whatever their number of columns.

A block is a set of columns Z beside the fitted ones X, its coefficients drawn from N(0, tau^2 s^2). In the noise V of
visit errors rho, with r what X leaves of whitened readings, and E, lambda the left singular vectors and squared
singular values (the largest made 1) of what X leaves of Z, and c = E'r:

    dev(rho, tau) = free log(r'r - sum c^2 tau^2 lambda / (1 + tau^2 lambda)) + sum log(1 + tau^2 lambda)
                    + log |V| + log |X' V^-1 X|
    e = (min dev(rho, 0) - min dev(rho, tau)) / 2

the minima over grids of rho and tau. What e reaches by chance is told by draws of the noise that was found.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.estimation.projection import Flags
from qsframework.estimation.variance_component import with_variance
from qsframework.estimation.visit_noise import Reml
from qsframework.hypotheses.columns import by_size
from qsframework.hypotheses.search.family_test import null_draws
from qsframework.plugin import Array, Indices

TAUS = np.geomspace(0.7, 200.0, 11)
DRAWS = 500
_LEAST = 0.02
"""Share of the largest singular value below which a direction does not count."""
_LEFT = 1e-2
"""Share of a block's columns that must remain beside what is fitted."""
_MOST = 14
"""Directions of a block at most."""
_LARGE = 1_000_000
"""Readings times draws at once."""
_HELD = 200_000
"""Numbers of blocks that are whitened at once: few enough for the processor's own memory."""
_EVERY = 2
"""Of the grid of rho, one place of so many is looked at."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Of G blocks, nats.

    e (G,): of the readings; chance (draws,): the largest of all by chance, sorted; held (G, w): which share of the
    squares of some effects each block holds, in the noise that was found
    """

    e: Array
    chance: Array
    held: Array

    def threshold(self, level: float) -> float:
        """Evidence that is significant at a family-wise level."""
        return float(np.quantile(self.chance, 1.0 - level))

    @property
    def p_values(self) -> Array:
        """Family-wise (G,): beyond what draws can tell, and without them, by Markov's inequality of Bayes factors."""
        draws = len(self.chance)
        above = draws - np.searchsorted(self.chance, self.e, side="left")
        bound = np.minimum(len(TAUS) * len(self.e) * np.exp(-np.maximum(self.e, 0.0)), 1.0)
        p = (above + 1.0) / (draws + 1.0)
        return np.where(above == 0, np.minimum(p, bound), p)


@dataclass(frozen=True, eq=False)
class _Seen:
    """Blocks of one number of columns, in one noise, beside the fitted columns.

    of (b,): their places; X (b, c, m): their whitened columns; turn (b, d, c): what makes of them the directions E that
    count, up to fitted columns, which residuals have nothing of; 0 elsewhere; weight (b, d): lambda, 0 likewise
    """

    of: Indices
    X: Array
    turn: Array
    weight: Array

    def along(self, rest: Array) -> Array:
        """E' of residuals (m, n): (b, d, n)."""
        b, c, m = self.X.shape
        return self.turn @ (self.X.reshape(b * c, m) @ rest).reshape(b, c, -1)


def evidence(
    blocks: Iterable[Array],
    fits: Reml,
    values: Array,
    *,
    seed: int = 0,
    effects: Array | None = None,
    draws: int = DRAWS,
    measured: Flags | None = None,
) -> Evidence:
    """Evidence of blocks (m, k) m, asked one after the other, for readings (m,) m; effects (m, w) m: whose share each
    block holds is asked; measured (m,): readings that there are, None: all; draws: of the noise, 0: none."""
    found = int(fits.choose(values[:, None])[0])
    draws = min(draws, max(_LARGE // len(values), 100))
    every = np.column_stack([values, null_draws(fits, found, values, draws, seed, measured)])
    places = _places(fits, found, draws > 0, len(values) > _LARGE // DRAWS)
    rests = [fits.left(k, every) for k in places]
    totals = [np.maximum(np.square(rest).sum(axis=0), 1e-300) for rest in rests]
    costs = fits.free * np.log(totals) + np.array([fits.cost[k] for k in places])[:, None]
    effects = np.zeros((len(values), 0)) if effects is None else effects
    own = fits.left(found, effects)
    square = np.maximum(np.square(own).sum(axis=0), 1e-300)
    best, held = [np.zeros((0, every.shape[1]))], [np.zeros((0, effects.shape[1]))]
    for some in _batches(blocks):
        best.append(np.full((len(some), every.shape[1]), np.inf))
        held.append(np.zeros((len(some), effects.shape[1])))
        for k, rest, total in zip(places, rests, totals, strict=True):
            for part in _parts(some, fits, k):
                deviance = fits.free * np.log(_factors(part, rest, total, fits.free).min(axis=1)) + fits.cost[k]
                best[-1][part.of] = np.minimum(best[-1][part.of], deviance)
                if k == found:
                    held[-1][part.of] = np.square(part.along(own)).sum(axis=1) / square
    beside = np.concatenate(best)
    e = np.where(np.isfinite(beside), 0.5 * (costs.min(axis=0) - beside), 0.0)
    return Evidence(e[:, 0], np.sort(e[:, 1:].max(axis=0, initial=-np.inf)), np.concatenate(held))


def prior_of(block: Array, fits: Reml, values: Array) -> float:
    """The sd of the coefficients of a block (m, k) m that its evidence for readings (m,) m is largest with."""
    found = int(fits.choose(values[:, None])[0])
    best, sd = np.inf, 0.0
    for k in _places(fits, found, False, False):
        rest = fits.left(k, values)
        total = float(rest @ rest)
        for part in _parts([block], fits, k):
            factors = _factors(part, rest[:, None], np.array([total]), fits.free)[0, :, 0]
            deviance = fits.free * np.log(factors) + fits.cost[k]
            if (least := float(deviance.min())) < best:
                largest = float(np.linalg.svd(fits.left(k, block), compute_uv=False)[0])
                best, sd = least, float(TAUS[deviance.argmin()]) * float(np.sqrt(total / fits.free)) / largest
    return sd


def _places(fits: Reml, found: int, drawn: bool, many: bool) -> list[int]:
    """Places of the grid of rho to look at: the one that was found alone where repeats told it; of the readings
    themselves none far beyond it, for what a block explains can only have passed for that noise; near it of many."""
    if fits.by is not fits.Q:
        return [found]
    places = sorted({*range(0, len(fits.cost), _EVERY), found})
    if drawn and not many:
        return places
    return [k for k in places if (found - _EVERY if many else 0) <= k <= found + _EVERY]


def _batches(blocks: Iterable[Array]) -> Iterator[list[Array]]:
    """Blocks that are whitened at once, so that not all of them are where readings are many."""
    some, size = list[Array](), 0
    for block in blocks:
        some.append(block)
        size += block.size
        if size >= _HELD:
            yield some
            some, size = [], 0
    if some:
        yield some


def _parts(blocks: Sequence[Array], fits: Reml, k: int) -> list[_Seen]:
    """The directions of the blocks that the fit in noise k leaves enough of."""
    white = np.ascontiguousarray(fits.noise.noises[k].whiten(np.concatenate(blocks, axis=1)).T)
    fitted = white @ fits.Q[k]
    out: list[_Seen] = []
    for of, at in by_size(np.array([b.shape[1] for b in blocks], dtype=np.intp)):
        X, F = white[at], fitted[at]
        products = X @ X.transpose(0, 2, 1)
        largest = np.diagonal(products, axis1=1, axis2=2).max(axis=1)
        values, vectors = np.linalg.eigh(products - F @ F.transpose(0, 2, 1))
        values, vectors = values[:, ::-1], vectors[:, :, ::-1]
        seen = (values > _LEAST**2 * values[:, :1]) & (values > _LEFT**2 * largest[:, None]) & (values > 1e-300)
        seen &= np.arange(int(at.shape[1])) < _MOST
        some = seen.any(axis=1)
        weight = np.where(seen, values / np.where(values[:, :1] > 0.0, values[:, :1], 1.0), 0.0)
        turn = vectors / np.sqrt(np.where(seen, values, np.inf))[:, None, :]
        d = int(seen.sum(axis=1).max(initial=0))
        if some.any():
            out.append(_Seen(of[some], X[some], turn[some][:, :, :d].transpose(0, 2, 1), weight[some][:, :d]))
    return out


def _factors(part: _Seen, rest: Array, total: Array, free: int) -> Array:
    """exp(dev / free) (b, taus, n) of residuals (m, n), without what the noise costs."""
    return with_variance(part.weight, np.square(part.along(rest)), total, np.square(TAUS), free)
