"""The two-step method on a whole arm: equations (19) to (22).

Step one fits an aggregated compliance of the balanced joint for each distinct angle of it, beside all other parameters.
Step two finds the joint's own stiffness and the balancer from these. The joint and its balancer are found by what the
model's effects do, not by their names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics import Model
from qsframework.errors import InputError, NotConverged
from qsframework.experiment import Experiment, Readings
from qsframework.identify.fit import Fit
from qsframework.identify.linear import Found, Rows, fit_rows, make_fit
from qsframework.identify.observations import Observations
from qsframework.identify.solve import solve
from qsframework.information import rank_test, scales
from qsframework.information.two_step import distinct_angles, step_two, stiffness_covariance
from qsframework.plugin import Actuator, Array, Conditions, Indices, ParallelSpring, Parameter, Spring, SpringLaw

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

    def rows(self, q: Array) -> Array:
        """[1, g, h] (n, 3): K = row @ [K2, Kc, s0 Kc], from the effect itself."""
        return np.stack([np.ones_like(q), self._value(q, 1.0, 0.0),
                         self._value(q, 1.0, 1.0) - self._value(q, 1.0, 0.0)], axis=-1)  # fmt: skip

    def _value(self, q: Array, stiffness: float, free_length: float) -> Array:
        term = self.balancer.stiffness(q[:, None], np.array([stiffness, free_length]), Conditions(None, None, None))
        assert term is not None
        return term.value[:, 0, 0]


def find_balanced(model: Model) -> Balanced:
    """The one joint that a balancer stiffens. InputError says what to use where there is none, or more than one."""
    found: list[Balanced] = []
    for effect in (e for e in model.effects if isinstance(e, ParallelSpring)):
        joints, names = effect.joints(model.facts), [p.name for p in effect.parameters(model.facts)]
        if len(joints) != 1 or len(names) != 2 or not _stiffens(effect):
            continue
        joint = model.facts.joint_index(joints[0])
        spring = _spring_of(model, joints[0])
        if spring is not None:
            found.append(Balanced(joint, spring, effect, names[0], names[1]))
    if not found:
        raise InputError(
            "the two-step method is for an arm with a balancer whose stiffness is to be found (effect "
            "compensator_stiffness): this model has none. Use method linear"
        )
    if len(found) > 1:
        raise InputError("the two-step method knows one balanced joint; this model has more. Use method one-step")
    if any(isinstance(e, SpringLaw) for e in model.effects):
        raise InputError("the two-step method needs springs that are linear in their torque. Use method one-step")
    return found[0]


def _stiffens(effect: ParallelSpring) -> bool:
    """Whether the effect has a stiffness Kc (g(q) + s0 h(q))."""
    q = np.array([[0.3], [0.9]])

    def value(stiffness: float, free_length: float) -> Array | None:
        term = effect.stiffness(q, np.array([stiffness, free_length]), Conditions(None, None, None))
        return None if term is None else term.value[:, 0, 0]

    one, two, far = value(1.0, 0.0), value(1.0, 1.0), value(2.0, 3.0)
    if one is None or two is None or far is None:
        return False
    return bool(np.allclose(far, 2.0 * (one + 3.0 * (two - one)), rtol=1e-9))


def _spring_of(model: Model, joint: str) -> str | None:
    """Name of the compliance that turns a joint's actuator."""
    for effect in (e for e in model.effects if isinstance(e, Spring)):
        if effect.virtual_joints(model.facts) == (Actuator(joint),):
            return effect.parameters(model.facts)[0].name
    return None


