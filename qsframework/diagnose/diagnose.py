"""`diagnose`: from readings to what the model gets wrong, step by step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.diagnose.evidence_table import findings_of, table_of
from qsframework.diagnose.linearization.candidates import Untested, find_causes
from qsframework.diagnose.linearization.columns import Case, make_case
from qsframework.diagnose.residuals.audited_rows import (
    audited_rows,
    far_from_linear,
    library_basis,
    misfit,
    replicates,
    split_told,
)
from qsframework.diagnose.residuals.dictionary import Closing, close, motions
from qsframework.diagnose.residuals.huber_pseudo_values import huber_pseudo_values
from qsframework.diagnose.residuals.noise_components import NoiseAudit, audit_noise
from qsframework.diagnose.result import Diagnosis, Errors, Finding, Method, Value
from qsframework.diagnose.selection.cross_validation import HeldOut, Search, held_out
from qsframework.diagnose.selection.exact_refit import Settled, predicted_or_linear, settle_fit
from qsframework.diagnose.selection.model_selection import (
    Answer,
    Library,
    answer_of,
    explain,
    make_library,
    most_plausible,
    refit,
)
from qsframework.diagnose.selection.search import LARGEST, parts_of
from qsframework.diagnose.verdict import ambiguous, verdict_of
from qsframework.errors import InputError, NotConverged
from qsframework.estimation import Independent, rms, rounding
from qsframework.experiment import Experiment, Readings, bridge, make_rows
from qsframework.experiment.observations import REACH, Rows, start_values
from qsframework.identify.pose_spread import check_pose_spread
from qsframework.identify.selection import in_order
from qsframework.plugin import Indices
from qsframework.screening.conventions import Convention, check_conventions

LEVEL = 0.04
_LIBRARY_SHARE = 0.6
"""Of the level that the library's test gets; the dictionary of the closing gate gets the rest."""
STEPS = ("conventions", "baseline", "causes", "noise", "search", "closing gate", "held-out gain", "table")
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Baseline:
    """What the search starts from: rows and noise after the audit, the exact fit to them, the whitened case.

    given, whole: rows and case before the audit; stated: whether somebody says the size of the noise; far: whether
    it has been audited again, at the values of a cause far from linear
    """

    experiment: Experiment
    readings: Readings
    rows: Rows
    fit: Settled
    case: Case
    audit: NoiseAudit
    out: Indices
    untested: tuple[Untested, ...]
    untold: tuple[str, ...]
    given: Rows
    whole: Case
    stated: bool
    far: bool = False

    @property
    def nu(self) -> float:
        return self.audit.nu


def diagnose(
    experiment: Experiment,
    readings: Readings,
    *,
    level: float = LEVEL,
    seed: int = 0,
    largest: int = LARGEST,
    repeats: int = 3,
    progress: Progress | None = None,
) -> Diagnosis:
    """What the experiment's model gets wrong on these readings, and which causes explain it.

    level: probability of naming anything where nothing acts; largest: causes named together at most; repeats: of the
    cross-validation; progress(step, done, all) is called before each step.

    Raises InputError, NotIdentifiable or NotConverged where the baseline itself cannot be fitted.
    """
    if not 0.0 < level < 0.5:
        raise InputError(f"level must be between 0 and 0.5, found {level:g}")
    tell = _teller(progress)
    first = make_rows(readings)
    angles = readings.poses.q[np.unique(first.plus)]
    one_pose = check_pose_spread(angles, len(experiment.fit_names()), bool(first.estimated))
    tell("conventions")
    conventions = check_conventions(experiment, readings)
    given = (experiment, readings)
    for convention in conventions:
        if convention.compelling:
            experiment, readings = convention.experiment, convention.readings
            break
    base = _baseline(experiment, readings, tell)
    tell("search")
    base, library, answers = _searched(base, level, largest, seed)
    best = answers[0] if answers else None
    tell("closing gate")
    closing = _close(base, best, seed)
    leftovers = closing.leftovers(level * (1.0 - _LIBRARY_SHARE))
    tell("held-out gain")
    held = _held(base, library, best, level, largest, seed, repeats)
    tell("table")
    extended = best.fit if best else base.fit
    threshold = library.scores.threshold(level * _LIBRARY_SHARE)
    findings = findings_of(library, answers, base.fit, held, threshold, _pose_names(base), seed)
    findings = (*_convention_findings(conventions), *findings)
    known = base.audit.unit_source == "stated"
    before = misfit(base.experiment, base.readings, base.rows, base.fit, known)
    after = misfit(base.experiment, base.readings, base.rows, extended, known)
    return Diagnosis(
        experiment=base.experiment,
        readings=base.readings,
        verdict=verdict_of(findings, leftovers, after, ambiguous(library, findings)),
        findings=findings,
        table=table_of(library, best, findings, base.untested),
        conventions=conventions,
        audit=base.audit,
        leftovers=leftovers,
        before=before,
        after=after,
        rms=_errors(base, extended, held, given),
        kept=base.rows.keep,
        outliers=base.out,
        baseline=base.fit,
        extended=extended,
        case=base.case,
        method=Method(held, base.far, base.untold, one_pose),
        level=level,
        seed=seed,
    )


