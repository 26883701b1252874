"""Laws as the pipeline asks for them: every term with all its derivatives, taken where an effect gives none.

By complex step where the law bears complex numbers: each derivative is then as exact as the law itself. Whether it
does is tried in one direction at every call, for a law may drop the imaginary part (by abs, or a cast) without a word.
Otherwise by central differences of fourth order, scaled by each variable's natural size.
"""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar, cast

import numpy as np

from qsframework.errors import PluginError, QsfError
from qsframework.plugin.facts import Array, Context
from qsframework.plugin.kinds import Effect, Geometry, Load, Loop, ParallelSpring, Sensor, Spring, SpringLaw
from qsframework.plugin.rotations import exponential
from qsframework.plugin.terms import (
    GeometryTerm,
    LawTerm,
    Loads,
    LoadTerm,
    LoopTerm,
    Reading,
    SensorTerm,
    StiffnessTerm,
    TensionTerm,
    TorqueTerm,
)

_STEP = 1e-5
"""Of a difference, in natural sizes."""
_IMAGINARY = 1e-30
_AGREE = 1e-4
_ROUNDING = 1e-9
_FAR = 1e60
"""Inputs beyond which a law may well overflow: an iteration that has lost its way."""
Function = Callable[[Any], Any]
Slope = Callable[[Function], Array]
T = TypeVar("T")


def sizes(effect: Effect, x: Array, context: Context) -> Array:
    """Natural size (p,) of each of an effect's parameters."""
    typical = np.array([p.typical for p in effect.parameters(context.robot)])
    return np.where(x == 0.0, typical, np.abs(x))


def difference(function: Function, variable: Array, size: Array | None = None) -> Array:
    """Fourth-order central differences along the last axis of the variable, put last in the result.

    variable (p,) or (N, p): of a batch each row moves its own value only; size (p,): natural sizes
    """
    found = _sizes(variable) if size is None else size
    columns: list[Array] = []
    for j in range(variable.shape[-1]):
        step = np.zeros_like(variable)
        step[..., j] = _STEP * found[j]
        near = np.asarray(function(variable + step)) - np.asarray(function(variable - step))
        far = np.asarray(function(variable + 2 * step)) - np.asarray(function(variable - 2 * step))
        columns.append(((8.0 * near - far) / 12.0) / (_STEP * found[j]))
    return np.stack(columns, axis=-1) if columns else np.zeros((*np.shape(function(variable)), 0))


def _sizes(variable: Array) -> Array:
    scale = np.abs(variable.reshape(-1, variable.shape[-1])).max(axis=0, initial=0.0)
    return np.where(scale > 0.0, np.maximum(scale, 1e-3), 1.0)


def derivative(function: Function, variable: Array, size: Array | None = None) -> Array:
    """d function / d variable as `difference` has it, by complex step where the function bears it."""
    found = _sizes(variable) if size is None else size
    exact = _complex(function, variable, found)
    if exact is None:
        return difference(function, variable, found)
    step = _STEP * found * np.linspace(1.0, 0.6, len(found))
    ends = [np.asarray(function(variable + sign * step)) for sign in (1.0, -1.0)]
    change = 0.5 * (ends[0] - ends[1])
    rounding = _ROUNDING * _STEP * np.abs(ends[0]).max(initial=0.0)
    off = np.abs(exact @ step - change).max(initial=0.0)
    most = np.abs(change).max(initial=0.0)
    return exact if off <= _AGREE * most + rounding else difference(function, variable, found)


def _complex(function: Function, variable: Array, size: Array) -> Array | None:
    """The derivative by complex step; None where the function does not take complex numbers or gives real ones."""
    columns: list[Array] = []
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for j in range(variable.shape[-1]):
                turned = variable.astype(complex)
                turned[..., j] += 1j * _IMAGINARY * size[j]
                value = np.asarray(function(turned), dtype=complex)
                columns.append(np.asarray(np.imag(value), dtype=np.float64) / (_IMAGINARY * size[j]))
    except (PluginError, TypeError, ValueError, ArithmeticError, Warning):
        return None
    return np.stack(columns, axis=-1) if columns else np.zeros((*np.shape(function(variable)), 0))


def _place(effect: Effect | type[Effect], law: str) -> str:
    """The law's name with the file that it stands in."""
    kind = effect if isinstance(effect, type) else type(effect)
    own = inspect.unwrap(getattr(kind, law))
    name = kind.effect_name() if isinstance(effect, type) else effect.name
    return f"{name}: {law}() in {own.__code__.co_filename}, line {own.__code__.co_firstlineno}"


def given(effect: Effect | type[Effect], law: str, *inputs: Any) -> Any:
    """What an effect, or its class, gives; a PluginError that names law and file where it fails."""
    try:
        return getattr(effect, law)(*inputs)
    except QsfError:
        raise
    except Exception as error:  # a third party's law may fail in any way
        said = f"{_place(effect, law)}, fails: {type(error).__name__}: {error}"
        raise PluginError(f"{said}. Mend it, or uninstall the package that brings it") from error


