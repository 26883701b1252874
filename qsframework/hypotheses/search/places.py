"""Places compete: which part moves beyond the model, whatever law makes it move.

Whitened in one size rho of the error that a visit shares, with X the fitted columns, J the motions of a place at each
visit, D what they scale with (nothing, or the torque there), and Z the columns of a law,

    y = X b + J D u + Z w + e,   Var u = s^2 tau^2,   Var w = s^2 tg^2,   Var e = s^2
    -2 L = n log RSS + log |V| + log |X' V^-1 X|        (REML: u and w integrated out, s profiled)

with J and Z of mean square 1 a reading. exp L is averaged over tau, tg and rho, never maximised. The repeatability is
one more place: all readings together. All axes of a place have half of its prior, each alone shares the rest; so have
motions that differ freely at each visit, and laws. Places that move the markers alike are one entry.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from qsframework.estimation.variance_component import with_variance
from qsframework.estimation.visit_noise import Reml, restricted
from qsframework.hypotheses.catalogue.generic_laws import Motions
from qsframework.hypotheses.catalogue.law import Law, LikelyPlace
from qsframework.hypotheses.catalogue.place_motions import (
    Place,
    Variable,
    VisitGroups,
    law_columns,
    places_of,
    variables,
    visits_of,
)
from qsframework.plugin import Array

_TAUS = np.geomspace(0.15, 6.0, 8)
_WEIGHTS = np.geomspace(0.1, 12.0, 7)
"""tg of laws."""
_RHOS = (0.0, 0.5, 0.75, 1.8, 3.2)
"""The first has half of the prior."""
_LAWS_AT, _MOST_LAWS = 12.0, 12
"""Nats below the likeliest place within which the laws of a place are looked at, and of how many at most."""
_ALIKE = 0.03
"""Share of a motion that another place cannot do, below which no reading tells the two apart."""
_RIVAL = 4.0
"""Nats below a place's likeliest axes within which others count as its motion too."""
_STANDS_IN = 2.3
"""Nats that a law pays whose variable can hardly reach its place: odds of one to ten."""
_PLAIN = 2.0
"""Nats by which laws must be likelier than a motion that differs at each visit, to be told."""
_TOGETHER = 0.95
"""Of the evidence, which the places that are told hold together."""
_ZERO = 1e-9
"""Of the largest eigenvalue of a visit: directions below are none."""
_SMALL = 10_000
"""Numbers of a matrix below which one batch of products takes less than a symmetric one each."""
_MOST = 20_000_000
"""Numbers of a place's motions at once: beyond them, where very many visits share their noise, no place is told."""


@dataclass(frozen=True, eq=False)
class PlaceMotion:
    """One way in which a place may move: about some of its axes, freely (a law without factors) or by a law.

    evidence: nats against nothing, its prior included; sd: of a coefficient, rad or m per unit of its functions
    """

    place: Place
    at: tuple[int, ...]
    law: Law
    evidence: float
    sd: float


@dataclass(frozen=True, eq=False)
class RankedPlace:
    """A place, or several that move the markers alike, the plainest first; evidence: nats against nothing, of all its
    explanations, the likeliest of them first."""

    places: tuple[Law, ...]
    evidence: float
    explanations: tuple[PlaceMotion, ...]

    @property
    def is_repeatability(self) -> bool:
        """Whether all readings of a visit move together, differently at each."""
        return all(law.part == "readings" for law in self.places) and not self.explanations[0].law.by

    def told(self, share: float) -> LikelyPlace:
        """By a law where one is plainly likelier than a motion of its own at each visit."""
        free = [e for e in self.explanations if not e.law.by]
        laws = [e for e in self.explanations if e.law.by]
        plain = not free or (bool(laws) and _total(laws) > _total(free) + _PLAIN)
        law = laws[0].law if plain else free[0].law
        other = {x.where: x for x in self.places if x.where != law.where}
        return LikelyPlace(law, share, free[0].sd if free else float("nan"), tuple(other.values()))


