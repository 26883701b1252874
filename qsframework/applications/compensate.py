"""Corrected targets: the joint angles at which the loaded arm, as it was identified, stands where it is wanted.

    tip(q_c; x) = wanted,  tip: the full equilibrium (17) under gravity, compensators and the wrench

solved by Newton steps with the rigid Jacobian, which is the loaded one to the size of the deflection, so that each
step leaves about that share of the error. What is left on the real arm is the error of the parameters: to first order
dt = S dx with S = d tip / d x at the corrected angles, so its covariance is S cov(x) S'.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from qsframework.applications.inverse import TipPose, arm_length, joint_step, pose_error, rigid_jacobian, rigid_tip
from qsframework.applications.targets import Targets
from qsframework.elastostatics import Model, actuator_torques, equilibrium, range_notes
from qsframework.errors import InputError, NotConverged, Problem
from qsframework.experiment import Experiment
from qsframework.identify import FitRecord
from qsframework.identify.soundness import check_fit
from qsframework.plugin import Array, Indices, Load, Poses
from qsframework.plugin.facts import frozen
from qsframework.units import JointUnits

REFERENCES = ("commanded", "unloaded")
_STEPS = 15
_CLOSE = 1e-10
_LARGEST_CORRECTION = np.deg2rad(10.0)
_SHARE = 1e-3
_STEP = 1e-2
_BLOCK = 64
_NOTHING = 1e-12
"""m or rad that the tip of a rigid model moves by rounding."""
Tell = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False, kw_only=True)
class Compensation:
    """N corrected targets, and what is left where.

    pendant (N, n) rad, m: the corrected angles and travels, units theirs
    command: the pose that a controller with Cartesian targets is to be told
    deflection (N, 6): from the wanted pose to where the arm would stand uncorrected, m and rad
    left (N, 6): the same after the correction, by the same parameters: what the solver left
    covariance (N, 6, 6): of the tip's error after the correction, from the fit's covariance and the uncertainty that
    was stated for the measuring campaign's load; noise_covariance: without the latter
    quantity: of what the errors are, as the fit's readings allow: "position" or "deflection under load"
    """

    targets: Targets
    units: JointUnits
    pendant: Array
    command: TipPose
    deflection: Array
    left: Array
    covariance: Array
    noise_covariance: Array
    notes: tuple[str, ...] = ()
    reference: str = "commanded"
    quantity: str = "position"

    @property
    def size(self) -> Array:
        """Distance (N,) m from the wanted place without a correction."""
        return np.asarray(np.linalg.norm(self.deflection[:, :3], axis=1))

    @property
    def sd(self) -> Array:
        """Root of the mean squared distance (N,) m from the wanted place that is to be expected after it."""
        return np.sqrt(np.einsum("ncc->n", self.covariance[:, :3, :3]))

    @property
    def noise_sd(self) -> Array:
        """The part of `sd` (N,) m that the readings' noise alone leaves."""
        return np.sqrt(np.einsum("ncc->n", self.noise_covariance[:, :3, :3]))

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
                "deflection_mm": (self.deflection[i, :3] * 1e3).tolist(),
                "rotation_mrad": (self.deflection[i, 3:] * 1e3).tolist(),
                "solver_left_mm": float(np.linalg.norm(self.left[i, :3]) * 1e3),
                "expected_error_mm": float(self.sd[i] * 1e3),
                "of_noise_mm": float(self.noise_sd[i] * 1e3),
                "sd_mm": (axes[i] * 1e3).tolist(),
                "expected_error_mrad": float(self.turn_sd[i] * 1e3),
            }
            for i, name in enumerate(self.targets.name)
        ]
        worst = {"target": self.targets.name[self.worst], "expected_error_mm": float(self.sd[self.worst] * 1e3)}
        return {"targets": rows, "largest": worst, "notes": list(self.notes)}