def _checked(effect: Effect, law: str, value: Any, shape: tuple[int, ...], *inputs: Array, what: str = "") -> Array:
    """A law's value; PluginError where it is not an array of numbers of this shape, or not finite."""
    what = what and f" of {what}"
    try:
        found = np.asarray(value, dtype=None if np.iscomplexobj(value) else np.float64)
    except (TypeError, ValueError):
        raise PluginError(f"{_place(effect, law)}, gives {value!r:.80}{what}, no array of numbers") from None
    if found.shape != shape:
        raise PluginError(f"{_place(effect, law)}, gives the shape {found.shape}{what}, must be {shape}")
    if not np.isfinite(found).all() and all(np.abs(v).max(initial=0.0) < _FAR for v in inputs):
        row = np.argwhere(~np.isfinite(found))[0].tolist()
        raise PluginError(f"{_place(effect, law)}, gives NaN or infinity{what}, first at {row}: {found[tuple(row)]}")
    return cast("Array", found)


def as_term(kind: Callable[..., T], value: Any) -> T:
    """A law's term, of a term or of its value alone."""
    own: Any = kind
    return value if isinstance(value, own) else kind(value)


def left_out(value: object) -> bool:
    """Whether a term leaves this to the framework."""
    return value is None


def geometry(effect: Geometry, x: Array, context: Context) -> GeometryTerm:
    """`errors` with all derivatives."""
    batch, n = context.poses.q.shape

    def errors(v: Array) -> GeometryTerm:
        term = as_term(GeometryTerm, given(effect, "errors", v, context))
        angles = np.zeros((batch, n)) if left_out(term.angles) else term.angles
        angles = _checked(effect, "errors", angles, (batch, n), what="angles")
        if term.twists is not None and not effect.moves_placements:
            raise PluginError(f"{_place(effect, 'errors')}, gives twists, but the class does not say moves_placements")
        twists = term.twists
        if twists is not None:
            twists = _checked(effect, "errors", twists, (batch, n, 6), what="twists")
        dx = np.zeros((batch, n, len(x))) if left_out(term.angles) else term.angles_dx
        return replace(term, angles=angles, angles_dx=dx, twists=twists)

    term = errors(x)
    if left_out(term.angles_dx):
        term = replace(term, angles_dx=derivative(lambda v: errors(v).angles, x, sizes(effect, x, context)))
    if term.twists is not None and left_out(term.twists_dx):
        term = replace(term, twists_dx=derivative(lambda v: errors(v).twists, x, sizes(effect, x, context)))
    return term


def closure(effect: Loop, actuators: Array, bars: Array, context: Context) -> LoopTerm:
    """`closure` with all derivatives, each for those who ask for it."""
    (batch, k), u = actuators.shape, np.concatenate([actuators, bars], axis=1)

    def size() -> Array:
        return np.array([1.0] * k + [p.typical for p in effect.parameters(context.robot)])

    def at(v: Array) -> LoopTerm:
        return as_term(LoopTerm, given(effect, "closure", v[:, :k], v[:, k:], context))

    def slope(v: Array) -> Array:
        term = at(v)
        return derivative(lambda w: at(w).q, v, size()) if left_out(term.slope) else term.q_u

    term = at(u)
    _checked(effect, "closure", term.q, (batch, k), u)
    q_u = (lambda: slope(u)) if left_out(term.slope) else term.slope
    q_uu = (lambda: difference(slope, u, size())) if left_out(term.bend) else term.bend
    return LoopTerm(term.q, q_u, q_uu)


def mixing(effect: Spring, x: Array, context: Context) -> Array:
    """`mixing`, (v, k) or (N, v, k)."""
    shape = (len(effect.virtual_joints(context.robot)), len(effect.compliances(context.robot)))
    found = given(effect, "mixing", x, context)
    return _checked(effect, "mixing", found, (len(context), *shape) if np.ndim(found) == 3 else shape)


def mixing_slope(effect: Spring, x: Array, context: Context) -> Array:
    """`mixing` by the parameters, (v, k, p) or (N, v, k, p)."""
    return derivative(lambda v: mixing(effect, v, context), x, sizes(effect, x, context))


def _with_slopes(
    effect: Effect, law: str, term: T, at: Array, shape: tuple[int, ...], x: Array, context: Context, **slope: Slope
) -> T:
    """The term of a law of one variable and the parameters, with its derivatives by both.

    shape: of its value; slope: the name of the derivative by the variable, and how it is taken of a function of that
    """

    def value(v: Array, w: Array) -> Array:
        own: Any = as_term(type(term), given(effect, law, v, w, context))
        return _checked(effect, law, own.value, shape, v)

    stated: Any = term
    _checked(effect, law, stated.value, shape, at)
    ((name, take),) = slope.items()
    taken: dict[str, Array] = {}
    if left_out(getattr(stated, name)):
        taken[name] = take(lambda v: value(v, x))
    if left_out(stated.dx):
        taken["dx"] = derivative(lambda w: value(at, w), x, sizes(effect, x, context))
    return replace(stated, **taken)


def torque(effect: ParallelSpring, q: Array, x: Array, context: Context) -> TorqueTerm | None:
    """`torque` with its first derivatives; None where it has none."""
    return _parallel_law(effect, "torque", TorqueTerm, q.shape, q, x, context)


