"""What a calibration certificate states: accuracy at readings held out, parameters and a budget with k = 2, conformity.

Accuracy and repeatability of poses as ISO 9283 defines them where readings repeat; uncertainties as the GUM combines
them; conformity by the rule that the holder of the certificate stated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from qsframework.diagnoses import Diagnosis, diagnose
from qsframework.errors import InputError, Problem, QsfError, some_of
from qsframework.experiment import Experiment, Frame, Readings, make_rows
from qsframework.experiment.before import errors_before
from qsframework.experiment.observations import ReadingRows
from qsframework.files import FileModel, Unit, read_yaml, validate as checked
from qsframework.fits import FitRecord, validate, validate_halves
from qsframework.fits.record import COVERAGE
from qsframework.fits.soundness import check_fit, own_readings
from qsframework.fits.validate import Validation, fitted_frames
from qsframework.plugin import Array
from qsframework.uses.levels import moving

HALVES = 10
_COMPLIANCES = ("rad/(N m)", "m/N")


class PartySpec(FileModel):
    """Who made the calibration, when and where."""

    number: str = ""
    customer: str = ""
    date: str = ""
    place: str = ""
    operator: str = ""
    approved_by: str = ""


class DeviceSpec(FileModel):
    """The robot, or the instrument with its own certificate; uncertainty: expanded, k = 2, of a point in space."""

    maker: str = ""
    type: str = ""
    serial_number: str = ""
    controller: str = ""
    certificate: str = ""
    valid_until: str = ""
    uncertainty: Annotated[float | None, Unit("m")] = None


class MetaSpec(FileModel):
    """meta.yaml: what no reading says. Everything may be left out, and is then left blank."""

    calibration: PartySpec = PartySpec()
    robot: DeviceSpec = DeviceSpec()
    instrument: DeviceSpec = DeviceSpec()
    temperature: str = ""
    load: str = ""
    remarks: str = ""
    tolerance: Annotated[float | None, Unit("m")] = None
    decision: Literal["guarded", "simple"] = "guarded"


@dataclass(frozen=True)
class Quantity:
    """A parameter of the fit: value and expanded uncertainty, SI, NaN where none is quoted; status: its state.
    stiffness: 1 / value and its expanded uncertainty, of a compliance that is told from zero; else None."""

    name: str
    unit: str
    value: float
    expanded: float
    status: str
    stiffness: tuple[float, float] | None


@dataclass(frozen=True)
class Share:
    """A source of the error of a predicted position: its standard uncertainty, m, of the distance in space.

    source: "parameters", "held", "load", "instrument", "repeatability" or "model"
    """

    source: str
    standard: float


@dataclass(frozen=True)
class Arrivals:
    """ISO 9283 at one pose and marker that was reached `count` times: accuracy AP before and after, repeatability RP,
    m."""

    pose: str
    count: int
    before: float
    after: float
    repeatability: float


@dataclass(frozen=True)
class Conformity:
    """Whether the 95 % error keeps a tolerance, m: True, False, or None where the uncertainty of the instrument leaves
    it open. rule "guarded": error + U below the tolerance proves, error - U above it disproves; "simple": the error
    alone decides. expanded: U of one reading along the error, NaN where nobody stated it."""

    tolerance: float
    rule: str
    error: float
    expanded: float
    holds: bool | None


@dataclass(frozen=True, eq=False, kw_only=True)
class Certificate:
    """All that stands on the certificate. kept: parameters that the model uses at nominal
    values of which nobody states an sd.

    temperature: lowest and highest that was recorded, K; None where none was
    """

    experiment: Experiment
    fit: FitRecord
    meta: MetaSpec
    validation: Validation
    quantities: tuple[Quantity, ...]
    budget: tuple[Share, ...]
    arrivals: tuple[Arrivals, ...]
    conformity: Conformity | None
    kept: tuple[str, ...]
    temperature: tuple[float, float] | None
    readings: int
    poses: int
    files: tuple[Path, ...]
    notes: tuple[str, ...] = ()

    @property
    def corrected(self) -> float:
        """Standard uncertainty, m, of a corrected position in space: all but the instrument."""
        return float(np.sqrt(sum(s.standard**2 for s in self.budget if s.source != "instrument")))


def read_meta(path: Path | None) -> MetaSpec:
    """meta.yaml, or nothing stated. InputError with all its problems, each with file and line."""
    return MetaSpec() if path is None else checked(read_yaml(path), MetaSpec)


def certify(
    experiment: Experiment,
    fit: FitRecord,
    readings: Readings,
    meta: MetaSpec,
    *,
    halves: int = HALVES,
    seed: int = 0,
    diagnosis: Diagnosis | None = None,
    anyway: bool = False,
) -> Certificate:
    """The certificate of a fit by readings: those that it has not seen, else by random halves of its own.

    diagnosis: of the fit's readings, where one was made; else they are diagnosed here. anyway: certify, and note it,
    while causes are named that the fit does not have.

    Raises InputError where the fit is not one that may be certified: not to be trusted (`soundness.check_fit`; a
    certificate knows no exception), no better than the values before at the readings held out, or, unless `anyway`,
    where other readings refute it or the diagnosis names what it does not have.
    """
    notes = check_fit(fit, experiment.robot, experiment, readings, anyway=None)
    notes += () if readings.made is None else ("the readings are simulated: no arm was measured",)
    looked = diagnosis or _looked(experiment, fit, readings)
    if isinstance(looked, str):
        notes += (looked,)
    else:
        notes += _causes(experiment, looked, anyway)
        fit = replace(fit, account=replace(fit.account, causes=looked.account.causes))
    found = validate(experiment, readings, fit)
    if found.seen:
        found = validate_halves(experiment, readings, fit, halves, seed)
    if not np.isfinite(found.whole.summary()[0]):
        raise InputError(f"{readings.where}: no reading has all three axes, and a certificate states errors in space")
    after, before = (float(np.sqrt(np.mean(found.whole.distances(b) ** 2))) for b in (False, True))
    if after >= before:
        raise InputError(
            f"{fit.path}: no certificate: the error at readings held out, {1e3 * after:.3f} mm, is not below that of "
            f"the values before, {1e3 * before:.3f} mm. Diagnose the readings first: `qsf diagnose {experiment.path}`"
        )
    if found.refuted:
        own = f"held-out poses of the fit's own by {1e3 * found.own_error:.3f} mm"
        said = f"these readings are missed by {1e3 * after:.3f} mm, {own}"
        hint = f"Identify these readings, and compare that fit with {fit.path}: it says what moved."
        notes += _although(said, hint, readings.where, anyway)
    rows = make_rows(readings)
    budget = _budget(experiment, fit, meta, rows, found)
    counted = {*fit.names, *(h.name for h in fit.held if h.sd >= 0.0)}
    temperature = rows.readings.poses.loaded.temperature
    told = None if temperature is None else temperature[np.isfinite(temperature)]
    return Certificate(
        experiment=experiment,
        fit=fit,
        meta=meta,
        validation=found,
        quantities=_quantities(experiment, fit),
        budget=budget,
        arrivals=_arrivals(experiment, fit, rows),
        conformity=_conformity(meta, found, budget),
        kept=tuple(p.name for p in experiment.model().parameters if p.nominal and p.name not in counted),
        temperature=None if told is None or not len(told) else (float(told.min()), float(told.max())),
        readings=len(rows.keep),
        poses=len(np.unique(rows.pose)),
        files=(experiment.path, Path(fit.path), *readings.sources),
        notes=notes,
    )


def _although(said: str, hint: str, where: str, anyway: bool) -> tuple[str, ...]:
    """The note that it is certified all the same. InputError unless `anyway`."""
    if not anyway:
        raise InputError(Problem(f"no certificate: {said}", where, hint=hint, argument=("anyway", "")))
    return (f"certified although {said}",)


def _looked(experiment: Experiment, fit: FitRecord, readings: Readings) -> Diagnosis | str:
    """A diagnosis of the fit's own readings, of those at hand where these are not there; or why there is none."""
    own, _ = own_readings(fit, experiment, readings)
    try:
        given = own if isinstance(own, Readings) else readings
        return diagnose(experiment.with_(fit=fit.model_names(experiment)), given)
    except QsfError as error:
        return f"whether a cause that the model does not have acts is not known: {error}"


