"""The chain rule: how a reading changes with each parameter, through all seven stages.

A parameter enters at the stage of its effect as a `Change`; everything after that stage is common
to all of them, and the same for a displacement and for the position in one state.
    d eps = (I + diag(c + f') K)^-1 [d(c T + f) + (c + f') (d tau_0 + d tau - dK eps)]
    d position = d FK + D d eps + dD eps, through the sensors
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from qsframework.elastostatics import loads, pulls, springs
from qsframework.elastostatics.direct import element_readings, geometry_tangents
from qsframework.elastostatics.evaluation import PlacedArm, gather, joint_torque
from qsframework.elastostatics.motion import Motion, MotionRate, combine, mixed_along, motion_along
from qsframework.elastostatics.sensors import Sensed
from qsframework.elastostatics.state import PlacedSite, PlacedSiteRate, columns_along
from qsframework.plugin import Array, Effect, Geometry, Load, Loop, ParallelSpring, Sensor, Spring, SpringLaw, laws


@dataclass(frozen=True, eq=False, kw_only=True)
class Change:
    """What one parameter changes before the springs answer, or in the reading; None stands for nothing.

    tau, preload (ne, N); K: of the stiffness (a, a, N), as factors (j, a, N), (j, k, N), (k, a, N) whose products it is
    the sum of, and as a matrix; spring: the coordinates whose compliance it is; law and sensor:
    which one it belongs to and its place there; markers: rates of the markers' columns
    """

    tau: Array | None = None
    preload: Array | None = None
    K: tuple[Sequence[tuple[Array, Array, Array]], Array | None] | None = None
    spring: tuple[int, ...] | None = None
    law: tuple[int, int] | None = None
    sensor: tuple[int, int] | None = None
    markers: tuple[PlacedSiteRate, ...] | None = None


@dataclass(frozen=True, eq=False)
class ReadState:
    """A state that is read of a placed arm. response: None of the pose that nothing deflects; sensed: None without
    sensors."""

    loaded: bool
    response: springs.Response | None
    sensed: Sensed | None


def changes(ev: PlacedArm, wanted: Sequence[int]) -> Iterator[tuple[int, Change]]:
    """Row and change for each wanted position in x, one at a time because they are large."""
    counts: dict[type, int] = {}
    for effect, part in zip(ev.model.effects, ev.model.slices, strict=True):
        kind = next(k for k in (Spring, *_RULES) if isinstance(effect, k))
        number = counts.get(kind, 0)
        own = [at for at in ev.model.compliance_rows if part.start <= at < part.stop]
        counts[kind] = number + (len(own) if isinstance(effect, Spring) else 1)
        for row, position in enumerate(wanted):
            if part.start <= position < part.stop:
                i = position - part.start
                if isinstance(effect, Spring):
                    coordinates = tuple(c for c, at in enumerate(ev.model.compliance_rows) if at == position)
                    yield row, Change(spring=coordinates) if coordinates else _ratio(ev, effect, number, i)
                else:
                    yield row, _RULES[kind](ev, number, i)


def answer(ev: PlacedArm, response: springs.Response, change: Change, loaded: bool) -> Array:
    """d eps (ne, N) of one state; the wrench acts on the loaded one only."""
    if change.spring is not None:
        rhs = np.zeros_like(response.eps)
        rhs[list(change.spring)] = response.T[list(change.spring)]
        return response.react(rhs)
    drive = np.zeros_like(response.eps)
    if change.preload is not None and ev.preloaded:
        drive += change.preload
    if loaded and change.tau is not None:
        drive += change.tau
    if change.K is not None:
        rows = list(ev.rates.active)
        eps = (response.eps if response.held is None else response.held)[rows]
        products, matrix = change.K
        for product in products:
            drive[rows] -= springs.sandwiched(*product, eps)
        if matrix is not None:
            drive[rows] -= np.einsum("abn,bn->an", matrix, eps)
    rhs = response.slope * drive
    if change.law is not None:
        rows, term = response.laws[change.law[0]]
        np.add.at(rhs, list(rows), term.dx[..., change.law[1]].T)
    return response.react(rhs)


def carry(columns: Sequence[PlacedSite | PlacedSiteRate], eps: Array, turn: bool = False) -> Array:
    """Shift (K, 3, N) of the markers, or the turn of their links, under a deflection eps (ne, N)."""
    return np.stack([np.einsum("ecn,en->cn", c.angular if turn else c.linear, eps) for c in columns])


def reading_along(ev: PlacedArm, state: ReadState, change: Change) -> Array:
    """d reading (K, 3, N) of one state."""
    sensed, response = state.sensed, state.response
    if change.sensor is not None:
        assert sensed is not None
        return sensed.by_parameters[change.sensor[0]][..., change.sensor[1]].transpose(1, 2, 0)
    if sensed is None and response is not None and change.spring is not None:
        own = list(change.spring)
        if not set(own) & set(response.stiffness.active):  # it gives by itself
            return np.stack([np.einsum("ekn,en->kn", m.linear[own], response.T[own]) for m in ev.state.markers])
    shift = np.zeros((len(ev.state.markers), *ev.state.tip.position.shape))
    turns = sensed is not None and sensed.turns
    if sensed is not None:
        shift = np.zeros_like(sensed.position)  # its layout in memory too, which einsum's rounding follows
    spin, carried = np.zeros_like(shift), None
    if response is not None:
        rate = answer(ev, response, change, state.loaded)
        shift += carry(ev.state.markers, rate)
        if turns:
            spin += carry(ev.state.markers, rate, turn=True)
    if change.markers is not None:
        shift += np.stack([m.position for m in change.markers])
        carried = np.stack([m.turn for m in change.markers])
        if response is not None:
            shift += carry(change.markers, response.eps)
        if response is not None and turns:
            spin += carry(change.markers, response.eps, turn=True)
    if sensed is None:
        return shift
    total = np.einsum("nkij,kjn->kin", sensed.by_position, shift)
    if not turns:
        return total
    turn = sensed.turn_rate(spin, carried)
    return total + np.einsum("nkij,nkj->kin", sensed.by_rotation, turn)


def tangents(ev: PlacedArm, wanted: Sequence[int], states: Sequence[ReadState]) -> Array:
    """d reading / d parameter (N, K, 3, P) of a state, or of the first less the second, for the wanted positions in
    x."""

    def elements() -> Array:
        return reduce(np.subtract, (element_readings(ev, s.sensed, s.response, s.loaded) for s in states))

    out = np.empty((len(wanted), len(ev.state.markers), 3, len(ev.poses)))
    others = geometry_tangents(ev, wanted, elements, out)
    for row, change in changes(ev, [wanted[i] for i in others]):
        out[others[row]] = reduce(np.subtract, (reading_along(ev, s, change) for s in states))
    return out.transpose(3, 1, 2, 0)


def _ratio(ev: PlacedArm, effect: Spring, first: int, i: int) -> Change:
    """A ratio by which a spring's coordinates, from `first` on, move its virtual joints."""
    x = next(xs for e, xs in ev.model.of_kind(Spring, ev.x) if e is effect)
    slope = laws.mixing_slope(effect, x, ev.motion.context)[..., i]

    def moved(motion: Motion) -> MotionRate:
        eps = ev.settled if motion is ev.motion else None
        return mixed_along(motion, ev.model.layout, first, slope, eps)

    return _geometric(ev, moved)


