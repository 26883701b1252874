"""The verb: from an experiment and its readings, of any kind, to a fit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import compress

import numpy as np
import numpy.typing as npt

from qsframework.arguments import checked
from qsframework.elastostatics import Model
from qsframework.errors import InputError, NotConverged, NotIdentifiable, Problem, nearest, some_of
from qsframework.estimation import (
    PLAIN,
    FitOptions,
    LinearFit,
    Observations,
    Solution,
    profile_interval,
    propagated,
    rank_test,
    rms,
    scales,
    sds_at,
    settle,
    shared_error,
)
from qsframework.estimation.axis_noise import LEVEL, axis_words
from qsframework.estimation.families import loosened
from qsframework.estimation.tails import chi2_sf
from qsframework.estimation.visit_noise import SharedError
from qsframework.experiment import Experiment, Frame, ObservationModel, Readings, make_rows, observation_model
from qsframework.experiment.account import account_of
from qsframework.experiment.before import errors_before
from qsframework.experiment.noise_by_axis import noise_by_axis
from qsframework.experiment.observations import ReadingRows, start_values
from qsframework.experiment.prior import families, springs_of
from qsframework.experiment.setup import GEOMETRY, expand_name
from qsframework.fits.columns import ERRORS
from qsframework.fits.estimate import Estimate, EstimateState, estimate_of
from qsframework.fits.findings import every_finding
from qsframework.fits.fit import KINDS, Fit, Found
from qsframework.fits.held import held_at_nominal
from qsframework.fits.load_error import load_columns, load_sds
from qsframework.fits.pose_spread import check_pose_spread
from qsframework.fits.record import Masked
from qsframework.fits.two_step import two_step
from qsframework.information import what_would_help
from qsframework.information.identifiable import in_order
from qsframework.information.selection import NotEstimated, identifiable_names
from qsframework.plugin import Array, Geometry
from qsframework.screening import (
    SHARE,
    Mistake,
    WrongRows,
    adopted,
    doubled,
    find_mistakes,
    find_outliers,
    masked,
    told_outliers,
)
from qsframework.work.threads import on_one_thread

_UNUSUAL = 3.0
"""Times what is known of an arm's geometry from which its own is worth a word."""
_ENOUGH = 30
"""Degrees of freedom below which no reading is called gross: a few cannot say what is usual."""


@checked
@on_one_thread
def identify(
    experiment: Experiment, readings: Readings, fit: Sequence[str] | None = None, options: FitOptions = PLAIN
) -> Fit:
    """Estimate the experiment's parameters, and frames of unknown place, from readings.

    Parameters that the readings do not identify are held at nominal and listed with those they are correlated with.
    Where the experiment says `rigid: true`, springs that are not estimated count as rigid. What is wrong with the
    readings or the files stands in the fit's account (`account.findings`); what uses the fit stops there.

    Args:
        experiment: the campaign.
        readings: its readings.
        fit: other parameters to estimate: effects, instances or single parameters.
        options: method, bounds, loss and the like.

    Returns:
        p estimates, SI, with their covariance (p, p) and the held-out error, m.

    Raises:
        InputError: where there are fewer readings than parameters.
        NotIdentifiable: names the parameters, where the readings identify none of them or are all of one pose.
        NotConverged: with its reason.
    """
    experiment = experiment if fit is None else experiment.with_(fit=tuple(fit))
    found = fit_readings(experiment, readings, options)
    used = found.used(readings)
    return replace(found, account=replace(found.account, findings=every_finding(found, experiment, used)))


