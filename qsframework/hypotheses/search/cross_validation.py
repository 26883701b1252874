"""What the extension gains on readings that it has not seen: repeated K-fold by pose, the search nested inside."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.hypotheses.columns import Case, Subspace
from qsframework.hypotheses.search.family_test import log_p_values
from qsframework.hypotheses.search.subsets import Bounds, Gram, make_gram, search
from qsframework.plugin import Array, Indices

FOLDS = 10
REPEATS = 3
LEAVE_ONE_OUT = 48
"""Up to this many poses each is left out by itself."""
_SHORT = 16
"""Causes that a fold's search looks at: those that explain most by themselves."""


@dataclass(frozen=True, eq=False, kw_only=True)
class HeldOut:
    """Held-out errors per repeat of the folds and scalar reading (repeats, m): of the identified and of the extended
    model, in m, zero where nothing was measured; gain: 1 - extended / identified, both whitened by the noise, in which
    an error that a visit's markers share counts once; clear: by how many of its standard errors it lies above nothing.

    poses: how many there are; repeats: of the folds, 0 where each pose is left out by itself; same: share of the folds
    whose search chose the causes of the whole, or their aliases
    """

    identified: Array
    extended: Array
    gain: float
    clear: float
    poses: int
    repeats: int
    same: float

    @property
    def rms_identified(self) -> float:
        return float(np.sqrt(np.sum(self.identified**2) / max(np.count_nonzero(self.identified), 1)))

    @property
    def rms_extended(self) -> float:
        return float(np.sqrt(np.sum(self.extended**2) / max(np.count_nonzero(self.extended), 1)))


@dataclass(frozen=True, eq=False, kw_only=True)
class Search:
    """How a fold decides: subspaces of the causes, significance (log p), degrees of freedom of the noise's unit, one
    position for each alias class, bounds, causes at most."""

    subspaces: tuple[Subspace, ...]
    threshold: float
    nu: float
    classes: tuple[int, ...]
    bounds: Bounds | None
    largest: int


def folds(pose: Indices, seed: int, repeats: int = REPEATS) -> list[Indices]:
    """For each repeat the fold (m,) of every scalar: whole poses, K folds, repeated with other cuts; up to some poses
    each by itself, once."""
    poses, own = np.unique(pose, return_inverse=True)
    if len(poses) <= LEAVE_ONE_OUT:
        return [own.astype(np.intp)]
    rng = np.random.default_rng(seed)
    out: list[Indices] = []
    for _ in range(repeats):
        label = np.empty(len(pose), dtype=np.intp)
        for n, test in enumerate(_parts(pose, rng.permutation(poses), FOLDS)):
            label[test] = n
        out.append(label)
    return out


def parts_of_poses(pose: Indices, parts: int) -> Iterator[Indices]:
    """Scalars (k,) of whole poses, in at most so many parts."""
    poses = np.unique(pose)
    yield from _parts(pose, np.random.default_rng(0).permutation(poses), min(parts, len(poses)))


def _parts(pose: Indices, poses: Indices, count: int) -> Iterator[Indices]:
    for part in np.array_split(poses, count):
        yield np.flatnonzero(np.isin(pose, part))


def held_out(
    case: Case,
    closing: Case | None,
    members: Sequence[int],
    alike: Sequence[set[int]],
    how: Search | None,
    seed: int = 0,
    repeats: int = REPEATS,
) -> HeldOut:
    """Errors at poses that neither the fit nor the choice of causes has seen.

    case: linearised at the baseline; closing: at the extended model, its fitted columns being the baseline's and the
    named causes' (`members`), used in folds that choose these; alike: for each member the causes that count as the
    same; how: None: every fold takes the named causes, without a search, as where they are far from linear
    """
    labels = folds(case.pose, seed, repeats)
    identified = np.stack([case.held_out_errors(case.A, label) for label in labels])
    extended, same = np.zeros(identified.shape), list[bool]()
    for at, label in enumerate(labels):
        count = int(label.max()) + 1
        chosen = [
            tuple(members) if how is None else _choose(case, np.flatnonzero(label != f), how) for f in range(count)
        ]
        same += [_matches(own, alike) for own in chosen]
        for own in set(chosen):
            here = np.isin(label, [f for f in range(count) if chosen[f] == own])
            again = closing is not None and _matches(own, alike)
            of, columns = (closing, closing.A) if closing is not None and again else (case, case.beside(own))
            extended[at, here] = of.held_out_errors(columns, np.where(here, label, -1))[here]
    return _judged(case, identified, extended, float(np.mean(same)))


