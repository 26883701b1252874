"""Which causes of the library explain the readings: the search among them, beside another structure of the arm, and
without rows that belong to nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from qsframework.diagnoses.baseline import (
    Baseline,
    StartingFit,
    baseline_of,
    fits_beside,
    in_noise_beside,
    start_of,
    without_rows,
)
from qsframework.diagnoses.options import LIBRARY_SHARE, seen_below
from qsframework.diagnoses.residuals.audited_rows import (
    bic,
    far_from_linear,
    find_outliers,
    library_basis,
    visit_shifts,
)
from qsframework.diagnoses.residuals.noise_components import visible
from qsframework.errors import InputError, NotConverged, NotIdentifiable
from qsframework.estimation import rms
from qsframework.hypotheses.catalogue.causes import Cause, with_causes
from qsframework.hypotheses.exact_refit import SettledFit
from qsframework.hypotheses.hypothesis import Hypothesis
from qsframework.hypotheses.search.cross_validation import HeldOut, Search, held_out
from qsframework.hypotheses.search.family_test import family_test
from qsframework.hypotheses.search.model_selection import (
    Answer,
    Library,
    Refits,
    answer_of,
    blocks_of,
    explain,
    make_library,
    most_plausible,
    refit,
)
from qsframework.hypotheses.search.subsets import parts_of
from qsframework.plugin import Indices
from qsframework.screening import Mistake, find_slips
from qsframework.screening.conventions import check_structures, fits_better

_OUTLIERS = 0.01
"""Level at which a row does not belong to the others."""
_ROUNDS = 3
"""Times that a noise is found beside what was found in it."""
_BETTER = 1.0
"""By how much the BIC must fall for another structure."""
_AS_GOOD = 2.0
"""By how much it may rise where causes are spared: they merely do the same."""
_SURE = 1e-4
"""Odds against another structure below which it may stand."""
_SETTLED = 0.8
"""Share of a noise that the next one has where the names stay: nothing more is hidden in it."""


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """Level of all tests together; causes that are named together at most; random seed; repeats of the folds."""

    level: float
    largest: int
    seed: int
    repeats: int

    @property
    def of_library(self) -> float:
        """Level of the test of the library."""
        return seen_below(self.level)

    @property
    def of_remaining(self) -> float:
        """Level of the test for remaining signal."""
        return self.level * (1.0 - LIBRARY_SHARE)


@dataclass(frozen=True, eq=False)
class FoundCauses:
    """The library, its answers, best first, and the baseline in the noise that these leave; plain: the same without
    any answer, in the noise that is left then."""

    base: Baseline
    library: Library
    answers: Sequence[Answer]
    plain: FoundCauses | None = None

    @property
    def best(self) -> Answer | None:
        return self.answers[0] if self.answers else None

    @property
    def members(self) -> tuple[int, ...]:
        return self.answers[0].subset.members if self.answers else ()

    @property
    def causes(self) -> list[Cause]:
        """Those of the best answer."""
        return [self.base.case.causes[i] for i in self.members]

    @property
    def extended(self) -> SettledFit:
        """The exact fit with the causes of the best answer."""
        return self.answers[0].fit if self.answers else self.base.fit

    def without(self, names: Sequence[str]) -> FoundCauses:
        """The best answer without some of its causes, its fit and its noise being those without any cause where none
        stays, or where no fit without them leads anywhere."""
        kept = [c for c in self.causes if c.name not in names]
        fit = self.base.refit(kept) if kept else None
        if self.plain is None or fit is None:
            return self.plain or self
        members = tuple(i for i, c in zip(self.members, self.causes, strict=True) if c in kept)
        best = replace(self.answers[0], subset=replace(self.answers[0].subset, members=members), fit=fit)
        return replace(self, answers=(best, *self.answers[1:]))


def find_named(start: StartingFit, options: SearchOptions, tell: Callable[[str], None]) -> FoundCauses:
    """The search, and once more without the rows that belong to nothing."""
    tell("causes")
    base = baseline_of(start)
    tell("search")
    found = _searched(base, options)
    outliers = _outliers(found)
    return _searched(without_rows(found.base, outliers), options) if len(outliers) else found


def beside_structures(
    start: StartingFit, found: FoundCauses, options: SearchOptions, tell: Callable[[str], None]
) -> tuple[FoundCauses, tuple[Mistake, ...]]:
    """What was found, or what is found with another structure, which then stands beside it: rather that than causes
    that merely do the same, and rather the file's than another one."""
    for structure, other in _structures(start):
        instead = find_named(other, options, tell)
        spared = len(instead.members) < len(found.members)
        if _dearer(instead, found) < (_AS_GOOD if spared else -_BETTER):
            return instead, (structure,)
    return found, ()


