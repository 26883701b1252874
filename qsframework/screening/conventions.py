"""Conventions that may be wrong: controller angles, axes, signs, units, order of rows. Each is applied and refitted.

A deterministic check before any physics is suspected: a wrong convention is not small, and no spring mends it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.errors import InputError, NotIdentifiable
from qsframework.estimation import left, rms, scales
from qsframework.experiment import Experiment, Readings, bridge
from qsframework.plugin import Array, Indices, Spring
from qsframework.screening.convention_changes import (
    Change,
    couplings,
    displacement_axes,
    earlier,
    force_axes,
    joint_signs,
    structures,
)
from qsframework.screening.linearized_fit import LinearizedFit, of_bridge, other_loads
from qsframework.screening.logging_faults import exchanges, late_angles

LEVEL = 1e-4
"""The likelihood ratio, all conventions counted, beyond which one may be compelling."""
RATIO = 0.8
"""How far the sum of squares must fall at least; a hidden effect makes smaller differences."""
LOCAL = 0.25
"""The same for the rows that a change touches: physics at some poses is not undone by exchanging their readings."""
_BELOW = 2.0
"""sds below its bound from which a compliance speaks against a convention."""
_UNITS = (
    (9.80665, "the load is in kg (or kgf) where the file says N"),
    (4.4482216, "the load is in lbf where the file says N"),
    (1e3, "the load is in kN where the file says N, or the displacements in um where it says mm"),
    (1e-3, "the displacements are in m where the file says mm, or the load in N where it says kN"),
    (1.0 / 25.4, "the displacements are in inches where the file says mm"),
)
"""Factor of the compliances as fitted, which is (true load) / (load of the file), and what it stands for."""
_NEAR = 0.25
"""How near, in log, the common factor of the compliances must be to that of a unit."""
_NO_FURTHER = 2.0
"""How much larger the residuals of a linear fit may be where exact fits may turn out the other way."""
_FAR = 3.0
"""How many times further from the nominal arm than as given positions are beyond any fit: derivatives cost more."""
_APART = 0.5
"""How far, in log, the compliances may scatter about their common factor."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Convention:
    """Another reading of the file or of the controller, applied and refitted.

    name: the parameter of a joint's shown angle, `joint_sign[joint_2]`, `displacement_axes`, `displacement_sign`,
    `force_axes`, `load_unit`, `swapped_markers` or `late_angles`, or a structure, such as `loop absent:
    parallelogram[joint_3]`; value: what a coupling is fixed at, the factor
    of a unit, else 1; experiment, readings: with the convention applied; rms, rms_given: m, of the fits with it
    and as given; evidence: log of how much likelier it makes the readings, the number of conventions tried
    counted; below: compliances that the fit puts below their bounds; structure: whether the
    arm itself is another one. Only a compelling one is to be believed; a
    `load_unit` never is, because the compliances absorb it.
    """

    name: str
    value: float
    words: str
    experiment: Experiment
    readings: Readings
    rms: float
    rms_given: float
    evidence: float
    below: int
    compelling: bool
    structure: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class _Fit:
    """Linear least squares: whitened residuals `left` (m,) and their sum of squares, rms in m, estimates and sds (p,)
    of the named parameters in their scales, degrees of freedom."""

    square: float
    left: Array
    rms: float
    x: Array
    sd: Array
    dof: int
    below: int
    trial: LinearizedFit


def check_conventions(experiment: Experiment, readings: Readings) -> tuple[Convention, ...]:
    """The conventions under which the readings fit better than as given, the likeliest first; none is the rule.

    Where one is compelling, the next best only goes along, and is not compelling any more: axes that are nearly those
    of the right sign fit better than as given, too.
    """
    given = _fit(_first(experiment, readings))
    changes = [
        *couplings(experiment, readings),
        *joint_signs(experiment, readings),
        *displacement_axes(experiment, readings),
        *force_axes(experiment, readings),
    ]
    judged = [_judge(change, given, len(changes)) for change in changes]
    judged += [_judge(*mistake) for mistake in _mistakes(given)]
    found = [c for c in judged if c is not None]
    better = sorted((c for c in found if c.evidence > 0.0), key=lambda c: (not c.compelling, -c.evidence))
    if better and better[0].compelling:
        better = [better[0], *(replace(c, compelling=False) for c in better[1:2])]
    return (*better, *_units(given))