def fit_readings(experiment: Experiment, readings: Readings, options: FitOptions = PLAIN) -> Fit:
    """The same without a look at what is wrong with the readings or the files."""
    twice = () if options.keep_all else tuple(doubled(readings))
    readings = masked(readings, [one.mask for one in twice])
    model, rows = experiment.model(), make_rows(readings)
    names = in_order(model, experiment.fit_names())
    _check_names(options, names)
    said, wrong = _gross(experiment, readings, rows, options)
    if GEOMETRY in (experiment.fit or ()) and not rows.estimated and not readings.is_position[rows.keep].any():
        raise InputError(
            f"fit: {GEOMETRY} needs absolute positions (x_mm, y_mm, z_mm); these readings are displacements, "
            "which hardly depend on it. Name what they identify, such as compliances, or give positions"
        )
    method = two_step if options.method == "two-step" else _one_step
    used = rows if wrong is None else make_rows(readings.masked(wrong))
    try:
        found = _finished(experiment, used, options, lambda own: method(experiment, own, names, options))
    except NotConverged as error:
        said = " ".join(_in_the_table(experiment, readings))
        raise NotConverged(f"{error}. {said}" if said else str(error)) from error
    if wrong is not None:
        predicted, measured = found.predict(replace(readings, use=readings.use & wrong))
        found = replace(found, missed=measured - predicted, missed_kind=readings.kind[readings.use & wrong])
    nominal, error, largest = _held_out(found)
    said = (*masked_words(readings, twice), *said)
    found = replace(found, gross=said, held_out_nominal=nominal, held_out_error=error, held_out_largest=largest)
    every = (of["held_out"] for of in found.errors.values() if "held_out" in of)
    return replace(found, held_out_worst=max(every, default=np.nan))


def _in_the_table(experiment: Experiment, readings: Readings) -> tuple[str, ...]:
    """What is wrong in the table beyond doubt, in the words of `qsf check`."""
    found = adopted(find_mistakes(experiment, readings, gross=False))
    return tuple(f"Wrong in the table: {c.words}." for c in found)


def _held_out(fit: Fit) -> tuple[float, float, float]:
    """The errors of a fit at held-out poses, masked rows among them: of the nominal arm, of the fit, the largest."""
    kind = next(k for k in KINDS if (fit.kind == k).any())
    nominal, out = (row.errors(fit, kind) for row in ERRORS if row.key in ("nominal", "held_out"))
    far = np.sqrt(np.nansum(out**2, axis=1))
    return fit.error_of(nominal), fit.error_of(out), float(far.max()) if len(far) else float("nan")


def _gross(
    experiment: Experiment, readings: Readings, rows: ReadingRows, options: FitOptions
) -> tuple[tuple[Masked, ...], npt.NDArray[np.bool_] | None]:
    """What is to be said of rows that are far off, and those of the readings to mask: few, or none."""
    count = len(rows.at) - len(experiment.fit_names()) - rows.unknown_motions
    if options.keep_all or count < _ENOUGH:
        return (), None
    outliers = find_outliers(experiment, readings)
    if outliers is None or not (outliers.gross.any() or outliers.missed.any()):
        return (), None
    found = told_outliers(readings, rows.keep, outliers)
    many = outliers.share > SHARE
    said = masked_words(readings, [one for one in found if not (many and one.name == "gross")])
    if many or not outliers.gross.any():
        return said, None
    wrong = np.zeros(len(readings), dtype=bool)
    wrong[rows.keep[outliers.gross]] = True
    return said, wrong


def masked_words(readings: Readings, found: Sequence[WrongRows | Mistake]) -> tuple[Masked, ...]:
    """Rows that are masked as a fit of the others keeps them: `replace(fit, cleaned=...)`."""
    names = [source.name for source in readings.sources]
    out: list[Masked] = []
    for one in found:
        own = np.isin(readings.line, one.rows) & ((readings.file == names.index(one.file)) if one.file else True)
        own = own if one.mask is None or not one.mask.any() else one.mask
        for file in np.unique(readings.file[own]).tolist():
            here = own & (readings.file == file)
            kinds = readings.kind[here].tolist()
            what = "positions" if "position" in kinds else f"{kinds[0]}s"
            rows = tuple(sorted({int(line) for line in readings.line[here]}))
            out.append(Masked(one.name, rows, one.words, what, file))
    return tuple(out)


def _check_names(options: FitOptions, names: Sequence[str]) -> None:
    for name in (*options.fixed, *(n for group in options.tied for n in group), *options.profile):
        if name not in names:
            raise InputError(
                Problem(f"the fit has no parameter {name!r}", allowed=", ".join(names), hint=nearest(name, names))
            )