def identify_two_step(
    experiment: Experiment, readings: Readings, names: Sequence[str], weighted: bool = True, shared: float = 0.0
) -> Fit:  # fmt: skip
    """Estimate parameters in two steps; weighted False: step two by plain least squares, for comparison only.

    shared: sd of the error that the markers of a pose share, see `fit_rows`.

    Raises InputError where the arm has no balancer, its stiffness is not to be fitted, or the readings have fewer than
    as many distinct angles of the balanced joint as step two has unknowns; NotConverged where a step finds a
    stiffness that is not positive.
    """
    model = experiment.model()
    balanced = find_balanced(model)
    unknowns = _unknowns(balanced, names)
    rows, source = fit_rows(experiment, readings, len(names), shared)
    angles, group = distinct_angles(readings.poses.q[:, balanced.joint], _ANGLE)
    used = np.unique(group[rows.measurement])
    if len(used) < len(unknowns):
        said = ", ".join(f"{a:.1f}" for a in np.rad2deg(angles[used]))
        raise InputError(
            f"step two has {len(unknowns)} unknowns ({', '.join(unknowns)}) and needs as many distinct angles of "
            f"{model.facts.joints[balanced.joint]}: the readings have {len(used)} ({said} deg). Measure at more "
            "angles of this joint, or fit less"
        )
    first = _StepOne(model, balanced, readings, rows, names, angles[used], np.searchsorted(used, group))
    x, covariance = first.run(weighted)
    chosen = [model.parameters[i] for i in model.index(names)]
    A = rows.of(model.sensitivity(readings.poses, x, names))
    whitened = rows.noise.whiten((A * scales(chosen)).reshape(-1, len(names)))
    found = Found(
        "two-step" if weighted else "two-step, unweighted", x, covariance, np.linalg.qr(whitened)[0],
        rank_test(whitened, names), rows.of(model.predict(readings.poses, model.nominal)),
        rows.of(model.predict(readings.poses, x)),
        notes=(f"Step one found {len(used)} aggregated compliances of {balanced.compliance}.",),
    )  # fmt: skip
    return make_fit(model, chosen, rows, readings, source, found)


def _unknowns(balanced: Balanced, names: Sequence[str]) -> tuple[str, ...]:
    """The fitted parameters of step two, compliance first."""
    missing = [n for n in (balanced.compliance, balanced.stiffness) if n not in names]
    if missing:
        raise InputError(
            f"the two-step method estimates {balanced.compliance} and {balanced.stiffness}; not in the fit: "
            f"{', '.join(missing)}. Name them under `fit:` or with --fit, or use method linear"
        )
    more = (balanced.free_length,) if balanced.free_length in names else ()
    return (balanced.compliance, balanced.stiffness, *more)


