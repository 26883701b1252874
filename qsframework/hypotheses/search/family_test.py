"""The F test of every block of columns at once, with family-wise p-values, in a noise whose size is not known.

Of whitened readings r that the fitted columns left, a block with k directions takes S = |Q'r|^2 of R = |r|^2, and
F = (S/k) / ((R - S)/(free - k)). Blocks are ranked by log p of F(k, nu - k); nu allows for the error that visits share,
whose size rho is estimated. The strongest of all is compared with that of the same residuals dealt out anew, in each of
which rho is estimated again; beyond the resolution of such draws p is that of F times the number of blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from qsframework.estimation.projection import Flags
from qsframework.estimation.tails import chi2_sf, f_sf
from qsframework.estimation.visit_noise import Reml
from qsframework.hypotheses.columns import by_size
from qsframework.plugin import Array, Indices

DRAWS = 1000
_LARGE = 4_000_000
"""Readings times draws at once."""
_NEAR = 2
"""Places of the grid to each side of the estimate that a draw looks at where readings are many: they tell rho well."""
_MANY = 3000


def null_draws(fits: Reml, k: int, values: Array, draws: int, seed: int, measured: Flags | None = None) -> Array:
    """Draws (3 R, draws) m of readings (3 R,) m with nothing in them, in noise k; measured (3 R,): those that exist.

    The whitened residuals change places, row by row, and their signs: tails stay as they were measured, where Gaussian
    draws would have none, and whatever acts somewhere loses its place.
    """
    rng = np.random.default_rng(seed)
    rows = fits.left(k, values).reshape(-1, 3)
    there = np.ones(rows.shape, dtype=bool) if measured is None else measured.reshape(-1, 3)
    kind = there @ [1, 2, 4]
    drawn = np.zeros((len(rows), 3, draws))
    for pattern in np.unique(kind).tolist():
        at = np.flatnonzero(kind == pattern)
        order = rng.permuted(np.tile(at, (draws, 1)), axis=1)
        drawn[at] = rows[order].transpose(1, 2, 0)
    drawn *= rng.choice(np.array([-1.0, 1.0]), drawn.shape)
    return fits.noise.noises[k].colour(drawn.reshape(len(values), draws)) * there.reshape(-1, 1)


@dataclass(frozen=True, eq=False)
class FamilyBlock:
    """Columns (m, k) of readings in metres, or whitened ones; one_sided: only a positive coefficient counts."""

    columns: Array
    one_sided: bool = False


@dataclass(frozen=True, eq=False)
class Scores:
    """Of G blocks: s estimated, degrees of freedom, log p of each alone, and family-wise p-value (G,).

    thresholds: log p that the smallest of all passes by chance, sorted (draws,)
    """

    size: Array
    dof: Indices
    log_p: Array
    p_adjusted: Array
    thresholds: Array

    @property
    def p_value(self) -> float:
        """Probability that nothing acts and yet some block looks as strong as the strongest."""
        return float(self.p_adjusted.min(initial=1.0))

    def threshold(self, level: float) -> float:
        """log p below which a block is significant at a family-wise level."""
        return float(np.quantile(self.thresholds, level))


@dataclass(frozen=True, eq=False)
class _Bank:
    """All columns (m, K) of the blocks, those of one size together: their places (blocks, k) by k."""

    columns: Array
    parts: tuple[tuple[Indices, Indices], ...]
    sided: Flags

    @cached_property
    def dof(self) -> Indices:
        out = np.zeros(len(self.sided), dtype=np.intp)
        for blocks, at in self.parts:
            out[blocks] = at.shape[1]
        return out

    def squares(self, white: Array, left: Array) -> Array:
        """S (G, d) of residuals (m, d), by columns that are whitened and freed of the fitted ones."""
        c = white.T @ left
        out = np.zeros((len(self.sided), left.shape[1]))
        for blocks, at in self.parts:
            X = white.T[at]
            gram: Array = X @ X.transpose(0, 2, 1)
            gram += 1e-12 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(at.shape[1]) + 1e-300
            z: Array = np.asarray(np.linalg.solve(np.linalg.cholesky(gram), c[at]), dtype=np.float64)
            positive = ~self.sided[blocks][:, None] | (z[:, 0] > 0.0)
            out[blocks] = np.square(z).sum(axis=1) * positive
        return out


def _bank(blocks: Sequence[FamilyBlock]) -> _Bank:
    parts = by_size(np.array([b.columns.shape[1] for b in blocks], dtype=np.intp))
    columns = np.concatenate([b.columns for b in blocks], axis=1)
    return _Bank(columns, tuple(parts), np.array([b.one_sided for b in blocks], dtype=bool))


def family_test(
    blocks: Sequence[FamilyBlock],
    fits: Reml,
    values: Array,
    seed: int = 0,
    draws: int = DRAWS,
    measured: Flags | None = None,
) -> Scores:
    """Test all blocks against readings (m,) in metres; measured (m,): those that there are, None: all."""
    if not blocks or not sum(b.columns.shape[1] for b in blocks):
        none = np.zeros(len(blocks))
        return Scores(none, none.astype(np.intp), none, np.ones(len(blocks)), np.zeros(draws))
    bank = _bank(blocks)
    draws = min(draws, max(_LARGE // len(values), 200))
    found = int(fits.choose(values[:, None])[0])
    among = range(len(fits.cost))
    if len(values) > _MANY:
        among = range(max(found - _NEAR, 0), min(found + _NEAR + 1, len(fits.cost)))
    drawn = null_draws(fits, found, values, draws, seed, measured)
    every = np.column_stack([values, drawn])
    places = np.concatenate([[found], fits.choose(drawn, among)])
    size, log_p = np.zeros((2, len(blocks), draws + 1))
    for k in np.unique(places):
        at = np.flatnonzero(places == k)
        size[:, at], log_p[:, at] = _scored(bank, fits, int(k), every[:, at])
    return _scores(bank, size[:, 0], log_p[:, 0], np.sort(log_p[:, 1:].min(axis=0)))


def _scores(bank: _Bank, size: Array, log_p: Array, thresholds: Array) -> Scores:
    below = np.searchsorted(thresholds, log_p, side="right")
    adjusted = (below + 1.0) / (len(thresholds) + 1.0)
    union = np.minimum(np.exp(np.minimum(log_p, 0.0)) * max(int((bank.dof > 0).sum()), 1), 1.0)
    adjusted = np.where(below == 0, np.minimum(adjusted, union), adjusted)
    return Scores(size, bank.dof, log_p, np.where(bank.dof > 0, adjusted, 1.0), thresholds)


def _scored(bank: _Bank, fits: Reml, k: int, values: Array) -> tuple[Array, Array]:
    """s and log p (G, d) of the blocks in readings (m, d), in noise k."""
    residuals = fits.left(k, values)
    total = np.square(residuals).sum(axis=0)
    S, dof = bank.squares(fits.left(k, bank.columns), residuals), np.maximum(bank.dof, 1)[:, None]
    unit = np.maximum(total - S, 1e-12 * total + 1e-300) / np.maximum(fits.free - dof, 1)
    chi = S / unit
    size = np.sqrt(np.maximum(chi - dof, 0.0))
    return size, log_p_values(chi, bank.dof[:, None], bank.sided[:, None], fits.freedom(k))


def log_p_values(statistic: Array, dof: Array | Indices, sided: Array | Flags, nu: float = np.inf) -> Array:
    """log p of each block alone, of k F: chi-square, or F(k, nu - k) where the unit of the noise is estimated."""
    k = np.maximum(dof, 1)
    p = chi2_sf(statistic, k) if np.isinf(nu) else f_sf(statistic / k, k, np.maximum(nu - k, 1.0))
    with np.errstate(divide="ignore"):
        log_p = np.log(p)
    log_p = np.where(sided, np.where(statistic > 0.0, log_p - np.log(2.0), 0.0), log_p)
    return np.where(dof > 0, log_p, 0.0)


def chance(blocks: Sequence[FamilyBlock], nu: float = np.inf, draws: int = 2000, seed: int = 0) -> Array:
    """log p (draws,), sorted, that the strongest of blocks with orthonormal columns reaches where nothing acts.

    Of readings that are still to be measured: independent noise, whose unit has nu degrees of freedom.
    """
    sizes = np.array([b.columns.shape[1] for b in blocks])
    if not sizes.sum():
        return np.zeros(draws)
    sided = np.array([b.one_sided for b in blocks], dtype=bool)
    Q = np.concatenate([b.columns for b in blocks], axis=1)
    owner = np.repeat(np.arange(len(blocks)), sizes)
    rng = np.random.default_rng(seed)
    drawn = rng.standard_normal((draws, min(Q.shape))) @ np.linalg.qr(Q, mode="r")
    if np.isfinite(nu):
        drawn /= np.sqrt(rng.chisquare(nu, draws) / nu)[:, None]
    kept = np.where(sided[owner] & (drawn < 0.0), 0.0, drawn)
    squares = np.zeros((draws, len(blocks)))
    edges = np.flatnonzero(np.r_[True, np.diff(owner) != 0])
    squares[:, owner[edges]] = np.add.reduceat(kept**2, edges, axis=1)
    best = np.zeros(draws)
    for k in np.unique(sizes[sizes > 0]):  # blocks of one kind are ranked by their squares: only the largest counts
        for side in (False, True):
            at = np.flatnonzero((sizes == k) & (sided == side))
            if len(at):
                largest = squares[:, at].max(axis=1)
                best = np.minimum(best, log_p_values(largest, np.full(draws, k), np.full(draws, side), nu))
    return np.sort(best)
