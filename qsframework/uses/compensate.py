"""Corrected targets: the joint angles at which the loaded arm, as it was identified, stands where it is wanted.

    tip(q_c; x) = wanted,  tip: the full equilibrium (17) under gravity, compensators and the wrench

solved by Newton steps with the rigid Jacobian, which is the loaded one to the size of the deflection, so that each
step leaves about that share of the error. What is left on the real arm is the error of the parameters: to first order
dt = S dx with S = d tip / d x at the corrected angles, so its covariance is S cov(x) S'.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from qsframework.arguments import checked
from qsframework.elastostatics import Model, actuator_torques, equilibrium, range_notes
from qsframework.errors import InputError, NotConverged, Problem, refuse, some_of
from qsframework.experiment import Experiment, Frame
from qsframework.experiment.account import Account, flange_places
from qsframework.files import as_file
from qsframework.fits import FitRecord
from qsframework.fits.soundness import check_fit
from qsframework.option import check_choice
from qsframework.plans.programme import overloads
from qsframework.plugin import Array, Indices, Poses, Sensor
from qsframework.plugin.facts import frozen
from qsframework.units import JointUnits
from qsframework.uses.inverse import (
    TipPose,
    arm_length,
    joint_step,
    pose_error,
    poses_at,
    rigid_jacobian,
    rigid_tip,
)
from qsframework.uses.levels import LEVELS, Levels, levels_of, moving, own_load, tip_slope
from qsframework.uses.options import Reference
from qsframework.uses.targets import Targets
from qsframework.viewed import Viewed

_STEPS = 15
_CLOSE = 1e-10
_LARGEST_CORRECTION = np.deg2rad(10.0)
_SHARE = 1e-3
_BLOCK = 64
_BEYOND = 1.2
"""Times the largest measured load from which a target is said to lie beyond it."""
_AROUND = 0.1
"""Of the diagonal of the box that the measured places of the flange fill: farther outside, a target is said to lie
beyond the workspace. A few dozen poses leave about so much of a workspace beyond the outermost ones."""
_SEEN = 1e-6
"""m by which a natural size of what was held must move the tip to be worth a word."""
_KILOGRAMS = 0.11
"""Of the force of the readings: kilograms written for newtons are a little less, kilonewtons far less."""
_NOTHING = 1e-12
"""m or rad that the tip of a rigid model moves by rounding."""
Tell = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Compensation(Viewed):
    """N corrected targets, and what is left where.

    pendant (N, n) rad, m: the corrected angles and travels, units theirs
    command: the pose that a controller with Cartesian targets is to be told
    deflection (N, 6): from the wanted pose to where the arm would stand uncorrected, m and rad
    own (N, 6): the part of it that the arm's own weight, its balancers and its geometry make without the wrench
    level: of `LEVELS`, at which the held-out error, and so all distances and errors, are taken: after the best frame
    where that of the instrument was estimated, after the best frame and tool where all places of markers were, too
    absorbed (N, 6): the part of `own` that this frame and tool take up
    left (N, 6): as `deflection` after the correction, by the same parameters; kept (N,): targets that keep their
    commanded pose, because their error would not become smaller
    covariance (N, 6, 6): of the tip's error after the correction: from the fit's covariance, what held-out poses are
    off beyond the noise, and the uncertainties of the campaign's load and of what was held at nominal values;
    noise_covariance: of noise alone
    sds: as `sd` (N,), at "base", "frame" and "tool", where the instrument's frame was estimated; at "base" not where
    nobody states how well what that frame absorbs is known
    account: that of the fit
    """

    targets: Targets
    units: JointUnits
    pendant: Array
    command: TipPose
    deflection: Array
    own: Array
    level: int
    absorbed: Array
    left: Array
    kept: npt.NDArray[np.bool_]
    covariance: Array
    noise_covariance: Array
    sds: dict[str, Array]
    notes: tuple[str, ...] = ()
    reference: str = "commanded"
    account: Account

    @property
    def at_level(self) -> str:
        """At which level distances and errors are, a clause; none where they are of the deflection under load."""
        return f"; {LEVELS[self.level]}" if self.account.positions and self.reference == "commanded" else ""

    @property
    def uncorrected(self) -> Array:
        """Distance (N,) m from the wanted place without a correction."""
        return np.asarray(np.linalg.norm((self.deflection - self.absorbed)[:, :3], axis=1))

    @property
    def of_load(self) -> Array:
        """Distance (N,) m by which the wrench alone moves the tip."""
        return np.asarray(np.linalg.norm((self.deflection - self.own)[:, :3], axis=1))

    @property
    def of_own(self) -> Array:
        """Distance (N,) m by which own weight, balancers and geometry alone move the tip."""
        return np.asarray(np.linalg.norm((self.own - self.absorbed)[:, :3], axis=1))

    @property
    def sd(self) -> Array:
        """Root of the mean squared distance (N,) m from the wanted place that is to be expected after it."""
        return np.hypot(_distance(self.covariance), np.where(self.kept, self.uncorrected, 0.0))

    @property
    def noise_sd(self) -> Array:
        """The part of `sd` (N,) m that the readings' noise alone leaves."""
        return _distance(self.noise_covariance)

    @property
    def turn_sd(self) -> Array:
        """The same of the rotation (N,) rad."""
        return np.sqrt(np.einsum("ncc->n", self.covariance[:, 3:, 3:]))

    @property
    def worst(self) -> int:
        """The target with the largest error to be expected."""
        return int(np.argmax(self.sd))

    def as_json(self) -> dict[str, Any]:
        """Millimetres, milliradians and degrees, as the names say."""
        axes = np.sqrt(np.einsum("ncc->nc", self.covariance[:, :3, :3]))
        rows = [
            {
                "target": name,
                **self.units.fields("q", self.pendant[i]),
                **self.units.fields("correction", self.pendant[i] - self.targets.pendant[i]),
                "kept": bool(self.kept[i]),
                "uncorrected_mm": float(self.uncorrected[i] * 1e3),
                "deflection_mm": (self.deflection[i, :3] * 1e3).tolist(),
                "own_weight_and_geometry_mm": (self.own[i, :3] * 1e3).tolist(),
                "rotation_mrad": (self.deflection[i, 3:] * 1e3).tolist(),
                "solver_left_mm": float(np.linalg.norm(self.left[i, :3]) * 1e3),
                "expected_error_mm": float(self.sd[i] * 1e3),
                "of_noise_mm": float(self.noise_sd[i] * 1e3),
                **{f"expected_error_{of}_mm": float(sd[i] * 1e3) for of, sd in self.sds.items()},
                "sd_mm": (axes[i] * 1e3).tolist(),
                "expected_error_mrad": float(self.turn_sd[i] * 1e3),
            }
            for i, name in enumerate(self.targets.name)
        ]
        worst = {"target": self.targets.name[self.worst], "expected_error_mm": float(self.sd[self.worst] * 1e3)}
        level, account = self.at_level.lstrip("; ") or "deflection under load", as_file(self.account)
        return {"level": level, "targets": rows, "largest": worst, "account": account, "notes": list(self.notes)}


