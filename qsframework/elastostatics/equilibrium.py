"""The loaded equilibrium, equation (17), and the Cartesian stiffness there, equation (18).

The springs' equation eps = c T + f(T) is solved with the torques at the deflected pose:
T = D(eps)' w + gravity(eps) - M_c(q + eps) - K_eq eps. The balancer's own stiffness arrives through
M_c and is not added again; only the equivalent stiffness K_eq of the commanded pose is.

In (18) the torques on the coordinates change when the arm gives: H = d(D' w + tau_0) / d eps. For elements a <= b in
chain order the tip's velocity changes by omega_a x v_b, so a force f held fixed in the world gives H_ab = f . (omega_a
x v_b); a moment m adds m . (omega_d x omega_c) to the torque c for an element d before c. Gravity is a force at every
mass centre.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qsframework.elastostatics import loads, pulls, springs
from qsframework.elastostatics.evaluation import elastic_laws, gather, move_commanded
from qsframework.elastostatics.loads import Applied, wrench_along
from qsframework.elastostatics.motion import Motion, move
from qsframework.elastostatics.pulls import Pull, on_coordinates
from qsframework.elastostatics.springs import Torques, joint_rates, sandwich
from qsframework.elastostatics.state import State, place
from qsframework.elastostatics.structure import Structure, chunks
from qsframework.errors import InputError, NotConverged
from qsframework.plugin import Array, GeometryTerm, Load, ParallelSpring, Poses, laws
from qsframework.robot.gravity import mass_columns
from qsframework.robot.kinematics import Twists, cross

_STEPS = 40
_CHORDS = 8
_SINGULAR = 1e13
_FARTHEST = np.pi
"""Deflection of one spring, rad or m, beyond which there is no equilibrium to speak of."""
_TOLERANCE = 1e-10
"""What a next step would change, relative to the deflection, if it shrank as the last one did."""


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """N settled poses: eps (N, ne), load point (N, 3) and the rotation (N, 3, 3) of its frame, markers (N, K, 3)."""

    eps: Array
    tip: Array
    tip_rotation: Array
    markers: Array


@dataclass(frozen=True, eq=False)
class Settled:
    """A batch at its equilibrium, batch last, with what equation (18) and derivatives need.

    commanded: the arm before it gives, geometry: the terms that moved it there
    """

    at: _Residual
    eps: Array
    K: springs.ParallelStiffness
    commanded: Motion
    geometry: tuple[GeometryTerm, ...]


def equilibrium(model: Structure, poses: Poses, x: Array | None = None, loaded: bool = True) -> Equilibrium:
    """Solve equation (17) under gravity, compensators and, if `loaded`, the wrench.

    Raises NotConverged if a pose does not settle (a load beyond the arm's stability).
    """
    parts = [_outcome(settle(model, chunk, x, loaded)) for _, chunk in chunks(poses)]
    return Equilibrium(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def cartesian_stiffness(model: Structure, poses: Poses) -> Array:
    """K_C (N, 6, 6) at the loaded equilibrium, equation (18): (D (K_theta - H)^-1 D')^-1.

    Force over translation in N/m, moment over rotation in N m/rad. InputError where some direction
    is rigid: its stiffness is infinite, use the compliance there.
    """
    compliance = cartesian_compliance(model, poses)
    scale = np.sqrt(np.abs(np.einsum("ncc->nc", compliance)))
    scaled = compliance / np.maximum(scale[:, :, None] * scale[:, None, :], 1e-300)
    if np.any(np.linalg.cond(scaled) > _SINGULAR):
        raise InputError("in one direction the tip is rigid; add springs or use the compliance")
    return np.asarray(np.linalg.inv(compliance), dtype=np.float64)


def cartesian_compliance(model: Structure, poses: Poses, x: Array | None = None, hessian: bool = True) -> Array:
    """Tip twist per unit wrench (N, 6, 6) at the loaded equilibrium: D (I - C H)^-1 C D'."""
    parts: list[Array] = []
    for _, chunk in chunks(poses):
        s = settle(model, chunk, x, True)
        H = s.at.hessian() if hessian else s.at.hessian(weight=0.0, gravity=False)
        tip = s.at.state.tip
        D = np.concatenate([tip.linear, tip.angular], axis=1)
        parts.append(np.einsum("ecn,edn->ncd", D, _react(s.at.slope, s.K, H, s.at.slope[:, None] * D)))
    return np.concatenate(parts)


def _outcome(s: Settled) -> tuple[Array, Array, Array, Array]:
    state = s.at.state
    markers = np.stack([m.position for m in state.markers]) if state.markers else np.zeros((0, 3, s.eps.shape[1]))
    return s.eps.T, state.tip.position.T, state.tip.rotation, markers.transpose(2, 0, 1)


def settle(model: Structure, poses: Poses, x: Array | None, loaded: bool, start: Settled | None = None) -> Settled:
    """Chord steps with the Hessian of the start; Newton steps with a fresh one where those do not settle."""
    x = model.nominal if x is None else x
    geometry, commanded = move_commanded(model, poses, x, loaded)
    compliance, K = model.compliance(x), _equivalent(model, commanded, x)
    weight = 1.0 if loaded else 0.0
    eps = np.zeros((len(compliance), len(poses))) if start is None else start.eps

    def at(eps: Array, state: State | None = None) -> _Residual:
        placed = _deflected(model, commanded, eps) if state is None else state
        return _residual(model, x, placed, compliance, K, eps, weight)

    here = at(eps, None if start is None else start.at.state)
    if not np.any(here.value):  # nothing gives
        return Settled(here, eps, K, commanded, geometry)
    H, size, change = here.hessian(), np.zeros(len(poses)), eps
    for step in range(_STEPS):
        newton = step >= _CHORDS
        if newton:
            H = here.hessian()
        change = _react(here.slope, K, H, here.value) if newton else _chord(here.slope, K, H, here.value)
        eps = eps - change
        before, size = size, np.abs(change).max(axis=0, initial=0.0)
        here = at(eps)
        shrank = np.minimum(size / np.maximum(before, 1e-300), 1.0) if step else 1.0
        if np.all(size * shrank <= _TOLERANCE * np.maximum(np.abs(eps).max(axis=0, initial=0.0), 1e-9)):
            return Settled(here, _elastic(model, x, eps), K, commanded, geometry)
    raise NotConverged(f"a pose does not settle in {_STEPS} steps: {_softest(model, x, eps, change)}")


def _elastic(model: Structure, x: Array, eps: Array) -> Array:
    """eps (ne, N) of a settled batch, or NotConverged where no arm gives so much and still stands.

    Of numbers far too large a step loses its digits and looks settled.
    """
    if np.all(np.abs(eps) <= _FARTHEST):
        return eps
    raise NotConverged(f"no elastic arm gives so far: {_softest(model, x, eps, eps)}")


def _softest(model: Structure, x: Array, eps: Array, moved: Array) -> str:
    """Which coordinate is moved most (ne, N), how far it has given, and what to look at."""
    i, n = np.unravel_index(np.argmax(np.abs(moved)), moved.shape)
    at = model.compliance_rows[i]
    p = model.parameters[at]
    return (
        f"{p.name} of {x[at]:.3g} {p.unit} lets it give by {eps[i, n]:.2g} rad or m. Look at the units of compliances "
        "and of the load; a load beyond the arm's stability does the same"
    )


def _chord(slope: Array, K: springs.ParallelStiffness, H: Array, rhs: Array) -> Array:
    """Two terms of (I + diag(slope) (K - H))^-1 in powers of H, which is small beside the springs."""
    inverted = springs.inverse(K, slope)
    first = springs.solve(K, inverted, rhs)
    return first + springs.solve(K, inverted, slope * np.einsum("abn,bn->an", H, first))


def _deflected(model: Structure, commanded: Motion, eps: Array) -> State:
    """Place the chain with its coordinates at eps: actuators, bars and virtual joints all move."""
    layout = commanded.layout
    phi, bars = commanded.phi.copy(), commanded.bars.copy()
    virtual: dict[int, Array] = {}
    for parts, value in zip(layout.coordinates, eps, strict=True):
        for part in parts:
            if part.kind == "actuator":
                phi[part.index] += part.factor * value
            elif part.kind == "bar":
                bars[part.index] += part.factor * value
            else:
                virtual[part.index] = virtual.get(part.index, 0.0) + part.factor * value
    return place(move(layout, commanded.context, phi, bars, commanded.placements), model.tip, model.markers, virtual)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Residual:
    """eps - c T - f(T) at a deflected state, the torques T, the slope c + f' and the laws' terms there."""

    value: Array
    T: Array
    slope: Array
    laws: springs.Terms
    state: State
    applied: loads.Applied
    gravity: Array
    torques: springs.Torques
    drawn: Sequence[pulls.Pull | None]
    weight: float

    def hessian(self, weight: float | None = None, gravity: bool = True) -> Array:
        """H at this state; the tip load and gravity can be left out."""
        applied = self.applied if gravity else replace(self.applied, moments=np.zeros_like(self.applied.moments))
        weight = self.weight if weight is None else weight
        return load_hessian(self.state, applied, self.gravity, self.torques, self.drawn, weight)


def _residual(
    model: Structure, x: Array, state: State, compliance: Array, K: springs.ParallelStiffness, eps: Array, weight: float
) -> _Residual:
    context = state.motion.context
    applied = loads.apply_loads(model.of_kind(Load, x), state.tip.rotation, context)
    torques = springs.torques(model.of_kind(ParallelSpring, x), state.motion)
    T = loads.gravity_torque(state, applied.moments, model.gravity) - K.times(eps)
    if weight:
        T += weight * loads.wrench_torque(state.tip, applied.wrench.T)
    for joints, term in torques:
        rates = springs.joint_rates(state.motion, joints)
        T[list(rates.active)] += np.einsum("jan,nj->an", rates.E, term.value)
    drawn = pulls.pulls(model.of_kind(ParallelSpring, x), state.placed, context)
    pulled = pulls.torque(drawn, state.motion.coefficients)
    T += 0.0 if pulled is None else pulled
    value, slope, terms = springs.answer(compliance, T, elastic_laws(model, x, context))
    return _Residual(
        value=eps - value,
        T=T,
        slope=slope,
        laws=terms,
        state=state,
        applied=applied,
        gravity=model.gravity,
        torques=torques,
        drawn=drawn,
        weight=weight,
    )


def _equivalent(model: Structure, motion: Motion, x: Array) -> springs.ParallelStiffness:
    """K_eq of the commanded pose: the compensators' equivalent stiffness alone."""
    blocks: list[tuple[tuple[int, ...], Array]] = []
    for effect, xs in model.of_kind(ParallelSpring, x):
        joints = springs.joints_of(effect, motion)
        term = laws.stiffness(effect, motion.q[list(joints)].T, xs, motion.context)
        if term is not None:
            blocks.append((joints, term.value))
    touched = tuple(sorted({j for joints, _ in blocks for j in joints}))
    rates = springs.joint_rates(motion, touched)
    return springs.ParallelStiffness(
        rates.active, springs.sandwich(rates.E, gather(touched, blocks, motion.q.shape[-1]), rates.E)
    )


def stiffness_left(K: springs.ParallelStiffness, H: Array) -> springs.ParallelStiffness:
    """K - H on all coordinates: what gives further moves the loads too."""
    count, rows = len(H), list(K.active)
    stiffness = -H
    stiffness[np.ix_(rows, rows)] += K.K
    return springs.ParallelStiffness(tuple(range(count)), stiffness)


def _react(slope: Array, K: springs.ParallelStiffness, H: Array, rhs: Array) -> Array:
    """Solve (I + diag(slope) (K - H)) d = rhs for rhs (ne, ..., N). NotConverged where no d is told."""
    A, flat = springs.system(stiffness_left(K, H), slope), rhs.reshape(len(slope), -1, rhs.shape[-1])
    try:
        solved = np.asarray(np.linalg.solve(A.transpose(2, 0, 1), flat.transpose(2, 0, 1)), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise NotConverged(
            "a pose stands just where its load makes the arm give without end: look at the units of its compliances "
            "and of the load"
        ) from None
    return solved.transpose(1, 2, 0).reshape(rhs.shape)


def load_hessian(
    state: State, applied: Applied, gravity: Array, torques: Torques, drawn: Sequence[Pull | None], weight: float = 1.0
) -> Array:
    """H (ne, ne, N): tip load (times `weight`, 0 for the unloaded state), gravity and compensators."""
    motion, wrench = state.motion, applied.wrench.T * weight
    pull = np.broadcast_to(gravity[:, None], wrench[:3].shape)
    acting = [(state.tip.elements, wrench[:3])] if weight else []
    acting += [(columns, pull) for columns in mass_columns(state.placed, applied.moments)]
    elements = _of_forces(acting, motion.used, wrench.shape[1])
    if weight:
        _add_moment(elements, motion.used, state.tip.elements, wrench[3:])
    place = {e: i for i, e in enumerate(motion.used)}
    coefficients = tuple(tuple((place[e], rate) for e, rate in terms) for terms in motion.coefficients)
    H = on_coordinates(coefficients, elements)
    for joints, term in torques:
        rates = joint_rates(motion, joints)
        H[np.ix_(rates.active, rates.active)] += sandwich(rates.E, term.dq.transpose(1, 2, 0), rates.E)
    drawn = [spring for spring in drawn if spring is not None and spring.acts]
    for spring in drawn:
        H -= spring.on(motion.coefficients, spring.stiffness())
    H += _turning(state, applied, weight)
    if motion.layout.loops:
        torque = sum((spring.torque() for spring in drawn), np.zeros((len(motion.layout.chain), wrench.shape[1])))
        for columns, force in acting:
            torque[: columns.upstream] += np.einsum("ecn,cn->en", columns.linear, force)
        if weight:
            columns = state.tip.elements
            torque[: columns.upstream] += np.einsum("ecn,cn->en", columns.angular, wrench[3:])
        for joints, term in torques:
            torque[[motion.layout.joint_elements[j] for j in joints]] += term.value.T
        H += _curvature(motion, torque)
    return H


def _of_forces(acting: Sequence[tuple[Twists, Array]], used: Sequence[int], batch: int) -> Array:
    """H_ab = f . (omega_a x v_b) for a <= b, symmetric (u, u, N), of the elements that elastic coordinates move."""
    total = np.zeros((len(used), len(used), batch))
    for columns, force in acting:
        own = [e for e in used if e < columns.upstream]
        lever = cross(force[None], columns.angular[own])
        total[: len(own), : len(own)] += np.einsum("acn,bcn->abn", lever, columns.linear[own])
    later, earlier = np.tril_indices(len(used), -1)
    total[later, earlier] = total[earlier, later]
    return total


def _add_moment(total: Array, used: Sequence[int], columns: Twists, moment: Array) -> None:
    """H_cd += m . (omega_d x omega_c) for d < c: not symmetric."""
    if not np.any(moment):
        return
    angular = columns.angular[[e for e in used if e < columns.upstream]]
    found = np.einsum("dkn,ckn->dcn", cross(moment[None], angular), angular)
    d, c = np.triu_indices(len(angular), 1)
    total[c, d] += found[d, c]


def _curvature(motion: Motion, torque: Array) -> Array:
    """(dE/d eps)' torque: the loops bend the way from actuators to joints."""
    count = len(motion.coefficients)
    total = np.zeros((count, count, torque.shape[-1]))
    for loop, term in zip(motion.layout.loops, motion.loops, strict=True):
        if not np.any(term.q_uu):
            continue
        joints = [motion.layout.joint_elements[j] for j in loop.joints]
        bend = np.einsum("niuv,in->uvn", term.q_uu, torque[joints])
        inside = [
            (c, index, part.factor)
            for c, parts in enumerate(motion.layout.coordinates)
            for part in parts
            if (index := loop.input(part.kind, part.index)) is not None
        ]
        for c, u, first in inside:
            for d, v, second in inside:
                total[c, d] += first * second * bend[u, v]
    return total


def _turning(state: State, applied: Applied, weight: float) -> Array | float:
    """Loads that turn with the flange: D' (dw / d rotation) times the flange's rotation per coordinate."""
    turning = [term.d_rotation for term in applied.terms if term.d_rotation is not None]
    if not turning or not weight:
        return 0.0
    change = weight * wrench_along(applied.terms, state.tip.angular, None).transpose(0, 2, 1)
    linear = np.einsum("ekn,dkn->edn", state.tip.linear, change[:, :3])
    return linear + np.einsum("ekn,dkn->edn", state.tip.angular, change[:, 3:])