def check_structures(experiment: Experiment, readings: Readings) -> tuple[Change, ...]:
    """The structures of the arm that may fit the readings better than that of its file: no further from them by a
    linear fit, and with no compliance below its bound that is not so in the file's own. Exact fits compare them."""
    given = _fit(_first(experiment, readings))
    return tuple(change for change in structures(experiment, readings) if _may_fit(change, given))


def _may_fit(change: Change, given: _Fit) -> bool:
    try:
        trial = _trial(change.experiment, change.readings, given.trial)
    except (InputError, NotIdentifiable):
        return False
    if trial is None:
        return False
    fit = _fit(trial)
    return fit.rms < _NO_FURTHER * given.rms and fit.below <= given.below


def _judge(change: Change, given: _Fit, tried: int, rows: Indices | None = None) -> Convention | None:
    """Apply a change and compare; `rows` of the file are those that it touches, None for all. None where it cannot be
    applied: angles beyond the arm's, readings that then hold no frame."""
    try:
        trial = _trial(change.experiment, change.readings, given.trial)
    except (InputError, NotIdentifiable):
        return None
    if trial is None:
        return None
    fit = _fit(trial)
    drop = np.log(max(given.square, 1e-300)) - np.log(max(fit.square, 1e-300))
    drop -= np.log(given.dof / fit.dof)  # late angles leave a measurement out
    evidence = 0.5 * min(fit.dof, given.dof) * float(drop) - float(np.log(tried))
    enough = drop > -np.log(RATIO) and (rows is None or _local(given, fit, rows) < LOCAL)
    compelling = evidence > -np.log(LEVEL) and enough and fit.below <= given.below
    return Convention(
        name=change.name,
        value=change.value,
        words=fits_better(change, fit.rms, given.rms),
        experiment=change.experiment,
        readings=change.readings,
        rms=fit.rms,
        rms_given=given.rms,
        evidence=evidence,
        below=fit.below,
        compelling=bool(compelling),
    )


def fits_better(change: Change, rms: float, given: float) -> str:
    """What a change is, and what the fits leave with it and as given, m."""
    return f"{change.words}: the readings then fit to {rms * 1e3:.3f} mm a coordinate, as given to {given * 1e3:.3f} mm"


def _local(given: _Fit, fit: _Fit, rows: Indices) -> float:
    """What a change leaves of the sum of squares of the rows that it touches."""
    both = np.intersect1d(np.intersect1d(given.trial.keep, fit.trial.keep), rows)

    def square(f: _Fit) -> float:
        return float(np.sum(f.left[np.isin(f.trial.keep[f.trial.row], both)] ** 2))

    return square(fit) / max(square(given), 1e-300)


def _first(experiment: Experiment, readings: Readings) -> LinearizedFit:
    """Columns of frames and fitted parameters, and the readings less what the nominal values give."""
    return of_bridge(experiment, bridge(experiment, readings, experiment.fit_names(), linear=True))


def _trial(experiment: Experiment, readings: Readings, given: LinearizedFit) -> LinearizedFit | None:
    """The same of changed readings; None where they lie so far from the nominal arm that no fit makes up for it.

    given: the readings as they are, whose columns stay where only values change and no frame is to be found
    """
    before = given.readings
    kept = experiment is given.experiment and readings.use is before.use
    if kept and readings.states is before.states and not _moved(given, readings):
        rows = replace(given.rows, readings=readings)
        return replace(given, rows=rows, errors=given.errors + rows.scalars - given.rows.scalars)
    seen = bridge(experiment, readings, experiment.fit_names(), linear=True)
    if seen.rows.estimated:
        errors = seen.rows.scalars - seen.rows.flat(seen.rows.predict(seen.model, seen.x, seen.frames, linear=True))
        if rms(errors) > _FAR * rms(given.errors):
            return None
    if kept and np.array_equal(readings.poses.q, before.poses.q):
        return other_loads(given, seen)
    return of_bridge(experiment, seen)


def _moved(given: LinearizedFit, readings: Readings) -> bool:
    """Whether readings in a frame that is to be found are others than before: then the frame is, too."""
    changed = np.any(given.rows.measured != readings.value[given.keep], axis=1, where=given.rows.mask)
    return bool(np.isin(given.rows.frame[changed], given.rows.estimated).any())