@dataclass(frozen=True, eq=False)
class _StepOne:
    """The readings seen as those of an arm with a compliance of the balanced joint for each angle."""

    model: Model
    balanced: Balanced
    readings: Readings
    rows: Rows
    names: Sequence[str]
    angles: Array
    group: Indices

    @property
    def others(self) -> list[str]:
        second = (self.balanced.compliance, self.balanced.stiffness, self.balanced.free_length)
        return [n for n in self.names if n not in second]

    def run(self, weighted: bool) -> tuple[Array, Array]:
        """All parameters x and the covariance (p, p) of the fitted ones."""
        model, b, count = self.model, self.balanced, len(self.angles)
        others = self.others
        solution = solve(self.observations())
        k = solution.x[len(others) :]
        if np.any(k <= 0.0):
            at = ", ".join(f"{a:.1f}" for a in np.rad2deg(self.angles[k <= 0.0]))
            raise NotConverged(f"step one finds no positive compliance of {b.compliance} at {at} deg. Use one-step")
        part = slice(len(others), len(others) + count)
        stiffness = 1.0 / k
        spread = stiffness_covariance(solution.covariance[part, part], stiffness)
        rows = b.rows(self.angles)
        x = model.nominal
        if b.free_length not in self.names:
            s0 = x[model.index([b.free_length])[0]]
            rows = np.stack([rows[:, 0], rows[:, 1] + s0 * rows[:, 2]], axis=1)
        found, second = step_two(rows, stiffness, spread, weighted)
        values, slope = _to_model(found)
        gain = _gain(rows, spread, weighted)
        cross = slope @ gain @ (-(stiffness**2)[:, None] * solution.covariance[part, : len(others)])
        order = [*others, b.compliance, b.stiffness, *([b.free_length] if len(found) == 3 else [])]
        joint = np.block([[solution.covariance[: len(others), : len(others)], cross.T],
                          [cross, slope @ second @ slope.T]])  # fmt: skip
        x[model.index(order)] = np.concatenate([solution.x[: len(others)], values])
        place = [order.index(n) for n in self.names]
        return x, joint[np.ix_(place, place)]

    def observations(self) -> Observations:
        """Step one: other parameters, then the n aggregated compliances, each seen by the poses at its angle only."""
        model, b = self.model, self.balanced
        others, (here, off) = self.others, model.index([b.compliance, b.stiffness])
        index = model.index(others)
        of_row = self.group[self.rows.measurement]
        parts = [(j, np.flatnonzero(self.group == j)) for j in range(len(self.angles))]

        def full(x: Array, j: int) -> Array:
            every = model.nominal
            every[off] = 0.0
            every[index], every[here] = x[: len(others)], x[len(others) + j]
            return every

        def predict(x: Array) -> Array:
            out = np.empty((len(self.readings.poses), len(model.markers), 3))
            for j, those in parts:
                out[those] = model.predict(self.readings.poses.take(those), full(x, j))
            return self.rows.of(out).ravel()

        def jacobian(x: Array) -> Array:
            out = np.empty((len(self.readings.poses), len(model.markers), 3, len(others) + 1))
            for j, those in parts:
                wanted = [*others, b.compliance]
                out[those] = model.sensitivity(self.readings.poses.take(those), full(x, j), wanted)
            A = self.rows.of(out)
            own = np.where(of_row[:, None, None] == np.arange(len(self.angles)), A[..., -1:], 0.0)
            return np.concatenate([A[..., :-1], own], axis=-1).reshape(-1, len(others) + len(self.angles))

        return Observations(
            self.rows.measured.ravel(), predict, jacobian, self._parameters(),
            self.rows.noise, np.repeat(self.rows.pose, 3),
            np.repeat(self.readings.rows[self.rows.keep], 3),
        )  # fmt: skip

    def _parameters(self) -> tuple[Parameter, ...]:
        own = self.model.parameters[self.model.index([self.balanced.compliance])[0]]
        aggregated = [
            Parameter(f"{own.name} at {a:.1f} deg", own.unit, own.nominal, own.typical, own.sd, own.lower, own.upper)
            for a in np.rad2deg(self.angles)
        ]
        return (*(self.model.parameters[i] for i in self.model.index(self.others)), *aggregated)


def _to_model(found: Array) -> tuple[Array, Array]:
    """[k2, Kc, s0] or [k2, Kc] from [K2, Kc, s0 Kc] or [K2, Kc], and the derivative."""
    K2, Kc = found[:2]
    if K2 <= 0.0 or Kc <= 0.0:
        raise NotConverged(
            f"step two finds K2 = {K2:.3g} N m/rad and Kc = {Kc:.3g} N/m: not positive, so these readings do not tell "
            "the balancer. Use one-step, which keeps the bounds"
        )
    slope = np.diag([-1.0 / K2**2, 1.0, *([1.0 / Kc] if len(found) == 3 else [])])
    if len(found) == 2:
        return np.array([1.0 / K2, Kc]), slope
    slope[2, 1] = -found[2] / Kc**2
    return np.array([1.0 / K2, Kc, found[2] / Kc]), slope


def _gain(rows: Array, covariance: Array, weighted: bool) -> Array:
    """d found / d stiffness (3, n) of step two."""
    L = np.linalg.cholesky(covariance) if weighted else np.eye(len(rows))
    A = np.linalg.solve(L, rows)
    size: Array = np.linalg.norm(A, axis=0)
    return np.linalg.lstsq(A / size, np.linalg.inv(L), rcond=None)[0] / size[:, None]