def _causes(experiment: Experiment, found: Diagnosis, anyway: bool) -> tuple[str, ...]:
    """What to note of a diagnosis. InputError where it names a cause or a mistake that the fit does not have, unless
    `anyway`."""
    if found.account.causes:
        said = f"the readings name what the fit does not have, {some_of(found.account.causes)}"
        hint = f"Let `qsf diagnose {experiment.path}` write the extended robot, then identify and certify that."
        return _although(said, hint, found.readings.where, anyway)
    notes = [f"the readings hint at {f.name}, which the model does not have" for f in found.findings]
    if found.learned is not None and found.learned.holds:
        before, after = (f"{1e3 * found.rms.in_space(e):.3f} mm" for e in (found.learned.before, found.learned.heldout))
        notes.append(
            f"an unexplained effect remains; with an empirical correction, the held-out "
            f"error (3D RMS) is {after} instead of {before}"
        )
    elif found.leftovers:
        notes.append("the readings hint at an unexplained effect")
    return tuple(notes)


def _quantities(experiment: Experiment, fit: FitRecord) -> tuple[Quantity, ...]:
    units = {p.name: p.unit for p in experiment.model().parameters}
    out: list[Quantity] = []
    for e, sd in zip(fit.estimates, fit.sd_total, strict=True):
        if e.name not in units:
            continue
        unit = units[e.name]
        expanded = fit.coverage * sd if np.isfinite(e.sd) else float("nan")
        told = unit in _COMPLIANCES and e.value > expanded > 0.0
        stiffness = (1.0 / e.value, expanded / e.value**2) if told else None
        out.append(Quantity(e.name, unit, e.value, expanded, e.state.value, stiffness))
    return tuple(out)