def compensate(
    experiment: Experiment,
    fit: FitRecord,
    targets: Targets,
    reference: str = "commanded",
    tell: Tell | None = None,
    *,
    anyway: bool = False,
) -> Compensation:
    """Correct targets by an identified model.

    reference "commanded": the tip is wanted where the controller's own kinematics put it, so gravity, compensators and
    errors of geometry that the fit knows are corrected too; "unloaded": where the arm stands without the wrench, as for
    targets that were taught with an empty hand (joint targets only).

    The covariance is that of the fit, widened where its residuals do not fit their noise (`FitRecord.widening`).
    anyway: use a fit that is not to be trusted, and note why it is not (`soundness.check_fit`).

    Raises InputError where the fit is of another robot or not to be trusted, an actuator is overloaded, nothing in the
    model gives under the wrenches, a target cannot be corrected within the limits, or the arm does not carry the
    wrench there.
    """
    doubted = check_fit(fit, experiment.robot, experiment, anyway=anyway)
    if reference not in REFERENCES:
        raise InputError(Problem(f"unknown reference {reference!r}", allowed=", ".join(REFERENCES)))
    if reference == "unloaded" and targets.cartesian:
        raise InputError("reference 'unloaded' is for joint targets; a Cartesian target says itself where to stand")
    model, x = experiment.model(), arm_values(experiment, fit)
    _check_torques(experiment, model, x, targets)
    _check_gives(experiment, x, targets)
    parts: list[tuple[Array, ...]] = []
    for start in range(0, len(targets), _BLOCK):
        part = np.arange(start, min(start + _BLOCK, len(targets)))
        parts.append(_block(experiment, fit, x, targets, part, reference))
        if tell is not None:
            tell("targets", int(part[-1]) + 1, len(targets))
    pendant, deflection, left, covariance, noise = (np.concatenate(a) for a in zip(*parts, strict=True))
    _check_corrected(experiment, targets, pendant, deflection, left)
    command = rigid_tip(experiment.robot, experiment.load_site, experiment.robot.controller.to_joints(pendant))
    stood = Poses(pendant, experiment.robot.controller.to_joints(pendant), targets.wrench)
    notes = (*doubted, *_scope(fit), *fit_notes(experiment, fit), *range_notes(model, stood, targets.name, x))
    return Compensation(
        targets=targets,
        units=experiment.robot.controller.units,
        pendant=frozen(pendant),
        command=command,
        deflection=deflection,
        left=left,
        covariance=covariance,
        noise_covariance=noise,
        notes=notes,
        reference=reference,
        quantity=fit.account.quantity,
    )


def _scope(fit: FitRecord) -> tuple[str, ...]:
    """Of what the expected errors are, where that is not the position in the base frame."""
    if not fit.account.positions:
        return (
            "the fit is of deflections under load: the expected errors are of these; where the unloaded arm stands in "
            "its base frame was not measured",
        )
    if fit.account.frames:
        return (
            "the instrument's frame was estimated from the same readings: the expected errors are in that frame, and "
            "what turns or shifts the whole arm or its tool is absorbed there",
        )
    return ()


def arm_values(experiment: Experiment, fit: FitRecord) -> Array:
    """The fit's values (p,), with the errors of the campaign's own load left out: the work brings another load."""
    x, model = fit.x_of(experiment.model()), experiment.model()
    own = {e.name for e in experiment.effects if isinstance(e, Load)}
    for effect, part in zip(model.effects, model.slices, strict=True):
        if effect.name in own:
            nulls = [p.null for p in model.parameters[part]]
            x[part] = [v if n is None else n for v, n in zip(x[part], nulls, strict=True)]
    return x


def fit_notes(experiment: Experiment, fit: FitRecord) -> tuple[str, ...]:
    """What the expected errors do not say, and what was not checked."""
    notes: list[str] = []
    if experiment.robot.payload is None:
        notes.append("robot.yaml states no payload_kg: the forces were not checked against it")
    known = [n for n, sd in zip(fit.names, fit.sd, strict=True) if not np.isfinite(sd)]
    if known:
        notes.append(f"counted as known exactly, for the fit quotes no sd: {', '.join(known)}")
    given = (p.name for p in experiment.model().parameters if not p.by_name)
    fixed = [n for n in given if n not in fit.names and fit.model_values[n] != 0.0]
    if fixed:
        notes.append(f"not identified, counted as known exactly at their nominal values: {', '.join(fixed)}")
    if experiment.has_load and fit.total_covariance is None:
        notes.append(
            "the fit states no uncertainty of its load (load_uncertainty in experiment.yaml): counted as exact"
        )
    if fit.widening > 1.0:
        ratio = f"{np.sqrt(fit.widening):.1f}"
        notes.append(
            f"the fit's residuals are {ratio} times the stated noise: the expected errors are widened by that factor, "
            "and what the model lacks may add more"
        )
    return tuple(notes)