def _one_step(experiment: Experiment, rows: ReadingRows, names: Sequence[str], options: FitOptions) -> Found:
    """All parameters at once."""
    readings = rows.readings
    x0 = start_values(experiment, names)
    free = [n for n in names if n not in options.fixed]
    if not free:
        raise InputError("every parameter is fixed: nothing is left to estimate")
    seen = observation_model(experiment, readings, free, linear=options.linear, x=x0, rows=rows)
    told, left = identifiable_names(seen, options, known=not options.free)
    if not told:
        raise _none_identifiable(experiment, seen, left, names)
    if options.free and left:
        raise _not_told_freely(left)
    seen = replace(seen, names=tuple(n for n in names if n in told or n in options.fixed))
    tied = tuple(g for g in options.tied if set(g) <= set(seen.names))
    options = replace(options, tied=tied, starts=0 if seen.frames else options.starts)
    observations = seen.observations()
    observations = replace(observations, prior_sd=None, prior=None) if options.free else observations
    one_pose = _check_enough(rows, observations, seen, options)
    notes = ("Only one pose was measured: nothing says whether this fit holds at another one.",) if one_pose else ()
    observations, solution, vague = _begun(seen, observations, options)
    while observations.known[0].any() and (
        more := _vague(seen, observations, (solution.unit or 1.0) * solution.free_sd)
    ):
        vague |= more
        observations = observations.knowing(more)
        solution = settle(observations, options, solution.x)
    notes = (*notes, *_vague_words(seen.model, vague))
    before = observations.prior_sd
    if rows.stated and observations.known[0].any() and not options.tied:
        loose, said = _loosened(seen, observations, solution)
        observations, notes = observations.knowing(loose), (*notes, *said)
        solution = settle(observations, options, solution.x)
    return Found(
        seen=seen,
        solution=solution,
        covariance=solution.covariance,
        method="one-step",
        left=left,
        notes=notes,
        solved=observations,
        before=before,
        vague=tuple(vague),
    )


def _check_enough(rows: ReadingRows, observations: Observations, seen: ObservationModel, options: FitOptions) -> bool:
    """Whether all readings are of one pose. InputError where they are too few for what nothing is known of before."""
    weight, group = observations.known[0], {name: g[0] for g in options.tied for name in g}
    open_ = {group.get(n, n) for n, w in zip(observations.names, weight, strict=True) if w == 0.0} - {*options.fixed}
    if len(rows.at) <= len(open_):
        raise InputError(
            f"{len(rows.keep)} reading{'s give' if len(rows.keep) > 1 else ' gives'} {len(rows.at)} numbers: too few "
            f"for {len(open_)} parameters{' (six of them each tracker frame)' if seen.frames else ''}; measure more "
            "poses, or fit fewer parameters (`fit:` in the experiment)"
        )
    angles = rows.readings.poses.q[np.unique(rows.plus)]
    return check_pose_spread(angles, len(open_) - seen.motions, bool(seen.frames))


def _begun(
    seen: ObservationModel, observations: Observations, options: FitOptions
) -> tuple[Observations, Solution, dict[str, float]]:
    """The first solution. Where it does not settle, that with what is known of the springs that readings hardly tell:
    these and their sds."""
    try:
        return observations, settle(observations, options), {}
    except NotConverged:
        vague = {} if options.free else _vague(seen, observations, sds_at(observations, seen.start))
        if not vague:
            raise
    observations = observations.knowing(vague)
    return observations, settle(observations, options), vague


def _vague(seen: ObservationModel, observations: Observations, sds: Array) -> dict[str, float]:
    """The springs whose sds (p,) by the readings exceed their size, with the sd they take: stated, else that size."""
    springs, open_ = springs_of(seen.model), observations.known[0] == 0.0
    far = sds > [p.scale for p in seen.parameters]
    return {p.name: p.sd or p.scale for p in compress(seen.parameters, open_ & far) if p.name in springs}


def _vague_words(model: Model, vague: Mapping[str, float]) -> Iterator[str]:
    """What is to be said of springs that the readings tell worse than their own size."""
    for name, sd in vague.items():
        p = model.parameters[model.index([name])[0]]
        source = "stated" if p.sd is not None else "natural"
        yield (
            f"{name}: its sd by the readings alone exceeds its own size; it takes its {source} sd, {sd:.3g} {p.unit}, "
            "about its nominal value."
        )


