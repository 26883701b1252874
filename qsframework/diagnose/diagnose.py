"""`diagnose`: from readings to what the model gets wrong, step by step."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from qsframework.arguments import checked
from qsframework.diagnose.evidence_table import findings_of, table_of
from qsframework.diagnose.learn import LawTrial, foretold, law_trials
from qsframework.diagnose.likeness import alike
from qsframework.diagnose.linearization.candidates import Cause, Untested, find_causes
from qsframework.diagnose.linearization.columns import Case, make_case
from qsframework.diagnose.linearization.generic_blocks import generic_blocks, motions
from qsframework.diagnose.options import LEVEL, Level
from qsframework.diagnose.residuals.audited_rows import (
    bic,
    far_from_linear,
    find_outliers,
    in_noise,
    library_basis,
    lone_visits,
    misfit,
    repeats,
    replicates,
    split_told,
    visit_noise,
)
from qsframework.diagnose.residuals.noise_components import NoiseAudit, audit_noise, visible
from qsframework.diagnose.result import (
    Diagnosis,
    Errors,
    LearnedLaw,
    Leftover,
    LikelyPlace,
    Method,
    NamedCause,
    Value,
    left_open,
)
from qsframework.diagnose.selection.closing_gate import (
    Likely,
    finest,
    leftovers,
    named_in,
    on_one_axis,
    open_alternative,
)
from qsframework.diagnose.selection.cross_validation import HeldOut, Search, held_out
from qsframework.diagnose.selection.exact_refit import SettledFit, predicted_or_linear, settle_fit
from qsframework.diagnose.selection.family_test import family_test
from qsframework.diagnose.selection.model_selection import (
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
from qsframework.diagnose.selection.places import Competition, compete
from qsframework.diagnose.selection.search import LARGEST, parts_of
from qsframework.diagnose.verdict import ambiguous, verdict_of
from qsframework.errors import InputError, NotConverged, NotIdentifiable
from qsframework.estimation import orthonormal, rms, rounding
from qsframework.estimation.linear_fit import winsorised
from qsframework.estimation.visit_noise import Reml, reml
from qsframework.experiment import Experiment, Readings, make_rows, observation_model
from qsframework.experiment.account import Account, account_of
from qsframework.experiment.observations import REACH, ReadingRows, start_values, values_before
from qsframework.identify.pose_spread import check_pose_spread
from qsframework.identify.selection import at_found_markers
from qsframework.information.identifiable import in_order
from qsframework.option import Seed
from qsframework.plugin import Array, Indices
from qsframework.screening import Mistake, adopted, find_mistakes
from qsframework.screening.convention_changes import ConventionChange
from qsframework.screening.conventions import check_structures, fits_better
from qsframework.work.threads import on_one_thread

_LIBRARY_SHARE = 0.6
"""Of the level that the library's test gets; the generic blocks of the closing gate get the rest."""
_GROSS = 0.01
"""Level at which a row does not belong to the others."""
_ROUNDS = 3
"""Times that a noise is told beside what was found in it."""
_BETTER = 1.0
"""By how much the BIC must fall for another structure."""
_AS_GOOD = 2.0
"""By how much it may rise where causes are spared: they merely do the same."""
_SURE = 1e-4
"""Odds against another structure below which it may stand."""
_SETTLED = 0.8
"""Share of a noise that the next one has where the names stay: nothing more is hidden in it."""
_ROUNDED = 0.5
"""Share of the noise below which what is left is rounding: the noise is never told below that."""
_PREDICTS = 0.98
"""Share of the held-out error with some names below which a law stands in their place."""
_AHEAD = 2.2
"""Nats by which the causes of the library must be likelier than places that follow no law of it, for a name to be
certain."""
_LIKELY = 60
"""Laws among which each fold chooses anew, to say whether what is learned predicts."""
_SPEAKS, _BESIDE = 1.5, 4.0
"""Nats for some part of the arm that moves from which on it is told: where nothing is named, and beside names."""
STEPS = ("conventions", "baseline", "causes", "search", "test for remaining signal", "held-out gain", "table", "noise")
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class _Start:
    """An exact fit of the experiment's own parameters to all rows; unidentifiable: the others."""

    experiment: Experiment
    readings: Readings
    rows: ReadingRows
    fit: SettledFit
    unidentifiable: tuple[str, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Baseline:
    """What the search starts from: the exact fit to the rows, and the whitened case, tamed, in a noise that was told.

    given, whole: rows and case as they came; good: places of the rows in them that are left; fits: of the columns that
    the noise was told beside, in every noise that may be; far: whether a cause is far from linear
    """

    experiment: Experiment
    readings: Readings
    rows: ReadingRows
    fit: SettledFit
    case: Case
    fits: Reml
    nu: float
    good: Indices
    untested: tuple[Untested, ...]
    unidentifiable: tuple[str, ...]
    given: ReadingRows
    whole: Case
    far: bool = False

    @property
    def start(self) -> ReadingRows:
        """The rows that are left, in the noise that came with them."""
        return self.given.take(self.good)

    @property
    def values(self) -> Array:
        """The tamed residuals (m,) of the baseline, m."""
        return self.rows.padded_noise.colour(self.case.residuals)


@checked
@on_one_thread
def diagnose(
    experiment: Experiment,
    readings: Readings,
    *,
    level: Level = LEVEL,
    seed: Seed = 0,
    largest: int = LARGEST,
    repeats: int = 3,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find unmodelled effects in readings, and the causes that explain them.

    Args:
        experiment: the campaign.
        readings: its readings.
        level: false-alarm probability.
        seed: random seed.
        largest: causes named together at most, 0: none.
        repeats: of the cross-validation.
        progress: called with step, done and all before each step.

    Returns:
        Causes with their evidence, errors (RMS, m) and what remains.

    Raises:
        InputError: where readings and experiment do not fit each other.
        NotIdentifiable: where the baseline itself is not identifiable.
        NotConverged: where its fit does not converge.
    """
    tell, one_pose = _teller(progress), _one_pose(experiment, readings)
    tell("conventions")
    conventions = find_mistakes(experiment, readings, gross=False)
    proved = adopted(conventions)
    last = proved[-1] if proved else None
    tell("baseline")
    start = _start(last.experiment, last.readings) if last else _start(experiment, readings)
    largest = 0 if last and last.hides else largest
    found = _found(start, tell, level, largest, seed)
    if not proved:
        found, structure = _structured(start, found, tell, level, largest, seed)
        conventions = (*structure, *conventions)
    tell("test for remaining signal")
    found, closing = _closed(found, level, largest, seed, repeats)
    base, library, answers = found.base, found.library, found.answers
    best, extended = found.best, found.extended
    tell("held-out gain")
    held = _held(base, library, best, level, largest, seed, repeats)
    tell("table")
    threshold = library.scores.threshold(level * _LIBRARY_SHARE)
    findings = findings_of(library, answers, base.fit, held, threshold, _pose_names(base), seed)
    race = closing.race if best is None and closing.race is not None else _competition(base)
    findings = (*_convention_findings(conventions), *_instead(base, best, race, closing, findings))
    certain = _certain(base, best, findings)
    learned = _best_law(base, best, certain, closing, level, seed, repeats)
    known, settled = _settled(base, best, findings) if left_open(findings, closing.leftovers) else ((), base.fit)
    tell("noise")
    audit = _audit(base, learned.fit if learned and learned.holds else extended)
    after = misfit(base.experiment, base.readings, base.rows, extended)
    return Diagnosis(
        account=_account(base, findings),
        experiment=base.experiment,
        readings=base.readings,
        verdict=verdict_of(findings, closing.leftovers, after, audit, ambiguous(library, findings)),
        findings=findings,
        table=table_of(library, best, findings, base.untested),
        conventions=conventions,
        audit=audit,
        leftovers=closing.leftovers,
        places=closing.places,
        before=misfit(base.experiment, base.readings, base.rows, base.fit),
        after=after,
        rms=_errors(base, extended, held, (experiment, readings), audit),
        kept=base.rows.keep,
        outliers=np.setdiff1d(base.given.keep, base.rows.keep),
        baseline=base.fit,
        extended=extended,
        certain=certain,
        learned=learned,
        case=base.case,
        known=known,
        settled=settled,
        competition=_competition_beside(base, known, settled) if known else race,
        method=Method(held, base.far, base.unidentifiable, one_pose, lone_visits(base.rows)),
        level=level,
        seed=seed,
    )


@dataclass(frozen=True, kw_only=True)
class _Closing:
    """What the names leave and where it may be, by name the law that stands in its place as well, those that cannot
    stand beside theirs, what can be learned and how well a choice among laws foretells, and how places compete."""

    leftovers: tuple[Leftover, ...]
    places: tuple[LikelyPlace, ...]
    alternatives: Mapping[str, Leftover]
    beaten: Collection[str]
    law_trials: Sequence[LawTrial]
    anew: float = 0.0
    race: Competition | None = None


_OPEN = _Closing(leftovers=(), places=(), alternatives={}, beaten=(), law_trials=())
"""Where nothing may be said of what is left."""


@dataclass(frozen=True, eq=False)
class _Found:
    """The library, its answers, best first, and the baseline in the noise that these leave; plain: the same without
    any answer, in the noise that is left then."""

    base: _Baseline
    library: Library
    answers: Sequence[Answer]
    plain: _Found | None = None

    @property
    def best(self) -> Answer | None:
        return self.answers[0] if self.answers else None

    @property
    def members(self) -> tuple[int, ...]:
        return self.answers[0].subset.members if self.answers else ()

    @property
    def extended(self) -> SettledFit:
        return self.answers[0].fit if self.answers else self.base.fit


def _found(start: _Start, tell: Callable[[str], None], level: float, largest: int, seed: int) -> _Found:
    """The search, and once more without the rows that belong to nothing."""
    tell("causes")
    base = _baseline(start)
    tell("search")
    found = _searched(base, level, largest, seed)
    gross = _gross(found)
    return _searched(_without(found.base, gross), level, largest, seed) if len(gross) else found


def _certain(base: _Baseline, best: Answer | None, findings: Sequence[NamedCause]) -> SettledFit:
    """The exact fit with the names that are not doubtful; that of all where it cannot be made."""
    doubtful = {f.name for f in findings if f.doubtful}
    if best is None or not doubtful:
        return best.fit if best else base.fit
    causes = [base.case.causes[i] for i in best.subset.members]
    kept = [c for c in causes if c.name not in doubtful]
    return (refit(base.case, kept, base.fit, base.rows) if kept else base.fit) or best.fit


def _settled(
    base: _Baseline, best: Answer | None, findings: Sequence[NamedCause]
) -> tuple[tuple[Cause, ...], SettledFit]:
    """The names that are certain and have no open alternative, and the exact fit with them."""
    plain = {f.name for f in findings if not f.doubtful and not f.open_alternative}
    known = tuple(c for c in _causes(base, best) if c.name in plain)
    fit = refit(base.case, known, base.fit, base.rows) if known else None
    return ((), base.fit) if fit is None else (known, fit)


def _account(base: _Baseline, findings: Sequence[NamedCause]) -> Account:
    """Of the baseline, with the names that it leaves open."""
    account = account_of(base.experiment, base.rows, base.fit.names)
    return replace(account, causes=tuple(f.name for f in findings if not f.doubtful))


def _pose_names(base: _Baseline) -> list[str]:
    """Names of the poses by the number that the rows give them."""
    names = dict(zip(base.rows.pose.tolist(), base.rows.pose_names, strict=True))
    return [names.get(number, "") for number in range(max(names) + 1)]


def _convention_findings(conventions: Sequence[Mistake]) -> tuple[NamedCause, ...]:
    """The conventions and mistakes that were adopted, as causes of their own."""
    return tuple(
        NamedCause(
            name=c.name,
            values=(Value(c.name, "", c.value, 0.0, 0.0 if c.value != 1.0 or "[" in c.name else 1.0),),
            s=float(np.sqrt(2.0 * max(c.evidence, 0.0))),
            p_value=float(np.exp(-min(c.evidence, 700.0))),
            ebic_gain=2.0 * c.evidence,
            alternatives=(),
            hangs_on=(),
        )
        for c in adopted(conventions)
        if np.isfinite(c.evidence)
    )


def _one_pose(experiment: Experiment, readings: Readings) -> bool:
    """Whether all readings are of one pose. NotIdentifiable where they are and several parameters are fitted."""
    rows = make_rows(readings)
    angles = readings.poses.q[np.unique(rows.plus)]
    return check_pose_spread(angles, len(experiment.fit_names()), bool(rows.estimated))


def _teller(progress: Progress | None) -> Callable[[str], None]:
    def tell(step: str) -> None:
        if progress is not None:
            progress(step, STEPS.index(step), len(STEPS))

    return tell


def _start(experiment: Experiment, readings: Readings) -> _Start:
    """The exact fit of the experiment's own parameters, in the noise that is stated."""
    model = experiment.model()
    rows = make_rows(readings)
    wanted = in_order(model, experiment.fit_names())
    x = start_values(experiment, wanted)
    seen = observation_model(experiment, readings, wanted, linear=True, x=x, rows=rows)
    names, unidentifiable = split_told(seen)
    try:
        fit = settle_fit(model, rows, names, x, frames=seen.frames)
    except NotConverged as error:
        if not unidentifiable:
            raise
        said = f"{error}. These readings do not identify {', '.join(unidentifiable)}: kept at the nominal value"
        raise NotConverged(said) from error
    about = at_found_markers(seen, fit.x)
    again, other = (names, unidentifiable) if about is None else split_told(about)
    if again != names:  # the markers' places were a guess
        at = model.index(list(again))
        x[at] = fit.x[at]
        with suppress(NotConverged):
            fit, unidentifiable = settle_fit(model, rows, again, x, frames=fit.frames), other
    return _Start(experiment, readings, rows, fit, unidentifiable)


def _structures(given: _Start) -> list[tuple[Mistake, _Start]]:
    """The structure of the arm whose exact fit is compellingly better than that of its file, the likeliest; or none.

    A cause may do so too: the two are compared when both were searched beside.
    """
    changes = check_structures(given.experiment, given.readings)
    tried: list[tuple[float, ConventionChange, _Start]] = []
    for change in changes:
        try:
            start = _start(change.experiment, change.readings)
        except (InputError, NotConverged, NotIdentifiable):
            continue
        tried.append((bic(given.rows, given.fit) - bic(start.rows, start.fit), change, start))
    out: list[tuple[Mistake, _Start]] = []
    for gain, change, start in sorted(tried, key=lambda t: -t[0])[:1]:
        evidence = 0.5 * gain - float(np.log(len(changes)))
        if evidence > -np.log(_SURE):
            after, before = (rms(f.residuals[given.rows.mask]) for f in (start.fit, given.fit))
            structure = Mistake(
                name=change.name,
                value=change.value,
                words=fits_better(change, after, before),
                experiment=change.experiment,
                readings=change.readings,
                rms=after,
                rms_given=before,
                evidence=evidence,
                below=0,
                compelling=True,
                structure=True,
            )
            out.append((structure, start))
    return out


def _structured(
    start: _Start, found: _Found, tell: Callable[[str], None], level: float, largest: int, seed: int
) -> tuple[_Found, tuple[Mistake, ...]]:
    """What was found, or what is found with another structure, which then stands beside it: rather that than causes
    that merely do the same, and rather the file's than another one."""
    for structure, other in _structures(start):
        instead = _found(other, tell, level, largest, seed)
        spared = len(instead.members) < len(found.members)
        if _dearer(instead, found) < (_AS_GOOD if spared else -_BETTER):
            return instead, (structure,)
    return found, ()


def _dearer(one: _Found, other: _Found) -> float:
    """By how much the BIC of one extended model is above that of another, for the rows that both have left."""
    both = np.intersect1d(one.base.good, other.base.good)
    costs = [bic(f.base.given.take(both), f.extended, np.flatnonzero(np.isin(f.base.good, both))) for f in (one, other)]
    return costs[0] - costs[1]


def _baseline(start: _Start) -> _Baseline:
    """All causes beside the exact fit, and the noise that it leaves."""
    experiment, rows, fit = start.experiment, start.rows, start.fit
    causes, untested = find_causes(experiment, fit.names, rows)
    case = make_case(experiment, rows, fit.names, causes, fit.by_name(), fit.residuals, fit.frames).grouped()
    fits = _fits(rows, case.raw[:, : case.A.shape[1]])
    base = _Baseline(
        experiment=experiment,
        readings=start.readings,
        rows=rows,
        fit=fit,
        case=case,
        fits=fits,
        nu=fits.freedom(0),
        good=np.arange(len(rows.keep)),
        untested=untested,
        unidentifiable=start.unidentifiable,
        given=rows,
        whole=case,
    )
    return _told(base, fits, fit)


def _fits(rows: ReadingRows, columns: Array) -> Reml:
    """Fits of columns (3 R, f) m to rows, in every noise that may be."""
    return reml(visit_noise(rows), orthonormal(columns), len(rows.at), repeats(rows))


def _told(base: _Baseline, fits: Reml, beside: SettledFit) -> _Baseline:
    """The baseline in the noise that an exact fit to its rows leaves, tamed about that fit."""
    start, noise = base.start, fits.noise
    k, white, tame = _winsorised(fits, beside.residuals.ravel())
    k, white, tame = _winsorised(fits, beside.residuals.ravel(), noise.noises[k].colour(tame))
    left = noise.noises[k].colour(tame)
    unit = max(fits.unit(k, left), rounding(start.noise, start.scalars, REACH))
    rows = in_noise(start, unit, float(noise.rhos[k]))
    fit = settle_fit(base.experiment.model(), rows, base.whole.fitted, base.fit.x, frames=base.fit.frames)
    case = base.whole.rewhitened(base.good, rows.padded_noise, fit.residuals)
    grown = unit * float(np.sqrt(1.0 + noise.many * noise.rhos[k] ** 2)) if start.stated else 1.0
    case = replace(case, residuals=case.residuals - (white - tame) / unit, grown=max(grown, 1.0))
    return replace(base, rows=rows, fit=fit, case=case, fits=fits, nu=fits.freedom(k))


def _winsorised(fits: Reml, values: Array, tame: Array | None = None) -> tuple[int, Array, Array]:
    """Place of the noise that readings (m,) m tell, or tamed ones in their place; the readings whitened, and tamed."""
    k = int(fits.choose((values if tame is None else tame)[:, None])[0])
    white = fits.noise.noises[k].whiten(values)
    return k, white, winsorised(white, fits.Q[k])


def _without(base: _Baseline, gross: Indices) -> _Baseline:
    """The baseline without some of its rows, fitted and its noise told again."""
    good = np.delete(base.good, gross)
    rows = base.given.take(good)
    fit = settle_fit(base.experiment.model(), rows, base.whole.fitted, base.fit.x, frames=base.fit.frames)
    scalars = (3 * good[:, None] + np.arange(3)).ravel()
    fits = _fits(rows, base.whole.raw[scalars, : base.whole.A.shape[1]])
    return _told(replace(base, good=good, fit=fit), fits, fit)


def _gross(found: _Found) -> Indices:
    """Places of rows that belong neither to the model that was found nor to the whole library; at most a tenth."""
    base, fit = found.base, found.extended
    mask, shape = base.rows.mask, (len(base.rows.keep), 3)
    columns = visible(orthonormal(fit.jacobian).reshape(*shape, -1))
    gross = find_outliers(fit.white.reshape(shape), columns, _GROSS, mask)
    if not len(gross):
        return gross
    library = library_basis(base.case)
    if int(mask.sum()) - library.shape[1] >= max(base.case.count // 3, 6):
        raw = base.rows.padded_noise.whiten(base.fit.residuals.ravel()).reshape(shape)
        gross = np.intersect1d(gross, find_outliers(raw, library, _GROSS, mask))
    return gross if len(gross) <= max(1, len(base.rows.keep) // 10) else gross[:0]


def _audit(base: _Baseline, fit: SettledFit) -> NoiseAudit:
    """What the rows say of their noise beside an exact fit, against what is stated."""
    rows, given = base.rows, base.start
    shape = (len(rows.keep), 3)
    sigma = np.sqrt(np.mean(given.sigma**2, axis=1))
    ratio = np.sqrt(np.mean(rows.sigma**2, axis=1)) / sigma
    white = fit.residuals / sigma[:, None]
    columns = orthonormal(rows.padded_noise.colour(fit.jacobian) / np.repeat(sigma, 3)[:, None])
    return audit_noise(
        white,
        columns.reshape(*shape, -1),
        sigma,
        given.stated,
        rows.plus,
        replicates(rows.readings, rows),
        mask=None if rows.mask.all() else rows.mask,
        unit=float(ratio.mean()),
        shared=rows.shared,
        outliers=np.setdiff1d(np.arange(len(base.given.keep)), base.good),
    )


def _searched(base: _Baseline, level: float, largest: int, seed: int) -> _Found:
    """The library, its answers, best first, and the baseline in the noise that these leave.

    Whether anything acts is tested in the noise that the fitted parameters alone leave. What does is then searched for
    again in the noise beside it: what it did to the readings has passed for noise before.
    """
    subspaces = base.case.subspaces()
    measured = base.rows.mask.ravel()
    scores = family_test(blocks_of(base.case, subspaces), base.fits, base.values, seed, measured=measured)
    library = make_library(base.case, base.fit, base.nu, subspaces, scores)
    plain = _Found(base, library, ())
    answers, fitted = _answers(library, base, level, largest, {})
    for _ in range(_ROUNDS if answers else 0):
        best = answers[0]
        far = far_from_linear(base.case, best.fit)
        fits = _fits(base.start, base.rows.padded_noise.colour(best.fit.jacobian))
        again = replace(_told(base, fits, best.fit), far=far)
        there = make_library(again.case, again.fit, again.nu, again.case.subspaces(), scores)
        found, fitted = _answers(there, again, level, largest, fitted)
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
    return _Found(base, library, answers, plain)


def _closed(found: _Found, level: float, largest: int, seed: int, repeats: int) -> tuple[_Found, _Closing]:
    """The closing gate, and what stands after it: names that a law is far ahead of drop out, and the law remains, where
    it also predicts held-out poses better than they do."""
    if not largest:
        return found, _OPEN
    rest = level * (1.0 - _LIBRARY_SHARE)
    closing = _close(found.base, found.best, found.extended, rest, seed)
    if found.best is None or found.plain is None or not closing.beaten:
        return found, closing
    members = tuple(i for i in found.members if found.base.case.causes[i].name not in closing.beaten)
    fit = refit(found.base.case, [found.base.case.causes[i] for i in members], found.base.fit, found.base.rows)
    stands = found.plain
    if members and fit is not None:
        answer = replace(found.best, subset=replace(found.best.subset, members=members), fit=fit)
        stands = replace(found, answers=(answer, *found.answers[1:]))
    after = _close(stands.base, stands.best, stands.extended, rest, seed)
    law = _best_law(stands.base, stands.best, stands.extended, after, level, seed, repeats)
    named = _held(found.base, found.library, found.best, level, largest, seed, repeats).rms_extended
    return (stands, after) if law is not None and law.heldout < _PREDICTS * named else (found, closing)


def _answers(
    library: Library, base: _Baseline, level: float, largest: int, before: Refits
) -> tuple[list[Answer], Refits]:
    """Explanations where the library's test is significant, most plausible alias first; none otherwise. And all exact
    fits so far."""
    if library.scores.p_value > level * _LIBRARY_SHARE:
        return [], before
    answers, fitted = explain(library, base.fit, base.rows, level, largest, before)
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


def _close(base: _Baseline, best: Answer | None, fit: SettledFit, level: float, seed: int) -> _Closing:
    """The generic blocks against what an exact fit leaves, and in the place of each of its names."""
    moved = motions(fit.model, base.rows, fit.x, fit.frames)
    blocks = list(generic_blocks(moved))
    noise = base.rows.padded_noise
    columns = noise.colour(fit.jacobian)
    tame = noise.colour(winsorised(fit.white, orthonormal(fit.jacobian)))
    fits = _fits(base.rows, columns)
    size = fits.unit(int(fits.choose(tame[:, None])[0]), tame)
    left, likely, places = tuple[Leftover, ...](), list[Likely](), tuple[LikelyPlace, ...]()
    race: Competition | None = None
    e = np.zeros(0)
    if size > _ROUNDED:
        left, e = leftovers(blocks, fits, tame, level, seed + 1, base.rows.mask.ravel())
        likely = on_one_axis(blocks, e, fits, tame, fit.model.facts)
        left = finest(left, likely)
        race = compete(moved, fits, tame, {} if best else _visible_causes(base))
        if left or race.margin > (_BESIDE if best else _SPEAKS):
            places = race.likely([(x.whole, x.evidence) for x in likely])
    causes = {c.name: c.names for c in _causes(base, best)}
    alternatives: dict[str, Leftover] = {}
    beaten: set[str] = set()
    for name in named_in(fit, causes, columns):
        own = [columns.shape[1] - len(fit.names) + fit.names.index(p) for p in causes[name.name]]
        rival = open_alternative(blocks, _fits(base.rows, np.delete(columns, own, axis=1)), tame, name)
        if rival is not None:
            alternatives[name.name] = rival[0]
            beaten |= {name.name} if rival[1] else set()
    here = tuple(x for x in left if places and x.law.where in places[0].wheres)
    trials = law_trials(fit.model, [*blocks, *(x.block for x in likely)], here, len(blocks), fits, tame)
    if here:  # a block that passed its own test says by which variable
        left = (*here, *(x for x in left if x not in here))
        same = (replace(places[0].law, by=()), *places[0].equivalent)
        law = here[0].law
        first = replace(places[0], law=law, equivalent=tuple(x for x in same if x.where != law.where))
        places = (first, *places[1:])
    elif race is not None and places:
        p = left[0].p_value if left else float(np.exp(-race.margin))
        left = (Leftover(places[0].law, p, race.margin), *left)
    strong = sorted(zip(e.tolist(), blocks, strict=True), key=lambda x: -x[0])[:_LIKELY] if len(e) else []
    among = [*(x.block.columns for x in likely), *(b.columns for _, b in strong)]
    anew = foretold(among, fits, tame, np.repeat(base.rows.pose, 3)) if trials else 0.0
    return _Closing(
        leftovers=left, places=places, alternatives=alternatives, beaten=beaten, law_trials=trials, anew=anew, race=race
    )


def _competition(base: _Baseline) -> Competition:
    """Places and causes beside one another, at the fit of the springs alone."""
    moved = motions(base.fit.model, base.rows, base.fit.x, base.fit.frames)
    fits = _fits(base.rows, base.rows.padded_noise.colour(base.case.A))
    return compete(moved, fits, base.values, _visible_causes(base))


def _competition_beside(base: _Baseline, known: Sequence[Cause], fit: SettledFit) -> Competition:
    """Places and the other causes beside one another, at an exact fit with causes that are known. What was drawn in of
    the readings at the last model is no effect here either."""
    noise, names = base.rows.padded_noise, {c.name for c in known}
    others = {name: columns for name, columns in _visible_causes(base).items() if name not in names}
    values = base.values + (fit.residuals - base.fit.residuals).ravel()
    moved = motions(fit.model, base.rows, fit.x, fit.frames)
    return compete(moved, _fits(base.rows, noise.colour(fit.jacobian)), values, others)


def _visible_causes(base: _Baseline) -> dict[str, Array]:
    """Columns (m, p) m of each cause that the readings can show."""
    seen = [s.visible for s in base.case.subspaces()]
    return {c.name: base.case.metres(i) for i, (c, s) in enumerate(zip(base.case.causes, seen, strict=True)) if s}


def _instead(
    base: _Baseline, best: Answer | None, race: Competition, closing: _Closing, findings: Sequence[NamedCause]
) -> tuple[NamedCause, ...]:
    """The names, each with the law that stands in its place as well: of the closing gate, or, where the causes are not
    plainly ahead of all places beside the other names, the likeliest law of these."""
    out: list[NamedCause] = []
    for f in findings:
        instead = closing.alternatives.get(f.name)
        if instead is None:
            others = [c for c in _causes(base, best) if c.name != f.name]
            fit = refit(base.case, others, base.fit, base.rows) if others else None
            there = race if fit is None else _competition_beside(base, others, fit)
            first = next((e for e in there.entries if not e.is_repeatability), None)
            if first is not None and there.causes_ahead <= _AHEAD:
                ahead = first.evidence - there.causes.get(f.name, 0.0)
                instead = Leftover(first.told(1.0).law, float("nan"), ahead)
        out.append(replace(f, instead=instead))
    return tuple(out)


def _causes(base: _Baseline, best: Answer | None) -> list[Cause]:
    return [base.case.causes[i] for i in best.subset.members] if best else []


def _best_law(
    base: _Baseline, best: Answer | None, certain: SettledFit, closing: _Closing, level: float, seed: int, repeats: int
) -> LearnedLaw | None:
    """The law that what is left teaches, at a place that is told: the first of the plainest that holds, else the
    plainest.

    Where doubtful names do not stay, what is left beside the certain ones teaches it.
    """
    if best is not None and certain is not best.fit:
        closing = _close(base, None, certain, level * (1.0 - _LIBRARY_SHARE), seed)
    tried: list[LearnedLaw] = []
    for trial in closing.law_trials:
        learned = _learned(base, best, certain, trial, closing.anew, seed, repeats)
        if learned is not None and learned.holds:
            return learned
        tried += [learned] if learned is not None else []
    return tried[0] if tried else None


def _learned(
    base: _Baseline, best: Answer | None, certain: SettledFit, trial: LawTrial, anew: float, seed: int, repeats: int
) -> LearnedLaw | None:
    """A law fitted exactly beside the certain names, with its held-out gain; None where no fit leads anywhere."""
    kept = [c for c in _causes(base, best) if set(c.names) <= set(certain.names)]
    fit = refit(base.case, [*kept, trial.cause], base.fit, base.rows)
    if fit is None:
        return None
    cases = _case_at(base, kept, certain), _case_at(base, [*kept, trial.cause], fit)
    held = held_out(*cases, (), [], None, seed, repeats)
    bounds = {p.name: (p.lower, p.upper) for p in fit.model.parameters}
    return LearnedLaw(
        cause=trial.cause,
        leftover=trial.leftover,
        s=float(np.sqrt(max(certain.chi2 - fit.chi2, 0.0))),
        fit=fit,
        before=held.rms_identified,
        heldout=held.rms_extended,
        gain=held.gain,
        clear=held.clear,
        anew=anew,
        physical=all(bounds[n][0] <= v <= bounds[n][1] for n, v in fit.by_name().items()),
        alike=alike(base.case, kept, fit, trial.leftover.law, trial.cause),
    )


def _held(
    base: _Baseline, library: Library, best: Answer | None, level: float, largest: int, seed: int, repeats: int
) -> HeldOut:
    """Cross-validation of the baseline and of the extended model, in the noise beside them."""
    members = best.subset.members if best else ()
    how = Search(
        subspaces=library.subspaces,
        threshold=library.scores.threshold(level * _LIBRARY_SHARE),
        nu=library.nu,
        classes=library.heads,
        bounds=library.bounds,
        largest=largest,
    )
    closing = _case_at(base, _causes(base, best), best.fit) if best else None
    alike = [set(library.aliases(i)) for i in members]
    return held_out(base.case, closing, members, alike, how if best and not base.far else None, seed, repeats)


def _case_at(base: _Baseline, causes: Sequence[Cause], fit: SettledFit) -> Case:
    """The case whose fitted parameters are those of a fit with causes, linearised there, without further causes."""
    case = make_case(base.experiment, base.rows, base.case.fitted, causes, fit.by_name(), fit.residuals, fit.frames)
    held = [np.array(c.sizes) / c.prior if c.prior else np.zeros(len(c.names)) for c in causes]
    back = [[-fit.value(n) / s if c.prior else 0.0 for n, s in zip(c.names, c.sizes, strict=True)] for c in causes]
    A = np.concatenate([case.A, *case.B], axis=1)
    aim = np.concatenate([np.zeros(len(case.held)) if case.aim is None else case.aim, *back])
    return replace(case, A=A, causes=(), B=(), held=np.concatenate([case.held, *held]), aim=aim)


def _errors(
    base: _Baseline, extended: SettledFit, held: HeldOut, given: tuple[Experiment, Readings], audit: NoiseAudit
) -> Errors:
    experiment, readings = given
    model = experiment.model()
    given_rows = replace(base.rows, readings=readings)  # as they were before a convention was applied
    x = start_values(experiment, experiment.fit_names(), values_before(model, readings))
    frames = given_rows.start(model, x)
    predicted, _ = predicted_or_linear(model, given_rows, x, frames)  # values far off may bear no load
    nominal = base.rows.measured - predicted
    mask, own = base.rows.mask, base.start.sigma * audit.unit
    noise = float(np.sqrt(np.mean(own[mask] ** 2) + audit.shared**2))
    return Errors(
        nominal=rms(nominal),
        identified=rms(base.fit.residuals[mask]),
        extended=rms(extended.residuals[mask]),
        heldout_identified=held.rms_identified,
        heldout_extended=held.rms_extended,
        noise=noise,
        axes=float(mask.sum() / mask.any(axis=1).sum()),
    )
