"""The chain rule: how a reading changes with each parameter, through all seven stages.

A parameter enters at the stage of its effect as a `Change`; everything after that stage is common.
    d eps = (I + diag(c + f') K)^-1 [d(c T + f) + (c + f') (d tau_0 + d tau - dK eps)]
    d reading = D d eps + dD eps, through the sensors
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics import loads, pulls, springs
from qsframework.elastostatics.evaluation import Evaluation, gather, joint_torque
from qsframework.elastostatics.motion import MotionRate, combine, motion_along
from qsframework.elastostatics.sensors import turn_rate
from qsframework.elastostatics.state import ColumnRate, column_along
from qsframework.plugin import Array, Geometry, Load, Loop, ParallelSpring, Sensor, Spring, SpringLaw


@dataclass(frozen=True, eq=False)
class Change:
    """What one parameter changes before the springs answer; None stands for nothing.

    tau, preload (ne, N); K (a, a, N); law: (coordinates, derivative (N, k)) for the unloaded and
    the loaded state; markers: rates of the markers' columns
    """

    tau: Array | None = None
    preload: Array | None = None
    K: Array | None = None
    law: tuple[tuple[int, ...], Array, Array] | None = None
    markers: tuple[ColumnRate, ...] | None = None


def sensitivities(ev: Evaluation, wanted: Sequence[int]) -> Array:
    """d reading / d parameter for the wanted positions in x: (P, K, 3, N)."""
    out = np.empty((len(wanted), len(ev.state.markers), 3, len(ev.poses)))
    counts: dict[type, int] = {}
    for effect, part in zip(ev.model.effects, ev.model.slices, strict=True):
        kind = next(k for k in _RULES if isinstance(effect, k))
        number = counts.get(kind, 0)
        counts[kind] = number + (part.stop - part.start if kind is Spring else 1)
        for row, position in enumerate(wanted):
            if part.start <= position < part.stop:
                out[row] = _RULES[kind](ev, number, position - part.start)
    return out


def _answer(ev: Evaluation, response: springs.Response, change: Change, is_loaded: bool) -> Array:
    """d eps (ne, N) of one state."""
    drive = np.zeros_like(response.eps)
    if change.preload is not None and ev.preload is not None:
        drive += change.preload
    if is_loaded and change.tau is not None:
        drive += change.tau
    if change.K is not None:
        drive -= springs.Stiffness(response.stiffness.active, change.K).times(response.eps)
    rhs = response.slope * drive
    if change.law is not None:
        rows, unloaded, loaded = change.law
        np.add.at(rhs, list(rows), (loaded if is_loaded else unloaded).T)
    return response.react(rhs)


def _finish(ev: Evaluation, change: Change) -> Array:
    """d reading (K, 3, N) of a change."""
    loaded = _answer(ev, ev.loaded, change, True)
    unloaded = None if ev.unloaded is None else _answer(ev, ev.unloaded, change, False)
    return _readings(ev, unloaded, loaded, change.markers)


def _readings(ev: Evaluation, unloaded: Array | None, loaded: Array, markers: tuple[ColumnRate, ...] | None) -> Array:
    if ev.sensed is not None:
        first = None if ev.unloaded is None else ev.unloaded.eps
        return _sensed(ev, 1, loaded, ev.loaded.eps, markers) - _sensed(ev, 0, unloaded, first, markers)
    change = loaded if unloaded is None else loaded - unloaded
    out = np.stack([np.einsum("ecn,en->cn", m.linear, change) for m in ev.state.markers])
    if markers is not None:
        eps = ev.loaded.eps if ev.unloaded is None else ev.loaded.eps - ev.unloaded.eps
        out += np.stack([np.einsum("ecn,en->cn", m.linear, eps) for m in markers])
    return out


def _sensed(
    ev: Evaluation, which: int, change: Array | None, eps: Array | None, markers: tuple[ColumnRate, ...] | None
) -> Array:
    """d reading of one state through the sensors."""
    assert ev.sensed is not None
    sensed = ev.sensed[which]
    shift, spin = np.zeros_like(sensed.position), np.zeros_like(sensed.position)
    carried = None
    if change is not None:
        shift += np.stack([np.einsum("ecn,en->cn", m.linear, change) for m in ev.state.markers])
        spin += np.stack([np.einsum("ecn,en->cn", m.angular, change) for m in ev.state.markers])
    if markers is not None:
        shift += np.stack([m.position for m in markers])
        carried = np.stack([m.turn for m in markers])
        if eps is not None:
            shift += np.stack([np.einsum("ecn,en->cn", m.linear, eps) for m in markers])
            spin += np.stack([np.einsum("ecn,en->cn", m.angular, eps) for m in markers])
    turn = turn_rate(sensed.turned, spin, carried)
    total = np.einsum("nkij,kjn->kin", sensed.by_position, shift)
    return total + np.einsum("nkij,nkj->kin", sensed.by_rotation, turn)


def _compliance(ev: Evaluation, first: int, i: int) -> Array:
    """A spring: column D_i times the torque T_i that it carries, equation (4)."""
    coordinate = first + i
    if ev.sensed is None and coordinate not in ev.rates.active:
        torque = ev.loaded.T[coordinate] if ev.unloaded is None else ev.loaded.T[coordinate] - ev.unloaded.T[coordinate]
        return np.stack([m.linear[coordinate] * torque for m in ev.state.markers])

    def answer(response: springs.Response) -> Array:
        rhs = np.zeros_like(response.eps)
        rhs[coordinate] = response.T[coordinate]
        return response.react(rhs)

    return _readings(ev, None if ev.unloaded is None else answer(ev.unloaded), answer(ev.loaded), None)


def _parallel(ev: Evaluation, number: int, i: int) -> Array:
    pull = ev.pulls[number]
    if pull is not None:
        return _pulled(ev, pull, i)
    face = ev.faces[number]
    K = gather(ev.touched, [(face.joints, face.stiffness.dx[..., i])], len(ev.poses))
    preload = None
    if ev.preload is not None and face.torque is not None:
        rows = [ev.touched.index(j) for j in face.joints]
        preload = np.zeros_like(ev.preload)
        preload[list(ev.rates.active)] = np.einsum("jan,nj->an", ev.rates.E[rows], face.torque.dx[..., i])
    return _finish(ev, Change(K=springs.sandwich(ev.rates.E, K, ev.rates.E), preload=preload))


def _pulled(ev: Evaluation, pull: pulls.Pull, i: int) -> Array:
    """A parameter of a spring between two points."""
    coefficients, active = ev.motion.coefficients, ev.rates.active
    K = pulls.on_coordinates(coefficients, pull.stiffness_by(i))[np.ix_(active, active)]
    preload = None if ev.preload is None else combine(coefficients, pull.torque_by(i))
    return _finish(ev, Change(K=K, preload=preload))


def _law(ev: Evaluation, number: int, i: int) -> Array:
    assert ev.unloaded is not None
    rows, loaded = ev.loaded.laws[number]
    _, unloaded = ev.unloaded.laws[number]
    return _finish(ev, Change(law=(rows, unloaded.dx[..., i], loaded.dx[..., i])))


def _load(ev: Evaluation, number: int, i: int) -> Array:
    terms = ev.applied.terms
    wrench = loads.wrench_along(terms, None, terms[number].dx[..., i], number + 1)
    preload = None
    moments = terms[number].moments_dx
    if ev.preload is not None and moments is not None:
        preload = loads.gravity_torque(ev.state, moments[..., i], ev.model.gravity)
    return _finish(ev, Change(tau=loads.wrench_torque(ev.state.tip, wrench.T), preload=preload))


def _sensor(ev: Evaluation, number: int, i: int) -> Array:
    assert ev.sensed is not None
    unloaded, loaded = ev.sensed
    change = loaded.by_parameters[number][..., i] - unloaded.by_parameters[number][..., i]
    return change.transpose(1, 2, 0)


def _geometry(ev: Evaluation, number: int, i: int) -> Array:
    term = ev.geometry[number]
    twists = None if term.twists_dx is None else term.twists_dx[..., i].transpose(1, 2, 0)
    bars = np.zeros((ev.model.layout.bars, len(ev.poses)))
    return _geometric(ev, motion_along(ev.motion, term.angles_dx[..., i].T, bars, twists))


def _loop(ev: Evaluation, number: int, i: int) -> Array:
    bars = np.zeros((ev.model.layout.bars, len(ev.poses)))
    bars[ev.model.layout.loops[number].bars[i]] = 1.0
    return _geometric(ev, motion_along(ev.motion, np.zeros_like(ev.motion.q), bars, None))


def _geometric(ev: Evaluation, rate: MotionRate) -> Array:
    """A change of the unloaded geometry reaches every stage after it."""
    tip = column_along(ev.motion, ev.state.tip, rate)
    tau = loads.wrench_torque(tip, ev.applied.wrench.T)
    if ev.applied.terms:
        wrench = loads.wrench_along(ev.applied.terms, tip.turn, None)
        tau = tau + loads.wrench_torque(ev.state.tip, wrench.T)
    markers = tuple(column_along(ev.motion, m, rate) for m in ev.state.markers)
    dE = springs.joint_rates(ev.motion, ev.touched, ev.rates.active, rate.coefficients).E
    K, preload = _stiffness_along(ev, rate, dE), _preload_along(ev, rate, dE)
    if any(pull is not None for pull in ev.pulls):
        effects = ev.model.of_kind(ParallelSpring, ev.x)
        dK, dtorque = pulls.along(effects, ev.motion, rate, ev.poses.loaded)
        K = K + dK[np.ix_(ev.rates.active, ev.rates.active)]
        preload = None if preload is None else preload + dtorque
    return _finish(ev, Change(tau=tau, K=K, preload=preload, markers=markers))


def _joint_rate(ev: Evaluation, joints: Sequence[int], rate: MotionRate) -> Array:
    return rate.elements[[ev.model.layout.joint_elements[j] for j in joints]]


def _stiffness_along(ev: Evaluation, rate: MotionRate, dE: Array) -> Array:
    blocks = [(f.joints, np.einsum("nijk,kn->nij", f.stiffness.dq, _joint_rate(ev, f.joints, rate))) for f in ev.faces]
    E, K = ev.rates.E, ev.joint_stiffness
    slope = springs.sandwich(E, gather(ev.touched, blocks, len(ev.poses)), E)
    return slope + springs.sandwich(dE, K, E) + springs.sandwich(E, K, dE)


def _preload_along(ev: Evaluation, rate: MotionRate, dE: Array) -> Array | None:
    if ev.preload is None:
        return None
    total = loads.gravity_torque_along(ev.state, ev.applied.moments, ev.model.gravity, rate)
    slope = np.zeros((len(ev.touched), len(ev.poses)))
    for f in ev.faces:
        if f.torque is not None:
            turn = np.einsum("nij,jn->in", f.torque.dq, _joint_rate(ev, f.joints, rate))
            slope[[ev.touched.index(j) for j in f.joints]] += turn
    torque = joint_torque(ev.faces, ev.touched, len(ev.poses))
    total[list(ev.rates.active)] += np.einsum("jan,jn->an", dE, torque) + np.einsum("jan,jn->an", ev.rates.E, slope)
    return total


_RULES = {
    Geometry: _geometry,
    Loop: _loop,
    Spring: _compliance,
    ParallelSpring: _parallel,
    SpringLaw: _law,
    Load: _load,
    Sensor: _sensor,
}