def _parallel(ev: PlacedArm, number: int, i: int) -> Change:
    pull = ev.pulls[number]
    if pull is not None:
        return _pulled(ev, pull, i)
    face, K = ev.faces[number], None
    if ev.held is not None:
        E = ev.held.rates.E
        K = ([(E, gather(ev.touched, [(face.joints, face.stiffness.dx[..., i])], len(ev.poses)), E)], None)
    preload = None
    if ev.preloaded and face.torque is not None:
        rows = [ev.touched.index(j) for j in face.joints]
        preload = ev.torques
        preload[list(ev.rates.active)] = np.einsum("jan,nj->an", ev.rates.E[rows], face.torque.dx[..., i])
    return Change(K=K, preload=preload)


def _pulled(ev: PlacedArm, pull: pulls.Pull, i: int) -> Change:
    """A parameter of a spring between two points."""
    coefficients, active, K = ev.motion.coefficients, ev.rates.active, None
    if ev.settled is None:
        K = ((), pull.on(coefficients, pull.stiffness_by(i))[np.ix_(active, active)])
    return Change(K=K, preload=combine(coefficients, pull.torque_by(i)) if ev.preloaded else None)


def _load(ev: PlacedArm, number: int, i: int) -> Change:
    terms = ev.applied.terms
    wrench = loads.wrench_along(terms, None, terms[number].dx[..., i], number + 1)
    preload = None
    moments = terms[number].moments_dx
    if ev.preloaded and moments is not None:
        own = loads.of_bodies(moments[..., i], ev.model.facts)
        preload = loads.gravity_torque(ev.state, own, ev.model.gravity)
    return Change(tau=loads.wrench_torque(ev.state.tip, wrench.T), preload=preload)


