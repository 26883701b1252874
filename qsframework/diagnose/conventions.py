"""Conventions that may be wrong: controller angles, axes, signs, units, order of rows. Each is applied and refitted.

A deterministic check before any physics is suspected: a wrong convention is not small, and no spring mends it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.diagnose.changes import Change, couplings, displacement_axes, earlier, force_axes, joint_signs
from qsframework.experiment import Experiment, Readings
from qsframework.identify.linear import fit_rows
from qsframework.identify.mistakes import exchanges, late_angles
from qsframework.identify.trial import Trial
from qsframework.information import scales
from qsframework.plugin import Array, Indices, Spring

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
_APART = 0.5
"""How far, in log, the compliances may scatter about their common factor."""


@dataclass(frozen=True, eq=False)
class Convention:
    """Another reading of the file or of the controller, applied and refitted.

    name: `controller_coupling[joint_3]`, `joint_sign[joint_2]`, `displacement_axes`, `displacement_sign`,
    `force_axes`, `load_unit`, `swapped_markers` or `late_angles`; value: what a coupling is fixed at, the factor
    of a unit, else 1; experiment, readings: with the convention applied; rms, rms_given: m, of the fits with it
    and as given; evidence: log of how much likelier it makes the readings, the number of conventions tried
    counted; below: compliances that the fit puts below their bounds. Only a compelling one is to be believed; a
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


@dataclass(frozen=True, eq=False)
class _Fit:
    """Linear least squares: whitened residuals `left` (R, 3) and their sum of squares, rms in m, estimates and sds (p,)
    in their scales, degrees of freedom."""

    square: float
    left: Array
    rms: float
    x: Array
    sd: Array
    dof: int
    below: int
    trial: Trial


def check_conventions(experiment: Experiment, readings: Readings) -> tuple[Convention, ...]:
    """The conventions under which the readings fit better than as given, the likeliest first; none is the rule.

    Where one is compelling, the next best only goes along, and is not compelling any more: axes that are nearly those
    of the right sign fit better than as given, too.
    """
    given = _fit(_trial(experiment, readings))
    changes = [*couplings(experiment, readings), *joint_signs(experiment, readings),
               *displacement_axes(experiment, readings), *force_axes(experiment, readings)]  # fmt: skip
    found = [_judge(change, given, len(changes)) for change in changes]
    found += [_judge(*mistake) for mistake in _mistakes(given)]
    better = sorted((c for c in found if c.evidence > 0.0), key=lambda c: (not c.compelling, -c.evidence))
    if better and better[0].compelling:
        better = [better[0], *(replace(c, compelling=False) for c in better[1:2])]
    return (*better, *_units(given))


def _judge(change: Change, given: _Fit, tried: int, rows: Indices | None = None) -> Convention:
    """Apply a change and compare; `rows` of the file are those that it touches, None for all."""
    fit = _fit(_trial(change.experiment, change.readings, given.trial))
    drop = np.log(max(given.square, 1e-300)) - np.log(max(fit.square, 1e-300))
    drop -= np.log(given.dof / fit.dof)  # late angles leave a measurement out
    evidence = 0.5 * min(fit.dof, given.dof) * float(drop) - float(np.log(tried))
    enough = drop > -np.log(RATIO) and (rows is None or _local(given, fit, rows) < LOCAL)
    compelling = evidence > -np.log(LEVEL) and enough and fit.below <= given.below
    words = (
        f"{change.words}: the readings then fit to {fit.rms * 1e3:.3f} mm a coordinate, as given to "
        f"{given.rms * 1e3:.3f} mm"
    )
    return Convention(change.name, change.value, words, change.experiment, change.readings, fit.rms, given.rms,
                      evidence, fit.below, bool(compelling))  # fmt: skip


def _local(given: _Fit, fit: _Fit, rows: Indices) -> float:
    """What a change leaves of the sum of squares of the rows that it touches."""
    both = np.intersect1d(np.intersect1d(given.trial.keep, fit.trial.keep), rows)
    after, before = (float(np.sum(f.left[np.isin(f.trial.keep, both)] ** 2)) for f in (fit, given))
    return after / max(before, 1e-300)


