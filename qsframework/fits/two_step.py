"""The two-step method on a whole arm: equations (19) to (22).

Step one fits an aggregated compliance of the balanced joint for each distinct angle of it, beside all other parameters.
Step two finds the joint's own stiffness and the balancer from these. The joint and its balancer are found by what the
model's effects do, not by their names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.elastostatics import Model
from qsframework.elastostatics.so3 import left_jacobian
from qsframework.errors import InputError, NotConverged
from qsframework.estimation import FitOptions, Observations, solve
from qsframework.estimation.projection import least_squares
from qsframework.estimation.solver import solution_at
from qsframework.experiment import Experiment, Frame, ObservationModel, ReadingRows, observation_model
from qsframework.experiment.frames import motion_count, spans
from qsframework.experiment.observations import start_values
from qsframework.fits.fit import Found
from qsframework.plugin import (
    Actuator,
    Array,
    Context,
    Indices,
    ParallelSpring,
    Parameter,
    Poses,
    RobotFacts,
    Spring,
    SpringLaw,
    laws,
)

_ANGLE = 1e-4
"""Angles of the balanced joint closer than this (rad) count as one."""


@dataclass(frozen=True, eq=False)
class Balanced:
    """The balanced joint: its index, its compliance, and the balancer's stiffness Kc (g + s0 h) at an angle."""

    joint: int
    compliance: str
    balancer: ParallelSpring
    stiffness: str
    free_length: str
    facts: RobotFacts

    def rows(self, q: Array) -> Array:
        """[1, g, h] (n, 3): K = row @ [K2, Kc, s0 Kc], from the effect itself."""
        return np.stack(
            [np.ones_like(q), self._value(q, 1.0, 0.0), self._value(q, 1.0, 1.0) - self._value(q, 1.0, 0.0)], axis=-1
        )

    def _value(self, q: Array, stiffness: float, free_length: float) -> Array:
        value = _stiffness(self.balancer, self.facts, q, stiffness, free_length)
        assert value is not None
        return value


def find_balanced(model: Model) -> Balanced:
    """The one joint that one balancer stiffens. InputError says what to use where there is none, or more than one."""
    found: list[Balanced] = []
    for effect in (e for e in model.effects if isinstance(e, ParallelSpring)):
        joints, names = effect.joints(model.facts), [p.name for p in effect.parameters(model.facts)]
        if len(joints) != 1 or len(names) != 2 or not _stiffens(effect, model.facts):
            continue
        joint = model.facts.joint_index(joints[0])
        spring = _spring_of(model, joints[0])
        if spring is not None:
            found.append(Balanced(joint, spring, effect, names[0], names[1], model.facts))
    if not found:
        raise InputError(
            "the two-step method is for an arm with a balancer whose stiffness is to be found: this model has none. "
            "Use method one-step"
        )
    if len(found) > 1:
        raise InputError(
            f"the two-step method knows one balancer; this model has {', '.join(b.balancer.name for b in found)}. Use "
            "method one-step, which fits them all at once"
        )
    if any(isinstance(e, SpringLaw) for e in model.effects):
        raise InputError("the two-step method needs springs that are linear in their torque. Use method one-step")
    return found[0]


def _stiffness(
    effect: ParallelSpring, facts: RobotFacts, q: Array, stiffness: float, free_length: float
) -> Array | None:
    """What an effect adds (n,) to its joint at angles q (n,); None where it has no stiffness."""
    every = np.zeros((len(q), facts.n))
    context = Context(facts, Poses(every, every, np.zeros((len(q), 6))))
    term = laws.stiffness(effect, q[:, None], np.array([stiffness, free_length]), context)
    return None if term is None else term.value[:, 0, 0]


def _stiffens(effect: ParallelSpring, facts: RobotFacts) -> bool:
    """Whether the effect has a stiffness Kc (g(q) + s0 h(q))."""
    q = np.array([0.3, 0.9])
    one, two, far = (_stiffness(effect, facts, q, *pair) for pair in ((1.0, 0.0), (1.0, 1.0), (2.0, 3.0)))
    if one is None or two is None or far is None:
        return False
    return bool(np.allclose(far, 2.0 * (one + 3.0 * (two - one)), rtol=1e-9))


def _spring_of(model: Model, joint: str) -> str | None:
    """Name of the compliance that turns a joint's actuator."""
    for effect in (e for e in model.effects if isinstance(e, Spring)):
        if effect.virtual_joints(model.facts) == (Actuator(joint),):
            return effect.parameters(model.facts)[0].name
    return None


