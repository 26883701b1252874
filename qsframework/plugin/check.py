"""`check_effect`: does an effect keep the protocol? Run it on every effect you write."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeVar, cast

import numpy as np

from qsframework import units
from qsframework.errors import InputError, PluginError
from qsframework.plugin.facts import Array, Conditions, Poses, RobotFacts, frozen
from qsframework.plugin.kinds import Effect, Geometry, Load, Loop, ParallelSpring, Sensor, Spring, SpringLaw
from qsframework.plugin.loops import with_branches
from qsframework.plugin.parameter import Parameter
from qsframework.plugin.terms import Actuator, Bar, Loads, Reading, StiffnessTerm, TorqueTerm, VirtualJoint

T = TypeVar("T")
BATCH = 5
_STEP = 1e-5
_TOLERANCE = 1e-6
Case = tuple[str, Callable[[Array], Any], Array, Any]
"""What is differentiated by what: label, value as a function of the variable, the variable, the derivative."""


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


def check_effect(effect: Effect, robot: RobotFacts | None = None, seed: int = 0) -> tuple[str, ...]:
    """Check shapes, derivatives (finite differences), vanishing at the null value, purity and units.

    Returns the names of the checks that held. Raises PluginError that lists all that did not.
    """
    robot = with_branches(robot or sample_robot(), [effect])
    rng = np.random.default_rng(seed)
    failures: list[str] = []
    passed: list[str] = []

    def record(label: str, ok: bool, detail: str = "") -> None:
        (passed if ok else failures).append(label if ok else f"{label}: {detail}")

    _check_declaration(effect, robot, record)
    x = _sample_parameters(effect, robot, rng)
    if not failures:
        for label, function, variable, derivative in _cases(effect, robot, x, rng):
            _check_case(label, function, variable, derivative, record)
    if failures:
        raise PluginError(f"{effect.name} breaks the plugin protocol:\n  " + "\n  ".join(failures))
    return tuple(passed)


def _check_declaration(effect: Effect, robot: RobotFacts, record: Callable[..., None]) -> None:
    parameters = effect.parameters(robot)
    record("docstring", bool(type(effect).__doc__), "the class needs a sentence on its physics")
    stated = getattr(type(effect), "__dataclass_params__", None)
    record("frozen", stated is not None and stated.frozen, "make it a frozen dataclass")
    for p in parameters:
        record(f"unit of {p.name}", units.known(p.unit), f"pint does not know {p.unit!r}")
        record(
            f"name of {p.name}",
            p.name == effect.name or p.name.startswith(effect.name + "."),
            f"must be {effect.name} or {effect.name}.something",
        )
    record("distinct names", len({p.name for p in parameters}) == len(parameters), "two parameters share a name")
    try:
        effect.validate(robot)
        record("validate", True)
    except InputError as error:
        record("validate", False, str(error))
    for place in type(effect).places(robot, ("m1",)):
        record(f"place {place.name}", isinstance(place, type(effect)), "places must give instances of the effect")


def _sample_parameters(effect: Effect, robot: RobotFacts, rng: np.random.Generator) -> Array:
    def draw(p: Parameter) -> float:
        value = p.nominal + p.typical * rng.uniform(0.2, 1.0)
        return float(np.clip(value, p.lower, p.upper))

    return np.array([draw(p) for p in effect.parameters(robot)])


def _null(effect: Effect, robot: RobotFacts, x: Array) -> Array | None:
    parameters = effect.parameters(robot)
    if not parameters or all(p.null is None for p in parameters):
        return None
    return np.array([value if p.null is None else p.null for p, value in zip(parameters, x, strict=True)])


def _check_case(
    label: str, function: Callable[[Array], Any], variable: Array, derivative: Any, record: Callable[..., None]
) -> None:
    before = variable.copy()
    first, second = np.asarray(function(variable)), np.asarray(function(variable))
    record(
        f"{label} is pure",
        bool(np.array_equal(first, second) and np.array_equal(before, variable)),
        "two calls differ or the input was changed",
    )
    record(f"{label} is finite", bool(np.isfinite(first).all()), "it gives NaN or infinity")
    if derivative is None:
        return
    derivative = np.asarray(derivative)
    numeric = difference(function, variable)
    if derivative.shape != numeric.shape:
        record(f"{label} shape", False, f"derivative has shape {derivative.shape}, must be {numeric.shape}")
        return
    error = np.abs(derivative - numeric).max(initial=0.0) / max(np.abs(numeric).max(initial=0.0), 1e-12)
    if np.abs(numeric).max(initial=0.0) == 0.0:
        error = np.abs(derivative).max(initial=0.0)
    record(f"{label} derivative", bool(error < _TOLERANCE), f"differs from finite differences by {error:.1e} relative")


def difference(function: Callable[[Array], Any], variable: Array) -> Array:
    """Fourth-order central differences along the last axis of the variable, put last in the result."""
    columns: list[Array] = []
    for j in range(variable.shape[-1]):
        step = np.zeros_like(variable)
        scale = np.abs(variable[..., j]).max(initial=0.0)
        step[..., j] = _STEP * (max(scale, 1e-3) if scale > 0 else 1.0)
        size = step[..., j].max(initial=0.0)
        near = np.asarray(function(variable + step)) - np.asarray(function(variable - step))
        far = np.asarray(function(variable + 2 * step)) - np.asarray(function(variable - 2 * step))
        columns.append((8.0 * near - far) / (12.0 * size))
    return np.stack(columns, axis=-1) if columns else np.zeros((*np.shape(function(variable)), 0))


def _cases(effect: Effect, robot: RobotFacts, x: Array, rng: np.random.Generator) -> Iterator[Case]:
    for kind, cases in _CASES.items():
        if isinstance(effect, kind):
            yield from cases(effect, robot, x, rng)


def _conditions(rng: np.random.Generator) -> Conditions:
    return Conditions(rng.uniform(0, 1e4, BATCH), rng.uniform(285, 305, BATCH), rng.choice([-1.0, 1.0], BATCH))


def _poses(robot: RobotFacts, rng: np.random.Generator) -> Poses:
    q = rng.uniform(-1, 1, (BATCH, robot.n))
    return Poses(q, q, rng.normal(0, 1e3, (BATCH, 6)), _conditions(rng), _conditions(rng))


def _vanishes(effect: Effect, robot: RobotFacts, x: Array, value: Callable[[Array], Any]) -> Iterator[Case]:
    null = _null(effect, robot, x)
    if null is None:
        return
    size = float(np.abs(np.asarray(value(null))).max(initial=0.0))
    if size > 1e-12:
        raise PluginError(f"{effect.name} does not vanish at its null value: it still gives {size:.3g}")
    yield "null value", lambda _: value(null), null, None


def _geometry(effect: Geometry, robot: RobotFacts, x: Array, rng: np.random.Generator) -> Iterator[Case]:
    poses = _poses(robot, rng)
    term = effect.errors(poses, x, robot)
    yield "angles by x", lambda v: effect.errors(poses, v, robot).angles, x, term.angles_dx
    if term.twists is not None:
        yield "twists by x", lambda v: effect.errors(poses, v, robot).twists, x, term.twists_dx
    yield from _vanishes(effect, robot, x, lambda v: effect.errors(poses, v, robot).angles)


def _loop(effect: Loop, robot: RobotFacts, x: Array, rng: np.random.Generator) -> Iterator[Case]:
    k, m = len(effect.joints(robot)), len(effect.parameters(robot))
    u = np.concatenate([rng.uniform(-0.5, 0.5, (BATCH, k)), rng.normal(0, 1e-4, (BATCH, m))], axis=1)
    term = effect.closure(u[:, :k], u[:, k:], robot)
    yield "closure", lambda v: effect.closure(v[:, :k], v[:, k:], robot).q, u, term.q_u
    yield "closure slope", lambda v: effect.closure(v[:, :k], v[:, k:], robot).q_u, u, term.q_uu
    perfect = effect.closure(u[:, :k], np.zeros((BATCH, m)), robot).q
    back = effect.actuators(perfect, robot)
    if not np.allclose(back, u[:, :k], atol=1e-9):
        raise PluginError(
            f"{effect.name}: actuators(closure(phi)) is not phi (off by {np.abs(back - u[:, :k]).max():.1e})"
        )
    yield "transmission angle", lambda v: effect.transmission_angle(v, robot), perfect, None


def _spring(effect: Spring, robot: RobotFacts, x: Array, rng: np.random.Generator) -> Iterator[Case]:
    virtual, mixing = effect.virtual_joints(robot), effect.mixing(robot)
    for joint in cast("tuple[object, ...]", virtual):
        if isinstance(joint, Actuator):
            robot.joint_index(joint.joint)
        elif isinstance(joint, VirtualJoint):
            robot.link_index(joint.link)
        elif not isinstance(joint, Bar):
            raise PluginError(f"{effect.name}: {joint!r} is not an Actuator, Bar or VirtualJoint")
    if mixing.shape != (len(virtual), len(x)):
        raise PluginError(
            f"{effect.name}: mixing has shape {mixing.shape}, must be (virtual joints, parameters) = "
            f"{(len(virtual), len(x))}"
        )
    yield "mixing", lambda _: effect.mixing(robot), x, None


def _given(effect: Effect, what: str, term: T | None) -> T:
    if term is None:
        raise PluginError(f"{effect.name}: {what} is None at some angles or parameters and not at others")
    return term


def _parallel(effect: ParallelSpring, robot: RobotFacts, x: Array, rng: np.random.Generator) -> Iterator[Case]:
    q, conditions = rng.uniform(-1, 1, (BATCH, len(effect.joints(robot)))), _conditions(rng)
    torque, stiffness = effect.torque(q, x, conditions), effect.stiffness(q, x, conditions)

    def torque_at(q: Array, x: Array) -> TorqueTerm:
        return _given(effect, "torque", effect.torque(q, x, conditions))

    def stiffness_at(q: Array, x: Array) -> StiffnessTerm:
        return _given(effect, "stiffness", effect.stiffness(q, x, conditions))

    if torque is not None:
        yield "torque by q", lambda v: torque_at(v, x).value, q, torque.dq
        yield "torque by x", lambda v: torque_at(q, v).value, x, torque.dx
        if torque.dqq is not None:
            yield "slope by q", lambda v: torque_at(v, x).dq, q, torque.dqq
        if torque.dqx is not None:
            yield "slope by x", lambda v: torque_at(q, v).dq, x, torque.dqx
        yield from _vanishes(effect, robot, x, lambda v: torque_at(q, v).value)
    if stiffness is not None:
        yield "stiffness by q", lambda v: stiffness_at(v, x).value, q, stiffness.dq
        yield "stiffness by x", lambda v: stiffness_at(q, v).value, x, stiffness.dx
        yield from _vanishes(effect, robot, x, lambda v: stiffness_at(q, v).value)
    if effect.ends(robot) is not None:
        s = rng.uniform(0.5, 1.5, (BATCH, 1))
        tension = effect.tension(s[:, 0], x, conditions)
        yield "tension by s", lambda v: effect.tension(v[:, 0], x, conditions).value, s, tension.ds[:, None]
        yield "tension by x", lambda v: effect.tension(s[:, 0], v, conditions).value, x, tension.dx
        yield from _vanishes(effect, robot, x, lambda v: effect.tension(s[:, 0], v, conditions).value)
    elif torque is None and stiffness is None:
        raise PluginError(f"{effect.name} has neither torque, stiffness nor ends")


def _law(effect: SpringLaw, robot: RobotFacts, x: Array, rng: np.random.Generator) -> Iterator[Case]:
    torque = rng.uniform(-1e4, 1e4, (BATCH, len(effect.springs(robot))))
    term = effect.extra(torque, x)
    slope = np.zeros((*torque.shape, torque.shape[1]))
    slope[:, np.arange(torque.shape[1]), np.arange(torque.shape[1])] = term.dT
    yield "law by torque", lambda v: effect.extra(v, x).value, torque, slope
    yield "law by x", lambda v: effect.extra(torque, v).value, x, term.dx
    yield from _vanishes(effect, robot, x, lambda v: effect.extra(torque, v).value)


def _rotations(rng: np.random.Generator, *shape: int) -> Array:
    q = np.linalg.qr(rng.normal(size=(*shape, 3, 3)))[0]
    return q * np.linalg.det(q)[..., None, None]


def turn(rotation: Array, small: Array) -> Array:
    """exp([small]x) rotation, to second order and re-orthonormalised: enough for differences."""
    x, y, z = np.moveaxis(small, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)
    angle2 = (small**2).sum(-1)[..., None, None]
    return (np.eye(3) + (1 - angle2 / 6) * cross + 0.5 * cross @ cross) @ rotation


def _load(effect: Load, robot: RobotFacts, x: Array, rng: np.random.Generator) -> Iterator[Case]:
    rotation, wrench = _rotations(rng, BATCH), rng.normal(0, 1e3, (BATCH, 6))

    def apply(w: Array, x: Array, small: Array | None = None) -> Any:
        turned = rotation if small is None else turn(rotation, small)
        return effect.apply(Loads(w, turned, robot.moments), x, robot)

    term = apply(wrench, x)
    yield "wrench by wrench", lambda v: apply(v, x).wrench, wrench, term.d_wrench
    yield "wrench by x", lambda v: apply(wrench, v).wrench, x, term.dx
    none = np.zeros((BATCH, 6, 3)) if term.d_rotation is None else term.d_rotation
    yield "wrench by rotation", lambda v: apply(wrench, x, v).wrench, np.zeros((BATCH, 3)), none
    if term.moments is not None:
        yield "moments by x", lambda v: apply(wrench, v).moments, x, term.moments_dx
        yield from _vanishes(effect, robot, x, lambda v: apply(wrench, v).moments)
    yield from _vanishes(effect, robot, x, lambda v: apply(wrench, v).wrench - wrench)


def _sensor(effect: Sensor, robot: RobotFacts, x: Array, rng: np.random.Generator) -> Iterator[Case]:
    markers, conditions = ("m1", "m2"), _conditions(rng)
    position, rotation = rng.normal(0, 2, (BATCH, 2, 3)), _rotations(rng, BATCH, 2)

    def read(p: Array, x: Array, small: Array | None = None) -> Array:
        turned = rotation if small is None else turn(rotation, small[:, None, :])
        return effect.read(Reading(p, turned), x, markers, conditions).position

    term = effect.read(Reading(position, rotation), x, markers, conditions)
    shift = np.zeros((BATCH, 3))
    yield "position by position", lambda v: read(position + v[:, None, :], x), shift, term.d_position
    yield "position by x", lambda v: read(position, v), x, term.dx
    none = np.zeros((BATCH, 2, 3, 3)) if term.d_rotation is None else term.d_rotation
    yield "position by rotation", lambda v: read(position, x, v), shift, none
    yield from _vanishes(effect, robot, x, lambda v: read(position, v) - position)


_CASES: dict[type[Effect], Callable[..., Iterator[Case]]] = {
    Geometry: _geometry,
    Loop: _loop,
    Spring: _spring,
    ParallelSpring: _parallel,
    SpringLaw: _law,
    Load: _load,
    Sensor: _sensor,
}