def _pose_names(base: _Baseline) -> list[str]:
    """Names of the poses by the number that the rows give them."""
    names = [""] * (int(base.rows.pose.max()) + 1)
    for number, name in zip(base.rows.pose.tolist(), base.rows.pose_names, strict=True):
        names[number] = name
    return names


def _convention_findings(conventions: Sequence[Convention]) -> tuple[Finding, ...]:
    """The compelling convention that was adopted, as a cause of its own."""
    adopted = next((c for c in conventions if c.compelling), None)
    if adopted is None:
        return ()
    value = Value(adopted.name, "", adopted.value, 0.0, 0.0 if adopted.value != 1.0 or "[" in adopted.name else 1.0)
    return (
        Finding(
            name=adopted.name,
            values=(value,),
            s=float(np.sqrt(2.0 * max(adopted.evidence, 0.0))),
            p_value=float(np.exp(-min(adopted.evidence, 700.0))),
            ebic_gain=2.0 * adopted.evidence,
            rivals=(),
            hangs_on=(),
        ),
    )


def _teller(progress: Progress | None) -> Callable[[str], None]:
    def tell(step: str) -> None:
        if progress is not None:
            progress(step, STEPS.index(step), len(STEPS))

    return tell


def _baseline(experiment: Experiment, readings: Readings, tell: Callable[[str], None]) -> _Baseline:
    """The exact fit of the experiment's own parameters, the audit of the noise, and the fit under audited noise."""
    tell("baseline")
    model = experiment.model()
    rows = make_rows(readings)
    wanted = in_order(model, experiment.fit_names())
    x = start_values(experiment, wanted)
    seen = bridge(experiment, readings, wanted, linear=True, x=x, rows=rows)
    names, untold = split_told(seen)
    try:
        fit = settle_fit(model, rows, names, x, frames=seen.frames)
    except NotConverged as error:
        if not untold:
            raise
        said = f"{error}. These readings do not tell {', '.join(untold)}: kept at the nominal value"
        raise NotConverged(said) from error
    if not rows.stated:  # until the audit knows better, all that the baseline leaves counts as noise
        unit = float(np.sqrt(fit.chi2 / max(len(rows.at) - fit.jacobian.shape[1], 1)))
        unit = max(unit, rounding(rows.noise, rows.scalars, REACH))
        scaled = replace(readings, sigma=readings.sigma * unit, minus_sigma=readings.minus_sigma * unit)
        rows = replace(rows, readings=scaled)
    tell("causes")
    causes, untested = find_causes(experiment, names, rows)
    case = make_case(experiment, rows, names, causes, fit.by_name(), fit.residuals, fit.frames)
    tell("noise")
    audit = _audit(case, rows, rows.stated)
    base = _Baseline(
        experiment=experiment,
        readings=readings,
        rows=rows,
        fit=fit,
        case=case,
        audit=audit,
        out=rows.keep[:0],
        untested=untested,
        untold=untold,
        given=rows,
        whole=case,
        stated=rows.stated,
    )
    return _under(base, audit)


def _audit(case: Case, rows: Rows, stated: bool) -> NoiseAudit:
    library = np.concatenate([case.A, *case.B], axis=1)
    shape = (len(rows.keep), 3)
    sigma = np.sqrt(np.mean(rows.sigma**2, axis=1))
    return audit_noise(
        case.residuals.reshape(shape),
        library.reshape(*shape, -1),
        sigma,
        stated,
        rows.plus,
        replicates(rows.readings, rows),
        mask=None if rows.mask.all() else rows.mask,
        least=rounding(rows.noise, rows.scalars, REACH),
    )


def _under(base: _Baseline, audit: NoiseAudit) -> _Baseline:
    """The baseline with the rows that an audit leaves, and in its noise."""
    given, whole = base.given, base.whole
    good = np.setdiff1d(np.arange(len(given.keep)), audit.outliers)
    out = given.keep[audit.outliers]
    rows = audited_rows(given, good, audit)
    fit = settle_fit(base.experiment.model(), rows, whole.fitted, base.fit.x, frames=base.fit.frames)
    case = whole.rewhitened(good, rows.padded_noise, fit.residuals)
    if audit.heavy_tailed:
        case = replace(case, residuals=huber_pseudo_values(case.residuals, library_basis(case)))
    return replace(base, rows=rows, fit=fit, case=case, audit=audit, out=out)


