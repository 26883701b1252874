"""`diagnose`: from readings to what the model gets wrong, step by step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.diagnose.case import Case, make_case
from qsframework.diagnose.causes import Untested, find_causes
from qsframework.diagnose.conventions import Convention, check_conventions
from qsframework.diagnose.explain import Answer, Library, answer_of, explain, make_library, most_plausible, refit
from qsframework.diagnose.fitted import Settled, displacement_or_linear, settle_fit
from qsframework.diagnose.gain import HeldOut, Search, held_out
from qsframework.diagnose.gate import Closing, close, motions
from qsframework.diagnose.noise_audit import NoiseAudit, audit_noise
from qsframework.diagnose.proof import audited_rows, far_from_linear, library_basis, misfit, replicates, told_names
from qsframework.diagnose.result import Diagnosis, Errors, Finding, Value
from qsframework.diagnose.search import LARGEST, parts_of
from qsframework.diagnose.table import findings_of, table_of
from qsframework.diagnose.taming import tamed
from qsframework.diagnose.verdict import ambiguous, verdict_of, words_of
from qsframework.errors import InputError
from qsframework.experiment import Experiment, Readings
from qsframework.identify.fit import rms
from qsframework.identify.linear import Rows, fit_rows
from qsframework.identify.noise import readings_noise
from qsframework.identify.observations import Independent, Noise
from qsframework.identify.single import single_pose
from qsframework.plugin import Indices

LEVEL = 0.04
_LIBRARY_SHARE = 0.6
"""Of the level that the library's test gets; the dictionary of the closing gate gets the rest."""
STEPS = ("conventions", "baseline", "causes", "noise", "search", "closing gate", "held-out gain", "table")
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class _Baseline:
    """What the search starts from: rows and noise after the audit, the exact fit to them, the whitened case.

    given, whole: rows and case before the audit; stated: whether somebody says the size of the noise; far: whether
    it has been audited again, at the values of a cause far from linear
    """

    experiment: Experiment
    readings: Readings
    rows: Rows
    noise: Noise
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
    experiment: Experiment, readings: Readings, *, level: float = LEVEL, seed: int = 0, largest: int = LARGEST,
    repeats: int = 3, progress: Progress | None = None,
) -> Diagnosis:  # fmt: skip
    """What the experiment's model gets wrong on these readings, and which causes explain it.

    level: probability of naming anything where nothing acts; largest: causes named together at most; repeats: of the
    cross-validation; progress(step, done, all) is called before each step.

    Raises InputError, NotIdentifiable or NotConverged where the baseline itself cannot be fitted.
    """
    if not 0.0 < level < 0.5:
        raise InputError(f"level must be between 0 and 0.5, found {level:g}")
    tell = _teller(progress)
    used = np.unique(readings.measurement[readings.use])
    lonely = single_pose(readings.poses.q[used], len(experiment.fit_names()))
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
    errors = _errors(base, extended, held, given)
    table = table_of(library, best, findings, base.untested)
    verdict = verdict_of(findings, leftovers, after, ambiguous(library, findings))
    outliers = [int(base.readings.rows[i]) for i in base.out]
    said = words_of(verdict, findings, leftovers, conventions, base.audit, after, errors, table, outliers)
    return Diagnosis(
        base.experiment, base.readings, verdict, said, findings, table, conventions, base.audit, leftovers, before,
        after, errors, base.rows.keep, base.out, base.fit, extended, base.case,
        (*lonely, *_notes(base, held, extended)), level, seed,
    )  # fmt: skip


def _pose_names(base: _Baseline) -> list[str]:
    """Names of the poses by the number that the rows give them."""
    names = [""] * (int(base.rows.pose.max()) + 1)
    for number, measurement in zip(base.rows.pose.tolist(), base.rows.measurement.tolist(), strict=True):
        names[number] = base.readings.pose[measurement]
    return names