def _loosened(
    seen: ObservationModel, observations: Observations, solution: Solution
) -> tuple[dict[str, float], tuple[str, ...]]:
    """The sds of what was known before, as far off as this arm is seen to be, by name; and what to say of that."""
    weight, towards = observations.known
    free = solution.covariance.diagonal() > 0.0
    own, flat = np.flatnonzero(free & (weight > 0.0)), np.flatnonzero(free & (weight == 0.0))
    names = [observations.names[i] for i in own]
    kinds = families(seen.model, names)
    every = [*dict.fromkeys(kinds.values())]
    A = solution.jacobian * np.sqrt(solution.weights)[:, None]
    y = solution.residuals * np.sqrt(solution.weights) + A[:, own] @ (solution.x - towards)[own]
    family = np.array([every.index(kinds[n]) for n in names], dtype=np.intp)
    found = loosened(A[:, flat], A[:, own] / weight[own], y, family)
    said = [
        f"{effect}, {unit or 'a share'}: {factor:.1f} times ({low:.1f} to {high:.1f}) as far off as of other arms."
        for (effect, unit), factor, low, high in zip(every, found.factor, *found.interval, strict=True)
        if factor > _UNUSUAL
    ]
    return dict(zip(names, (found.by / weight[own]).tolist(), strict=True)), tuple(said)


def _not_told_freely(left: Sequence[NotEstimated]) -> NotIdentifiable:
    """That a fit without priors cannot tell what is asked of it."""
    said = some_of([entry.words() for entry in left], 6, "; ")
    return NotIdentifiable(
        f"without what is known before the readings these are not identifiable: {said}. Take them out of `fit:`, or "
        "let what is known count"
    )


def _none_identifiable(
    experiment: Experiment, seen: ObservationModel, left: Sequence[NotEstimated], names: Sequence[str]
) -> NotIdentifiable | InputError:
    """Why nothing can be estimated at all."""
    poses = seen.rows.readings.poses.take(seen.rows.plus)
    said = some_of([entry.words() for entry in left], 6, "; ")
    if GEOMETRY in (experiment.fit or ()):
        wanted = expand_name(GEOMETRY, seen.model)
        return InputError(
            f"fit: {GEOMETRY}: these readings identify none of its {len(wanted)} numbers ({said}); measure poses "
            f"that move every joint, or leave {GEOMETRY} out"
        )
    advice = what_would_help(seen.model, names[0], poses)
    return NotIdentifiable(f"these readings identify none of the parameters: {said}. {names[0]}: {advice}")


def _finished(
    experiment: Experiment, rows: ReadingRows, options: FitOptions, fitted: Callable[[ReadingRows], Found]
) -> Fit:
    """A method's fit with what all methods share: the error of a visit, intervals, the load's uncertainty, words."""
    found = fitted(rows)
    known = rows.shared if rows.stated else 0.0
    error = _visit_error(found) if options.shared else None
    if error is not None and error.sd > 0.0 and not known:
        found = fitted(rows.sharing(error.sd / error.unit))
    result, seen = _fit_of(experiment, found, options), found.seen
    if known:
        said = _of_visits(rows, error, known)
        result = replace(result, shared_sd=known, notes=(*result.notes, *said))
    elif error is not None:
        result = replace(result, shared_sd=error.sd, shared_p=error.p_value)
    observations = found.solved or seen.observations()
    intervals = tuple(profile_interval(observations, found.solution, name, options) for name in options.profile)
    result = replace(result, intervals=intervals)
    sds = load_sds(experiment, seen.model, seen.names)
    if sds.any() and rows.readings.states.loaded[rows.plus].any():
        columns = seen.rows.noise.whiten(load_columns(_at(found), seen.values(found.solution.x)) * sds)
        G = propagated(found.solution, columns)
        result = replace(result, total_covariance=result.covariance + G @ G.T)
    free = [e.name for e in result.estimates if e.sd != 0.0]
    aside = [e.name for e in result.not_estimated]
    return replace(result, held=held_at_nominal(_at(found), result.x, found.solution, free, aside))


def _at(found: Found) -> ObservationModel:
    """The bridge in the frames that were found."""
    return replace(found.seen, frames=found.seen.moved(found.solution.x))


def _of_visits(rows: ReadingRows, error: SharedError | None, known: float) -> Iterator[str]:
    """What is to be said of the stated error that the markers of a visit share."""
    if rows.lone_visits:
        yield "Each visit has one marker: the stated repeatability is part of the error of that marker."
    if error is not None:
        size = f"{1e3 * error.sd:.4f} mm by the residuals and {1e3 * known:.4f} mm as stated (p = {error.p_known:.2g})"
        yield f"The markers of a visit share an error of {size}; the latter counts."


