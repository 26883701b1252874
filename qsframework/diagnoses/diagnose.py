"""`diagnose`: from readings to what the model gets wrong, step by step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from qsframework.arguments import checked
from qsframework.diagnoses.baseline import Baseline, audit_of, start_of
from qsframework.diagnoses.evidence_table import findings_of, table_of
from qsframework.diagnoses.learned_law import best_law, tested
from qsframework.diagnoses.named_causes import (
    FoundCauses,
    SearchOptions,
    beside_slips,
    beside_structures,
    find_named,
    held_out_gain,
)
from qsframework.diagnoses.options import LEVEL, Level
from qsframework.diagnoses.remaining import Beside, Remaining, ranked_places, with_alternatives
from qsframework.diagnoses.residuals.audited_rows import misfit
from qsframework.diagnoses.residuals.noise_components import NoiseAudit
from qsframework.diagnoses.result import Diagnosis, Errors, Method, NamedCause, Value, left_open
from qsframework.diagnoses.verdict import ambiguous, verdict_of
from qsframework.estimation import rms
from qsframework.experiment import Experiment, Readings, make_rows
from qsframework.experiment.account import account_of
from qsframework.experiment.before import errors_before
from qsframework.experiment.prior import from_priors
from qsframework.fits.findings import noise_findings, outside_prior, unexplained
from qsframework.fits.pose_spread import check_pose_spread
from qsframework.hypotheses.exact_refit import SettledFit
from qsframework.hypotheses.search.cross_validation import HeldOut
from qsframework.hypotheses.search.subsets import LARGEST
from qsframework.option import Seed
from qsframework.screening import Mistake, adopted, find_mistakes, state_findings
from qsframework.work.threads import on_one_thread

STEPS = ("conventions", "baseline", "causes", "search", "test for remaining signal", "held-out gain", "table", "noise")
Progress = Callable[[str, int, int], None]


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
    # Whether all readings are of one pose. NotIdentifiable where they are and several parameters are fitted.
    rows = make_rows(readings)
    angles = readings.poses.q[np.unique(rows.plus)]
    tell, one_pose = _teller(progress), check_pose_spread(angles, len(experiment.fit_names()), bool(rows.estimated))
    tell("conventions")
    mistakes = find_mistakes(experiment, readings, gross=False)
    last = next(reversed(adopted(mistakes)), None)
    most = 0 if last is not None and last.hides else largest
    options = SearchOptions(level=level, largest=most, seed=seed, repeats=repeats)
    tell("baseline")
    start = start_of(last.experiment, last.readings) if last else start_of(experiment, readings)
    found, slips = beside_slips(start, find_named(start, options, tell), options, tell)
    proved = adopted(mistakes)
    mistakes = (*proved, *slips, *(m for m in mistakes if m not in proved))
    if last is None and not slips:
        found, structure = beside_structures(start, found, options, tell)
        mistakes = (*structure, *mistakes)
    tell("test for remaining signal")
    found, remaining, beside = tested(found, options)
    given = experiment, readings
    return _told(found, remaining, beside, options, tell, mistakes=mistakes, given=given, one_pose=one_pose)


def _told(
    found: FoundCauses,
    remaining: Remaining,
    beside: Beside,
    options: SearchOptions,
    tell: Callable[[str], None],
    *,
    mistakes: Sequence[Mistake],
    given: tuple[Experiment, Readings],
    one_pose: bool,
) -> Diagnosis:
    """What the causes that were found and what they leave come to: gain, names with what may stand in their place, what
    is learned, noise; given: as they were before a mistake was mended."""
    base, library, extended = found.base, found.library, found.extended
    tell("held-out gain")
    held = held_out_gain(found, options)
    tell("table")
    threshold = library.scores.threshold(options.of_library)
    findings = findings_of(library, found.answers, base.fit, held, threshold, base.pose_names(), options.seed)
    findings = (*_mistakes_as_causes(mistakes), *with_alternatives(findings, found.causes, remaining, beside))
    certain = _certain(found, findings)
    learned = best_law(found, certain, remaining, options)
    known = beside(_known(findings) if left_open(findings, remaining.leftovers) else frozenset())
    race = remaining.race if not found.answers and remaining.race else known.race
    tell("noise")
    audit = audit_of(base, learned.alone if learned and learned.holds else extended)
    after = misfit(base.experiment, base.readings, base.rows, extended)
    # Of the baseline, with the names that it leaves open, and what is wrong with the readings.
    account = account_of(base.experiment, base.rows, base.fit.names)
    errors, sigma = _errors(base, extended, held, given, audit), rms(base.start.sigma[base.rows.mask])
    told = [m for m in mistakes if m.told]
    noise = noise_findings(sigma, audit.unit, (errors.nominal, errors.heldout_extended)) if audit.stated else ()
    values = extended.x[extended.model.index(base.fit.names)]
    unlikely = (*noise, *outside_prior(from_priors(base.fit.model, base.readings, base.fit.names, values)))
    wrong = (*(m.finding for m in told), *unexplained(told, unlikely), *state_findings(*given))
    return Diagnosis(
        account=replace(account, causes=tuple(f.name for f in findings if not f.doubtful), findings=wrong),
        experiment=base.experiment,
        readings=base.readings,
        verdict=verdict_of(findings, remaining.leftovers, after, audit, ambiguous(library, findings)),
        findings=findings,
        table=table_of(library, found.best, findings, base.untested),
        conventions=tuple(mistakes),
        audit=audit,
        leftovers=remaining.leftovers,
        places=ranked_places(remaining, findings, race),
        before=misfit(base.experiment, base.readings, base.rows, base.fit),
        after=after,
        rms=errors,
        kept=base.rows.keep,
        outliers=np.setdiff1d(base.given.keep, base.rows.keep),
        baseline=base.fit,
        extended=extended,
        certain=certain,
        learned=learned,
        case=base.case,
        known=known.causes,
        settled=known.fit,
        competition=race,
        method=Method(held, base.far, base.unidentifiable, one_pose, base.rows.lone_visits),
        level=options.level,
        seed=options.seed,
    )


def _certain(found: FoundCauses, findings: Sequence[NamedCause]) -> SettledFit:
    """The exact fit with the names that are not doubtful; that of all where it cannot be made."""
    doubtful = {f.name for f in findings if f.doubtful}
    if not doubtful:
        return found.extended
    return found.base.refit([c for c in found.causes if c.name not in doubtful]) or found.extended


def _known(findings: Sequence[NamedCause]) -> frozenset[str]:
    """The names that are certain and have no open alternative."""
    return frozenset(f.name for f in findings if not f.doubtful and not f.open_alternative)


def _mistakes_as_causes(mistakes: Sequence[Mistake]) -> tuple[NamedCause, ...]:
    """The conventions and mistakes that were adopted, as causes of their own."""
    return tuple(
        NamedCause(
            name=m.name,
            values=(Value(m.name, "", m.value, 0.0, 0.0 if m.value != 1.0 or "[" in m.name else 1.0),),
            s=float(np.sqrt(2.0 * max(m.evidence, 0.0))),
            p_value=float(np.exp(-min(m.evidence, 700.0))),
            ebic_gain=2.0 * m.evidence,
            alternatives=(),
            hangs_on=(),
        )
        for m in adopted(mistakes)
        if np.isfinite(m.evidence)
    )


def _teller(progress: Progress | None) -> Callable[[str], None]:
    def tell(step: str) -> None:
        if progress is not None:
            progress(step, STEPS.index(step), len(STEPS))

    return tell


def _errors(
    base: Baseline, extended: SettledFit, held: HeldOut, given: tuple[Experiment, Readings], audit: NoiseAudit
) -> Errors:
    experiment, readings = given
    given_rows = replace(base.rows, readings=readings)  # as they were before a convention was applied
    nominal = errors_before(experiment, given_rows, experiment.fit_names())
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