def _fit(trial: LinearizedFit) -> _Fit:
    """The fitted parameters by linear least squares about their nominal values; what is not told stays there.

    Within their bounds: with the sign of all displacements reversed springs fit as well, but with negative compliances.
    """
    model, names = trial.experiment.model(), trial.experiment.fit_names()
    chosen = [model.parameters[i] for i in model.index(names)]
    size = scales(chosen)
    motions = trial.A.shape[1] - len(chosen)
    frames = np.linalg.qr(trial.A[:, :motions])[0]
    A, target = left(frames, trial.A[:, motions:]), left(frames, trial.target)
    U, values, V = np.linalg.svd(A, full_matrices=False)
    told = values > 1e-9 * values[0]
    U, values, V = U[:, told], values[told], V[told]
    z = U.T @ target
    start = np.array([p.nominal for p in chosen]) / size
    low, high = (np.array([getattr(p, end) for p in chosen]) / size - start for end in ("lower", "upper"))
    free = V.T @ (z / values)
    kept = _within(values[:, None] * V, z, free, low, high)
    rest = target - U @ (values * (V @ kept))
    square, dof = float(rest @ rest), len(target) - int(told.sum()) - motions
    sd = np.sqrt(np.square(V.T / values).sum(axis=1) * (target @ target - z @ z) / dof)
    below = int((~np.isclose(sd, 0.0) & (free < low - _BELOW * sd)).sum())
    rms = float(np.sqrt(np.mean(np.square(trial.noise.colour(rest)))))
    return _Fit(square=square, left=rest, rms=rms, x=start + free, sd=sd, dof=dof, below=below, trial=trial)


def _within(R: Array, z: Array, free: Array, low: Array, high: Array) -> Array:
    """Least squares |R d - z| with low <= d <= high; `free` is the solution without the bounds."""
    from scipy.optimize import lsq_linear

    if np.all((free >= low) & (free <= high)):
        return free
    wide = np.where(high > low, high, low + 1e-12)
    return np.asarray(lsq_linear(R, z, (low, wide), method="bvls").x)


def _mistakes(given: _Fit) -> list[tuple[Change, _Fit, int, Indices]]:
    """Exchanged markers and late angles, with the number of alternatives that they were among and their rows."""
    trial = replace(given.trial, stated=False)  # a hidden effect must not look like a mistake
    readings, experiment = trial.readings, trial.experiment
    out: list[tuple[Change, _Fit, int, Indices]] = []
    swapped = exchanges(trial, LEVEL)
    if swapped:
        value = np.array(readings.value)
        touched = np.unique(np.concatenate([order for order, _ in swapped]))
        for order, _ in swapped:
            value[order[:, 0]] = readings.value[order[:, 1]]
        words = "; ".join(words for _, words in swapped)
        change = Change("swapped_markers", 1.0, words, experiment, replace(readings, value=value))
        out.append((change, given, 3 * len(readings.states), touched))
    for rows, words in late_angles(trial, LEVEL)[:1]:
        change = Change("late_angles", 1.0, words, experiment, earlier(trial, rows))
        out.append((change, given, len(readings.states), rows))
    return out


def _units(given: _Fit) -> list[Convention]:
    """A unit that all compliances absorb: they are off their nominal values by one factor, and it is a unit's."""
    trial = given.trial
    model, names = trial.experiment.model(), trial.experiment.fit_names()
    springs = {p.name for e in model.effects if isinstance(e, Spring) for p in e.parameters(model.facts)}
    nominal = np.array([model.parameters[i].nominal for i in model.index(names)])
    told = np.array([n in springs for n in names]) & (nominal > 0.0) & (given.x > 3.0 * given.sd)
    if told.sum() < 2:
        return []
    ratio = np.log(given.x[told] * scales([model.parameters[i] for i in model.index(names)])[told] / nominal[told])
    common = float(np.median(ratio))
    if np.median(np.abs(ratio - common)) > _APART:
        return []
    out: list[Convention] = []
    for factor, meaning in _UNITS:
        if abs(common - np.log(factor)) > _NEAR:
            continue
        poses = replace(trial.readings.poses, wrench=trial.readings.poses.wrench * factor)
        words = (
            f"all compliances come out about {np.exp(common):.3g} times their nominal values: perhaps {meaning} "
            f"(a factor of {factor:.4g}); the fit absorbs it, so it cannot be proved from these readings"
        )
        out.append(
            Convention(
                name="load_unit",
                value=factor,
                words=words,
                experiment=trial.experiment,
                readings=trial.readings.with_poses(poses),
                rms=given.rms,
                rms_given=given.rms,
                evidence=0.0,
                below=given.below,
                compelling=False,
            )
        )
    return out


def compelling(found: Sequence[Convention]) -> Convention | None:
    """The likeliest convention that is beyond doubt, None where the readings are right as given."""
    return next((c for c in found if c.compelling), None)
