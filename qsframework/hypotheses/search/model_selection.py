"""From scores to a name: significance of the library, search of subsets, exact refits of the best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.errors import NotConverged, NotIdentifiable
from qsframework.experiment.observations import ReadingRows
from qsframework.hypotheses.catalogue.causes import REACH, Cause, widened
from qsframework.hypotheses.columns import Case, Subspace
from qsframework.hypotheses.exact_refit import SettledFit, settle_fit
from qsframework.hypotheses.search.family_test import FamilyBlock, Scores, log_p_values
from qsframework.hypotheses.search.principal_angles import alias_classes
from qsframework.hypotheses.search.subsets import LARGEST, Bounds, Gram, Subset, make_gram, search
from qsframework.plugin import InputError

REFITS = 5
_OTHERS = 1.0 / 24.0
"""Share of the level for causes beside others: 0.0005 of 0.012."""
_TIE = 2.0
"""EBIC by which two explanations are as good as each other."""
_ODDS = 20.0
"""EBIC that only chance of e^-10 makes up for."""
_LAST = "link"
"""Role of what is opened last."""
_BEYOND = 2.0
"""Standard deviations by which a parameter of an exact fit may end beyond its bound."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Library:
    """The library against the baseline's residuals: subspaces, Gram matrix, scores, one position per alias class.

    nu: degrees of freedom of the noise's unit
    """

    case: Case
    subspaces: tuple[Subspace, ...]
    gram: Gram
    scores: Scores
    classes: tuple[tuple[int, ...], ...]
    bounds: Bounds
    nu: float

    @property
    def heads(self) -> tuple[int, ...]:
        """One position for each class of aliases."""
        return tuple(c[0] for c in self.classes)

    def aliases(self, i: int) -> tuple[int, ...]:
        """The class that cause i belongs to."""
        return next((c for c in self.classes if i in c), (i,))

    def unit(self, members: Sequence[int] = ()) -> float:
        """Variance of unit weight that some causes leave."""
        used = self.case.fit.Q.shape[1] + sum(len(self.gram.at[i]) for i in members)
        return max(self.gram.solve(members)[0] / max(self.gram.count - used, 1), 1e-300)


@dataclass(frozen=True, eq=False)
class Answer:
    """A subset with its exact fit; ebic less that of the baseline."""

    subset: Subset
    fit: SettledFit
    ebic: float


def blocks_of(case: Case, subspaces: Sequence[Subspace]) -> tuple[FamilyBlock, ...]:
    """What each cause can do to the readings, m, along the directions that are seen; none of an invisible one."""
    sizes = [np.array(s.cause.sizes)[:, None] for s in subspaces]
    metres = [case.metres(i) @ (s.turn / size) for i, (s, size) in enumerate(zip(subspaces, sizes, strict=True))]
    return tuple(FamilyBlock(m, s.one_sided) for m, s in zip(metres, subspaces, strict=True))


def make_library(
    case: Case, baseline: SettledFit, nu: float, subspaces: tuple[Subspace, ...], scores: Scores
) -> Library:
    """The Gram matrix and the alias classes of all causes. nu: degrees of freedom of the noise's unit."""
    bounds = _bounds(case, baseline)
    gram = make_gram(subspaces, case.fit.white, bounds)
    classes = tuple(c for c in alias_classes(subspaces) if subspaces[c[0]].visible)
    return Library(case=case, subspaces=subspaces, gram=gram, scores=scores, classes=classes, bounds=bounds, nu=nu)


def _bounds(case: Case, baseline: SettledFit) -> Bounds:
    index = baseline.model.index(case.fitted)
    lower = np.array([baseline.model.parameters[i].lower for i in index])
    at = [baseline.names.index(name) for name in case.fitted]
    sd = np.sqrt(np.diag(baseline.covariance))[at]
    return Bounds(baseline.x[index], sd, lower)


Refits = Mapping[frozenset[str], SettledFit | None]
"""Exact fits of the same readings in another noise, by the names of their causes; None where none was possible."""


def explain(
    library: Library,
    baseline: SettledFit,
    rows: ReadingRows,
    level: float,
    largest: int = LARGEST,
    before: Refits | None = None,
) -> tuple[list[Answer], Refits]:
    """The best explanations with one or more causes, each fitted exactly, best first; of those as good, the one with
    the fewest causes. And all that was fitted.

    Every cause of an answer is significant: alone at the level, beside others at a share of it, because the best of
    many pairs nearly always holds one cause that only fits the noise. before: where fits start, and what has none. A
    subset that by the linear search explains less than half of what another explains exactly is not fitted.
    """
    found = [s for s in search(library.gram, library.heads, largest) if significant(library, s, level)]
    answers: list[Answer] = []
    fitted: dict[frozenset[str], SettledFit | None] = {}
    for subset in found:
        best = min((a.ebic for a in answers), default=np.inf)
        if subset.ebic > max(best + _ODDS, 0.5 * best):
            continue
        causes = [library.case.causes[i] for i in subset.members]
        fit = refit(library.case, causes, baseline, rows, before)
        fitted[frozenset(c.name for c in causes)] = fit
        answers += _answer(library, subset, fit, baseline)
        if len(answers) == REFITS:
            break
    if not answers:
        return [], fitted
    best = min(a.ebic for a in answers)

    def order(a: Answer) -> tuple[bool, int, float]:
        tied = a.ebic <= best + _TIE
        return not tied, len(a.subset.members) if tied else 0, a.ebic

    return sorted(answers, key=order), fitted


