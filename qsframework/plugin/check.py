"""`check_effect`: does an effect keep the protocol? Run it on every effect you write."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from qsframework import units
from qsframework.arguments import checked
from qsframework.errors import InputError, PluginError
from qsframework.plugin import laws
from qsframework.plugin.facts import Array, Conditions, Context, Poses, RobotFacts, came_from, frozen
from qsframework.plugin.kinds import Effect, Geometry, Load, Loop, ParallelSpring, Sensor, Spring, SpringLaw
from qsframework.plugin.laws import as_term, difference
from qsframework.plugin.loops import with_branches
from qsframework.plugin.parameter import Parameter
from qsframework.plugin.rotations import exponential
from qsframework.plugin.terms import (
    Actuator,
    Bar,
    GeometryTerm,
    LawTerm,
    Loads,
    LoopTerm,
    Reading,
    SensorTerm,
    StiffnessTerm,
    TensionTerm,
    TorqueTerm,
    VirtualJoint,
)

BATCH = 5
_TOLERANCE = 1e-6
_SMALL = 1e-12
Function = Callable[[Array], Any]


def sample_robot() -> RobotFacts:
    """A heavy six-axis arm with a parallelogram's axes, to try effects on. The values are made up."""
    placements = np.tile(np.eye(4), (6, 1, 1))
    placements[:, :3, 3] = [(0, 0, 0.9), (0.4, 0, 0), (0, 0, 1.1), (0, 0, 0.25), (1.3, 0, 0), (0.3, 0, 0)]
    axes = np.array([(0, 0, 1), (0, 1, 0), (0, -1, 0), (-1, 0, 0), (0, -1, 0), (-1, 0, 0)], dtype=float)
    centres = np.array([(0, 0, 0), (0.2, 0, -0.1), (0, 0, 0.5), (0.1, 0, 0.2), (0.6, 0, 0), (0, 0, 0), (0, 0, 0.1)])
    return RobotFacts(
        name="sample",
        joints=tuple(f"joint_{k}" for k in range(1, 7)),
        links=("base_link", *(f"link_{k}" for k in range(1, 7))),
        axes=frozen(axes),
        placements=frozen(placements),
        masses=frozen([1000, 900, 500, 700, 250, 120, 60]),
        centres=frozen(centres),
        payload=700.0,
    )