@checked
def compensate(
    experiment: Experiment,
    fit: FitRecord,
    targets: Targets,
    reference: Reference = "commanded",
    tell: Tell | None = None,
    *,
    path: bool = False,
    anyway: bool = False,
) -> Compensation:
    """Correct targets for deflection under load by an identified model.

    The covariance is that of the fit, widened where its residuals exceed their noise (`FitRecord.widening`), with what
    held-out poses are off beyond the noise (`FitRecord.lack`), and of the stated sds of what it held at nominal. A
    target whose error would not become smaller keeps its commanded pose.

    Args:
        experiment: the campaign of the fit.
        fit: the identified values.
        targets: N targets with their wrenches.
        reference: "commanded": the target is where the controller's own kinematics put the tip, so gravity,
            compensators and errors of geometry that the fit knows are corrected too; "unloaded": where the arm
            stands without the wrench, as for targets recorded with an empty hand (joint targets only).
        tell: called with each step, its number and how many there are.
        path: the targets are points of one path, of which all are moved or none.
        anyway: use a rejected fit, and note the reason (`soundness.check_fit`); move every target.

    Returns:
        Corrected joint values (N, n) rad or m, and the predicted error of each target, m.

    Raises:
        InputError: where the fit is of another robot or rejected, an actuator is overloaded, nothing in the model is
            compliant under the wrenches, a target cannot be corrected within the limits, the arm does not carry the
            wrench there, or no target would come nearer to its place.
    """
    doubted = check_fit(fit, experiment.robot, experiment, anyway=anyway)
    check_choice("reference", Reference, reference)
    if reference == "unloaded" and targets.cartesian:
        raise InputError("reference 'unloaded' is for joint targets; a Cartesian target says itself where to stand")
    model, x = experiment.model(), arm_values(experiment, fit)
    _check_torques(experiment, model, x, targets)
    _check_gives(experiment, x, targets)
    framed = _series(fit) is not None and reference == "commanded"
    names = moving(experiment, fit)
    levels = levels_of(experiment, fit.account, names, x, targets.wrench) if framed else None
    parts: list[tuple[Array, ...]] = []
    for start in range(0, len(targets), _BLOCK):
        part = np.arange(start, min(start + _BLOCK, len(targets)))
        parts.append(_block(experiment, fit, x, targets, part, reference, levels))
        if tell is not None:
            tell("targets", int(part[-1]) + 1, len(targets))
    pendant, deflection, own, left, spread, noise, open_, absorbed = map(np.concatenate, zip(*parts, strict=True))
    spread[:, :, :3, :3] += fit.lack**2 / 3.0 * np.eye(3)
    level = framed * (1 + (len(fit.account.tool) >= 3 * len(experiment.markers)))
    covariance, absorbed = spread[:, level], absorbed[:, level]
    whole = path or framed  # targets that stay beside others that move would not lie in one frame
    before = np.linalg.norm((deflection - absorbed)[:, :3], axis=1)
    kept = np.zeros(len(targets), dtype=bool) if anyway else _kept(before, _distance(covariance), whole)
    pendant, left = np.where(kept[:, None], targets.pendant, pendant), np.where(kept[:, None], deflection, left)
    _check_corrected(experiment, targets, pendant, deflection, left, kept)
    command = rigid_tip(experiment.robot, experiment.load_site, experiment.robot.controller.to_joints(pendant))
    stood = poses_at(experiment.robot, pendant, targets.wrench)
    exact, open_in_base = _not_counted(experiment, fit, open_, level)
    sds = {of: _distance(spread[:, k]) for k, of in enumerate(("base", "frame", "tool")) if framed}
    if open_in_base:
        sds.pop("base", None)
    notes = (*doubted, *_scope(fit, sds, open_in_base), *fit_notes(experiment, fit, exact))
    notes += (*_beyond_notes(fit.account, targets, experiment), *range_notes(model, stood, targets.name, x))
    if kept.any():
        names = some_of([n for n, still in zip(targets.name, kept, strict=True) if still])
        notes += (f"not moved, since a correction would bring them no nearer to their places: {names}",)
    return Compensation(
        targets=targets,
        units=experiment.robot.controller.units,
        pendant=frozen(pendant),
        command=command,
        deflection=deflection,
        own=own,
        level=level,
        absorbed=absorbed,
        left=left,
        kept=kept,
        covariance=covariance,
        noise_covariance=noise[:, level],
        sds=sds,
        notes=notes,
        reference=reference,
        account=fit.account,
    )


