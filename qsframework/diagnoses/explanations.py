"""What may be true of readings, and how well further visits part it.

Explanations h: places that move by a law, and causes of the library. With X the fitted columns, Z those of h, its
weights drawn from N(0, sd^2), and everything whitened, a fit of h to readings y has

    P_h = [X Z_h]' [X Z_h] + diag(0, 1 / sd^2),   theta_h = P_h^-1 [X Z_h]' y.

Were h true, a rival k would fit theta_{k|h}. A visit with columns F adds

    delta_hk^2 += r' (I + F_k P_k^-1 F_k')^-1 r,   r = F_h theta_h - F_k theta_{k|h}

and J = sum of sqrt(pi_h pi_k) exp(-delta_hk^2 / 8), over pairs that differ in place or variable, is Bhattacharyya's
bound of the chance to confuse them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from qsframework.estimation.projection import Flags
from qsframework.experiment import Experiment, Frame
from qsframework.experiment.observations import ReadingRows
from qsframework.hypotheses.catalogue.causes import Cause
from qsframework.hypotheses.catalogue.generic_laws import Motions, motions
from qsframework.hypotheses.catalogue.place_motions import VisitGroups, by_group, law_columns, places_of, variables
from qsframework.hypotheses.columns import make_case
from qsframework.hypotheses.search.places import PlaceMotion
from qsframework.plugin import Array, Indices

_DRAWS = 400


@dataclass(frozen=True)
class Suspect:
    """An remaining explanation: a law of a place or a cause, in words of neither; share of the evidence; place:
    number of the answer that it belongs to."""

    law: PlaceMotion | Cause
    share: float
    place: int

    @property
    def kind(self) -> str:
        """By what it moves."""
        return self.law.name if isinstance(self.law, Cause) else "*".join(self.law.law.by)


@dataclass(frozen=True, eq=False, kw_only=True)
class Foretold:
    """What explanations could do to rows, m, not whitened: fitted (3 R, f) directions that they tell, columns of each
    of H explanations (3 R, p), their weights drawn with sd 1; residuals (3 R,) m of what was read."""

    rows: ReadingRows
    fitted: Array
    own: tuple[Array, ...]
    residuals: Array
    suspects: tuple[Suspect, ...]

    def explanations(self, first: Flags, later: Flags) -> Explanations:
        """With some rows (R,) read already, and the visits of others still to come."""
        known, y = self.whitened(first)
        to_come, _ = self.whitened(later)
        at = by_group(self.rows.plus[later])
        visits = VisitGroups(at, np.zeros(int(later.sum()), dtype=np.intp))
        kinds = {kind: i for i, kind in enumerate(dict.fromkeys(s.kind for s in self.suspects))}
        return Explanations(
            first=known,
            visits=tuple(visits.split(columns) for columns in to_come),
            y=y,
            odds=np.array([s.share for s in self.suspects]),
            place=np.array([s.place for s in self.suspects]),
            kind=np.array([kinds[s.kind] for s in self.suspects]),
            free=self.fitted.shape[1],
        )

    def whitened(self, rows: Flags) -> tuple[tuple[Array, ...], Array]:
        """Columns of all explanations, the fitted ones first in each, and residuals, in the noise of some rows (R,)."""
        kept = np.flatnonzero(rows)
        noise = self.rows.take(kept).padded_noise
        at = (3 * kept[:, None] + np.arange(3)).ravel()
        fitted = noise.whiten(self.fitted[at])
        own = tuple(np.concatenate([fitted, noise.whiten(Z[at])], axis=1) for Z in self.own)
        return own, noise.whiten(self.residuals[at])


def motions_at(experiment: Experiment, rows: ReadingRows, x: Mapping[str, float], frames: Sequence[Frame]) -> Motions:
    """How every place would move the rows, about parameter values by name; the others are at their nominal ones."""
    model = experiment.model()
    return motions(
        model, rows, np.array([x.get(n, v) for n, v in zip(model.names, model.nominal, strict=True)]), frames
    )


def foretold(
    experiment: Experiment, moved: Motions, x: Mapping[str, float], residuals: Array, suspects: Sequence[Suspect]
) -> Foretold:
    """The columns of all explanations about the values of the fitted parameters, by name. residuals (R, 3) m, zero
    where nothing is read."""
    causes = [s.law for s in suspects if isinstance(s.law, Cause)]
    case = make_case(experiment, moved.rows, list(x), causes, dict(x), residuals, moved.frames)
    by, places = {v.name: v for v in variables(moved)}, {(*p.law.where, p.law.part): p for p in places_of(moved)}
    columns: list[Array] = []
    for s in suspects:
        if isinstance(s.law, Cause):
            columns.append(case.metres(causes.index(s.law)))
            continue
        law = s.law.law
        place = places[(*law.where, law.part)]
        own = [by[f] for f in by if f in law.by or not f]
        Z = dict(law_columns(place, s.law.at, moved, own))[law.by] * s.law.sd
        columns.append(Z.reshape(-1, Z.shape[2]))
    return Foretold(
        rows=moved.rows,
        fitted=case.noise.colour(case.fit.Q),
        own=tuple(columns),
        residuals=residuals.ravel(),
        suspects=tuple(suspects),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Explanations:
    """Columns of each of H explanations, whitened, their weights drawn with sd 1: first (m, p) of what was read, at
    each of N visits to come (N, w, p); y (m,): what was read; odds (H,); place, kind (H,): numbers of the answers;
    free: how many columns, the first of each, are fitted freely."""

    first: tuple[Array, ...]
    visits: tuple[Array, ...]
    y: Array
    odds: Array
    place: Indices
    kind: Indices
    free: int

    @cached_property
    def _information(self) -> list[Array]:
        """P_h (p, p) of what was read."""
        widths = [int(C.shape[1]) for C in self.first]
        prior = [np.diag([1e-9] * self.free + [1.0] * (width - self.free)) for width in widths]
        return [C.T @ C + P for C, P in zip(self.first, prior, strict=True)]

    @cached_property
    def theta(self) -> list[Array]:
        """What each fits to what was read."""
        pairs = zip(self.first, self._information, strict=True)
        return [np.asarray(np.linalg.solve(P, C.T @ self.y), dtype=np.float64) for C, P in pairs]

    @cached_property
    def shown(self) -> Array:
        """What each predicts of the visits (N, w, H)."""
        return np.stack([F @ t for F, t in zip(self.visits, self.theta, strict=True)], axis=-1)

    @cached_property
    def _drawn(self) -> list[Array]:
        """C_k' C_h theta_h (p, H) of each k."""
        predicted = np.stack([C @ t for C, t in zip(self.first, self.theta, strict=True)], axis=-1)
        return [C.T @ predicted for C in self.first]

    @cached_property
    def _weights(self) -> Array:
        """(H, H): of the pairs that differ in place or variable."""
        apart = (self.place[:, None] != self.place) | (self.kind[:, None] != self.kind)
        return np.sqrt(self.odds[:, None] * self.odds) * apart

    def gains(self, taken: Sequence[int], among: Indices) -> Array:
        """By how much each visit (n,) would raise delta^2 [k, h] (n, H, H), after those that are taken."""
        out = np.empty((len(among), len(self.odds), len(self.odds)))
        seen = self.shown[list(taken)].reshape(-1, len(self.odds))
        for k, (P, drawn, F) in enumerate(zip(self._information, self._drawn, self.visits, strict=True)):
            own = F[list(taken)].reshape(-1, F.shape[2])
            inverse = np.linalg.inv(P + own.T @ own)
            r = self.shown[among] - F[among] @ (inverse @ (drawn + own.T @ seen))
            S = np.eye(F.shape[1]) + F[among] @ inverse @ F[among].transpose(0, 2, 1)
            out[:, k] = (r * np.linalg.solve(S, r)).sum(axis=1)
        return out

    def bound(self, squares: Array) -> Array:
        """J (n,) of delta^2 (n, H, H)."""
        return np.asarray((self._weights.T * np.exp(-squares / 8.0)).sum(axis=(1, 2)))

    def squares(self, taken: Sequence[int]) -> Array:
        """delta^2 [k, h] of visits together."""
        out = np.zeros((len(self.odds), len(self.odds)))
        for i in range(len(taken)):
            out += self.gains(taken[:i], np.array([taken[i]]))[0]
        return out

    def chances(self, taken: Sequence[int], seed: int) -> tuple[float, float]:
        """That the answer with the largest share has the right place, and the right place and variable."""
        rng, square = np.random.default_rng(seed), self.squares(taken)
        both = self.place * (int(self.kind.max(initial=0)) + 1) + self.kind
        labels = [np.unique(label, return_inverse=True)[1] for label in (self.place, both)]
        right = np.zeros(2)
        for h, share in enumerate(self.odds):
            evidence = seen_evidence(self.odds, square[:, h], h, rng)
            right += [share * winners(evidence, own, int(own.max()) + 1)[own[h]] for own in labels]
        return float(right[0]), float(right[1])


def seen_evidence(odds: Array, square: Array, h: int, rng: np.random.Generator, draws: int = _DRAWS) -> Array:
    """Evidence (draws, H) of explanations of some odds (H,) in repeated measurements, h being true, by their delta^2
    (H,) against it."""
    out = np.log(odds / odds[h]) - 0.5 * square + np.sqrt(square) * rng.standard_normal((draws, len(square)))
    out[:, h] = 0.0
    return np.asarray(out, dtype=np.float64)


def winners(evidence: Array, label: Indices, labels: int) -> Array:
    """Share (labels,) of measurements in which the explanations of each label (H,) hold the most evidence (draws, H)
    together."""
    shares = np.exp(evidence) @ np.eye(labels)[label]
    return np.bincount(np.argmax(shares, axis=1), minlength=labels) / len(evidence)