def _source(experiment: Experiment, rows: ReadingRows) -> str:
    """Where the size of the noise is from."""
    source = experiment.noise.source
    return "estimated" if not rows.stated else "stated" if source == "estimated" else source


def _visit_error(found: Found) -> SharedError:
    """The error that the markers of a visit share, from the residuals of a fit without it (REML)."""
    rows = found.seen.rows
    if rows.lone_visits:
        raise InputError(
            "an error shared by the markers of a pose cannot be separated from their own: every measurement has one "
            "marker only. Leave it out, or measure more markers"
        )
    o = found.seen.observations()
    residuals = o.measured - o.predict(found.solution.x)
    free = np.sqrt(np.diag(found.covariance)) > 0.0
    own, others = rows.own_noise
    columns, known = o.jacobian(found.solution.x)[:, free], rows.shared if rows.stated else 0.0
    return shared_error(residuals, columns, own, rows.label, rows.stated, others, known)


def _fit_of(experiment: Experiment, found: Found, options: FitOptions) -> Fit:
    """The fit with its proof: estimates, residuals, what is left out."""
    seen, solution, rows = found.seen, found.solution, found.seen.rows
    readings, model = rows.readings, seen.model
    noise, free = rows.noise, found.covariance.diagonal() > 0.0
    scale = scales(list(seen.parameters))
    grown = solution.unit or 1.0
    fit = LinearFit(solution.hat, grown * solution.residuals, noise, rows.stated, priors=grown * solution.priors)
    least = seen.observations().least
    plain = float(np.sqrt(fit.chi2 / fit.dof))
    unit = 1.0 if rows.stated else max(plain if solution.unit is None else solution.unit, least)
    covariance, about_noise = found.covariance, ()
    if rows.stated or unit > least:  # else there is no noise
        covariance, about_noise = _by_axis(rows, fit, solution, found.covariance)
    covariance = covariance * unit**2
    x, frames = seen.values(solution.x), seen.moved(solution.x)
    predicted = rows.predict(model, x, frames, options.linear)
    notes = (*_option_notes(options, solution), *readings.about_reads, *about_noise, *found.notes)
    if not rows.stated and unit == least:
        notes = (*notes, "The readings have no noise: sigma is what rounding leaves, and the sds say no more.")
    estimates = _estimates(found, solution, frames, x, np.sqrt(covariance.diagonal()), unit)
    left = tuple(e for e in found.left if e.name in model.names)
    beyond = (f"{note}." for note in rows.range_notes(model, x))
    notes = (*notes, *_advice(rows, model, left, estimates), *beyond, *readings.about_still(model.facts.driven))
    left_out = rows.spread(noise.colour(fit.held_out_errors(rows.together)))
    lost = (np.isnan(left_out) & np.isfinite(rows.measured)).any(axis=1)
    return Fit(
        robot=model.facts.name,
        account=account_of(experiment, rows, seen.names),
        method=found.method,
        options=options,
        model=model,
        model_values=dict(zip(model.names, x.tolist(), strict=True)),
        estimates=estimates,
        covariance=covariance,
        rank=rank_test(
            solution.jacobian[:, free] * scale[free],
            [p.name for p in compress(seen.parameters, free)],
        ),
        sigma=unit * rms(rows.flat(rows.sigma)),
        sigma_source=_source(experiment, rows),
        lines=readings.line[rows.keep],
        file=readings.file[rows.keep],
        sources=tuple(str(s) for s in readings.sources),
        poses=rows.pose_names,
        kind=readings.kind[rows.keep],
        measured=rows.measured,
        predicted=predicted,
        nominal=rows.measured - errors_before(experiment, rows, seen.names, options.linear),
        residuals=rows.measured - predicted,
        studentised=rows.spread(fit.studentised()),
        left_out=left_out,
        carriers=tuple(dict.fromkeys(rows.pose_names[i] for i in np.flatnonzero(lost))),
        chi2=fit.chi2 / unit**2,
        dof=fit.dof,
        frames=frames,
        not_estimated=left,
        alignments=readings.alignments,
        made=readings.made,
        about_noise=about_noise,
        notes=notes,
    )