def _kept(uncorrected: Array, expected: Array, together: bool) -> npt.NDArray[np.bool_]:
    """Targets (N,) whose expected error, m, is not below the uncorrected one; together all or none. InputError where
    all are."""
    sizes = [float(np.sqrt(np.mean(np.square(size)))) for size in (uncorrected, expected)]
    kept = np.full(len(expected), not sizes[1] < sizes[0]) if together else ~(expected < uncorrected)
    if kept.all():
        raise InputError(
            Problem(
                "no correction: it would make the targets no better",
                found=f"{1e3 * sizes[1]:.3f} mm (RMS) to be expected after it, {1e3 * sizes[0]:.3f} mm without it",
                hint="Measure more poses near the targets (`qsf design` plans them), or diagnose the readings.",
                argument=("anyway", ""),
            )
        )
    return kept


def _beyond_notes(account: Account, targets: Targets, experiment: Experiment) -> Iterator[str]:
    """Targets beyond the loads, the angles and the workspace of the readings."""

    def named(which: Array) -> str:
        return some_of([targets.name[i] for i in np.flatnonzero(which)])

    for what, part, most in (("force", slice(3), account.force), ("moment", slice(3, 6), account.moment)):
        size = np.linalg.norm(targets.wrench[:, part], axis=1)
        far = size > _BEYOND * most
        if far.any():
            unit = "N" if what == "force" else "N m"
            yield f"beyond the {what} of the readings, {most:.4g} {unit}: {size.max():.4g} {unit} at {named(far)}"
    force = np.linalg.norm(targets.wrench[:, :3], axis=1)
    small = (force > 0.0) & (force < _KILOGRAMS * account.force)
    if small.any():
        most = f"{force[small].max():.4g} N at most, where the readings had {account.force:.4g} N"
        yield f"small forces, {most}, at {named(small)}: they count as newtons"
    low, high = np.array(account.angles).reshape(-1, 2).T
    outside = (targets.pendant < low) | (targets.pendant > high)
    columns = zip(experiment.robot.facts.driven, outside.T, strict=True)
    joints = [f"{joint} at {named(far)}" for joint, far in columns if far.any()]
    if joints:
        yield f"beyond the angles of the readings: {'; '.join(joints)}"
    low, high = np.array(account.flange).T
    places = flange_places(experiment, experiment.robot.controller.to_joints(targets.pendant))
    around = _AROUND * np.linalg.norm(high - low)
    far = np.any((places < low - around) | (places > high + around), axis=1)
    if far.any():
        yield f"flange over {1e3 * around:.0f} mm outside the box of its measured places: {named(far)}"