@dataclass(frozen=True, eq=False)
class Competition:
    """All places, the likeliest first, and causes by name: nats against nothing, of each with its prior."""

    entries: tuple[RankedPlace, ...]
    causes: Mapping[str, float]

    @property
    def parts(self) -> list[RankedPlace]:
        """All but the repeatability, the likeliest first."""
        return [e for e in self.entries if not e.is_repeatability]

    @property
    def margin(self) -> float:
        """Nats by which some part of the arm moves rather than nothing, or all readings of a visit together, which is
        repeatability."""
        parts = [e.evidence for e in self.parts]
        other = [0.0, *(e.evidence for e in self.entries if e.is_repeatability)]
        return _mean(parts) - float(np.logaddexp.reduce(other)) if parts else -np.inf

    @property
    def lead(self) -> float:
        """Nats by which the likeliest part of the arm is ahead of nothing and the repeatability together."""
        other = [0.0, *(e.evidence for e in self.entries if e.is_repeatability)]
        return max((e.evidence for e in self.parts), default=-np.inf) - float(np.logaddexp.reduce(other))

    @property
    def causes_ahead(self) -> float:
        """Nats by which the causes of the library are likelier than places, one on average against the other."""
        parts = [e.evidence for e in self.parts]
        return _mean(list(self.causes.values())) - _mean(parts) if parts and self.causes else -np.inf

    def likely(self, blocks: Sequence[tuple[Law, float]] = ()) -> tuple[LikelyPlace, ...]:
        """The places that hold 95 % of the evidence, the likeliest first; half of it is that of blocks (nats)."""
        parts = self.parts
        odds = _shares([e.evidence for e in parts])
        more = np.zeros(len(parts))
        for (law, _), share in zip(blocks, _shares([e for _, e in blocks]), strict=True):
            home = next((i for i, e in enumerate(parts) if law.where in {x.where for x in e.places}), None)
            if home is not None:
                more[home] += share
        shares = 0.5 * odds + 0.5 * more / more.sum() if more.any() else odds
        told: list[LikelyPlace] = []
        for entry, share in sorted(zip(parts, shares.tolist(), strict=True), key=lambda x: -x[1]):
            if sum(x.share for x in told) < _TOGETHER:
                told.append(entry.told(share))
        return tuple(told)


def _shares(evidence: Sequence[float]) -> Array:
    odds = np.exp(np.array(evidence) - max(evidence, default=0.0))
    return odds / max(odds.sum(), 1e-300)


def _mean(evidence: Sequence[float] | Array) -> float:
    return float(np.logaddexp.reduce(evidence) - np.log(len(evidence)))


def compete(moved: Motions, fits: Reml, values: Array, causes: Mapping[str, Array]) -> Competition:
    """Every place with its evidence in readings (m,) m, and causes by their columns (m, p) m."""
    visits = visits_of(moved.rows)
    race = _Race(fits, visits, _noises(fits, values, visits))
    known = {name: race.cause(columns) for name, columns in causes.items()}
    free = [race.free(p) for p in places_of(moved) if p.plus.size * visits.together <= _MOST]
    ranked = sorted(free, key=lambda own: -_total(own))
    near = [own for own in ranked[:_MOST_LAWS] if _total(own) > _total(ranked[0]) - _LAWS_AT]
    by = variables(moved)
    every = [[*own, *race.laws(own, moved, by)] for own in near] + ranked[len(near) :]
    top = max(map(_total, every), default=0.0)
    groups = race.alike([own for own in every if _total(own) > top - _LAWS_AT])
    grouped = {id(own) for group in groups for own in group}
    groups += [[own] for own in every if id(own) not in grouped]
    entries = [entry for group in groups for entry in _entries(group)]
    return Competition(tuple(sorted(entries, key=lambda e: -e.evidence)), known)


def _entries(group: Sequence[Sequence[PlaceMotion]]) -> Iterator[RankedPlace]:
    """Of places of one motion; their evidence is that of the likeliest, for they are one answer.

    What moves all readings differently at each visit is repeatability, and an entry of its own.
    """
    places = tuple(dict.fromkeys(own[0].place.law for own in group))
    if any(law.part == "readings" for law in places):
        yield _entry((Law("readings", "", ()),), [[e for e in own if not e.law.by] for own in group])
        group = [[e for e in own if e.law.by] for own in group]
    if any(group):
        yield _entry(places, [own for own in group if own])


