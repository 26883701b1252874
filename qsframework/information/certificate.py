"""How far a design is from the best possible: the equivalence theorem, recomputed in float64.

A criterion is psi(M), smaller is better, and 1 / psi is concave and homogeneous of degree 1 in the
information matrix M (trace of the covariance, det(cov)^(1/p), ...). With G = -d log psi / d M, for
every design M* that the experiment allows

    psi(M) / psi(M*) <= <G, M*>

and the largest <G, M*> over all allowed designs is a linear programme with a closed form. Information
M0 that is there before (a prior, readings already taken) is part of every M*.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from qsframework.plugin import Array, Indices

Group = slice | Indices


@dataclass(frozen=True, eq=False)
class Allowed:
    """Designs over N candidates: in each group the weights sum to its share and none exceeds `cap`.

    A group is a slice or the indices of its candidates; the groups are disjoint.
    """

    groups: tuple[Group, ...]
    shares: tuple[float, ...]
    cap: float = 1.0

    def best(self, scores: Array) -> float:
        """Largest sum of w_i scores_i over the allowed designs."""
        return float(sum(self.in_group(scores[g], share) for g, share in zip(self.groups, self.shares, strict=True)))

    def in_group(self, values: Array, share: float) -> float:
        """Largest sum of w_i values_i with weights of sum `share`."""
        if share <= 0.0:
            return 0.0
        if self.cap >= share:
            return share * float(values.max())
        full = int(np.floor(share / self.cap + 1e-9))
        rest = share - full * self.cap
        count = min(full + 1, len(values))
        top = -np.sort(-np.partition(values, len(values) - count)[len(values) - count :])
        return self.cap * top[:full].sum() + (rest * top[full] if rest > 1e-12 and full < len(top) else 0.0)

    def problems(self, count: int) -> str:
        """Why no design is allowed, or nothing."""
        for group, share in zip(self.groups, self.shares, strict=True):
            size = len(range(*group.indices(count))) if isinstance(group, slice) else len(group)
            if share > 0 and size * self.cap < share * (1.0 - 1e-9):
                return f"{size} candidates with weights up to {self.cap:.4g} cannot reach their share {share:.4g}"
        return ""


def everything(count: int) -> Allowed:
    """All designs over `count` candidates."""
    return Allowed((slice(0, count),), (1.0,))


def bound_of(scores: Array, allowed: Allowed, prior: float = 0.0) -> float:
    """Certified efficiency in [0, 1] from the scores <G, M_i> of all candidates; `prior` is <G, M0>."""
    best = prior + allowed.best(scores)
    return float(min(1.0 / best, 1.0)) if best > 0 and np.isfinite(best) else 0.0


def deletable(scores: Array, parameters: int) -> npt.NDArray[np.bool_]:
    """Candidates (N,) that no D-optimal design over all of them uses (Harman and Pronzato 2007, for k rows each).

    scores are tr(cov M_i) / p. With M* optimal and H = M^(-1/2) M* M^(-1/2), tr H <= p max(scores) and
    tr H^-1 <= p; both bound the smallest eigenvalue of H, and a support point of M* has at least that score.
    """
    slack = parameters * max(float(scores.max()) - 1.0, 0.0)
    least = 1.0 + slack / 2.0 - np.sqrt(slack * (4.0 + slack - 4.0 / parameters)) / 2.0
    return scores < least * (1.0 - 1e-9)