def _not_counted(experiment: Experiment, fit: FitRecord, open_: Array, level: int) -> tuple[list[str], list[str]]:
    """Names of what was held at nominal values and nobody states an sd of: what moves the tip (N, 3, h) at this level,
    and what does in the base frame."""
    moves = np.any(open_ > _SEEN, axis=0)[[level, 0]]
    own = [h.name for h, seen in zip(fit.held, moves[0], strict=True) if seen]
    given = (p.name for p in experiment.model().parameters if not p.by_name)
    others = {*fit.names, *(h.name for h in fit.held)}
    own += [n for n in given if n not in others and fit.model_values[n] != 0.0]
    return own, [h.name for h, both in zip(fit.held, moves.T, strict=True) if both[1]]


def _scope(fit: FitRecord, sds: dict[str, Array], absorbed: Sequence[str]) -> tuple[str, ...]:
    """Of what the expected errors are, which are `sds` at the three levels, as notes."""
    base = "in the base frame they are not known"
    if absorbed:
        base += f", for nobody states how well {some_of(absorbed)} {'is' if len(absorbed) == 1 else 'are'}"
    elif sds:
        base = f"in the base frame up to {1e3 * sds['base'].max():.3f} mm is to be expected"
    if sds and fit.account.tool:
        base += f", with a tool that nobody measured up to {1e3 * sds['frame'].max():.3f} mm after the best frame"
    return tuple(said.rstrip(".") for said in fit.account.scope(base))


def arm_values(experiment: Experiment, fit: FitRecord) -> Array:
    """The fit's values (p,), with the errors of the campaign's own load left out: the work brings another load."""
    x, model = fit.x_of(experiment.model()), experiment.model()
    for i in model.index(own_load(experiment)):
        null = model.parameters[i].null
        x[i] = x[i] if null is None else null
    return x