def _by_axis(rows: ReadingRows, fit: LinearFit, solution: Solution, covariance: Array) -> tuple[Array, tuple[str, ...]]:
    """The covariance (p, p) of unit noise: where nobody states the noise, as it is by direction and distance, that is
    C + C A' (V - 1) A C / b of whitened columns A, b the factor of a robust loss; and what to say."""
    Q = np.nan_to_num(rows.spread(fit.Q)).reshape(-1, fit.Q.shape[1])
    found = noise_by_axis(rows, LinearFit(Q, np.nan_to_num(rows.spread(fit.white)).ravel()))
    if found is None or found.p_value >= LEVEL:
        return covariance, ()
    if rows.stated:
        return covariance, (f"{axis_words(found)}.",) if chi2_sf(fit.chi2, fit.dof) >= LEVEL else ()
    size = (solution.unit or 1.0) / np.sqrt(solution.robust)
    pull = np.nan_to_num(rows.spread(size * solution.jacobian @ covariance))
    more = np.einsum("rip,rij,rjq->pq", pull, found.factor - np.eye(3), pull, optimize=True)
    return covariance + more, (f"{axis_words(found)}; the uncertainties allow for it.",)


def _advice(
    rows: ReadingRows, model: Model, left: Sequence[NotEstimated], estimates: Sequence[Estimate]
) -> tuple[str, ...]:
    """What would help to tell the parameters that these readings do not tell, or tell badly; of an effect whose values
    belong together once."""
    readings = rows.readings
    poses = readings.poses.take(rows.plus)
    placed = model.names_of(Geometry) if readings.is_position[rows.keep].any() else set[str]()
    silent = [e.name for e in left if not e.correlated_with and e.name not in placed]
    badly = [e for e in estimates if e.state is EstimateState.NOT_IDENTIFIABLE and e.name in {*model.names} - placed]
    whole = {n: e.name for e, own in zip(model.effects, model.slices, strict=True) if e.whole for n in model.names[own]}
    said = (
        *(f"{whole.get(name, name)}: {what_would_help(model, name, poses)}" for name in silent),
        *(f"{whole.get(e.name, e.name)}: {e.state.value}; {what_would_help(model, e.name, poses)}." for e in badly),
    )
    return tuple(dict.fromkeys(said))


def _estimates(
    found: Found, solution: Solution, frames: Sequence[Frame], x: Array, sd: Array, unit: float
) -> tuple[Estimate, ...]:
    seen = found.seen
    values = np.concatenate([*(f.pose for f in frames), x[seen.model.index(seen.names)]])
    plain = np.sqrt(found.covariance.diagonal())
    grown = unit * np.divide(sd, plain * unit, out=np.ones(len(sd)), where=plain > 0.0)  # by the noise's directions
    free = solution.free_sd * grown
    weight, prior = (found.solved or seen.observations()).known
    weight = weight if found.solved else np.zeros(len(sd))
    before = np.full(len(sd), np.inf) if found.before is None else found.before
    out: list[Estimate] = []
    for i, p in enumerate(seen.parameters):
        own = float("nan") if p.name in solution.at_bound else float(sd[i])
        of_frame = i < seen.motions
        known = replace(p, nominal=float(prior[i]), sd=float(before[i])) if weight[i] else p
        told = replace(p, typical=1e100) if of_frame else known
        estimate = estimate_of(told, float(values[i]), own, float(free[i]), bool(weight[i]))
        state = EstimateState.NOT_IDENTIFIABLE if p.name in found.vague else estimate.state
        counted = 1.0 / float(weight[i]) if weight[i] else None
        out.append(replace(estimate, state=state, size=p.scale, counted_sd=counted))
    return tuple(out)


def _option_notes(options: FitOptions, solution: Solution) -> tuple[str, ...]:
    """What to say of how a fit was made."""
    said = ["Nothing counted as known before the readings."] if options.free else []
    if options.loss != "linear":
        light = int((solution.weights < 0.5).sum())
        said.append(f"Loss {options.loss}: {light} coordinates lost more than half their weight.")
    said += [f"Fixed: {', '.join(options.fixed)}."] if options.fixed else []
    said += [f"Tied, in the ratio of their nominal values: {', '.join(group)}." for group in options.tied]
    if solution.at_bound:
        said.append(f"At a bound: {', '.join(solution.at_bound)}; the other sds hold while it stays there.")
    return tuple(said)
