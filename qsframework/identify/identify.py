"""The verb: from an experiment and its displacement readings to a fit, by the method that is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.elastostatics import Model
from qsframework.errors import InputError, NotConverged, NotIdentifiable, Problem, nearest
from qsframework.experiment import Experiment, Readings
from qsframework.experiment.setup import GEOMETRY
from qsframework.identify.equilibrium import fit_exactly, linearised, with_shift
from qsframework.identify.fit import Fit
from qsframework.identify.linear import Found, Rows, fit_rows, identify_linear, make_fit, rounding
from qsframework.identify.noise import SharedError, noise_parts, pose_groups, shared_error
from qsframework.identify.observations import Noise, Observations
from qsframework.identify.profile import profile_interval
from qsframework.identify.single import single_pose
from qsframework.identify.solve import Solution, solve
from qsframework.identify.two_step import identify_two_step
from qsframework.identify.uncertainty import load_sds, total_covariance
from qsframework.information import rank_test, what_would_help
from qsframework.plugin import Array

METHODS = ("linear", "one-step", "two-step")
SHARED = ("pose",)
_ROUNDS = 50
_STILL = 1e-6
_MAD = 1.4826


def identify(
    experiment: Experiment, readings: Readings, fit: Sequence[str] | None = None, method: str = "linear",
    priors: bool = False, loss: str = "linear", fixed: Sequence[str] = (), tied: Sequence[Sequence[str]] = (),
    shared: str = "", exact: bool = False, profile: Sequence[str] = (),
) -> Fit:  # fmt: skip
    """Estimate the experiment's parameters from displacement readings.

    `fit` names other parameters to estimate: effects, instances or single parameters. method "linear" looks at no
    bounds, so that a wrong model or convention shows itself in a value beyond them; "one-step" is nonlinear, keeps the
    bounds, and takes `priors` (stated values and sds count as readings), a robust `loss` (huber, soft_l1), `fixed` and
    `tied` parameters; "two-step" finds an aggregated compliance for each angle of the balanced joint first.

    shared "pose": all markers of a measurement share an error, the robot's repeatability. Its sd is estimated from the
    residuals (REML), and the readings are weighed with it; chi-square then says nothing of errors common to a pose.

    exact: by the full equilibrium instead of the linear model; without it a note says where that would matter.

    profile: parameters whose 95 % profile intervals the plain one-step fit gives too; in a model that bends, or at a
    bound, value +- t sd is none.

    Raises InputError where there are fewer readings than parameters; NotIdentifiable, naming the parameters, where the
    readings cannot tell them apart, or are all of one pose; NotConverged with its reason.
    """
    if method not in METHODS:
        raise InputError(
            Problem(f"unknown method {method!r}", allowed=", ".join(METHODS), hint=nearest(method, METHODS))
        )
    if GEOMETRY in (fit or experiment.fit or ()):
        raise InputError(
            f"fit: {GEOMETRY} is told by absolute positions (x_mm, y_mm, z_mm); these readings are displacements, "
            "which hardly depend on it. Name what they tell, such as joint_compliance, or give positions"
        )
    names = experiment.fit_names() if fit is None else experiment.with_(fit=tuple(fit)).fit_names()
    if method != "one-step" and (priors or loss != "linear" or fixed or tied):
        raise InputError(f"priors, loss, fixed and tied are for method one-step, not for {method}")
    if profile and (method != "one-step" or priors or loss != "linear" or tied):
        raise InputError(
            "profile is for method one-step without priors, loss and tied: it follows the plain least squares"
        )

    def refit(given: Readings, profile: Sequence[str] = ()) -> Fit:
        return _of_linear_model(experiment, given, names, method, priors, loss, fixed, tied, shared, profile)

    model = experiment.model()
    found = fit_exactly(model, readings, refit) if exact else with_shift(refit(readings), model, readings, refit)
    if not profile:
        return found
    last = linearised(model, readings, found.x) if exact else readings
    return replace(found, intervals=refit(last, profile).intervals)


def _of_linear_model(
    experiment: Experiment, readings: Readings, names: Sequence[str], method: str, priors: bool, loss: str,
    fixed: Sequence[str], tied: Sequence[Sequence[str]], shared: str, profile: Sequence[str],
) -> Fit:  # fmt: skip
    """The fit of the model that balances the load at the undeflected pose, with its notes and total uncertainty."""

    def fitted(within: float) -> Fit:
        if method == "linear":
            return identify_linear(experiment, readings, names, within)
        if method == "two-step":
            return identify_two_step(experiment, readings, names, shared=within)
        return _one_step(experiment, readings, names, priors, loss, fixed, tied, within, profile)

    found, within = fitted(0.0), 0.0
    free = 1 if priors else int((np.diag(found.covariance) > 0.0).sum()) - sum(len(group) - 1 for group in tied)
    used = np.unique(readings.measurement[readings.use])
    lonely = single_pose(readings.poses.q[used], free)
    if shared:
        error = _pose_error(experiment, readings, found, shared)
        within = error.sd / error.unit
        found = replace(fitted(within) if within else found, shared_sd=error.sd)
        found = replace(found, notes=(error.words(), *found.notes))
    found = replace(found, notes=(*lonely, *found.notes)) if lonely else found
    if not load_sds(experiment, names).any():
        return found
    noise = fit_rows(experiment, readings, len(names), within)[0].noise
    return replace(found, total_covariance=total_covariance(found, experiment, readings, noise))


def _pose_error(experiment: Experiment, readings: Readings, found: Fit, shared: str) -> SharedError:
    """The error that the markers of a measurement share, from the residuals of a fit without it."""
    if shared not in SHARED:
        raise InputError(Problem(f"unknown shared error {shared!r}", allowed=", ".join(SHARED),
                                 hint=nearest(shared, SHARED)))  # fmt: skip
    rows, source = fit_rows(experiment, readings, len(found.names))
    if len(np.unique(rows.measurement)) == len(rows.measurement):
        raise InputError(
            "an error shared by the markers of a pose cannot be told from their own: every measurement has one marker "
            "only. Leave it out, or measure more markers"
        )
    A = rows.of(found.model.sensitivity(readings.poses, found.x, found.names)).reshape(found.residuals.size, -1)
    own, others = noise_parts(readings, rows.keep, rows.sigma)
    label = pose_groups(readings, rows.keep)
    free = np.sqrt(np.diag(found.covariance)) > 0.0
    return shared_error(found.residuals.ravel(), A[:, free], own, label, source == "stated", others)


def displacement_observations(
    model: Model, readings: Readings, rows: Rows, names: Sequence[str], x: Array | None = None
) -> Observations:
    """The readings as scalars, with the named parameters to fit and all others as in x, nominal if None."""
    index = model.index(names)
    nominal = model.nominal if x is None else x

    def full(x: Array) -> Array:
        every = nominal.copy()
        every[index] = x
        return every

    return Observations(
        rows.measured.ravel(),
        lambda x: rows.of(model.predict(readings.poses, full(x))).ravel(),
        lambda x: rows.of(model.sensitivity(readings.poses, full(x), names)).reshape(-1, len(names)),
        tuple(model.parameters[i] for i in index),
        rows.noise,
        np.repeat(rows.pose, 3),
        np.repeat(readings.rows[rows.keep], 3),
    )


def _one_step(
    experiment: Experiment, readings: Readings, names: Sequence[str], priors: bool, loss: str, fixed: Sequence[str],
    tied: Sequence[Sequence[str]], within: float = 0.0, profile: Sequence[str] = (),
) -> Fit:  # fmt: skip
    model = experiment.model()
    rows, source = fit_rows(experiment, readings, len(names), within)
    observations = displacement_observations(model, readings, rows, names)
    try:
        solution, unit = settled(observations, priors, loss, fixed, tied, source == "estimated")
    except NotIdentifiable as error:
        lost = [n for n in names if n in str(error)]
        said = [f"{n}: {what_would_help(model, n, readings.poses)}" for n in lost]
        raise NotIdentifiable("; ".join([str(error), *said])) from None
    x = model.nominal
    x[model.index(names)] = solution.x
    moved = [i for i, v in enumerate(np.diag(solution.covariance)) if v > 0.0]
    free = solution.jacobian[:, moved] * [observations.parameters[i].scale for i in moved]
    Q = orthonormal(free, solution.free)
    predicted = rows.of(model.predict(readings.poses, x))
    nominal = rows.of(model.predict(readings.poses, model.nominal))
    notes = words_of(priors, loss, fixed, tied, solution)
    found = Found(
        "one-step", x, solution.covariance, Q, rank_test(free, [names[i] for i in moved]), nominal, predicted,
        solution.at_bound, notes, unit, solution.free_sd,
    )  # fmt: skip
    fit = make_fit(model, list(observations.parameters), rows, readings, source, found)
    stated = source == "stated"
    return replace(fit, intervals=tuple(
        profile_interval(observations, solution, name, stated=stated, fixed=fixed) for name in profile
    ))  # fmt: skip


def orthonormal(rows: Array, free: int) -> Array:
    """Orthonormal columns (m, f) of what the readings can move, f at most the number of free parameters."""
    U, values, _ = np.linalg.svd(rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-300), full_matrices=False)
    return U[:, : min(free, int((values > 1e-9 * values[0]).sum()))]


def settled(
    observations: Observations, priors: bool, loss: str, fixed: Sequence[str], tied: Sequence[Sequence[str]],
    estimated: bool, start: Array | None = None, tolerance: float = 1e-9, starts: int = 5,
) -> tuple[Solution, float | None]:  # fmt: skip
    """The solution and the noise's unit; where priors or a robust loss need the unit, it is found with them."""
    if not estimated or (loss == "linear" and not priors):
        return solve(observations, start, priors, loss, fixed, tied, tolerance, starts=starts), None
    least = rounding(observations.noise, observations.measured)
    first = observations.measured - observations.predict(observations.start if start is None else start)
    unit = max(_size(observations.noise.whiten(first), 0, loss), least)
    for _ in range(_ROUNDS):
        scaled = replace(observations, noise=Scaled(observations.noise, unit, len(observations.measured)))
        solution = solve(scaled, start, priors, loss, fixed, tied, tolerance, starts=starts)
        new = max(unit * _size(solution.residuals, solution.free, loss), least)
        if abs(new - unit) <= _STILL * unit:
            return replace(solution, covariance=solution.covariance / unit**2, free_sd=solution.free_sd / unit), unit
        unit = new
    raise NotConverged(f"the size of the noise did not settle in {_ROUNDS} rounds; state sigma_mm in the experiment")