def _entry(places: tuple[Law, ...], group: Sequence[Sequence[PlaceMotion]]) -> RankedPlace:
    ordered = sorted((e for own in group for e in own), key=lambda e: -e.evidence)
    return RankedPlace(places, max(_total(own) for own in group), tuple(ordered))


def _total(own: Sequence[PlaceMotion]) -> float:
    return float(np.logaddexp.reduce([e.evidence for e in own]))


@dataclass(frozen=True, eq=False)
class _Noise:
    """The fit in noise k of the grid: orthonormal columns Q (G, r, f) and residuals y (G, r) by group, their squares,
    the degrees of freedom, the unit s of the noise, and L without any place, its prior included."""

    k: int
    Q: Array
    y: Array
    total: float
    free: int
    start: float

    @property
    def unit(self) -> float:
        return float(np.sqrt(self.total / max(self.free, 1)))


def _noises(fits: Reml, values: Array, visits: VisitGroups) -> tuple[_Noise, ...]:
    out: list[_Noise] = []
    fitted = fits.noise.noises[0].colour(fits.Q[0])
    for rho in _RHOS:
        k = int(np.argmin(np.abs(fits.noise.rhos - rho)))
        noise, rest = fits.noise.noises[k], fits.left(k, values)
        total = max(float(rest @ rest), 1e-300)
        prior = float(np.log(0.5 if rho == 0.0 else 0.5 / (len(_RHOS) - 1)))
        start = prior - 0.5 * (fits.free * np.log(total) + restricted(noise, fitted)[1])
        Q, y = visits.split(fits.Q[k]), visits.split(rest[:, None])[..., 0]
        out.append(_Noise(k, Q, y, total, fits.free, float(start)))
    return tuple(out)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Free:
    """A motion that is free at each visit, in T sizes: what it leaves of a fit in one noise.

    U (G, r, d): its directions; w (T, K): what V^-1 takes of each of the K; a (K, f), b (K,): fitted columns and
    residuals along them; products (T, f, f): X' V^-1 X; x (T, f): X' V^-1 y; rss (T,); log_det (T,)
    """

    U: Array
    w: Array
    a: Array
    b: Array
    products: Array
    x: Array
    rss: Array
    log_det: Array

    @cached_property
    def inverse(self) -> Array:
        """Of the products (T, f, f)."""
        return np.asarray(np.linalg.inv(self.products), dtype=np.float64)


def _free(white: Array, noise: _Noise, taus: Array) -> _Free:
    """Motions (G, r, c), whitened."""
    values, vectors = np.linalg.eigh(white.transpose(0, 2, 1) @ white)
    seen = values > _ZERO * max(float(values.max(initial=0.0)), 1e-300)
    U = white @ (vectors / np.sqrt(np.where(seen, values, np.inf))[:, None])
    lam = np.where(seen, values, 0.0).ravel()
    back = U.transpose(0, 2, 1)
    a, b = (back @ noise.Q).reshape(len(lam), noise.Q.shape[2]), (back @ noise.y[..., None]).ravel()
    grown = np.square(taus)[:, None] * lam
    w = grown / (1.0 + grown)
    products = np.eye(a.shape[1]) - _weighted(a, w)
    x = -(w * b) @ a
    rss = noise.total - w @ np.square(b) - (x * np.linalg.solve(products, x[..., None])[..., 0]).sum(axis=1)
    log_det = np.log1p(grown).sum(axis=1) + np.linalg.slogdet(products)[1]
    least = np.maximum(rss, 1e-12 * noise.total)
    return _Free(U=U, w=w, a=a, b=b, products=products, x=x, rss=least, log_det=log_det)


def _weighted(a: Array, w: Array) -> Array:
    """a' diag(w) a (T, f, f) of a (K, f), weights (T, K): a large one by symmetric products, in a third of the time."""
    if a.size < _SMALL:
        return (w[:, :, None] * a).transpose(0, 2, 1) @ a
    return np.stack([half.T @ half for half in np.sqrt(w)[:, :, None] * a])