def beside_slips(
    start: StartingFit, found: FoundCauses, options: SearchOptions, tell: Callable[[str], None]
) -> tuple[FoundCauses, tuple[Mistake, ...]]:
    """What is found without mistakes of single rows that stand out only beside the causes, and these mistakes: what
    acts at all poses hides them. Causes are then searched for again, and mistakes beside these."""
    slips: list[Mistake] = []
    for _ in range(_ROUNDS):
        beside = with_causes(start.experiment, found.causes, found.extended.by_name())
        more = find_slips(beside, start.readings) if found.causes else ()
        if not more:
            break
        slips += [replace(m, experiment=start.experiment) for m in more]
        start = start_of(start.experiment, more[-1].readings)
        found = find_named(start, options, tell)
    return found, tuple(slips)


def held_out_gain(found: FoundCauses, options: SearchOptions) -> HeldOut:
    """Cross-validation of the baseline and of the extended model, in the noise beside them."""
    base, library = found.base, found.library
    how = Search(
        subspaces=library.subspaces,
        threshold=library.scores.threshold(options.of_library),
        nu=library.nu,
        classes=library.heads,
        bounds=library.bounds,
        largest=options.largest,
    )
    closing = base.case_at(found.causes, found.extended) if found.answers else None
    alike = [set(library.aliases(i)) for i in found.members]
    nested = how if found.answers and not base.far else None
    return held_out(base.case, closing, found.members, alike, nested, options.seed, options.repeats)


def _structures(given: StartingFit) -> list[tuple[Mistake, StartingFit]]:
    """The structure of the arm whose exact fit is compellingly better than that of its file, the likeliest; or none.

    A cause may do so too: the two are compared when both were searched beside.
    """
    changes = check_structures(given.experiment, given.readings)
    tried: list[tuple[float, Hypothesis, StartingFit]] = []
    for change in changes:
        try:
            start = start_of(change.experiment, change.readings)
        except (InputError, NotConverged, NotIdentifiable):
            continue
        tried.append((bic(given.rows, given.fit) - bic(start.rows, start.fit), change, start))
    out: list[tuple[Mistake, StartingFit]] = []
    for gain, change, start in sorted(tried, key=lambda t: -t[0])[:1]:
        evidence = 0.5 * gain - float(np.log(len(changes)))
        if evidence > -np.log(_SURE):
            after, before = (rms(f.residuals[given.rows.mask]) for f in (start.fit, given.fit))
            told = replace(change, words=fits_better(change, after, before), structure=True)
            structure = Mistake(**vars(told), rms=after, rms_given=before, evidence=evidence, compelling=True)
            out.append((structure, start))
    return out


def _dearer(one: FoundCauses, other: FoundCauses) -> float:
    """By how much the BIC of one extended model is above that of another, for the rows that both have left."""
    both = np.intersect1d(one.base.good, other.base.good)
    costs = [bic(f.base.given.take(both), f.extended, np.flatnonzero(np.isin(f.base.good, both))) for f in (one, other)]
    return costs[0] - costs[1]


