"""One batch through all stages, with everything that the chain rule needs afterwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics import loads, pulls, springs
from qsframework.elastostatics.motion import Motion, combine, move, nominal_actuators
from qsframework.elastostatics.sensors import Sensed, sense
from qsframework.elastostatics.state import State, place
from qsframework.elastostatics.structure import Structure, chunks
from qsframework.plugin import (
    Array,
    Conditions,
    Geometry,
    GeometryTerm,
    Load,
    Loop,
    ParallelSpring,
    Poses,
    Sensor,
    Spring,
    SpringLaw,
)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A model at N poses and parameter values x.

    compliance (ne,), tau and preload (ne, N) N m; the preload and the unloaded response are None
    where every law is linear, because they then drop out of a displacement
    """

    model: Structure
    x: Array
    poses: Poses
    geometry: tuple[GeometryTerm, ...]
    motion: Motion
    state: State
    applied: loads.Applied
    compliance: Array
    tau: Array
    preload: Array | None
    faces: tuple[springs.Faces, ...]
    pulls: tuple[pulls.Pull | None, ...]
    rates: springs.JointRates
    joint_stiffness: Array
    unloaded: springs.Response | None
    loaded: springs.Response
    sensed: tuple[Sensed, Sensed] | None

    @property
    def touched(self) -> tuple[int, ...]:
        """The joints that parallel springs act on."""
        return tuple(sorted({j for f in self.faces for j in f.joints}))


def evaluate(model: Structure, poses: Poses, x: Array) -> Evaluation:
    """Run the stages at the commanded poses."""
    geometry, motion = move_commanded(model, poses, x)
    state = place(motion, model.tip, model.markers)
    rotation = state.placed.matrix(model.tip.link)
    applied = loads.apply_loads(model.of_kind(Load, x), poses.wrench, rotation, model.facts)
    compliance = np.concatenate([xs for _, xs in model.of_kind(Spring, x)] or [np.zeros(0)])
    tau = loads.wrench_torque(state.tip, applied.wrench.T)
    faces = tuple(springs.faces(e, motion, xs, poses.loaded) for e, xs in model.of_kind(ParallelSpring, x))
    drawn = tuple(pulls.pulls(model.of_kind(ParallelSpring, x), model.facts, state.placed, poses.loaded))
    touched = tuple(sorted({j for f in faces for j in f.joints}))
    rates = springs.joint_rates(motion, touched, active_coordinates(motion, touched, drawn))
    joint_stiffness = gather(touched, [(f.joints, f.stiffness.value) for f in faces], len(poses))
    K = springs.Stiffness(rates.active, springs.sandwich(rates.E, joint_stiffness, rates.E))
    pulled = pulls.stiffness(drawn, motion.coefficients)
    if pulled is not None:
        K = springs.Stiffness(rates.active, K.K + pulled[np.ix_(rates.active, rates.active)])
    laws = elastic_laws(model, x)
    preload = _preload(model, state, applied, faces, drawn, rates) if laws else None
    unloaded = None if preload is None else springs.respond(compliance, preload, K, laws)
    loaded = springs.respond(compliance, tau if preload is None else preload + tau, K, laws)
    sensed = _sense(model, x, poses, state, unloaded, loaded)
    return Evaluation(
        model, x, poses, geometry, motion, state, applied, compliance, tau, preload, faces, drawn, rates,
        joint_stiffness, unloaded, loaded, sensed,
    )  # fmt: skip


def move_commanded(model: Structure, poses: Poses, x: Array) -> tuple[tuple[GeometryTerm, ...], Motion]:
    """Stages 0 and 1 at the commanded poses, with the errors of geometry and bars."""
    geometry = tuple(e.errors(poses, xs, model.facts) for e, xs in model.of_kind(Geometry, x))
    phi = nominal_actuators(model.layout, np.ascontiguousarray(poses.q.T))
    placements = None
    for term in geometry:
        phi = phi + term.angles.T
        if term.twists is not None:
            twist = term.twists.transpose(1, 2, 0)
            placements = twist if placements is None else placements + twist
    bars = np.concatenate([xs for _, xs in model.of_kind(Loop, x)] or [np.zeros(0)])
    spread = np.broadcast_to(bars[:, None], (len(bars), len(poses)))
    return geometry, move(model.layout, phi, spread, placements)