def _likelihood(noise: _Noise, rss: Array, log_det: Array) -> Array:
    return noise.start - 0.5 * (noise.free * np.log(rss / noise.total) + log_det)


def _with_law(free: _Free, noise: _Noise, Z: Array) -> Array:
    """L (T, tg) of a law with columns Z (G, r, p), whitened, beside a free motion."""
    flat = Z.reshape(-1, Z.shape[2])
    z = (free.U.transpose(0, 2, 1) @ Z).reshape(len(free.b), Z.shape[2])
    wz = (free.w[:, :, None] * z).transpose(0, 2, 1)
    ZX = flat.T @ noise.Q.reshape(len(flat), -1) - wz @ free.a
    turned = ZX @ free.inverse
    S = flat.T @ flat - wz @ z - turned @ ZX.transpose(0, 2, 1)
    c = flat.T @ noise.y.ravel() - wz @ free.b - (turned @ free.x[..., None])[..., 0]
    values, vectors = np.linalg.eigh(S)
    lam = np.maximum(values, 1e-150)
    square = (np.square((c[:, None] @ vectors)[:, 0]) / lam)[..., None]
    left = with_variance(lam, square, free.rss[:, None, None], np.square(_WEIGHTS), noise.free)[..., 0]
    return _likelihood(noise, left, free.log_det[:, None])