def _size(residuals: Array, free: int, loss: str) -> float:
    """Sd of residuals that `free` parameters were fitted to; of a robust loss by their median, which outliers spare."""
    share = len(residuals) / (len(residuals) - free)
    if loss == "linear":
        return float(np.sqrt(np.mean(residuals**2) * share))
    return float(_MAD * np.median(np.abs(residuals)) * np.sqrt(share))


@dataclass(frozen=True, eq=False)
class Scaled:
    """Noise `unit` times another."""

    noise: Noise
    unit: float
    count: int

    def whiten(self, values: Array) -> Array:
        return self.noise.whiten(values) / self.unit

    def log_det(self) -> float:
        return self.noise.log_det() + 2.0 * self.count * float(np.log(self.unit))

    def turned(self, values: Array) -> Array:
        return self.noise.turned(values) / self.unit

    def colour(self, values: Array) -> Array:
        return self.noise.colour(values) * self.unit

    def weights(self) -> Array:
        return self.noise.weights() / self.unit**2


def words_of(
    priors: bool, loss: str, fixed: Sequence[str], tied: Sequence[Sequence[str]], solution: Solution
) -> tuple[str, ...]:  # fmt: skip
    """What to say of how a fit was made."""
    said = ["Stated values and sds counted as readings."] if priors else []
    if loss != "linear":
        light = int((solution.weights < 0.5).sum())
        said.append(f"Loss {loss}: {light} coordinates lost more than half their weight.")
    said += [f"Fixed: {', '.join(fixed)}."] if fixed else []
    said += [f"Tied, in the ratio of their nominal values: {', '.join(group)}." for group in tied]
    said += [f"At a bound: {', '.join(solution.at_bound)}; the other sds hold while it stays there."] if (
        solution.at_bound) else []  # fmt: skip
    return tuple(said)
