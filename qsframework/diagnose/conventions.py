"""Conventions that may be wrong: controller angles, axes, signs, units, order of rows. Each is applied and refitted.

A deterministic check before any physics is suspected: a wrong convention is not small, and no spring mends it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np

from qsframework.experiment import Experiment, Readings
from qsframework.identify.linear import fit_rows
from qsframework.identify.mistakes import late_angles, swapped_markers
from qsframework.identify.trial import Trial
from qsframework.information import scales
from qsframework.plugin import Array, Indices, Poses, Spring, registry

LEVEL = 1e-4
"""The likelihood ratio, all conventions counted, beyond which one may be compelling."""
RATIO = 0.8
"""How far the sum of squares must fall at least; a hidden effect makes smaller differences."""
_BELOW = 2.0
"""sds below its bound from which a compliance speaks against a convention."""
_UNITS = (
    (9.80665, "the load is in kg (or kgf) where the file says N"), (1e3, "the load is in kN where the file says N"),
    (4.4482216, "the load is in lbf where the file says N"),
    (1e-3, "the displacements are in um where the file says mm"),
    (25.4, "the displacements are in inches where the file says mm"),
    (1e3, "the displacements are in m where the file says mm"),
)  # fmt: skip
"""Factor of (true load) / (load of the file), or of displacements, and what it stands for."""
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
class _Change:
    """A convention before it is judged."""

    name: str
    value: float
    words: str
    experiment: Experiment
    readings: Readings


@dataclass(frozen=True, eq=False)
class _Fit:
    """Linear least squares: weighted sum of squares, rms in m, estimates and sds (p,) in their scales, numbers free."""

    square: float
    rms: float
    x: Array
    sd: Array
    dof: int
    below: int
    trial: Trial


def check_conventions(experiment: Experiment, readings: Readings) -> tuple[Convention, ...]:
    """The conventions under which the readings fit better than as given, the likeliest first; none is the rule."""
    given = _fit(_trial(experiment, readings))
    changes = [*_couplings(experiment, readings), *_joint_signs(experiment, readings),
               *_displacement_axes(experiment, readings), *_force_axes(experiment, readings)]  # fmt: skip
    found = [_judge(change, given, len(changes)) for change in changes]
    found += [_judge(change, given, count) for change, count in _mistakes(given)]
    better = sorted((c for c in found if c.evidence > 0.0), key=lambda c: (not c.compelling, -c.evidence))
    return (*better, *_units(given))


def _judge(change: _Change, given: _Fit, tried: int) -> Convention:
    fit = _fit(_trial(change.experiment, change.readings, given.trial))
    drop = np.log(max(given.square, 1e-300)) - np.log(max(fit.square, 1e-300))
    # late angles leave a measurement out: compare per number, on the numbers that both have
    drop -= np.log(given.dof / fit.dof)
    evidence = 0.5 * min(fit.dof, given.dof) * float(drop) - float(np.log(tried))
    whole = change.name not in ("swapped_markers", "late_angles")
    enough = not whole or drop > -np.log(RATIO)
    compelling = evidence > -np.log(LEVEL) and enough and fit.below <= given.below
    words = f"{change.words}: the readings then fit to {fit.rms * 1e3:.3f} mm a coordinate, as given to " \
            f"{given.rms * 1e3:.3f} mm"  # fmt: skip
    return Convention(change.name, change.value, words, change.experiment, change.readings, fit.rms, given.rms,
                      evidence, fit.below, bool(compelling))  # fmt: skip


def _trial(experiment: Experiment, readings: Readings, given: Trial | None = None) -> Trial:
    """Whitened columns of the fitted parameters, and the readings less what the nominal values give.

    given: the readings as they are, whose columns stay where only displacements change
    """
    if given is not None and readings.use is given.readings.use:
        keep, sigma, stated = given.keep, given.sigma, given.stated
        if experiment is given.experiment and readings.poses is given.readings.poses:
            moved = (readings.displacement - given.readings.displacement)[keep] / sigma[:, None]
            return replace(given, readings=readings, target=given.target + moved)
    else:
        rows, source = fit_rows(experiment, readings, len(experiment.fit_names()))
        keep, sigma, stated = rows.keep, rows.sigma, source == "stated"
    model, names = experiment.model(), experiment.fit_names()
    at = readings.measurement[keep], readings.marker[keep]
    size = scales([model.parameters[i] for i in model.index(names)])
    A = model.sensitivity(readings.poses, model.nominal, names)[at] * size / sigma[:, None, None]
    target = (readings.displacement[keep] - model.predict(readings.poses)[at]) / sigma[:, None]
    return Trial(experiment, readings, keep, sigma, stated, A, target)


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
    rms = float(np.sqrt(np.mean(np.square(left * trial.sigma[:, None]))))
    return _Fit(square, rms, start + free, sd, dof, below, trial)


def _within(R: Array, z: Array, free: Array, low: Array, high: Array) -> Array:
    """Least squares |R d - z| with low <= d <= high; `free` is the solution without the bounds."""
    from scipy.optimize import lsq_linear

    if np.all((free >= low) & (free <= high)):
        return free
    wide = np.where(high > low, high, low + 1e-12)
    return np.asarray(lsq_linear(R, z, (low, wide), method="bvls").x)


def _couplings(experiment: Experiment, readings: Readings) -> Iterator[_Change]:
    """An angle that is absolute where the file says relative, or the reverse, at every joint."""
    kind = registry().get("controller_coupling")
    if kind is None:
        return
    robot, model = experiment.robot, experiment.model()
    held = dict(zip(model.names, model.nominal, strict=True))
    for effect in kind.places(robot.facts, tuple(m.name for m in experiment.markers)):
        (own,) = effect.parameters(robot.facts)
        here = experiment if own.name in held else experiment.with_(effects=(*experiment.effects, effect))
        others = tuple(p for p in experiment.parameters if p.name != own.name)
        for value in (1.0, -1.0):
            fixed = replace(own, nominal=held.get(own.name, 0.0) + value)
            sign = "plus" if value > 0 else "minus"
            words = (
                f"{own.name} = {value:+g}: the true angle of {effect.where} is the file's {sign} the shown angle of "
                "the joint before it; an absolute angle was read as relative, or the reverse"
            )
            yield _Change(own.name, value, words, here.with_(parameters=(*others, fixed)), readings)


def _joint_signs(experiment: Experiment, readings: Readings) -> Iterator[_Change]:
    for k, joint in enumerate(experiment.robot.facts.joints):
        pendant = np.array(readings.poses.pendant)
        pendant[:, k] *= -1.0
        q = experiment.robot.controller.to_joints(pendant)
        poses = replace(readings.poses, pendant=pendant, q=q)
        words = f"the angle of {joint} counts the other way round"
        yield _Change(f"joint_sign[{joint}]", -1.0, words, experiment, replace(readings, poses=poses))


def _orientations() -> list[Array]:
    """The 47 signed permutations of three axes that are not the identity."""
    out = [np.diag(signs) @ np.eye(3)[list(order)]
           for order in permutations(range(3)) for signs in product((1.0, -1.0), repeat=3)]  # fmt: skip
    return [P for P in out if not np.array_equal(P, np.eye(3))]


def _axes(P: Array, what: str) -> str:
    """`dx = -dy of the file` for each axis that changes."""
    said = []
    for row, axis in zip(P, "xyz", strict=True):
        source = int(np.argmax(np.abs(row)))
        if row[source] != 1.0 or "xyz"[source] != axis:
            said.append(f"{what}{axis} is {'-' if row[source] < 0 else ''}{what}{'xyz'[source]} of the file")
    return ", ".join(said)


def _displacement_axes(experiment: Experiment, readings: Readings) -> Iterator[_Change]:
    for P in _orientations():
        reversed_ = np.array_equal(P, -np.eye(3))
        name = "displacement_sign" if reversed_ else "displacement_axes"
        words = (
            "displacements are unloaded minus loaded, or the force is the one that the robot exerts: the sign of one "
            "of them is reversed" if reversed_ else f"axes of the displacements: {_axes(P, 'd')}"
        )  # fmt: skip
        yield _Change(name, -1.0 if reversed_ else 1.0, words, experiment,
                      replace(readings, displacement=readings.displacement @ P.T))  # fmt: skip


def _force_axes(experiment: Experiment, readings: Readings) -> Iterator[_Change]:
    """Axes of the load cell. Its reversal is that of the displacements, and moments turn as axial vectors do."""
    wrench = readings.poses.wrench
    seen = [wrench, -wrench]
    for P in _orientations():
        turned = np.hstack([wrench[:, :3] @ P.T, np.linalg.det(P) * wrench[:, 3:] @ P.T])
        if any(np.allclose(turned, w) for w in seen):
            continue
        seen.append(turned)
        poses: Poses = replace(readings.poses, wrench=turned)
        yield _Change("force_axes", 1.0, f"axes of the force: {_axes(P, 'f')}", experiment,
                      replace(readings, poses=poses))  # fmt: skip


def _mistakes(given: _Fit) -> list[tuple[_Change, int]]:
    """Markers that were exchanged and angles that were logged late, with the number of alternatives they were among."""
    trial = replace(given.trial, stated=False)  # a hidden effect must not look like a mistake
    readings, experiment = trial.readings, trial.experiment
    out: list[tuple[_Change, int]] = []
    if np.linalg.matrix_rank(trial.A.reshape(-1, trial.A.shape[-1])) < trial.A.shape[-1]:
        return out
    swapped = swapped_markers(trial, LEVEL)
    if swapped:
        displacement = np.array(readings.displacement)
        for rows, _ in swapped:
            of = readings.measurement[rows]
            for m in np.unique(of):
                a, b = rows[of == m]
                displacement[[a, b]] = displacement[[b, a]]
        words = "; ".join(words for _, words in swapped)
        change = _Change("swapped_markers", 1.0, words, experiment, replace(readings, displacement=displacement))
        out.append((change, 3 * len(readings.poses)))
    for rows, words in late_angles(trial, LEVEL)[:1]:
        out.append((_Change("late_angles", 1.0, words, experiment, _earlier(readings, rows)), len(readings.poses)))
    return out


def _earlier(readings: Readings, rows: Indices) -> Readings:
    """The angles of a run of measurements moved up by one; the last one's are missing, so it is masked."""
    run = np.unique(readings.measurement[rows])
    order = np.arange(len(readings.poses))
    order[run[:-1]] = run[1:]
    poses = replace(readings.poses, pendant=readings.poses.pendant[order], q=readings.poses.q[order])
    use = np.array(readings.use)
    use[readings.measurement == run[-1]] = False
    return replace(readings, poses=poses, use=use)


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