@dataclass(frozen=True, eq=False)
class _Race:
    """What all places are measured with; evidence counts from nothing in noise without a shared error."""

    fits: Reml
    visits: VisitGroups
    noises: tuple[_Noise, ...]

    @property
    def nothing(self) -> float:
        return self.noises[0].start - float(np.log(0.5))

    @cached_property
    def _still(self) -> tuple[_Free, ...]:
        """No free motion, in every noise."""
        return tuple(_free(np.zeros((*noise.y.shape, 0)), noise, np.zeros(1)) for noise in self.noises)

    def white(self, columns: Array, noise: _Noise) -> Array:
        """Columns (3 R, p) m, whitened, group by group."""
        return self.visits.split(self.fits.noise.noises[noise.k].whiten(columns))

    def unit(self, motion: Array) -> tuple[Array, float]:
        """Motions (R, 3, c) of mean square 1 a reading, and how many of them are one rad or m."""
        flat = self.fits.noise.noises[0].whiten(motion.reshape(-1, motion.shape[2]))
        size = float(np.sqrt(np.square(flat).sum() / max(np.count_nonzero(flat), 1))) or 1.0
        return motion / size, size

    def free(self, place: Place) -> list[PlaceMotion]:
        """A place that moves freely at each visit, about all its axes and about each alone."""
        return [self._freely(place, axis, at) for axis, at in place.subsets()]

    def _freely(self, place: Place, axis: str, at: list[int]) -> PlaceMotion:
        motions = [place.plus[..., at]]
        if place.torque is not None:
            later, earlier = (t[:, None, at] for t in place.torque)
            motions.append(place.plus[..., at] * later - place.minus[..., at] * earlier)
        found, best = list[Array](), (-np.inf, 0.0)
        for motion in motions:
            unit, size = self.unit(motion)
            columns = self.visits.apart(unit)
            for noise in self.noises:
                free = _free(self.white(columns, noise), noise, _TAUS)
                L = _likelihood(noise, free.rss, free.log_det)
                found.append(L)
                if motion is motions[0]:
                    best = max(best, (float(L.max()), float(_TAUS[L.argmax()]) * noise.unit / size))
        e = float(np.logaddexp.reduce(np.concatenate(found)) - np.log(len(_TAUS) * len(motions)))
        law = replace(place.law, axis=axis)
        return PlaceMotion(place, tuple(at), law, e - self.nothing + _prior(place, axis), best[1])

    def laws(self, free: Sequence[PlaceMotion], moved: Motions, by: Sequence[Variable]) -> list[PlaceMotion]:
        """The laws of a place, about all its axes and about the likeliest alone; half of each without a free motion
        beside it."""
        noise, out = self.noises[0], list[PlaceMotion]()
        taus = np.concatenate([[1e-9], _TAUS[2::2]])
        prior = np.log(np.concatenate([[0.5], np.full(len(taus) - 1, 0.5 / (len(taus) - 1))]))
        single = max((e for e in free if e.law.axis), key=lambda e: e.evidence, default=None)
        for start in (e for e in free if not e.law.axis or e is single):
            place, at = start.place, list(start.at)
            beside = _free(self.white(self.visits.apart(self.unit(place.plus[..., at])[0]), noise), noise, taus)
            for factors, Z in law_columns(place, at, moved, by):
                unit, size = self.unit(Z)
                L = _with_law(beside, noise, self.white(unit.reshape(-1, Z.shape[2]), noise)) + prior[:, None]
                e = float(np.logaddexp.reduce(L.ravel()) - np.log(L.shape[1])) - self.nothing
                law = replace(start.law, by=factors)
                sd = float(_WEIGHTS[L[0].argmax()]) * noise.unit / size
                far = 0.0 if law.reaches(moved.facts) else _STANDS_IN
                out.append(PlaceMotion(place, start.at, law, e + _prior(place, start.law.axis) - far, sd))
        return [replace(e, evidence=e.evidence - float(np.log(len(out)))) for e in out]

    def cause(self, columns: Array) -> float:
        """Evidence of a cause's columns (3 R, p) m."""
        unit, _ = self.unit(columns.reshape(-1, 3, columns.shape[1]))
        out = list[float]()
        for noise, nothing in zip(self.noises, self._still, strict=True):
            L = _with_law(nothing, noise, self.white(unit.reshape(columns.shape), noise))
            out.append(_mean(L.ravel()))
        return float(np.logaddexp.reduce(out)) - self.nothing

    def alike(self, every: Sequence[list[PlaceMotion]]) -> list[list[list[PlaceMotion]]]:
        """The places by groups of one motion, the likeliest first: some likely axes of one move all readings as some of
        the other do, visit by visit."""
        groups: list[tuple[list[_Moves], list[list[PlaceMotion]]]] = []
        for own in sorted(every, key=lambda own: -_total(own)):
            moves = [self._moves(e) for e in _likely(own)]
            home = next((g for first, g in groups if any(_same(a, b) for a in first for b in moves)), None)
            if home is None:
                groups.append((moves, [own]))
            else:
                home.append(own)
        return [group for _, group in groups]

    def _moves(self, e: PlaceMotion) -> _Moves:
        J = self.white(self.visits.apart(e.place.plus[..., list(e.at)]), self.noises[0])
        U, size, _ = np.linalg.svd(J, full_matrices=False)
        return J, np.where((size > 1e-6 * max(float(size.max(initial=0.0)), 1e-300))[:, None], U, 0.0)


_Moves = tuple[Array, Array]
"""What a motion does to the readings (G, r, c), whitened, group by group, and its orthonormal directions."""


def _likely(own: Sequence[PlaceMotion]) -> list[PlaceMotion]:
    """The free motions of a place about its likely axes."""
    free = [e for e in own if not e.law.by]
    best = max(e.evidence for e in own)
    axes = {e.law.axis for e in own if e.evidence > best - _RIVAL}
    return [e for e in free if e.law.axis in axes]


def _same(a: _Moves, b: _Moves) -> bool:
    """Whether neither of two motions of as many axes can do what the other cannot."""
    return a[0].shape == b[0].shape and max(_left(a[0], b[1]), _left(b[0], a[1])) < _ALIKE


def _left(J: Array, U: Array) -> float:
    """Share of a motion (G, r, c) that directions U (G, r, c) of the same visits do not reach."""
    rest = J - U @ (U.transpose(0, 2, 1) @ J)
    return float(np.linalg.norm(rest) / (np.linalg.norm(J) or 1.0))


def _prior(place: Place, axis: str) -> float:
    """Log of the prior of some axes of a place, moving freely or by a law."""
    share = 1.0 if len(place.axes) == 1 else 0.5 / len(place.axes) if axis else 0.5
    return float(np.log(0.5 * share))