def stiffness(effect: ParallelSpring, q: Array, x: Array, context: Context) -> StiffnessTerm | None:
    """`stiffness` with all derivatives; None where it has none."""
    return _parallel_law(effect, "stiffness", StiffnessTerm, (*q.shape, q.shape[1]), q, x, context)


def _parallel_law(
    effect: ParallelSpring, law: str, kind: type[T], shape: tuple[int, ...], q: Array, x: Array, context: Context
) -> T | None:
    found = given(effect, law, q, x, context)
    if found is None:
        return None
    term = as_term(kind, found)
    return _with_slopes(effect, law, term, q, shape, x, context, dq=lambda f: derivative(f, q, np.ones((q.shape[-1],))))


def tension(effect: ParallelSpring, length: Array, x: Array, context: Context) -> TensionTerm:
    """`tension` with all derivatives."""

    def slope(f: Function) -> Array:
        return derivative(lambda v: f(v[:, 0]), length[:, None])[:, 0]

    term = as_term(TensionTerm, given(effect, "tension", length, x, context))
    return _with_slopes(effect, "tension", term, length, length.shape, x, context, ds=slope)


def extra(effect: SpringLaw, T: Array, x: Array, context: Context) -> LawTerm:
    """`extra` with all derivatives."""

    def slope(f: Function) -> Array:  # each by its own torque: all move together
        every = np.maximum(np.abs(T).max(initial=0.0), 1e-3 * context.robot.sizes.torque)
        return derivative(lambda v: f(T + v), np.zeros((len(T), 1)), np.array([every]))[..., 0]

    term = as_term(LawTerm, given(effect, "extra", T, x, context))
    return _with_slopes(effect, "extra", term, T, T.shape, x, context, dT=slope)


def loaded(effect: Load, loads: Loads, x: Array, context: Context) -> LoadTerm:
    """`apply` without the derivatives that it leaves out."""
    term = as_term(LoadTerm, given(effect, "apply", loads, x, context))
    wrench = loads.wrench if left_out(term.wrench) else term.wrench
    return replace(term, wrench=_checked(effect, "apply", wrench, loads.wrench.shape, loads.wrench, what="the wrench"))


def apply(effect: Load, loads: Loads, x: Array, context: Context) -> LoadTerm:
    """`apply` with all derivatives."""
    batch = len(loads.wrench)

    def at(v: Array, w: Array = loads.wrench, rotation: Array = loads.rotation) -> LoadTerm:
        return loaded(effect, replace(loads, wrench=w, rotation=rotation), v, context)

    term, none = at(x), np.zeros((batch, 3))
    if term.wrench is loads.wrench and left_out(term.d_wrench):  # as it came in
        same = np.broadcast_to(np.eye(6), (batch, 6, 6))
        term = replace(term, d_wrench=same, dx=np.zeros((batch, 6, len(x))))
    if left_out(term.d_wrench):
        most = np.maximum(np.abs(loads.wrench).max(axis=0, initial=0.0), context.robot.sizes.weight)
        turning = derivative(lambda v: at(x, rotation=exponential(v) @ loads.rotation).wrench, none, np.ones(3))
        term = replace(term, d_wrench=derivative(lambda w: at(x, w).wrench, loads.wrench, most), d_rotation=turning)
    if left_out(term.dx):
        term = replace(term, dx=derivative(lambda v: at(v).wrench, x, sizes(effect, x, context)))
    if term.moments is not None:
        shape = loads.moments.shape
        _checked(effect, "apply", term.moments, shape, what="moments")
        if left_out(term.moments_dx):
            term = replace(term, moments_dx=derivative(lambda v: at(v).moments, x, sizes(effect, x, context)))
    return term


def seen(effect: Sensor, reading: Reading, x: Array, context: Context) -> Array:
    """What `read` says (N, k, 3), without its derivatives."""
    found = as_term(SensorTerm, given(effect, "read", reading, x, context)).position
    return _checked(effect, "read", found, reading.position.shape, reading.position)


def read(effect: Sensor, reading: Reading, x: Array, context: Context) -> SensorTerm:
    """`read` with all derivatives."""
    none = np.zeros((len(context), 3))

    def at(v: Array, shift: Array = none, small: Array | None = None) -> Array:
        rotation = reading.rotation if small is None else exponential(small[:, None, :]) @ reading.rotation
        moved = replace(reading, position=reading.position + shift[:, None, :], rotation=rotation)
        return seen(effect, moved, v, context)

    term = as_term(SensorTerm, given(effect, "read", reading, x, context))
    _checked(effect, "read", term.position, reading.position.shape, reading.position)
    d_position, d_rotation, dx = term.d_position, term.d_rotation, term.dx
    if left_out(d_position):
        d_position = derivative(lambda v: at(x, v), none, np.ones(3))
        d_rotation = derivative(lambda v: at(x, none, v), none, np.ones(3))
    if left_out(dx):
        dx = derivative(at, x, sizes(effect, x, context))
    return SensorTerm(term.position, d_position, dx, d_rotation)