def two_step(
    experiment: Experiment, rows: ReadingRows, names: Sequence[str], options: FitOptions, weighted: bool = True
) -> Found:
    """Estimate parameters in two steps; weighted False: step two by plain least squares, for comparison only.

    Raises InputError where the arm has no balancer, its stiffness is not to be fitted, or the readings have fewer than
    as many distinct angles of the balanced joint as step two has unknowns; NotConverged where a step finds a
    stiffness that is not positive.
    """
    model = experiment.model()
    balanced = find_balanced(model)
    unknowns = _unknowns(balanced, names)
    angles, group = distinct_angles(rows.readings.poses.q[:, balanced.joint], _ANGLE)
    used = np.unique(group[rows.plus])
    if len(used) < len(unknowns):
        said = ", ".join(f"{a:.1f}" for a in np.rad2deg(angles[used]))
        raise InputError(
            f"step two has {len(unknowns)} unknowns ({', '.join(unknowns)}) and needs as many distinct angles of "
            f"{model.facts.joints[balanced.joint]}: the readings have {len(used)} ({said} deg). Measure at more "
            "angles of this joint, or fit less"
        )
    x0 = start_values(experiment, names)
    seen = observation_model(experiment, rows.readings, names, linear=options.linear, x=x0, rows=rows)
    first = _StepOne(seen, balanced, angles[used], np.searchsorted(used, group[rows.plus]))
    z, covariance = first.run(weighted)
    solution = solution_at(seen.observations(), z, covariance)
    count = len(used)
    notes = (f"Step one found {count} aggregated compliances of {balanced.compliance}.",)
    return Found(
        seen=seen,
        solution=solution,
        covariance=covariance,
        method="two-step" if weighted else "two-step, unweighted",
        notes=notes,
    )


def _unknowns(balanced: Balanced, names: Sequence[str]) -> tuple[str, ...]:
    """The fitted parameters of step two, compliance first."""
    missing = [n for n in (balanced.compliance, balanced.stiffness) if n not in names]
    if missing:
        raise InputError(
            f"the two-step method estimates {balanced.compliance} and {balanced.stiffness}; not in the fit: "
            f"{', '.join(missing)}. Name them under `fit:`, or use method one-step"
        )
    more = (balanced.free_length,) if balanced.free_length in names else ()
    return (balanced.compliance, balanced.stiffness, *more)


@dataclass(frozen=True, eq=False)
class _StepOne:
    """The readings seen as those of an arm with a compliance of the balanced joint for each angle; group (R,)."""

    seen: ObservationModel
    balanced: Balanced
    angles: Array
    group: Indices

    @property
    def others(self) -> list[str]:
        second = (self.balanced.compliance, self.balanced.stiffness, self.balanced.free_length)
        return [n for n in self.seen.names if n not in second]

    @property
    def first(self) -> int:
        """Place of the first aggregated compliance among the parameters of step one."""
        return self.seen.motions + len(self.others)

    def run(self, weighted: bool) -> tuple[Array, Array]:
        """Motions of the frames and values of the fitted parameters z (p,), and their covariance (p, p)."""
        b, first, model = self.balanced, self.first, self.seen.model
        start = np.concatenate([np.zeros(self.seen.motions), self.seen.x[model.index(self.others)]])
        nominal = self.seen.x[model.index([b.compliance])[0]]
        solution = solve(self.observations(), start=np.concatenate([start, np.full(len(self.angles), nominal)]))
        k = solution.x[first:]
        if np.any(k <= 0.0):
            at = ", ".join(f"{a:.1f}" for a in np.rad2deg(self.angles[k <= 0.0]))
            raise NotConverged(f"step one finds no positive compliance of {b.compliance} at {at} deg. Use one-step")
        part = slice(first, first + len(self.angles))
        stiffness = 1.0 / k
        spread = stiffness_covariance(solution.covariance[part, part], stiffness)
        rows = b.rows(self.angles)
        free_length = b.free_length in self.seen.names
        if not free_length:
            s0 = self.seen.x[model.index([b.free_length])[0]]
            rows = np.stack([rows[:, 0], rows[:, 1] + s0 * rows[:, 2]], axis=1)
        found, second = step_two(rows, stiffness, spread, weighted)
        values, slope = _to_model(found)
        gain = step_two_gain(rows, spread, weighted)
        cross = slope @ gain @ (-(stiffness**2)[:, None] * solution.covariance[part, :first])
        joint = np.block([[solution.covariance[:first, :first], cross.T], [cross, slope @ second @ slope.T]])
        names = [*(p.name for p in self.seen.parameters[: self.seen.motions]), *self.others, b.compliance, b.stiffness]
        names += [b.free_length] if free_length else []
        place = [names.index(p.name) for p in self.seen.parameters]
        return np.concatenate([solution.x[:first], values])[place], joint[np.ix_(place, place)]

    def observations(self) -> Observations:
        """Step one: frames and other parameters, then n aggregated compliances, each seen at its own angle only."""
        rows, model = self.seen.rows, self.seen.model
        b, first, motions = self.balanced, self.first, self.seen.motions
        here, off = model.index([b.compliance, b.stiffness])
        index = model.index(self.others)
        parts = [
            (j, rows.take(np.flatnonzero(self.group == j)), np.flatnonzero(self.group[rows.row] == j))
            for j in range(len(self.angles))
        ]

        def full(z: Array, j: int) -> Array:
            every = self.seen.x.copy()
            every[off] = 0.0
            every[index], every[here] = z[motions:first], z[first + j]
            return every

        def predict(z: Array) -> Array:
            out = np.empty(len(rows.at))
            for j, own, at in parts:
                out[at] = own.flat(own.predict(model, full(z, j), self._frames(z, own), self.seen.linear))
            return out

        def jacobian(z: Array) -> Array:
            out = np.zeros((len(rows.at), first + len(self.angles)))
            for j, own, at in parts:
                frames = self._frames(z, own)
                J = own.flat(own.rates(model, full(z, j), frames, [*self.others, b.compliance], self.seen.linear)[1])
                for f, frame, here in zip(own.estimated, frames, spans(frames), strict=True):
                    there = spans(self.seen.frames)[rows.estimated.index(f)]
                    part = J[:, here]
                    if not frame.touched:
                        part = np.hstack([part[:, :3], part[:, 3:] @ left_jacobian(z[there][3:])])
                    out[at, there] = part
                out[at, motions:first] = J[:, motion_count(frames) : -1]
                out[at, first + j] = J[:, -1]
            return out

        return Observations(
            measured=rows.scalars,
            predict=predict,
            jacobian=jacobian,
            parameters=self._parameters(),
            noise=rows.noise,
            block=rows.together,
            row=rows.row,
            stated=rows.stated,
            reach=self.seen.reach,
        )

    def _frames(self, z: Array, own: ReadingRows) -> list[Frame]:
        """The frames of some rows after their motions."""
        moved = dict(zip(self.seen.rows.estimated, self.seen.moved(z), strict=True))
        return [moved[f] for f in own.estimated]

    def _parameters(self) -> tuple[Parameter, ...]:
        model = self.seen.model
        own = model.parameters[model.index([self.balanced.compliance])[0]]
        aggregated = (replace(own, name=f"{own.name} at {a:.1f} deg", null=None) for a in np.rad2deg(self.angles))
        others = (model.parameters[i] for i in model.index(self.others))
        return (*self.seen.parameters[: self.seen.motions], *others, *aggregated)


