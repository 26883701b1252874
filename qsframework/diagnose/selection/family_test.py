"""The score (Lagrange multiplier) test of every cause at once, with family-wise p-values.

One Jacobian at the baseline serves all causes: under the baseline the whitened residuals r are standard normal beside
the fitted columns, so |Q' r|^2 of a cause with orthonormal directions Q (m, k) is chi-square with k degrees of freedom.
The largest of all (ranked by log p) is compared with its own distribution, drawn by Monte Carlo: max-T.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from qsframework.diagnose.linearization.columns import Subspace
from qsframework.plugin import Array, Indices

Flags = npt.NDArray[np.bool_]

DRAWS = 2000


@dataclass(frozen=True, eq=False)
class Block:
    """Directions Q (m, k), orthonormal; one_sided: only a positive coefficient counts."""

    Q: Array
    one_sided: bool = False


@dataclass(frozen=True, eq=False)
class Scores:
    """Of G blocks: statistic, degrees of freedom, log p of each alone, and family-wise p-value (G,).

    thresholds: log p that the smallest of all passes by chance, sorted (draws,)
    """

    statistic: Array
    dof: Array
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

    def s(self) -> Array:
        """Estimated visible size (G,) in units of noise."""
        return np.sqrt(np.maximum(self.statistic - self.dof, 0.0))


def blocks_of(subspaces: Sequence[Subspace]) -> tuple[Block, ...]:
    """The blocks of causes, invisible ones included with no direction."""
    return tuple(Block(s.Q, s.one_sided) for s in subspaces)


def score(blocks: Sequence[Block], residuals: Array, nu: float = np.inf, draws: int = DRAWS, seed: int = 0) -> Scores:
    """Test all blocks against whitened residuals (m,) that the fitted columns left.

    nu: degrees of freedom of the noise's unit, infinite where the noise is stated
    """
    sizes = np.array([b.Q.shape[1] for b in blocks])
    if not sizes.sum():
        none = np.zeros(len(blocks))
        return Scores(none, sizes, none, np.ones(len(blocks)), np.zeros(draws))
    Q = np.concatenate([b.Q for b in blocks], axis=1)
    owner = np.repeat(np.arange(len(blocks)), sizes)
    sided = np.array([b.one_sided for b in blocks])
    rng = np.random.default_rng(seed)
    drawn = rng.standard_normal((draws, min(Q.shape))) @ np.linalg.qr(Q, mode="r")
    unit = np.ones(draws) if np.isinf(nu) else rng.chisquare(nu, draws) / nu
    statistic = _statistics((residuals @ Q)[None], owner, sided, len(blocks))[0]
    log_p = log_p_values(statistic, sizes, sided, nu)
    chance = _statistics(drawn / np.sqrt(unit)[:, None], owner, sided, len(blocks))
    thresholds = np.sort(_smallest_log_p(chance, sizes, sided, nu))
    below = np.searchsorted(thresholds, log_p, side="right")
    adjusted = (below + 1.0) / (draws + 1.0)
    union = np.minimum(np.exp(np.minimum(log_p, 0.0)) * max(int((sizes > 0).sum()), 1), 1.0)
    adjusted = np.where(below == 0, np.minimum(adjusted, union), adjusted)
    return Scores(statistic, sizes, log_p, np.where(sizes > 0, adjusted, 1.0), thresholds)


def _smallest_log_p(statistic: Array, dof: Array, sided: Array, nu: float) -> Array:
    """Smallest log p of each draw: blocks of one kind are ranked by their statistic, so only the largest counts."""
    best = np.zeros(len(statistic))
    for k in np.unique(dof[dof > 0]):
        for side in (False, True):
            at = np.flatnonzero((dof == k) & (sided == side))
            if len(at):
                largest = statistic[:, at].max(axis=1)
                one = np.full(len(largest), side)
                best = np.minimum(best, log_p_values(largest, np.full(len(largest), k), one, nu))
    return best


def _statistics(coefficients: Array, owner: Indices, sided: Flags, count: int) -> Array:
    """Sum of squares (draws, G) of each block's coefficients; negative ones of one-sided blocks do not count."""
    kept = np.where(sided[owner] & (coefficients < 0.0), 0.0, coefficients)
    out = np.zeros((len(coefficients), count))
    edges = np.flatnonzero(np.r_[True, np.diff(owner) != 0])
    out[:, owner[edges]] = np.add.reduceat(kept**2, edges, axis=1)
    return out


def log_p_values(statistic: Array, dof: Array, sided: Array, nu: float = np.inf) -> Array:
    """log p of each block alone (..., G): chi-square, or F where the noise's unit has nu degrees of freedom."""
    from scipy.stats import chi2, f

    k = np.maximum(dof, 1)
    log_p = chi2.logsf(statistic, k) if np.isinf(nu) else f.logsf(statistic / k, k, nu)
    log_p = np.where(sided, np.where(statistic > 0.0, log_p - np.log(2.0), 0.0), log_p)
    return np.where(dof > 0, log_p, 0.0)