def answer_of(
    library: Library, subset: Subset, baseline: SettledFit, rows: ReadingRows, before: Refits
) -> list[Answer]:
    """A subset fitted exactly; none where that leads nowhere, or to what is not physical."""
    fit = refit(library.case, [library.case.causes[i] for i in subset.members], baseline, rows, before)
    return _answer(library, subset, fit, baseline)


def _answer(library: Library, subset: Subset, fit: SettledFit | None, baseline: SettledFit) -> list[Answer]:
    if fit is None or _beyond(fit):
        return []
    ebic = library.gram.ebic(fit.chi2, subset.dof, len(subset.members), len(library.heads), baseline.chi2)
    return [Answer(subset, fit, float(ebic))]


def refit(
    case: Case, causes: Sequence[Cause], baseline: SettledFit, rows: ReadingRows, before: Refits | None = None
) -> SettledFit | None:
    """The exact model with some causes, fitted from the baseline, or from where it ended in another noise; None where
    that leads nowhere.

    A cause with several parameters may do things that no reading shows: its parameters are held near zero by REACH
    times their typical sizes.
    """
    model = widened(case.experiment.model(), causes)
    near = (before or {}).get(frozenset(c.name for c in causes), baseline)
    if near is None:
        return None
    known = near.by_name()
    start = np.array([known.get(p.name, p.nominal) for p in model.parameters])
    names = [*case.fitted, *(n for c in causes for n in c.names)]
    several = [c for c in causes if len(c.names) > 1]
    priors = [(n, c.prior or REACH * s) for c in several for n, s in zip(c.names, c.sizes, strict=True)]
    try:
        return settle_fit(model, rows, names, start, priors, near.frames)
    except (NotConverged, NotIdentifiable, InputError, np.linalg.LinAlgError):
        return None


def _beyond(fit: SettledFit) -> bool:
    """Whether a parameter ends significantly beyond its bound: then the subset is not physical."""
    at = fit.model.index(fit.names)
    lower, upper = (np.array([getattr(fit.model.parameters[i], end) for i in at]) for end in ("lower", "upper"))
    far, x = _BEYOND * np.sqrt(np.diag(fit.covariance)), fit.x[at]
    return bool(np.any((x < lower - far) | (x > upper + far)))


def size_of(library: Library, i: int, given: Sequence[int]) -> float:
    """s of cause i beside the given ones."""
    return float(np.sqrt(max(_fall(library, i, given) - len(library.gram.at[i]), 0.0)))


def _fall(library: Library, i: int, given: Sequence[int]) -> float:
    """By how much cause i lowers the squares beside the given ones, in units of what is then left."""
    return float(library.gram.falls(given, [i])[0]) / library.unit([*given, i])


def p_value_of(library: Library, i: int, given: Sequence[int]) -> float:
    """Family-wise: max-T of a cause alone, a union bound for one beside others."""
    if not given:
        return float(library.scores.p_adjusted[i])
    fall, dof, sided = _fall(library, i, given), len(library.gram.at[i]), library.gram.sided[i]
    log_p = log_p_values(np.array([fall]), np.array([dof]), np.array([sided]), library.nu)
    return float(min(len(library.heads) * np.exp(log_p[0]), 1.0))


def significant(library: Library, subset: Subset, level: float) -> bool:
    """Whether every cause of a subset is significant: EBIC alone may prefer one that is not.

    All axes of a place are, where they are beside each one of them.
    """
    members, causes = subset.members, library.case.causes
    limit = level if len(members) == 1 else _OTHERS * level
    for i in members:
        others = [j for j in members if j != i]
        if p_value_of(library, i, others) > limit:
            return False
        axes = [j for j in library.gram.visible if causes[i].group and j != i and causes[j].shares(causes[i])]
        if any(p_value_of(library, i, [*others, j]) > _OTHERS * level for j in axes):
            return False
    return True


def most_plausible(library: Library, i: int) -> int:
    """Of causes that do the same to the readings, the one to be checked first: a link after bearings and bolts, and of
    these the one whose size is nearest to its typical one."""

    def order(j: int) -> tuple[bool, bool, bool, float]:
        subspace = library.subspaces[j]
        s = float(np.linalg.norm(subspace.Q.T @ library.case.residuals))
        odd = abs(float(np.log(max(s, 1e-9) / float(subspace.values[0]))))
        cause = subspace.cause
        wrong = library.gram.sided[j] and library.gram.c[library.gram.at[j][0]] < 0.0
        return bool(wrong), cause.group, cause.kind.role == _LAST, odd

    return min(library.aliases(i), key=order)