def _budget(
    experiment: Experiment, fit: FitRecord, meta: MetaSpec, rows: ReadingRows, found: Validation
) -> tuple[Share, ...]:
    """Standard uncertainties of the distance in space, over the readings: u^2 = tr(J C J') of what the fit says, its
    frames included, of what it held at nominal values, and what the held-out error has beyond all of them."""
    model = experiment.model()
    x, names = fit.x_of(model), fit.model_names(experiment)
    _, J = rows.rates(model, x, fitted_frames(fit, rows, model, x), [*names, *(h.name for h in fit.held)], fit.linear)
    J = np.where(rows.mask[..., None], J, 0.0)
    slope = np.zeros((*J.shape[:2], len(fit.names)))
    frames = [Frame(rows.readings.frames[f], np.eye(3), np.zeros(3)) for f in rows.estimated]
    work = moving(experiment, fit)
    for k, name in enumerate([*(p.name for frame in frames for p in frame.parameters()), *names]):
        if name in work:
            slope[..., fit.names.index(name)] = J[..., k]

    def standard(C: Array) -> float:
        return float(np.sqrt(max(float(np.einsum("rap,pq,raq->r", slope, np.nan_to_num(C), slope).mean()), 0.0)))

    shares = [Share("parameters", standard(fit.covariance))]
    if fit.held_moments.any():
        acts = [name != "" for name in work[len(fit.names) :]]
        wrong = slope @ fit.held_moved - J[..., J.shape[-1] - len(fit.held) :] * acts
        by_held = np.einsum("rah,hk,rak->r", wrong, fit.held_moments, wrong)
        shares.append(Share("held", float(np.sqrt(by_held.mean()))))
    if fit.total_covariance is not None:
        shares.append(Share("load", standard(fit.total_covariance - fit.covariance)))
    if rows.readings.repeatability:
        shares.append(Share("repeatability", float(np.sqrt(3.0)) * rows.readings.repeatability))
    # the instrument's part of one reading is what somebody stated: residuals hold more than the instrument
    if meta.instrument.uncertainty is not None:
        points = 2.0 - float(rows.readings.is_position[rows.keep].mean())  # a displacement is between two
        shares.append(Share("instrument", meta.instrument.uncertainty / COVERAGE * float(np.sqrt(points))))
    elif rows.readings.stated:
        mean_square = (np.where(rows.mask, rows.sigma, 0.0) ** 2).sum(axis=1).mean()
        shares.append(Share("instrument", float(np.sqrt(mean_square))))
    # the model's part is what the held-out error has beyond the others; 0 where that is within what chance makes of it
    squares = {s.source: s.standard**2 for s in shares}
    of_fit = squares["parameters"] * (2.0 if found.halves else 1.0)  # a fit to half of the readings has twice as much
    error = float(np.mean(found.whole.distances() ** 2))
    rest = error - sum(squares.values()) + squares["parameters"] - of_fit
    chance = np.hypot(error * np.sqrt(2.0 / len(rows.at)), of_fit * np.sqrt(2.0 / len(fit.names)))
    return (*shares, Share("model", float(np.sqrt(rest)) if rest > COVERAGE * chance else 0.0))


def _arrivals(experiment: Experiment, fit: FitRecord, rows: ReadingRows) -> tuple[Arrivals, ...]:
    """AP = |mean error|, RP = mean + 3 sd of the distances from the centre (ISO 9283, 7.2.1 and 7.2.2), where a marker
    was read at one pose and load several times."""
    readings = rows.readings
    position = readings.is_position[rows.keep] & np.isfinite(rows.measured).all(axis=1)
    poses = readings.poses
    key = np.column_stack([poses.q[rows.plus], poses.wrench[rows.plus], rows.marker, rows.frame])
    _, group = np.unique(np.round(key, 9), axis=0, return_inverse=True)
    again = [g for g, count in enumerate(np.bincount(group[position])) if count > 1]
    if not again:
        return ()
    model = experiment.model()
    x = fit.x_of(model)
    after = rows.measured - rows.predict(model, x, fitted_frames(fit, rows, model, x), fit.linear)
    errors = errors_before(experiment, rows, fit.model_names(experiment), fit.linear, fit.account.hashes), after
    out: list[Arrivals] = []
    for g in again:
        at = np.flatnonzero(position & (group == g))
        spread = np.linalg.norm(rows.measured[at] - rows.measured[at].mean(axis=0), axis=1)
        before, after = (float(np.linalg.norm(e[at].mean(axis=0))) for e in errors)
        repeated = float(spread.mean() + 3.0 * spread.std(ddof=1))
        out.append(Arrivals(rows.pose_names[int(at[0])], len(at), before, after, repeated))
    return tuple(out)


def _conformity(meta: MetaSpec, found: Validation, budget: Sequence[Share]) -> Conformity | None:
    if meta.tolerance is None:
        return None
    error = found.whole.summary()[2]
    instrument = next((s.standard for s in budget if s.source == "instrument"), float("nan"))
    expanded = COVERAGE * instrument / float(np.sqrt(3.0))
    holds: bool | None = error <= meta.tolerance
    if meta.decision == "guarded":
        holds = True if error + expanded <= meta.tolerance else False if error - expanded > meta.tolerance else None
    return Conformity(meta.tolerance, meta.decision, error, expanded, holds)