def fit_notes(experiment: Experiment, fit: FitRecord, exact: Sequence[str]) -> tuple[str, ...]:
    """What the expected errors do not say, and what was not checked; exact: names of what is treated as exact."""
    notes: list[str] = []
    if experiment.robot.payload is None:
        notes.append("robot.yaml states no payload_kg: the forces were not checked against it")
    known = [n for n, sd in zip(fit.names, fit.sd, strict=True) if not np.isfinite(sd)]
    if known:
        notes.append(f"treated as exact, for the fit quotes no sd: {', '.join(known)}")
    if exact:
        notes.append(f"treated as exact at their nominal values (no uncertainty stated): {some_of(exact)}")
    if own := [name for name in own_load(experiment) if name in fit.names]:
        notes.append(
            f"the targets' loads count as they stand: {some_of(own)} is of the campaign's load; what tilts or scales "
            "the work's load too belongs in their forces"
        )
    elif experiment.has_load and fit.total_covariance is None:
        notes.append(
            "the fit states no uncertainty of its load (load_uncertainty in experiment.yaml): counted as exact"
        )
    if needed := [e.name for e in experiment.model().effects if e.needs and not isinstance(e, Sensor)]:
        notes.append(f"the targets count at 20 degC, reached from the positive side ({some_of(needed)})")
    if fit.widening > 1.0:
        ratio = f"{np.sqrt(fit.widening):.1f}"
        notes.append(
            f"the fit's residuals are {ratio} times the stated noise: the expected errors are widened by that factor "
            f"and hold the {1e3 * fit.lack:.3f} mm that held-out poses are off beyond the noise"
        )
    return tuple(notes)


def _block(
    experiment: Experiment,
    fit: FitRecord,
    x: Array,
    targets: Targets,
    part: Indices,
    reference: str,
    levels: Levels | None,
) -> tuple[Array, ...]:
    """Corrected angles, deflection, its part without the wrench, what is left, and at each level `_spread` and what is
    absorbed of the part without the wrench, of some targets."""
    model, robot = experiment.model(), experiment.robot
    wrench, start = targets.wrench[part], targets.pendant[part]

    def stand(pendant: Array, values: Array, loaded: bool = True) -> TipPose:
        return _tip(model, poses_at(robot, pendant, wrench), values, loaded, targets, part)

    unloaded = stand(start, x, False)
    wanted = targets.wanted.take(part) if reference == "commanded" else unloaded
    length, matrix = arm_length(robot), robot.controller.matrix
    deflection = error = -pose_error(wanted, stand(start, x))
    bare = -pose_error(wanted, unloaded)
    pendant = start.copy()
    for _ in range(_STEPS):
        if np.all(np.abs(error[:, :3]) < _CLOSE * length) and np.all(np.abs(error[:, 3:]) < _CLOSE):
            break
        J = rigid_jacobian(robot, experiment.load_site, robot.controller.to_joints(pendant))
        pendant = pendant + joint_step(J @ matrix, -error, length)
        if np.abs(pendant - start).max() > 2 * _LARGEST_CORRECTION:
            break  # told by `_check_corrected`
        error = -pose_error(wanted, stand(pendant, x))
    names = moving(experiment, fit)
    slope = tip_slope(model, names, x, lambda v: stand(pendant, v))
    measured = 0 if reference == "unloaded" else len(names) if fit.account.positions else len(fit.names)
    slope[..., measured:] -= tip_slope(model, names[measured:], x, lambda v: stand(start, v, False))
    slope = np.concatenate([slope, bare[:, :, None]], axis=2)
    slopes = (slope,) * 3 if levels is None else levels.of(slope, stand(pendant, x))
    every = [(*_spread(model, fit, own[..., :-1]), bare - own[..., -1]) for own in slopes]
    return pendant, deflection, bare, error, *(np.stack(parts, axis=1) for parts in zip(*every, strict=True))


def _spread(model: Model, fit: FitRecord, slope: Array) -> tuple[Array, Array, Array]:
    """Covariance (N, 6, 6) of an error with these slopes (N, 6, p + h) by estimates and by what was held; that of the
    readings' noise alone; and how far (N, h) m a natural size moves the tip of what nobody states an sd of."""
    slope, held = slope[..., : len(fit.names)], slope[..., len(fit.names) :]
    whole, noise = (slope @ C @ slope.transpose(0, 2, 1) for C in (fit.widened, fit.widening * fit.noise_covariance))
    wrong = slope @ fit.held_moved - held
    sds = np.array([h.sd for h in fit.held])
    sizes = np.array([model.parameters[model.names.index(h.name)].scale for h in fit.held])
    open_ = np.linalg.norm(wrong[:, :3], axis=1) * np.where(np.isnan(sds), sizes, 0.0)
    return whole + wrong @ fit.held_moments @ wrong.transpose(0, 2, 1), noise, open_