def _audited_again(base: _Baseline, best: Answer) -> _Baseline | None:
    """Where some causes leave far less than all of them together: the baseline in the noise that is seen beside them.

    All causes are linear in the audit. What a large one does beyond that, a frame turned by half a radian for one,
    passes for noise there; at the values of its exact fit it does not. None where nothing speaks against the audit.
    """
    if not far_from_linear(base.case, best.fit):
        return None
    given, whole, fit = base.given, base.whole, best.fit
    predicted, _ = predicted_or_linear(fit.model, given, fit.x, fit.frames)
    residuals = given.padded(np.nan_to_num(given.measured) - predicted)
    case = make_case(base.experiment, given, whole.fitted, whole.causes, fit.by_name(), residuals, fit.frames)
    return replace(_under(base, _audit(case, given, base.stated)), far=True)


def _searched(base: _Baseline, level: float, largest: int, seed: int) -> tuple[_Baseline, Library, list[Answer]]:
    """The library, its answers, best first, and the baseline whose noise they leave."""
    library = make_library(base.case, base.fit, base.nu, seed)
    answers = _answers(library, base, level, largest)
    again = _audited_again(base, answers[0]) if answers else None
    if again is None:
        return base, library, answers
    library = make_library(again.case, again.fit, again.nu, seed)
    found = _answers(library, again, level, largest)
    tried = {part.members: part for a in (answers[0], *found[:1]) for part in parts_of(a.subset, library.gram)}
    parts = (answer_of(library, p, again.fit, again.rows) for p in tried.values())
    # the linear search adds causes for what is far from linear: all parts of its answers are weighed by exact fits
    return again, library, sorted((a for a in parts if a is not None), key=lambda a: a.ebic)


def _answers(library: Library, base: _Baseline, level: float, largest: int) -> list[Answer]:
    """Explanations where the library's test is significant, most plausible alias first; none otherwise."""
    if library.scores.p_value > level * _LIBRARY_SHARE:
        return []
    answers = explain(library, base.fit, base.rows, level, largest)
    if not answers:
        return []
    first = answers[0]
    members = tuple(most_plausible(library, i) for i in first.subset.members)
    if members != first.subset.members:
        causes = [base.case.causes[i] for i in members]
        fit = refit(base.case, causes, base.fit, base.rows)
        if fit is not None and fit.chi2 <= first.fit.chi2 + 1.0:
            first = Answer(replace(first.subset, members=members), fit, first.ebic)
    return [first, *answers[1:]]


def _close(base: _Baseline, best: Answer | None, seed: int) -> Closing:
    fit = best.fit if best else base.fit
    moved = motions(fit.model, base.rows, fit.x, fit.frames)
    drives = base.experiment.robot.facts.n
    white = huber_pseudo_values(fit.white, library_basis(base.case)) if base.audit.heavy_tailed else fit.white
    return close(moved, drives, fit.jacobian, white, base.rows.padded_noise, base.nu, 2000, seed + 1)


def _held(
    base: _Baseline, library: Library, best: Answer | None, level: float, largest: int, seed: int, repeats: int
) -> HeldOut:
    """Cross-validation in independent noise, so that errors stay in metres at each row."""
    sigma = base.rows.sigma.ravel()
    every = np.arange(len(base.rows.keep))
    case = base.case.rewhitened(every, Independent(sigma), base.fit.residuals)
    members = best.subset.members if best else ()
    closing = _extended_case(base, best, Independent(sigma)) if best else None
    alike = [set(library.aliases(i)) for i in members]
    how = Search(
        subspaces=case.subspaces(),
        threshold=library.scores.threshold(level * _LIBRARY_SHARE),
        nu=library.nu,
        stated=library.stated,
        classes=library.heads,
        bounds=library.bounds,
        largest=largest,
    )
    return held_out(case, closing, members, alike, how, sigma, seed, repeats, given=base.far)


def _extended_case(base: _Baseline, best: Answer, noise: Independent) -> Case:
    """The case whose fitted parameters are those of the extended model, linearised there, without further causes."""
    causes = [base.case.causes[i] for i in best.subset.members]
    experiment = base.experiment
    fit = best.fit
    case = make_case(experiment, base.rows, base.case.fitted, causes, fit.by_name(), fit.residuals, fit.frames)
    every = np.arange(len(base.rows.keep))
    case = case.rewhitened(every, noise, fit.residuals)
    return replace(case, A=np.concatenate([case.A, *case.B], axis=1), causes=(), B=())


def _errors(base: _Baseline, extended: Settled, held: HeldOut, given: tuple[Experiment, Readings]) -> Errors:
    experiment, readings = given
    model = experiment.model()
    given_rows = replace(base.rows, readings=readings)  # as they were before a convention was applied
    frames = given_rows.start(model, model.nominal)
    predicted, _ = predicted_or_linear(model, given_rows, model.nominal, frames)  # values far off may bear no load
    nominal = base.rows.measured - predicted
    mask, noise = base.rows.mask, float(np.sqrt(np.mean(base.rows.sigma[base.rows.mask] ** 2) + base.audit.shared**2))
    return Errors(
        rms(nominal),
        rms(base.fit.residuals[mask]),
        rms(extended.residuals[mask]),
        held.rms_identified,
        held.rms_extended,
        noise,
    )