def _searched(base: Baseline, options: SearchOptions) -> FoundCauses:
    """The library, its answers, best first, and the baseline in the noise that these leave.

    Whether anything acts is tested in the noise that the fitted parameters alone leave. What does is then searched for
    again in the noise beside it: what it did to the readings has passed for noise before.
    """
    subspaces = base.case.subspaces()
    measured = base.rows.mask.ravel()
    scores = family_test(blocks_of(base.case, subspaces), base.fits, base.values, options.seed, measured=measured)
    library = make_library(base.case, base.fit, base.nu, subspaces, scores)
    plain = FoundCauses(base, library, ())
    answers, fitted = _answers(library, base, options, {})
    for _ in range(_ROUNDS if answers else 0):
        best = answers[0]
        far = far_from_linear(base.case, best.fit)
        fits = fits_beside(base.start, base.rows.padded_noise.colour(best.fit.basis()))
        again = replace(in_noise_beside(base, fits, best.fit), far=far)
        there = make_library(again.case, again.fit, again.nu, again.case.subspaces(), scores)
        found, fitted = _answers(there, again, options, fitted)
        if far:  # the linear search adds causes for what is far from linear: all parts are weighed by exact fits
            tried = {part.members: part for a in (best, *found[:1]) for part in parts_of(a.subset, there.gram)}
            parts = [answer_of(there, p, again.fit, again.rows, fitted) for p in tried.values()]
            found = sorted(chain.from_iterable(parts), key=lambda a: a.ebic)
        if not found:
            break
        size, before = (np.hypot(b.rows.sigma[b.rows.mask].mean(), b.rows.shared) for b in (again, base))
        base, library, answers = again, there, found
        if found[0].subset.members == best.subset.members and size > _SETTLED * before:
            break
    return FoundCauses(base, library, answers, plain)


def _answers(library: Library, base: Baseline, options: SearchOptions, before: Refits) -> tuple[list[Answer], Refits]:
    """Explanations where the library's test is significant, most plausible alias first; none otherwise. And all exact
    fits so far."""
    if library.scores.p_value > options.of_library:
        return [], before
    answers, fitted = explain(library, base.fit, base.rows, options.of_library, options.largest, before)
    fitted = {**before, **fitted}
    if not answers:
        return [], fitted
    first = answers[0]
    members = tuple(most_plausible(library, i) for i in first.subset.members)
    if members != first.subset.members:
        causes = [base.case.causes[i] for i in members]
        fit = refit(base.case, causes, base.fit, base.rows, fitted)
        fitted = {**fitted, frozenset(c.name for c in causes): fit}
        if fit is not None and fit.chi2 <= first.fit.chi2 + 1.0:
            first = Answer(replace(first.subset, members=members), fit, first.ebic)
    return [first, *answers[1:]], fitted


def _outliers(found: FoundCauses) -> Indices:
    """Places of rows that belong neither to the model that was found nor to the whole library, nor to the others of
    their visit: a visit that moved as a whole is an effect; at most a tenth."""
    base, fit = found.base, found.extended
    mask, shape = base.rows.mask, (len(base.rows.keep), 3)
    columns = visible(fit.basis().reshape(*shape, -1))
    outliers = find_outliers(fit.white.reshape(shape), columns, _OUTLIERS, mask)
    if not len(outliers):
        return outliers
    library = library_basis(base.case)
    if int(mask.sum()) - library.shape[1] >= max(base.case.count // 3, 6):
        raw = base.rows.padded_noise.whiten(base.fit.residuals.ravel()).reshape(shape)
        outliers = np.intersect1d(outliers, find_outliers(raw, library, _OUTLIERS, mask))
    if len(outliers) > max(1, len(base.rows.keep) // 10):
        return outliers[:0]
    shifted = np.concatenate([columns, visit_shifts(base.rows, outliers)], axis=1)
    return np.intersect1d(outliers, find_outliers(fit.white.reshape(shape), shifted, _OUTLIERS, mask))