def _series(fit: FitRecord) -> Frame | None:
    """The frame that positions were measured in, the first of several, where it was estimated."""
    return fit.frames[0] if fit.frames and fit.account.positions else None


def _distance(covariance: Array) -> Array:
    """Root of the mean squared distance (N,) m of errors with these covariances (N, 6, 6)."""
    return np.sqrt(np.einsum("ncc->n", covariance[:, :3, :3]))


def _tip(model: Model, poses: Poses, x: Array, loaded: bool, targets: Targets, part: Indices) -> TipPose:
    """Where the tip settles; InputError with the target where it does not."""
    try:
        found = equilibrium(model, poses, x, loaded)
    except NotConverged:
        problems: list[Problem] = []
        for k, i in enumerate(part):
            try:
                equilibrium(model, poses.take([k]), x, loaded)
            except NotConverged:
                hint = "The load may be beyond the arm's stability; check its unit and the fit's compliances."
                problems.append(targets.problem(int(i), "the loaded arm does not settle there", hint=hint))
        if not problems:
            raise
        raise InputError(problems) from None
    return TipPose(found.tip, found.tip_rotation)


def _check_gives(experiment: Experiment, x: Array, targets: Targets) -> None:
    """InputError where wrenches act that move the tip of this model at no target: their effect would be passed over."""
    acts = np.flatnonzero(np.any(targets.wrench, axis=1))[:_BLOCK]
    if not len(acts):
        return
    pendant = targets.pendant[acts]
    poses = poses_at(experiment.robot, pendant, targets.wrench[acts])
    loaded, bare = (_tip(experiment.model(), poses, x, state, targets, acts) for state in (True, False))
    if np.abs(pose_error(loaded, bare)).max() > _NOTHING:
        return
    hint = "Leave the forces of the targets out, or identify the springs from readings under load"
    hint += ", without rigid: true in the experiment." if experiment.rigid else "."
    message = "nothing in the fitted model gives under this force, so it cannot be compensated"
    raise InputError(targets.problem(int(acts[0]), message, hint=hint))


def _check_torques(experiment: Experiment, model: Model, x: Array, targets: Targets) -> None:
    robot = experiment.robot
    if robot.torque_limits is None or not experiment.constraints.load_capacity:
        return
    poses = poses_at(robot, targets.pendant, targets.wrench)
    refuse(
        [
            targets.problem(i, f"{robot.facts.joints[k]} cannot hold the load", found=found, allowed=allowed)
            for i, k, found, allowed in overloads(robot, np.abs(actuator_torques(model, poses, x)))
        ]
    )


def _check_corrected(
    experiment: Experiment,
    targets: Targets,
    pendant: Array,
    deflection: Array,
    left: Array,
    kept: npt.NDArray[np.bool_],
) -> None:
    """InputError with each target that is to be moved and cannot be corrected, and why."""
    robot = experiment.robot
    problems: list[Problem] = []
    outside, moved = robot.controller.outside(pendant), np.abs(pendant - targets.pendant)
    length = arm_length(robot)

    def size(error: Array) -> Array:
        return np.hypot(np.linalg.norm(error[:, :3], axis=1) / length, np.linalg.norm(error[:, 3:], axis=1))

    far = (size(left) > np.maximum(_SHARE * size(deflection), 1e-9)) | (moved.max(axis=1) > _LARGEST_CORRECTION)
    for i in np.flatnonzero(~kept).tolist():
        if far[i]:
            message = "no small correction brings the tool to its target: the arm is at or near a singular pose"
            problems.append(targets.problem(i, message, hint="Move the target away from it, or turn the tool."))
            continue
        for k in np.flatnonzero(outside[i]).tolist():
            unit = robot.controller.units[k]
            message = f"the target is at the limit of {robot.facts.driven[k]} and its correction goes beyond it"
            found = f"{pendant[i, k] * unit.per:.4f} {unit.shown}"
            allowed = unit.between(*robot.controller.range_of(k))
            hint = f"Move the target by {moved[i, k] * unit.per:.3f} {unit.shown} or more from the limit."
            problems.append(targets.problem(i, message, found=found, allowed=allowed, hint=hint))
    refuse(problems)