def _convention_findings(conventions: Sequence[Convention]) -> tuple[Finding, ...]:
    """The compelling convention that was adopted, as a cause of its own."""
    adopted = next((c for c in conventions if c.compelling), None)
    if adopted is None:
        return ()
    value = Value(adopted.name, "", adopted.value, 0.0, 0.0 if adopted.value != 1.0 or "[" in adopted.name else 1.0)
    s = float(np.sqrt(2.0 * max(adopted.evidence, 0.0)))
    p = float(np.exp(-min(adopted.evidence, 700.0)))
    physics = "A convention of the file or of the controller is not the one that was assumed"
    return (Finding(adopted.name, (value,), s, p, 2.0 * adopted.evidence, (), (), physics, adopted.words),)


def _teller(progress: Progress | None) -> Callable[[str], None]:
    def tell(step: str) -> None:
        if progress is not None:
            progress(step, STEPS.index(step), len(STEPS))

    return tell


def _baseline(experiment: Experiment, readings: Readings, tell: Callable[[str], None]) -> _Baseline:
    """The exact fit of the experiment's own parameters, the audit of the noise, and the fit under audited noise."""
    tell("baseline")
    model = experiment.model()
    rows, source = fit_rows(experiment, readings, len(experiment.fit_names()))
    noise = readings_noise(readings, rows.keep, rows.sigma)
    names, untold = told_names(experiment, readings, rows, noise)
    fit = settle_fit(model, readings, rows, noise, names, model.nominal)
    if source == "estimated":  # until the audit knows better, all that the baseline leaves counts as noise
        unit = float(np.sqrt(fit.chi2 / (len(fit.white) - len(names))))
        rows = replace(rows, sigma=rows.sigma * unit)
        noise = readings_noise(readings, rows.keep, rows.sigma)
    tell("causes")
    causes, untested = find_causes(experiment, names, readings.poses)
    case = make_case(experiment, readings.poses, names, causes, fit.by_name(), rows, noise, fit.residuals)
    tell("noise")
    audit = _audit(readings, case, rows, source == "stated")
    base = _Baseline(
        experiment, readings, rows, noise, fit, case, audit, rows.keep[:0], untested, untold, rows, case,
        source == "stated",
    )  # fmt: skip
    return _under(base, audit)


def _audit(readings: Readings, case: Case, rows: Rows, stated: bool) -> NoiseAudit:
    library = np.concatenate([case.A, *case.B], axis=1)
    shape = (len(rows.keep), 3)
    return audit_noise(
        case.residuals.reshape(shape), library.reshape(*shape, -1), rows.sigma, stated, rows.measurement, rows.marker,
        replicates(readings, rows),
    )  # fmt: skip


def _under(base: _Baseline, audit: NoiseAudit) -> _Baseline:
    """The baseline with the rows that an audit leaves, and in its noise."""
    given, whole = base.given, base.whole
    good = np.setdiff1d(np.arange(len(given.keep)), audit.outliers)
    out = given.keep[audit.outliers]
    rows, noise = audited_rows(base.readings, given, good, audit)
    fit = settle_fit(base.experiment.model(), base.readings, rows, noise, whole.fitted, base.fit.x)
    case = whole.rewhitened(good, noise, fit.residuals)
    if audit.heavy_tailed:
        case = replace(case, residuals=tamed(case.residuals, library_basis(case)))
    return replace(base, rows=rows, noise=noise, fit=fit, case=case, audit=audit, out=out)


def _audited_again(base: _Baseline, best: Answer) -> _Baseline | None:
    """Where some causes leave far less than all of them together: the baseline in the noise that is seen beside them.

    All causes are linear in the audit. What a large one does beyond that, a frame turned by half a radian for one,
    passes for noise there; at the values of its exact fit it does not. None where nothing speaks against the audit.
    """
    if not far_from_linear(base.case, best.fit):
        return None
    given, whole, fit = base.given, base.whole, best.fit
    predicted, _ = displacement_or_linear(fit.model, base.readings, fit.x)
    residuals = given.measured - given.of(predicted)
    noise = readings_noise(base.readings, given.keep, given.sigma)
    case = make_case(
        base.experiment, base.readings.poses, whole.fitted, whole.causes, fit.by_name(), given, noise, residuals
    )
    return replace(_under(base, _audit(base.readings, case, given, base.stated)), far=True)


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
    parts = (answer_of(library, p, again.fit, again.readings, again.rows, again.noise) for p in tried.values())
    # the linear search adds causes for what is far from linear: all parts of its answers are weighed by exact fits
    return again, library, sorted((a for a in parts if a is not None), key=lambda a: a.ebic)