def _to_model(found: Array) -> tuple[Array, Array]:
    """[k2, Kc, s0] or [k2, Kc] from [K2, Kc, s0 Kc] or [K2, Kc], and the derivative."""
    K2, Kc = found[:2]
    if K2 <= 0.0 or Kc <= 0.0:
        raise NotConverged(
            f"step two finds K2 = {K2:.3g} N m/rad and Kc = {Kc:.3g} N/m: not positive, so these readings do not "
            "identify the balancer. Use one-step within bounds"
        )
    slope = np.diag([-1.0 / K2**2, 1.0, *([1.0 / Kc] if len(found) == 3 else [])])
    if len(found) == 2:
        return np.array([1.0 / K2, Kc]), slope
    slope[2, 1] = -found[2] / Kc**2
    return np.array([1.0 / K2, Kc, found[2] / Kc]), slope


def distinct_angles(q2: Array | Sequence[float], tolerance: float = 1e-6) -> tuple[Array, Indices]:
    """The distinct angles (n,) rad, ascending, and for each given one (N,) which of them it is.

    Angles within `tolerance` of their neighbour count as one, their mean.
    """
    q2 = np.asarray(q2, dtype=float)
    order = np.argsort(q2, kind="stable")
    new = np.diff(q2[order], prepend=-np.inf) > tolerance
    group = np.empty(len(q2), dtype=np.intp)
    group[order] = np.cumsum(new) - 1
    return np.bincount(group, q2) / np.bincount(group), group


def stiffness_covariance(compliance: Array, stiffness: Array | float) -> Array:
    """Covariance (n, n) of K_i = 1 / k_i from that of the compliances k_i: d K / d k = -K^2."""
    slope = np.broadcast_to(np.square(stiffness), compliance.shape[-1:])
    return slope[:, None] * compliance * slope


def step_two_information(rows: Array, covariance: Array | None = None) -> Array:
    """Information (3, 3) on K2, Kc, s0 Kc of aggregated stiffnesses: rows (n, 3) of (22), covariance (n, n) of (20).

    Without a covariance every stiffness weighs alike with unit variance.
    """
    white = rows if covariance is None else np.linalg.solve(np.linalg.cholesky(covariance), rows)
    return white.T @ white


def step_two_gain(rows: Array, covariance: Array, weighted: bool = True) -> Array:
    """d K2, Kc, s0 Kc (3, n) / d stiffness: least squares of aggregated stiffnesses, weighted by their covariance."""
    L = np.linalg.cholesky(covariance) if weighted else np.eye(len(rows))
    return least_squares(np.linalg.solve(L, rows), np.linalg.inv(L))


def step_two(rows: Array, stiffness: Array, covariance: Array, weighted: bool = True) -> tuple[Array, Array]:
    """Solve (21): K2, Kc, s0 Kc (3,) and their covariance from aggregated stiffnesses (n,), N m/rad."""
    gain = step_two_gain(rows, covariance, weighted)
    return gain @ stiffness, gain @ covariance @ gain.T