def _trial(experiment: Experiment, readings: Readings, given: Trial | None = None) -> Trial:
    """Columns of the fitted parameters, and the readings less what the nominal values give.

    given: the readings as they are, whose columns stay where only displacements change
    """
    if given is not None and readings.use is given.readings.use:
        keep, sigma, stated = given.keep, given.sigma, given.stated
        if experiment is given.experiment and readings.poses is given.readings.poses:
            moved = (readings.displacement - given.readings.displacement)[keep]
            return replace(given, readings=readings, errors=given.errors + moved)
        noise = given.noise
    else:
        rows, source = fit_rows(experiment, readings, len(experiment.fit_names()))
        keep, sigma, stated, noise = rows.keep, rows.sigma, source == "stated", rows.noise
    model, names = experiment.model(), experiment.fit_names()
    at = readings.measurement[keep], readings.marker[keep]
    size = scales([model.parameters[i] for i in model.index(names)])
    slopes = model.sensitivity(readings.poses, model.nominal, names)[at] * size
    errors = readings.displacement[keep] - model.predict(readings.poses)[at]
    return Trial(experiment, readings, keep, sigma, stated, slopes, errors, noise)


def _fit(trial: Trial) -> _Fit:
    """The fitted parameters by linear least squares about their nominal values; what is not told stays there.

    Within their bounds: with the sign of all displacements reversed springs fit as well, but with negative compliances.
    """
    model, A, target = trial.experiment.model(), trial.A, trial.target
    chosen = [model.parameters[i] for i in model.index(trial.experiment.fit_names())]
    size = scales(chosen)
    U, values, V = np.linalg.svd(A.reshape(-1, len(chosen)), full_matrices=False)
    told = values > 1e-9 * values[0]
    U, values, V = U[:, told], values[told], V[told]
    z = U.T @ target.ravel()
    start = np.array([p.nominal for p in chosen]) / size
    low, high = (np.array([getattr(p, end) for p in chosen]) / size - start for end in ("lower", "upper"))
    free = V.T @ (z / values)
    kept = _within(values[:, None] * V, z, free, low, high)
    left = (target.ravel() - U @ (values * (V @ kept))).reshape(target.shape)
    square, dof = float(np.square(left).sum()), target.size - int(told.sum())
    sd = np.sqrt(np.square(V.T / values).sum(axis=1) * (np.square(target).sum() - z @ z) / dof)
    below = int((~np.isclose(sd, 0.0) & (free < low - _BELOW * sd)).sum())
    rms = float(np.sqrt(np.mean(np.square(trial.noise.colour(left.ravel())))))
    return _Fit(square, left, rms, start + free, sd, dof, below, trial)


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
    if np.linalg.matrix_rank(trial.A.reshape(-1, trial.A.shape[-1])) < trial.A.shape[-1]:
        return out
    swapped = exchanges(trial, LEVEL)
    if swapped:
        displacement = np.array(readings.displacement)
        touched = np.unique(np.concatenate([order for order, _ in swapped]))
        for order, _ in swapped:
            displacement[order[:, 0]] = readings.displacement[order[:, 1]]
        words = "; ".join(words for _, words in swapped)
        change = Change("swapped_markers", 1.0, words, experiment, replace(readings, displacement=displacement))
        out.append((change, given, 3 * len(readings.poses), touched))
    for rows, words in late_angles(trial, LEVEL)[:1]:
        change = Change("late_angles", 1.0, words, experiment, earlier(readings, rows))
        out.append((change, given, len(readings.poses), rows))
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
        out.append(Convention("load_unit", factor, words, trial.experiment, replace(trial.readings, poses=poses),
                              given.rms, given.rms, 0.0, given.below, False))  # fmt: skip
    return out


def compelling(found: Sequence[Convention]) -> Convention | None:
    """The likeliest convention that is beyond doubt, None where the readings are right as given."""
    return next((c for c in found if c.compelling), None)
