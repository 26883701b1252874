"""Stages 3 and 4: how the elastic coordinates answer to a torque.

    eps = c T + f(T),   T = tau_0 + tau - K_par eps

c may be zero (a rigid gear), so steps are solved in the form (I + diag(c + f') K_par) d eps = rhs.
K_par touches few coordinates; only those are coupled.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics.motion import Coefficients, Motion
from qsframework.errors import NotConverged
from qsframework.plugin import Array, Context, LawTerm, ParallelSpring, SpringLaw, StiffnessTerm, TorqueTerm, laws

_STEPS = 60
_TOLERANCE = 1e-13
_HALVINGS = 30


@dataclass(frozen=True, eq=False)
class Faces:
    """What one parallel spring does at the commanded pose: torque on its joints and stiffness there.

    joints (k,) indices; the stiffness holds the torque's slope and the equivalent stiffness both
    """

    joints: tuple[int, ...]
    torque: TorqueTerm | None
    stiffness: StiffnessTerm


Torques = Sequence[tuple[tuple[int, ...], TorqueTerm]]
"""Joints and torque of each parallel spring that has one."""


def torques(effects: Sequence[tuple[ParallelSpring, Array]], motion: Motion) -> Torques:
    """The physical torques alone, at the joint angles of a motion."""
    out: list[tuple[tuple[int, ...], TorqueTerm]] = []
    for effect, x in effects:
        joints = joints_of(effect, motion)
        term = laws.torque(effect, motion.q[list(joints)].T, x, motion.context)
        if term is not None:
            out.append((joints, term))
    return out


def joints_of(effect: ParallelSpring, motion: Motion) -> tuple[int, ...]:
    """The joints of the arm that a parallel spring acts on."""
    facts = motion.layout.facts
    return tuple(facts.joint_index(j) for j in effect.joints(facts))


def faces(effect: ParallelSpring, motion: Motion, x: Array) -> Faces:
    """Evaluate an effect at the commanded joint angles."""
    joints = joints_of(effect, motion)
    q, context = motion.q[list(joints)].T, motion.context
    torque, term = laws.torque(effect, q, x, context), laws.stiffness(effect, q, x, context)
    if torque is not None:
        slope = _slope(effect, q, x, context, torque)
        if term is None:
            term = slope
        else:
            term = StiffnessTerm(term.value + slope.value, term.dq + slope.dq, term.dx + slope.dx)
    return Faces(joints, torque, term or no_stiffness(len(q), len(joints), len(x)))


def no_stiffness(batch: int, joints: int, parameters: int) -> StiffnessTerm:
    """The stiffness of a spring that has none."""
    shape = (batch, joints, joints)
    return StiffnessTerm(np.zeros(shape), np.zeros((*shape, joints)), np.zeros((*shape, parameters)))


def touched(springs: Sequence[Faces]) -> tuple[int, ...]:
    """The joints that parallel springs act on."""
    return tuple(sorted({j for spring in springs for j in spring.joints}))


def _slope(effect: ParallelSpring, q: Array, x: Array, context: Context, term: TorqueTerm) -> StiffnessTerm:
    """The stiffness -d torque / dq; its derivatives by differences where the effect gives none."""

    def slope(q: Array, x: Array) -> Array:
        torque = laws.torque(effect, q, x, context)
        assert torque is not None
        return torque.dq

    dqq = laws.difference(lambda v: slope(v, x), q) if term.dqq is None else term.dqq
    dqx = laws.difference(lambda v: slope(q, v), x, laws.sizes(effect, x, context)) if term.dqx is None else term.dqx
    return StiffnessTerm(-term.dq, -dqq, -dqx)


@dataclass(frozen=True, eq=False)
class JointRates:
    """Rates E (joints, active, N) of some joints per elastic coordinate that turns them."""

    active: tuple[int, ...]
    E: Array


def joint_rates(
    motion: Motion,
    joints: Sequence[int],
    active: tuple[int, ...] | None = None,
    coefficients: Coefficients | None = None,
) -> JointRates:
    """E for the joints; with `coefficients` the derivative of E on the same active set."""
    coefficients = motion.coefficients if coefficients is None else coefficients
    elements = [motion.layout.joint_elements[j] for j in joints]
    if active is None:
        active = tuple(c for c, terms in enumerate(coefficients) if any(e in elements for e, _ in terms))
    E = np.zeros((len(joints), len(active), motion.q.shape[-1]))
    for a, c in enumerate(active):
        for e, rate in coefficients[c]:
            if e in elements:
                E[elements.index(e), a] += rate
    return JointRates(active, E)


@dataclass(frozen=True, eq=False)
class ParallelStiffness:
    """K_par on the coordinates it touches: active (a,) indices, K (a, a, N) N m/rad."""

    active: tuple[int, ...]
    K: Array

    def times(self, eps: Array) -> Array:
        """K_par eps for eps (ne, N)."""
        out = np.zeros_like(eps)
        if self.active:
            rows = list(self.active)
            out[rows] = np.einsum("abn,bn->an", self.K, eps[rows])
        return out


def sandwich(left: Array, middle: Array, right: Array) -> Array:
    """left' middle right over the batch: (j, a, N), (j, k, N), (k, b, N) -> (a, b, N)."""
    if left.shape[0] == right.shape[0] == 1:
        return (left[0] * middle[0])[:, None] * right[0][None]
    return np.einsum("jan,jbn->abn", left, np.einsum("jkn,kbn->jbn", middle, right))


