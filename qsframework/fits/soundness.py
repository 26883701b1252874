"""Whether a stored fit may be used: does it explain the readings that it names, under this robot and experiment?

One question with one answer for everything that uses a fit. Lack of fit alone refuses nothing: it widens what the fit
predicts (`FitRecord.widening`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from qsframework.errors import InputError, NotConverged, NotIdentifiable, Problem, refuse
from qsframework.experiment import Experiment, Readings, load_experiment, read_readings
from qsframework.experiment.account import UsedFile
from qsframework.experiment.description import changed_parts
from qsframework.experiment.observations import start_values
from qsframework.files import sha256
from qsframework.fits.findings import every_finding
from qsframework.fits.identify import fit_readings
from qsframework.fits.record import FitRecord
from qsframework.plugin import Array, Parameter
from qsframework.robot import Robot

_ROUNDING = 1e-9
_CORRELATION = 1e-6
"""Below zero by rounding: parameters that are hardly told apart have eigenvalues near zero."""
_NEAR = 0.05
"""sds by which an estimate may differ when it is fitted again."""
_UNCHECKED = "that the fit explains its readings was not checked: {}"
_ALTHOUGH = "the fit is used although "
_SAME = 0.02
"""Relative difference of sizes of errors, and of correlations, when a fit is made again."""


def check_robot(fit: FitRecord, robot: Robot) -> None:
    """InputError for the fit of a robot of another name."""
    if fit.robot != robot.name:
        words, hint = "the fit is of another robot", "Give the experiment of that robot, or identify this one."
        raise InputError(Problem(words, fit.path or None, found=fit.robot, allowed=robot.name, hint=hint))


def experiment_of(fit: FitRecord, robot: Robot) -> Experiment | None:
    """The experiment beside a fit's file that is described as the fit's was; None where there is none."""
    for path in sorted(Path(fit.path).parent.glob("*.yaml")) if fit.path else ():
        try:
            found = load_experiment(path)
        except InputError:
            continue
        if found.robot.name == robot.name and not any(changed_parts(fit.account.description, found.robot, found)):
            return found
    return None


def check_fit(
    fit: FitRecord,
    robot: Robot,
    experiment: Experiment | None = None,
    readings: Readings | None = None,
    *,
    anyway: bool | None = False,
) -> tuple[str, ...]:
    """What to note of a fit before it is used.

    Args:
        fit: a stored fit, or one that was just made.
        robot: that it is used for.
        experiment: that it is used in; without one only what the robot says is compared.
        readings: those at hand; else the files that the fit names are looked for, by their hashes.
        anyway: use the fit, and note why it should not be; None: there is no such way.

    Returns:
        Sentences to show beside the result.

    Raises:
        InputError with every reason why the fit is not to be used: something was found wrong in its readings or files,
        it is of another robot or description, its values are impossible or are not those that its readings give.
    """
    check_robot(fit, robot)
    wrong = list(_contradictions(fit, robot, experiment))
    notes: list[str] = []
    if not (wrong or fit.account.stopping) and experiment is not None:
        own, notes = own_readings(fit, experiment, readings)
        if isinstance(own, str):
            wrong.append(own)
        elif own is not None:
            wrong += _explains(fit, experiment, own)
    problems = [Problem(f"the fit is not to be trusted: {why}", fit.path or None) for why in wrong]
    if wrong and anyway is not None:
        hint = "Identify again, or diagnose its readings; it is used all the same only where that is asked for."
        problems[-1] = replace(problems[-1], hint=hint, argument=("anyway", ""))
    doubts = check_findings(fit, anyway=anyway, beside=problems)
    return (*doubts, *(f"{_ALTHOUGH}{why}" for why in wrong), *notes)


def check_account(fit: FitRecord, experiment: Experiment, *, anyway: bool) -> tuple[str, ...]:
    """What to note of a fit that other readings judge: what was found wrong in its own, and which parts of robot and
    campaign are described otherwise. InputError where a finding stops, unless `anyway`."""
    changed = _described(fit, experiment.robot, experiment)
    return (*check_findings(fit, anyway=anyway), *(f"{_ALTHOUGH}{why}" for why in changed))


def _described(fit: FitRecord, robot: Robot, experiment: Experiment | None) -> Iterator[str]:
    parts = changed_parts(fit.account.description, robot, experiment)
    return (f"the {part} are described otherwise now than when it was made" for part in parts)


def check_findings(fit: FitRecord, *, anyway: bool | None = False, beside: Sequence[Problem] = ()) -> tuple[str, ...]:
    """What was found wrong in a fit's readings and files, as notes.

    Raises InputError with every finding that stops and what to do, and the problems `beside` them, unless `anyway`;
    None: there is no such way.
    """
    if not anyway:
        option = None if anyway is None else ("anyway", "")
        lines = ((f"{f.title}: {f.words}", f.mend) for f in fit.account.stopping)
        refuse([*(Problem(words, fit.path or None, hint=mend, argument=option) for words, mend in lines), *beside])
    return tuple(f"{_ALTHOUGH * f.stops}{f.title}: {f.words}" for f in fit.account.findings)


def _contradictions(fit: FitRecord, robot: Robot, experiment: Experiment | None) -> Iterator[str]:
    """Why this fit is not to be used, as far as its own numbers and the descriptions of arm and campaign say.

    A value beyond its declared bound by no more than twice its sd is one that the readings do not tell from the bound.
    Where the residuals agree with a stated noise, an held-out error that is not below that of the values
    before says no more than that these were right already.
    """
    parameters = robot.parameters if experiment is None else experiment.model().parameters
    known = {p.name: p for p in parameters}
    yield from _described(fit, robot, experiment)
    if experiment is not None:
        yield from _other_parameters(fit, experiment)
    for name, now in _unfitted(fit, robot, experiment):
        if not np.isclose(fit.model_values[name], now, rtol=_ROUNDING, atol=0.0):
            p = known[name]
            yield f"{name} was {fit.model_values[name]:.6g} {p.unit} when it was made and is {now:.6g} {p.unit} now"
    for e in fit.estimates:
        p, held = known.get(e.name), fit.model_values.get(e.name, e.value)
        if p is not None:
            beyond = max(p.lower - e.value, e.value - p.upper, 0.0)
            if beyond > 2.0 * (e.sd if np.isfinite(e.sd) else 0.0):
                yield f"{e.name} is {e.value:.3g} {p.unit}".rstrip() + f", and no arm has it {_side(p, e.value)}"
        if not np.isclose(held, e.value, rtol=_ROUNDING, atol=0.0):
            yield f"{e.name} is {e.value:g} among the estimates and {held:g} in the model"
    for what, C in (("covariance", fit.covariance), ("covariance with the load's", fit.total_covariance)):
        if C is not None and not _is_covariance(C):
            yield f"its {what} is none: a variance would be below zero"
    if fit.held_out_error >= fit.held_out_nominal and not fit.agrees:
        before, after = (f"{1e3 * v:.3f} mm" for v in (fit.held_out_nominal, fit.held_out_error))
        yield f"its held-out error, {after}, is not below that of the values before, {before}"


def _other_parameters(fit: FitRecord, experiment: Experiment) -> Iterator[str]:
    """Where the model has other parameters than the fit."""
    model = experiment.model()
    optional = {p.name for p in model.parameters if p.by_name}
    other = sorted((set(fit.model_values) ^ set(model.names)) - (optional - set(fit.model_values)))
    if other:
        yield (
            f"it is of another model than {experiment.path.name}: only one has {', '.join(other[:6])}. Give the "
            "experiment that the fit was made with, with the same effects"
        )


def _unfitted(fit: FitRecord, robot: Robot, experiment: Experiment | None) -> Iterator[tuple[str, float]]:
    """What the model has now of parameters that were not estimated."""
    if experiment is None:
        rigid = ("rad/(N m)", "m/N") if fit.account.rigid else ()
        now = {p.name: p.nominal for p in robot.parameters if p.unit not in rigid}
    else:
        own = [n for n in fit.names if n in experiment.model().names]
        now = dict(zip(experiment.model().names, start_values(experiment, own).tolist(), strict=True))
    for name, value in now.items():
        if name in fit.model_values and name not in fit.names:
            yield name, value


def own_readings(
    fit: FitRecord, experiment: Experiment, given: Readings | None
) -> tuple[Readings | str | None, list[str]]:
    """The readings of a fit as it used them, why they are not the same any more, or None; and what to note."""
    files = fit.account.files
    if given is not None and fit.account.is_of(given):
        return fit.used(given), []
    if not files and fit.account.simulated:
        return None, [_UNCHECKED.format("they were simulated, and are in no file")] if fit.path else []
    if not files:
        return "it names no readings", []
    found = [_place(file, fit, experiment) for file in files]
    lost = [file.path for file, place in zip(files, found, strict=True) if place is None]
    changed = [str(p) for file, p in zip(files, found, strict=True) if p is not None and sha256(p) != file.sha256]
    if changed:
        return f"its readings have changed since: {', '.join(changed)}", []
    if lost:
        return None, [_UNCHECKED.format(f"{', '.join(lost)} is not here; put it beside the experiment")]
    try:
        states = "positions" if fit.account.positions else "differences"
        return fit.used(read_readings([p for p in found if p is not None], experiment, states)), []
    except InputError as error:
        return f"its readings cannot be read with this experiment: {error}", []


def _place(file: UsedFile, fit: FitRecord, experiment: Experiment) -> Path | None:
    """Where a file of readings is now: at its place, else where the same bytes are, else a file of its name."""
    folder, name = experiment.path.parent, Path(file.path).name
    if (folder / file.path).is_file():
        return folder / file.path
    beside = [Path(fit.path).parent / name] if fit.path else []
    places = [p for p in (folder / name, *beside, *experiment.data) if p.is_file()]
    same = [p for p in places if sha256(p) == file.sha256]
    return next(iter(same), next((p for p in places if p.name == name), None))


def _explains(fit: FitRecord, experiment: Experiment, readings: Readings) -> Iterator[str]:
    """Where the fit is not the one that its readings give when it is made again."""
    options = replace(fit.options, keep_all=True, profile=())
    try:
        campaign = experiment.with_(fit=fit.model_names(experiment))
        again = fit_readings(campaign, readings, options)
    except (InputError, NotConverged, NotIdentifiable) as error:
        yield f"its readings cannot be fitted so: {error}"
        return
    if again.names != fit.names:
        yield "its estimates stand in another order, or are others, than its readings give"
        return
    parameters = {p.name: p for p in experiment.model().parameters}
    for what in ("kinds", "frames", "tool"):
        said, found = (", ".join(getattr(f.account, what)) or "none" for f in (fit, again))
        if said != found:
            yield f"its account says {what}: {said}, and its readings say {found}"
    for e, own in zip(fit.estimates, again.estimates, strict=True):
        sd = own.sd if np.isfinite(own.sd) else 0.0
        if abs(e.value - own.value) > _NEAR * sd + 1e-6 * abs(own.value):
            unit = parameters[e.name].unit if e.name in parameters else ""
            yield f"{e.name} is {e.value:.6g} {unit}".rstrip() + f" in it, and its readings give {own.value:.6g}"
        elif e.state is not own.state:
            yield f"{e.name} is said to be {e.state.value!r} in it, and its readings say {own.state.value!r}"
        elif not _alike(e.sd, own.sd):
            yield f"the sd of {e.name} is {e.sd:.4g} in it, and its readings give {own.sd:.4g}"
    if not _alike(fit.sigma, again.sigma):
        yield f"its noise is {1e3 * fit.sigma:.4g} mm, and its readings have {1e3 * again.sigma:.4g} mm here"
    elif not _alike(fit.chi2, again.chi2) or fit.dof != again.dof:
        given = f"{again.chi2:.4g} on {again.dof}"
        yield f"its sum of squares is {fit.chi2:.4g} on {fit.dof} degrees of freedom, and its readings give {given}"
    for what, one, other in (
        ("covariance", fit.covariance, again.covariance),
        ("covariance with the load's", fit.whole_covariance, again.whole_covariance),
        (
            "account of what was held at nominal values",
            fit.covariance + fit.held_covariance,
            again.covariance + again.held_covariance,
        ),
    ):
        if not _same_covariance(one, other):
            yield f"its {what} is not the one that its readings give"
            break
    found = every_finding(replace(again, options=fit.options), campaign, readings)
    if {(f.name, f.rows, f.stops) for f in fit.account.findings} != {(f.name, f.rows, f.stops) for f in found}:
        yield "what was found wrong in its readings and files is not what is found there now"
    pairs = ((fit.held_out_error, again.held_out_error), (fit.held_out_worst, again.held_out_worst))
    for own, given in pairs if not fit.masked else ():
        if not _alike(own, given):
            yield f"its held-out error is {1e3 * own:.4g} mm, and its readings give {1e3 * given:.4g} mm"


def _alike(one: float, other: float) -> bool:
    return bool(np.isclose(one, other, rtol=_SAME, atol=1e-12, equal_nan=True))


def _same_covariance(one: Array, other: Array) -> bool:
    """Whether sds differ by little, and correlations too."""
    sd = np.sqrt(np.maximum(np.diag(other), 0.0))
    scale = np.where(sd > 0.0, sd, 1.0)
    return one.shape == other.shape and bool(np.abs((one - other) / np.outer(scale, scale)).max(initial=0.0) < _SAME)


def _is_covariance(C: Array) -> bool:
    """Whether no combination of parameters has a variance below zero; in units of the parameters' own sds, for they
    are of many sizes."""
    variances = np.diag(C)
    sd = np.sqrt(np.where(variances > 0.0, variances, 1.0))
    return bool(np.all(variances >= 0.0)) and bool(
        not len(C) or np.linalg.eigvalsh(C / np.outer(sd, sd))[0] > -_CORRELATION
    )


def _side(p: Parameter, value: float) -> str:
    return f"below {p.lower:g}" if value < p.lower else f"above {p.upper:g}"