def held_out_average(case: Case, cases: Sequence[tuple[float, Case]], seed: int = 0, repeats: int = REPEATS) -> HeldOut:
    """Errors at poses that the fits have not seen: of a case, and of the average of other cases by their shares."""
    labels = folds(case.pose, seed, repeats)
    identified = np.stack([case.held_out_errors(case.A, label) for label in labels])
    extended = sum(share * np.stack([own.held_out_errors(own.A, label) for label in labels]) for share, own in cases)
    return _judged(case, identified, np.asarray(extended), 1.0)


def _judged(case: Case, identified: Array, extended: Array, same: float) -> HeldOut:
    """What whitened errors (repeats, m) come to."""
    poses = len(np.unique(case.pose))
    return HeldOut(
        identified=case.noise.colour(identified.T).T,
        extended=case.noise.colour(extended.T).T,
        gain=1.0 - float(np.linalg.norm(extended) / max(np.linalg.norm(identified), 1e-300)),
        clear=standard_errors(identified, extended, case.pose),
        poses=poses,
        repeats=0 if poses <= LEAVE_ONE_OUT else len(identified),
        same=same,
    )


def standard_errors(before: Array, after: Array, pose: Indices) -> float:
    """By how many of its standard errors, over the poses (m,), a sum of squares falls; whitened errors (..., m)."""
    fall = np.atleast_2d(np.square(before) - np.square(after)).mean(axis=0)
    each = np.bincount(np.unique(pose, return_inverse=True)[1], fall)
    spread = float(np.sqrt(len(each)) * each.std(ddof=1)) if len(each) > 1 else 0.0
    return float(each.sum()) / spread if spread > 0.0 else 0.0


def _matches(chosen: Sequence[int], alike: Sequence[set[int]]) -> bool:
    left = list(alike)
    for i in chosen:
        hit = next((a for a in left if i in a), None)
        if hit is None:
            return False
        left.remove(hit)
    return not left


def _choose(case: Case, train: Indices, how: Search) -> tuple[int, ...]:
    """What the search finds in these readings alone: nothing where nothing is significant."""
    gram = make_gram(how.subspaces, case.residuals, how.bounds, case.fit.Q, train)
    falls = gram.falls((), gram.visible)
    log_p = _log_p(how.subspaces, gram, falls, how)
    if not len(falls) or log_p.min() > how.threshold:
        return ()
    heads = set(how.classes)
    short = [j for j in (gram.visible[int(i)] for i in np.argsort(log_p)) if j in heads][:_SHORT]
    found = search(gram, short, how.largest)
    return found[0].members if found else ()


def _log_p(subspaces: Sequence[Subspace], gram: Gram, falls: Array, how: Search) -> Array:
    dof = np.array([subspaces[i].Q.shape[1] for i in gram.visible])
    sided = np.array([gram.sided[i] for i in gram.visible])
    wrong = np.array([gram.sided[i] and gram.c[gram.at[i][0]] < 0.0 for i in gram.visible])
    unit = max((gram.total - falls.max(initial=0.0)) / max(gram.count - 2, 1), 1e-300)
    return log_p_values(np.where(wrong, 0.0, falls / unit), dof, sided, how.nu)