def sandwiched(left: Array, middle: Array, right: Array, values: Array) -> Array:
    """`sandwich` times values (b, N), (a, N), without the matrix."""
    return np.einsum("jan,jn->an", left, np.einsum("jkn,kn->jn", middle, np.einsum("kbn,bn->kn", right, values)))


Laws = Sequence[tuple[SpringLaw, tuple[int, ...], Array, Context]]
"""Each law with the coordinates it acts on, its parameter values, and where it is asked for."""
Terms = tuple[tuple[tuple[int, ...], LawTerm], ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Response:
    """The arm's answer at one state: eps (ne, N), gear torques T (ne, N), and how eps reacts.

    slope (ne, N) or (ne, 1) is c + f'; laws holds each law's term with its coordinates; held (ne, N): the deflection
    that a stiffness which changes holds, eps unless the state is placed where it settles
    """

    eps: Array
    T: Array
    slope: Array
    stiffness: ParallelStiffness
    laws: Terms
    inverse: Array | None
    held: Array | None = None

    def react(self, rhs: Array) -> Array:
        """Solve (I + diag(slope) K_par) d eps = rhs (ne, ..., N)."""
        return solve(self.stiffness, self.inverse, rhs)


def system(stiffness: ParallelStiffness, slope: Array) -> Array:
    """I + diag(slope) K_par (a, a, N) on the coordinates that K_par touches."""
    return np.eye(len(stiffness.active))[:, :, None] + slope[list(stiffness.active)][:, None] * stiffness.K


def inverse(stiffness: ParallelStiffness, slope: Array) -> Array | None:
    """The inverse of `system`; None where K_par touches nothing."""
    if not stiffness.active:
        return None
    A = system(stiffness, slope)
    if len(A) == 1:
        return 1.0 / A
    return np.ascontiguousarray(np.linalg.inv(A.transpose(2, 0, 1)).transpose(1, 2, 0), dtype=np.float64)


def solve(stiffness: ParallelStiffness, inverse: Array | None, rhs: Array) -> Array:
    """Solve (I + diag(slope) K_par) d = rhs (ne, ..., N) by the inverse."""
    if inverse is None:
        return rhs
    out, rows = rhs.copy(), list(stiffness.active)
    own = rhs[rows]
    if rhs.ndim == 2:
        own = np.einsum("abn,bn->an", inverse, own)
    else:  # of many right sides one product a pose: in a third of the time
        flat = own.reshape(len(own), -1, own.shape[-1]).transpose(2, 0, 1)
        own = (inverse.transpose(2, 0, 1) @ flat).transpose(1, 2, 0).reshape(own.shape)
    out[rows] = own
    return out


def respond_linear(compliance: Array, torque: Array, stiffness: ParallelStiffness) -> Response:
    """eps = (I + diag(c) K_par)^-1 diag(c) torque."""
    slope = compliance[:, None]
    inverted = inverse(stiffness, slope)
    eps = solve(stiffness, inverted, slope * torque)
    return Response(
        eps=eps, T=torque - stiffness.times(eps), slope=slope, stiffness=stiffness, laws=(), inverse=inverted
    )


def answer(compliance: Array, T: Array, bends: Laws) -> tuple[Array, Array, Terms]:
    """c T + f(T), its slope c + f' (ne, N), and the laws' terms, at gear torques T (ne, N)."""
    value, slope = compliance[:, None] * T, np.repeat(compliance[:, None], T.shape[1], axis=1)
    terms: list[tuple[tuple[int, ...], LawTerm]] = []
    for law, rows, x, context in bends:
        term = laws.extra(law, T[list(rows)].T, x, context)
        np.add.at(value, list(rows), term.value.T)
        np.add.at(slope, list(rows), term.dT.T)
        terms.append((rows, term))
    return value, slope, tuple(terms)


Left = tuple[Array, Array, Array, Terms]
"""What is left of eps - c T - f(T), T, and the laws' slope and terms there."""
Residual = Callable[[Array], Left]


def respond(compliance: Array, torque: Array, stiffness: ParallelStiffness, bends: Laws) -> Response:
    """Solve eps = c T + f(T), T = torque - K_par eps, by Newton with backtracking.

    Raises NotConverged if a step cannot reduce the residual.
    """
    if not bends:
        return respond_linear(compliance, torque, stiffness)

    def residual(eps: Array) -> Left:
        T = torque - stiffness.times(eps)
        value, slope, terms = answer(compliance, T, bends)
        return eps - value, T, slope, terms

    eps = step = respond_linear(compliance, torque, stiffness).eps
    error, T, slope, terms = residual(eps)
    for _ in range(_STEPS):
        inverted = inverse(stiffness, slope)
        step = solve(stiffness, inverted, error)
        if np.all(np.abs(step) <= _TOLERANCE * np.maximum(np.abs(eps), 1e-9)):
            return Response(eps=eps - step, T=T, slope=slope, stiffness=stiffness, laws=terms, inverse=inverted)
        eps, (error, T, slope, terms) = _backtrack(residual, eps, step, error)
    raise NotConverged(f"the springs' laws did not settle in {_STEPS} steps; largest step {np.abs(step).max():.1e} rad")


def _backtrack(residual: Residual, eps: Array, step: Array, error: Array) -> tuple[Array, Left]:
    """Halve the step, pose by pose, until the residual does not grow."""
    size = np.ones(eps.shape[1])
    before = np.abs(error).max(axis=0)
    trial, found = eps, residual(eps)
    for _ in range(_HALVINGS):
        trial = eps - size * step
        found = residual(trial)
        worse = np.abs(found[0]).max(axis=0) > before * (1.0 + 1e-9) + 1e-16
        if not worse.any():
            break
        size = np.where(worse, 0.5 * size, size)
    return trial, found