def elastic_laws(model: Structure, x: Array) -> springs.Laws:
    """The springs' laws with the coordinates that they act on and their parameters."""
    return [(e, rows, xs) for (e, xs), rows in zip(model.of_kind(SpringLaw, x), model.law_rows, strict=True)]


def gather(touched: tuple[int, ...], blocks: list[tuple[tuple[int, ...], Array]], batch: int) -> Array:
    """Sum (N, k, k) blocks of some joints into one (J, J, N) matrix over all touched joints."""
    total = np.zeros((len(touched), len(touched), batch))
    for joints, value in blocks:
        rows = [touched.index(j) for j in joints]
        total[np.ix_(rows, rows)] += value.transpose(1, 2, 0)
    return total


def joint_torque(faces: tuple[springs.Faces, ...], touched: tuple[int, ...], batch: int) -> Array:
    """Torque (J, N) of the parallel springs on the joints they touch."""
    total = np.zeros((len(touched), batch))
    for f in faces:
        if f.torque is not None:
            total[[touched.index(j) for j in f.joints]] += f.torque.value.T
    return total


def _preload(
    model: Structure, state: State, applied: loads.Applied, faces: tuple[springs.Faces, ...],
    drawn: tuple[pulls.Pull | None, ...], rates: springs.JointRates,
) -> Array:  # fmt: skip
    """tau_0: gravity and the compensators' torques on the coordinates, (ne, N)."""
    torque = loads.gravity_torque(state, applied.moments, model.gravity)
    touched = tuple(sorted({j for f in faces for j in f.joints}))
    joints = joint_torque(faces, touched, torque.shape[1])
    torque[list(rates.active)] += np.einsum("jan,jn->an", rates.E, joints)
    pulled = pulls.torque(drawn, state.motion.coefficients)
    return torque if pulled is None else torque + pulled


def active_coordinates(motion: Motion, touched: tuple[int, ...], drawn: Sequence[pulls.Pull | None]) -> tuple[int, ...]:
    """The elastic coordinates that K_par couples: those that turn a touched joint or move a pull's ends."""
    active = set(springs.joint_rates(motion, touched).active)
    for pull in drawn:
        if pull is not None:
            moved = combine(motion.coefficients, pull.gradient)
            active |= {c for c in range(len(moved)) if np.any(moved[c])}
    return tuple(sorted(active))


def _sense(
    model: Structure, x: Array, poses: Poses, state: State, unloaded: springs.Response | None, loaded: springs.Response
) -> tuple[Sensed, Sensed] | None:
    """Readings of the unloaded and the loaded state, where the model has sensors."""
    sensors = model.of_kind(Sensor, x)
    if not sensors:
        return None

    def read(eps: Array | None, conditions: Conditions) -> Sensed:
        return sense(sensors, state, eps, model.marker_names, conditions)

    return read(None if unloaded is None else unloaded.eps, poses.unloaded), read(loaded.eps, poses.loaded)


def displacement(ev: Evaluation) -> Array:
    """Loaded minus unloaded reading of each marker, (K, 3, N) m."""
    if ev.sensed is not None:
        return ev.sensed[1].position - ev.sensed[0].position
    eps = ev.loaded.eps if ev.unloaded is None else ev.loaded.eps - ev.unloaded.eps
    return np.stack([np.einsum("ecn,en->cn", m.linear, eps) for m in ev.state.markers])


def spring_stiffness(model: Structure, poses: Poses, x: Array | None = None) -> Array:
    """K_theta(q) (N, ne, ne) of the elastic coordinates, equation (10): diag(1/c) + K_par at the commanded pose.

    A rigid spring (c = 0) has an infinite entry on the diagonal.
    """
    parts = []
    for _, chunk in chunks(poses):
        ev = evaluate(model, chunk, model.nominal if x is None else model.checked(x))
        count = len(ev.compliance)
        with np.errstate(divide="ignore"):
            total = np.zeros((len(chunk), count, count))
            total[:, range(count), range(count)] = 1.0 / ev.compliance
        rows = np.ix_(range(len(chunk)), ev.loaded.stiffness.active, ev.loaded.stiffness.active)
        total[rows] += ev.loaded.stiffness.K.transpose(2, 0, 1)
        parts.append(total)
    return np.concatenate(parts)