def _answers(library: Library, base: _Baseline, level: float, largest: int) -> list[Answer]:
    """Explanations where the library's test is significant, most plausible alias first; none otherwise."""
    if library.scores.p_value > level * _LIBRARY_SHARE:
        return []
    answers = explain(library, base.fit, base.readings, base.rows, base.noise, level, largest)
    if not answers:
        return []
    first = answers[0]
    members = tuple(most_plausible(library, i) for i in first.subset.members)
    if members != first.subset.members:
        causes = [base.case.causes[i] for i in members]
        fit = refit(base.case, causes, base.fit, base.readings, base.rows, base.noise)
        if fit is not None and fit.chi2 <= first.fit.chi2 + 1.0:
            first = Answer(replace(first.subset, members=members), fit, first.ebic)
    return [first, *answers[1:]]


def _close(base: _Baseline, best: Answer | None, seed: int) -> Closing:
    fit = best.fit if best else base.fit
    moved = motions(fit.model, base.readings.poses, base.rows, fit.x)
    drives = base.experiment.robot.facts.n
    white = tamed(fit.white, library_basis(base.case)) if base.audit.heavy_tailed else fit.white
    return close(moved, drives, fit.jacobian, white, base.noise, base.nu, 2000, seed + 1)


def _held(
    base: _Baseline, library: Library, best: Answer | None, level: float, largest: int, seed: int, repeats: int
) -> HeldOut:  # fmt: skip
    """Cross-validation in independent noise, so that errors stay in metres at each row."""
    sigma = np.repeat(base.rows.sigma, 3)
    every = np.arange(len(base.rows.keep))
    case = base.case.rewhitened(every, Independent(sigma), base.fit.residuals)
    members = best.subset.members if best else ()
    closing = _extended_case(base, best, Independent(sigma)) if best else None
    alike = [set(library.aliases(i)) for i in members]
    how = Search(
        case.subspaces(), library.scores.threshold(level * _LIBRARY_SHARE), library.nu, library.stated,
        library.heads, library.bounds, largest,
    )  # fmt: skip
    return held_out(case, closing, members, alike, how, sigma, seed, repeats, given=base.far)


def _extended_case(base: _Baseline, best: Answer, noise: Noise) -> Case:
    """The case whose fitted parameters are those of the extended model, linearised there, without further causes."""
    causes = [base.case.causes[i] for i in best.subset.members]
    experiment = base.experiment
    fit = best.fit
    case = make_case(
        experiment, base.readings.poses, base.case.fitted, causes, fit.by_name(), base.rows, noise, fit.residuals
    )
    return replace(case, A=np.concatenate([case.A, *case.B], axis=1), causes=(), B=())


def _errors(base: _Baseline, extended: Settled, held: HeldOut, given: tuple[Experiment, Readings]) -> Errors:
    experiment, readings = given
    model = experiment.model()
    predicted, _ = displacement_or_linear(model, readings, model.nominal)  # values far off may not bear the load
    nominal = base.rows.measured - base.rows.of(predicted)
    noise = float(np.sqrt(np.mean(base.rows.sigma**2) + base.audit.shared**2))
    return Errors(
        rms(nominal), rms(base.fit.residuals), rms(extended.residuals), held.rms_identified, held.rms_extended, noise
    )


def _notes(base: _Baseline, held: HeldOut, extended: Settled) -> tuple[str, ...]:
    nested = f"the search chose the same causes in {100 * held.same:.0f} % of the folds"
    said = [f"Held-out errors: {held.folds}; {'the causes are given' if base.far else nested}."]
    if base.far:
        said.append("A named cause is so large that it is far from linear: the noise was audited again at its size.")
    if base.untold:
        said.append(f"These readings do not tell {', '.join(base.untold)}: kept at the nominal value.")
    if base.audit.heavy_tailed:
        said.append("The errors have heavy tails: in the tests large ones count by Huber's rule, as 1.3 sds at most.")
    if not (base.fit.exact and extended.exact):
        said.append("The full equilibrium did not settle somewhere: the linear model was used instead.")
    return tuple(said)