def _geometry(ev: PlacedArm, number: int, i: int) -> Change:
    term = ev.geometry[number]
    twists = None if term.twists_dx is None else term.twists_dx[..., i].transpose(1, 2, 0)
    bars = np.zeros((ev.model.layout.bars, len(ev.poses)))
    return _geometric(ev, lambda motion: motion_along(motion, term.angles_dx[..., i].T, bars, twists))


def _loop(ev: PlacedArm, number: int, i: int) -> Change:
    bars = np.zeros((ev.model.layout.bars, len(ev.poses)))
    bars[ev.model.layout.loop_bars[number][i]] = 1.0
    return _geometric(ev, lambda motion: motion_along(motion, np.zeros_like(motion.q), bars, None))


def _geometric(ev: PlacedArm, moved: Callable[[Motion], MotionRate]) -> Change:
    """A change of the unloaded geometry reaches every stage after it. moved: how it moves a motion"""
    rate = moved(ev.motion)
    tip, *markers = columns_along(ev.motion, (ev.state.tip, *ev.state.markers), rate)
    tau = loads.wrench_torque(tip, ev.applied.wrench.T)
    if ev.applied.terms:
        wrench = loads.wrench_along(ev.applied.terms, tip.turn, None)
        tau = tau + loads.wrench_torque(ev.state.tip, wrench.T)
    dE = springs.joint_rates(ev.motion, ev.touched, ev.rates.active, rate.coefficients).E
    preload = _preload_along(ev, rate, dE) if ev.preloaded else None
    return Change(tau=tau, K=_stiffness_along(ev, moved, rate, dE), preload=preload, markers=tuple(markers))


def _joint_rate(ev: PlacedArm, joints: Sequence[int], rate: MotionRate) -> Array:
    return rate.elements[[ev.model.layout.joint_elements[j] for j in joints]]


def _stiffness_along(
    ev: PlacedArm, moved: Callable[[Motion], MotionRate], rate: MotionRate, dE: Array
) -> tuple[Sequence[tuple[Array, Array, Array]], Array | None] | None:
    """d (E' k E), as products, and that of springs between two points, as a matrix."""
    if ev.held is None:
        return None
    matrix = None
    if ev.settled is None:
        matrix = pulls.stiffness_along(ev.model.of_kind(ParallelSpring, ev.x), ev.motion, ev.pulls, rate)
        matrix = None if matrix is None else matrix[np.ix_(ev.rates.active, ev.rates.active)]
    else:
        rate = moved(ev.held.motion)
        dE = springs.joint_rates(ev.held.motion, ev.touched, ev.rates.active, rate.coefficients).E
    blocks = [(f.joints, np.einsum("nijk,kn->nij", f.stiffness.dq, _joint_rate(ev, f.joints, rate))) for f in ev.faces]
    E, K = ev.held.rates.E, ev.held.joint_stiffness
    return [(E, gather(ev.touched, blocks, len(ev.poses)), E), (dE, K, E), (E, K, dE)], matrix


def _preload_along(ev: PlacedArm, rate: MotionRate, dE: Array) -> Array:
    total = loads.gravity_torque_along(ev.state, ev.masses, ev.model.gravity, rate)
    slope = np.zeros((len(ev.touched), len(ev.poses)))
    for f in ev.faces:
        if f.torque is not None:
            turn = np.einsum("nij,jn->in", f.torque.dq, _joint_rate(ev, f.joints, rate))
            slope[[ev.touched.index(j) for j in f.joints]] += turn
    torque = joint_torque(ev.faces, ev.touched, len(ev.poses))
    total[list(ev.rates.active)] += np.einsum("jan,jn->an", dE, torque) + np.einsum("jan,jn->an", ev.rates.E, slope)
    pulled = pulls.torque_along(ev.pulls, ev.motion.coefficients, rate)
    return total if pulled is None else total + pulled


_RULES: dict[type[Effect], Callable[[PlacedArm, int, int], Change]] = {
    Geometry: _geometry,
    Loop: _loop,
    ParallelSpring: _parallel,
    SpringLaw: lambda _, number, i: Change(law=(number, i)),
    Load: _load,
    Sensor: lambda _, number, i: Change(sensor=(number, i)),
}