def _block(
    experiment: Experiment, fit: FitRecord, x: Array, targets: Targets, part: Indices, reference: str
) -> tuple[Array, ...]:
    """Corrected angles, deflection, what is left, and the covariances, whole and of the noise, of some targets."""
    model, robot = experiment.model(), experiment.robot
    wrench, start = targets.wrench[part], targets.pendant[part]

    def stand(pendant: Array, values: Array, loaded: bool = True) -> TipPose:
        return _tip(model, Poses(pendant, robot.controller.to_joints(pendant), wrench), values, loaded, targets, part)

    wanted = targets.wanted.take(part) if reference == "commanded" else stand(start, x, False)
    length, matrix = arm_length(robot), robot.controller.matrix
    deflection = error = -pose_error(wanted, stand(start, x))
    pendant = start.copy()
    for _ in range(_STEPS):
        if np.all(np.abs(error[:, :3]) < _CLOSE * length) and np.all(np.abs(error[:, 3:]) < _CLOSE):
            break
        J = rigid_jacobian(robot, experiment.load_site, robot.controller.to_joints(pendant))
        pendant = pendant + joint_step(J @ matrix, -error, length)
        if np.abs(pendant - start).max() > 2 * _LARGEST_CORRECTION:
            break  # told by `_check_corrected`
        error = -pose_error(wanted, stand(pendant, x))
    slope = tip_slope(model, fit, x, lambda v: stand(pendant, v))
    if reference == "unloaded":
        slope = slope - tip_slope(model, fit, x, lambda v: stand(start, v, False))
    noise, load = (
        slope @ C @ slope.transpose(0, 2, 1)
        for C in (fit.widening * fit.covariance, fit.whole_covariance - fit.covariance)
    )
    return pendant, deflection, error, noise + load, noise


def tip_slope(model: Model, fit: FitRecord, x: Array, stand: Callable[[Array], TipPose]) -> Array:
    """d tip / d parameters of the fit (N, 6, p), by central differences of the full equilibrium.

    Parameters that are not the model's, such as the tracker's frame, move no tip.
    """
    out = np.zeros((len(stand(x)), 6, len(fit.names)))
    for k, name in enumerate(fit.names):
        if fit.covariance[k, k] > 0.0 and name in model.names:  # the others are known exactly, or not at all
            i = model.index([name])[0]
            step = np.zeros(len(x))
            step[i] = _STEP * max(model.parameters[i].scale, abs(x[i]))
            out[:, :, k] = pose_error(stand(x + step), stand(x - step)) / (2.0 * step[i])
    return out


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
    poses = Poses(pendant, experiment.robot.controller.to_joints(pendant), targets.wrench[acts])
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
    poses = Poses(targets.pendant, robot.controller.to_joints(targets.pendant), targets.wrench)
    torque = np.abs(actuator_torques(model, poses, x))
    problems = [
        targets.problem(
            int(i),
            f"{robot.facts.joints[k]} cannot hold the load",
            found=f"{torque[i, k]:.0f} {robot.facts.units[k].load}",
            allowed=f"up to {robot.torque_limits[k]:.0f} {robot.facts.units[k].load}",
        )
        for i, k in zip(*np.nonzero(torque > robot.torque_limits), strict=True)
    ]
    if problems:
        raise InputError(problems)


def _check_corrected(experiment: Experiment, targets: Targets, pendant: Array, deflection: Array, left: Array) -> None:
    """InputError with each target that cannot be corrected, and why."""
    robot = experiment.robot
    problems: list[Problem] = []
    outside, moved = robot.controller.outside(pendant), np.abs(pendant - targets.pendant)
    length = arm_length(robot)

    def size(error: Array) -> Array:
        return np.hypot(np.linalg.norm(error[:, :3], axis=1) / length, np.linalg.norm(error[:, 3:], axis=1))

    far = (size(left) > np.maximum(_SHARE * size(deflection), 1e-9)) | (moved.max(axis=1) > _LARGEST_CORRECTION)
    for i in range(len(targets)):
        if far[i]:
            message = "no small correction brings the tool to the wanted pose: the arm is at or near a singular pose"
            problems.append(targets.problem(i, message, hint="Move the target away from it, or turn the tool."))
            continue
        for k in np.flatnonzero(outside[i]).tolist():
            unit = robot.controller.units[k]
            message = f"the target is at the limit of {robot.facts.driven[k]} and its correction goes beyond it"
            found = f"{pendant[i, k] * unit.per:.4f} {unit.shown}"
            allowed = unit.between(*robot.controller.range_of(k))
            hint = f"Move the target by {moved[i, k] * unit.per:.3f} {unit.shown} or more from the limit."
            problems.append(targets.problem(i, message, found=found, allowed=allowed, hint=hint))
    if problems:
        raise InputError(problems)