def cuts(length: int) -> range:
    """Where files of examples are cut off: at 40 places, so that each part of a head is met."""
    return range(0, length, length // 40 or 1)


@dataclass(frozen=True)
class Report:
    """The names of the checks that held, and what did not."""

    passed: list[str] = field(default_factory=list[str])
    failed: list[str] = field(default_factory=list[str])

    def record(self, label: str, ok: bool, detail: str = "") -> None:
        """One check, and what to say where it failed."""
        (self.passed if ok else self.failed).append(label if ok else f"{label}: {detail}")

    def attempt(self, label: str, job: Callable[[], Any]) -> Any:
        """What a job of the effect gives; None where it fails, which is recorded."""
        try:
            return job()
        except Exception as error:  # whatever a stranger's law does
            said = str(error) if isinstance(error, InputError | PluginError) else f"{type(error).__name__}: {error}"
            self.record(label, False, said)
            return None

    def bears(self, label: str, job: Callable[[], Any]) -> None:
        """Whether a job with a spoilt file gives anything, or an InputError."""
        try:
            job()
        except InputError:
            pass
        except Exception as error:  # whatever a stranger's code does
            self.record(label, False, f"{type(error).__name__}: {error}")
            return
        self.record(label, True)

    def law(self, label: str, function: Function, at: Array, slope: Any = None, size: Array | None = None) -> None:
        """A law, a function of the variable `at`: pure, finite, and with this derivative if there is one."""
        before = at.copy()
        found = self.attempt(label, lambda: (np.asarray(function(at)), np.asarray(function(at))))
        if found is None:
            return
        same = np.array_equal(found[0], found[1], equal_nan=True) and np.array_equal(before, at)
        self.record(f"{label} is pure", same, "two calls differ or the input was changed")
        finite = bool(np.isfinite(found[0]).all())
        self.record(f"{label} is finite", finite, "it gives NaN or infinity")
        if slope is None or not finite:
            return
        numeric, slope = self.attempt(label, lambda: difference(function, at, size)), np.asarray(slope)
        if numeric is None:
            return
        if slope.shape != numeric.shape:
            found_shape = f"derivative has shape {slope.shape}, must be {numeric.shape}"
            self.record(f"{label} shape", False, found_shape)
            return
        most = np.abs(numeric).max(initial=0.0)
        error = np.abs(slope - numeric).max(initial=0.0) / (max(most, _SMALL) if most > 0.0 else 1.0)
        said = f"differs from finite differences by {error:.1e} relative"
        self.record(f"{label} derivative", bool(error < _TOLERANCE), said)


@dataclass(frozen=True, eq=False, kw_only=True)
class Trial:
    """An effect and what its laws are asked at: parameters x (p,) of natural sizes (p,), at some loaded poses."""

    effect: Any
    robot: RobotFacts
    x: Array
    size: Array
    context: Context
    rng: np.random.Generator
    report: Report

    def vanishes(self, label: str, value: Callable[[Array, Context], Any]) -> None:
        """A law at the parameters' null values, and in the other state."""
        parameters = self.effect.parameters(self.robot)
        if any(p.null is not None for p in parameters):
            null = np.array([v if p.null is None else p.null for p, v in zip(parameters, self.x, strict=True)])
            left = self.report.attempt(f"null value of {label}", lambda: np.asarray(value(null, self.context)))
            if left is not None:
                most = float(np.abs(left).max(initial=0.0))
                said = f"{self.effect.name} does not vanish at its null value: it still gives {most:.3g}"
                self.report.record(f"null value of {label}", not most > _SMALL, said)
        if self.effect.by_state or self.effect.needs or isinstance(self.effect, Sensor):
            return
        other = Context(self.robot, self.context.poses, loaded=False)
        both = self.report.attempt(label, lambda: [np.asarray(value(self.x, c)) for c in (self.context, other)])
        if both is not None:
            said = "it differs between the loaded and the unloaded state: set by_state = True"
            self.report.record(f"one {label} in both states", np.array_equal(*both, equal_nan=True), said)


@checked
def check_effect(effect: Effect, robot: RobotFacts | None = None, seed: int = 0) -> tuple[str, ...]:
    """Check an effect: names, units, shapes, derivatives by finite differences, no effect at its null value, purity.

    Args:
        effect: the effect to check.
        robot: facts of the arm on which it is tried; a small one of its own if None.
        seed: random seed of the values that are tried.

    Returns:
        The names of the checks that held.

    Raises:
        PluginError: lists all checks that did not hold.
    """
    robot = with_branches(robot or sample_robot(), [effect])
    rng = np.random.default_rng(seed)
    report = Report()
    _declaration(effect, robot, report)
    x = report.attempt("parameters", lambda: _sample_parameters(effect, robot, rng))
    if x is not None:
        context = Context(robot, _poses(robot, rng, BATCH))
        size = laws.sizes(effect, x, context)
        trial = Trial(effect=effect, robot=robot, x=x, size=size, context=context, rng=rng, report=report)
        for kind, check in _CHECKS.items():
            if isinstance(effect, kind):
                report.attempt(kind.__name__, partial(check, trial))
    if report.failed:
        said = "\n  ".join(dict.fromkeys(report.failed))
        raise PluginError(f"{effect.name} breaks the plugin protocol:\n  {said}")
    return tuple(dict.fromkeys(report.passed))


def sample_context(robot: RobotFacts, count: int = 1) -> Context:
    """Some poses of a robot under some load, with conditions, to try laws at."""
    return Context(robot, _poses(robot, np.random.default_rng(0), count))


def _declaration(effect: Effect, robot: RobotFacts, report: Report) -> None:
    parameters = report.attempt("parameters", lambda: effect.parameters(robot)) or ()
    report.record("docstring", bool(type(effect).__doc__), "the class needs a sentence on its physics")
    stated = getattr(type(effect), "__dataclass_params__", None)
    report.record("frozen", stated is not None and stated.frozen, "make it a frozen dataclass")
    for p in parameters:
        report.record(f"unit of {p.name}", units.known(p.unit), f"pint does not know {p.unit!r}")
        own = p.name == effect.name or p.name.startswith(effect.name + ".")
        report.record(f"name of {p.name}", own, f"must be {effect.name} or {effect.name}.something")
    report.record("distinct names", len({p.name for p in parameters}) == len(parameters), "two parameters share a name")
    strange = [n for n in effect.needs if n not in _NEEDED]
    report.record("needs", not strange, f"unknown {', '.join(strange)}; allowed: {', '.join(_NEEDED)}")
    if report.attempt("validate", lambda: effect.require_fit(robot) or True):
        report.record("validate", True)
    for place in report.attempt("places", lambda: type(effect).places(robot, ("m1",))) or ():
        mine = isinstance(place, type(effect))
        report.record(f"place {place.name}", mine, "places must give instances of the effect")


_NEEDED = ("time", "temperature", "approach", "order")


def _sample_parameters(effect: Effect, robot: RobotFacts, rng: np.random.Generator) -> Array:
    def draw(p: Parameter) -> float:
        value = p.nominal + p.typical * rng.uniform(0.2, 1.0)
        return float(np.clip(value, p.lower, p.upper))

    return np.array([draw(p) for p in effect.parameters(robot)])


def _conditions(rng: np.random.Generator, q: Array) -> Conditions:
    count = len(q)
    time, warm, order = rng.uniform(0, 1e4, count), rng.uniform(285, 305, count), rng.uniform(0, 1, count)
    return Conditions(time, warm, rng.choice([-1.0, 1.0], count), order, came_from(q, order))


def _poses(robot: RobotFacts, rng: np.random.Generator, count: int) -> Poses:
    q = rng.uniform(-1, 1, (count, robot.n))
    pendant = q[:, [robot.joint_index(joint) for joint in robot.driven]]
    conditions = _conditions(rng, q), _conditions(rng, q)
    return Poses(pendant, q, rng.normal(0, 1e3, (count, 6)), *conditions)


def _geometry(t: Trial) -> None:
    def errors(x: Array, context: Context) -> GeometryTerm:
        return as_term(GeometryTerm, t.effect.errors(x, context))

    term = laws.geometry(t.effect, t.x, t.context)
    if not laws.left_out(errors(t.x, t.context).angles):
        t.report.law("angles by x", lambda v: errors(v, t.context).angles, t.x, term.angles_dx, t.size)
        t.vanishes("angles", lambda v, c: errors(v, c).angles)
    if term.twists is not None:
        t.report.law("twists by x", lambda v: errors(v, t.context).twists, t.x, term.twists_dx, t.size)
        t.vanishes("twists", lambda v, c: errors(v, c).twists)


def _loop(t: Trial) -> None:
    effect, robot, report = t.effect, t.robot, t.report
    k, m = len(effect.joints(robot)), len(t.x)
    u = np.concatenate([t.rng.uniform(-0.5, 0.5, (BATCH, k)), t.rng.normal(0, 1e-4, (BATCH, m))], axis=1)

    def closure(v: Array) -> LoopTerm:
        return as_term(LoopTerm, effect.closure(v[:, :k], v[:, k:], t.context))

    term = laws.closure(effect, u[:, :k], u[:, k:], t.context)
    report.law("closure", lambda v: closure(v).q, u, term.q_u)
    if not laws.left_out(closure(u).slope):
        report.law("closure slope", lambda v: closure(v).q_u, u, term.q_uu)
    perfect = closure(np.concatenate([u[:, :k], np.zeros((BATCH, m))], axis=1)).q
    back = effect.actuators(perfect, robot)
    off = np.abs(back - u[:, :k]).max()
    report.record("actuators", bool(off < 1e-9), f"actuators(closure(phi)) is not phi (off by {off:.1e})")
    report.law("transmission angle", lambda v: effect.transmission_angle(v, robot), perfect)


def _spring(t: Trial) -> None:
    virtual = t.effect.virtual_joints(t.robot)
    for joint in virtual:
        if isinstance(joint, Actuator):
            t.report.attempt("virtual joints", partial(t.robot.joint_index, joint.joint))
        elif isinstance(joint, VirtualJoint):
            t.report.attempt("virtual joints", partial(t.robot.link_index, joint.link))
        elif not isinstance(joint, Bar):
            t.report.record("virtual joints", False, f"{joint!r} is not an Actuator, Bar or VirtualJoint")
    t.report.law("mixing", lambda v: laws.mixing(t.effect, v, t.context), t.x)


def _parallel(t: Trial) -> None:
    effect, x, context, report = t.effect, t.x, t.context, t.report
    q = t.rng.uniform(-1, 1, (BATCH, len(effect.joints(t.robot))))
    faces = ((effect.torque, TorqueTerm, laws.torque), (effect.stiffness, StiffnessTerm, laws.stiffness))
    every = 0
    for law, kind, complete in faces:

        def value(q: Array, x: Array, c: Context = context, law: Any = law, kind: Any = kind) -> Any:
            found, name = law(q, x, c), law.__name__
            if found is None:
                raise PluginError(f"{name} is None at some angles or parameters and not at others")
            return as_term(kind, found)

        name, term = law.__name__, complete(effect, q, x, context)
        if term is None:
            continue
        every += 1
        report.law(f"{name} by q", lambda v: value(v, x).value, q, term.dq)
        report.law(f"{name} by x", lambda v: value(q, v).value, x, term.dx, t.size)
        if isinstance(term, TorqueTerm) and term.dqq is not None:
            report.law("slope by q", lambda v: value(v, x).dq, q, term.dqq)
        if isinstance(term, TorqueTerm) and term.dqx is not None:
            report.law("slope by x", lambda v: value(q, v).dq, x, term.dqx, t.size)
        t.vanishes(name, lambda v, c: value(q, v, c).value)
    if effect.ends(t.robot) is not None:
        _tension(t)
    elif not every:
        report.record("faces", False, f"{effect.name} has neither torque, stiffness nor ends")


def _tension(t: Trial) -> None:
    s = t.rng.uniform(0.5, 1.5, (BATCH, 1))

    def value(s: Array, x: Array, c: Context = t.context) -> Array:
        return as_term(TensionTerm, t.effect.tension(s[:, 0], x, c)).value

    term = laws.tension(t.effect, s[:, 0], t.x, t.context)
    t.report.law("tension by s", lambda v: value(v, t.x), s, term.ds[:, None])
    t.report.law("tension by x", lambda v: value(s, v), t.x, term.dx, t.size)
    t.vanishes("tension", lambda v, c: value(s, v, c))


def _law(t: Trial) -> None:
    torque = t.rng.uniform(-1e4, 1e4, (BATCH, len(t.effect.springs(t.robot))))

    def value(T: Array, x: Array, c: Context = t.context) -> Array:
        return as_term(LawTerm, t.effect.extra(T, x, c)).value

    term = laws.extra(t.effect, torque, t.x, t.context)
    for k in range(torque.shape[1]):  # a coordinate's slope is by its own torque, whatever else it looks at
        one = np.eye(torque.shape[1])[k]

        def own(v: Array, k: int = k, one: Array = one) -> Array:
            return value(torque + (v - torque[:, [k]]) * one, t.x)[:, [k]]

        t.report.law("law by torque", own, torque[:, [k]], term.dT[:, [k], None])
    t.report.law("law by x", lambda v: value(torque, v), t.x, term.dx, t.size)
    t.vanishes("law", lambda v, c: value(torque, v, c))


def _rotations(rng: np.random.Generator, *shape: int) -> Array:
    q = np.linalg.qr(rng.normal(size=(*shape, 3, 3)))[0]
    return q * np.linalg.det(q)[..., None, None]


def _load(t: Trial) -> None:
    rotation, wrench, report = _rotations(t.rng, BATCH), t.context.poses.wrench, t.report

    def apply(w: Array, x: Array, small: Array | None = None, c: Context = t.context) -> Any:
        turned = rotation if small is None else exponential(small) @ rotation
        return laws.loaded(t.effect, Loads(w, turned, t.robot.moments), x, c)

    term = laws.apply(t.effect, Loads(wrench, rotation, t.robot.moments), t.x, t.context)
    report.law("wrench by wrench", lambda v: apply(v, t.x).wrench, wrench, term.d_wrench)
    report.law("wrench by x", lambda v: apply(wrench, v).wrench, t.x, term.dx, t.size)
    none = np.zeros((BATCH, 6, 3)) if term.d_rotation is None else term.d_rotation
    report.law("wrench by rotation", lambda v: apply(wrench, t.x, v).wrench, np.zeros((BATCH, 3)), none)
    t.vanishes("wrench", lambda v, c: apply(wrench, v, None, c).wrench - wrench)
    if term.moments is not None:
        report.law("moments by x", lambda v: apply(wrench, v).moments, t.x, term.moments_dx, t.size)
        t.vanishes("moments", lambda v, c: apply(wrench, v, None, c).moments)


def _sensor(t: Trial) -> None:
    position, rotation = t.rng.normal(0, 2, (BATCH, 2, 3)), _rotations(t.rng, BATCH, 2)
    markers = (getattr(t.effect, "marker", "m1"), "m2")

    def read(p: Array, x: Array, small: Array | None = None, c: Context = t.context) -> Array:
        turned = rotation if small is None else exponential(small[:, None, :]) @ rotation
        return as_term(SensorTerm, t.effect.read(Reading(p, turned, markers), x, c)).position

    shift, x, report = np.zeros((BATCH, 3)), t.x, t.report
    t.vanishes("reading", lambda v, c: read(position, v, None, c) - position)
    term = laws.read(t.effect, Reading(position, rotation, markers), x, t.context)
    report.law("position by position", lambda v: read(position + v[:, None, :], x), shift, term.d_position)
    report.law("position by x", lambda v: read(position, v), x, term.dx, t.size)
    none = np.zeros((BATCH, 2, 3, 3)) if term.d_rotation is None else term.d_rotation
    report.law("position by rotation", lambda v: read(position, x, v), shift, none)


_CHECKS: dict[type[Effect], Callable[[Trial], None]] = {
    Geometry: _geometry,
    Loop: _loop,
    Spring: _spring,
    ParallelSpring: _parallel,
    SpringLaw: _law,
    Load: _load,
    Sensor: _sensor,
}
