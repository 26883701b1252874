"""One batch through the stages before the springs, with everything that the chain rule needs afterwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from qsframework.elastostatics import loads, pulls, springs
from qsframework.elastostatics.layout import mixed
from qsframework.elastostatics.motion import KNOWN, Motion, combine, commanded_actuators, move
from qsframework.elastostatics.sensors import Sensed, sense
from qsframework.elastostatics.state import State, place
from qsframework.elastostatics.structure import Structure, chunks
from qsframework.plugin import (
    Array,
    Context,
    Geometry,
    GeometryTerm,
    Load,
    Loop,
    ParallelSpring,
    Poses,
    Sensor,
    Spring,
    SpringLaw,
    laws,
)
from qsframework.robot.gravity import mass_columns
from qsframework.robot.kinematics import Twists


@dataclass(frozen=True, eq=False)
class CommandedStiffness:
    """The stiffness that parallel springs have beside their torque, where the arm is commanded: motion, the rates of
    the touched joints, and the stiffness (J, J, N) on these."""

    motion: Motion
    rates: springs.JointRates
    joint_stiffness: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedArm:
    """A model at N poses and parameter values x, its chain placed: at the commanded angles, or where it settles.

    settled (ne, N): deflection of the coordinates where the chain is placed, None at the commanded angles; held: of the
    springs whose stiffness times a deflection counts, None where there are none
    """

    model: Structure
    x: Array
    poses: Poses
    geometry: tuple[GeometryTerm, ...]
    motion: Motion
    state: State
    applied: loads.Applied
    faces: tuple[springs.Faces, ...]
    pulls: tuple[pulls.Pull | None, ...]
    rates: springs.JointRates
    held: CommandedStiffness | None
    settled: Array | None = None

    @property
    def preloaded(self) -> bool:
        """Whether gravity and the compensators count."""
        return True

    @property
    def torques(self) -> Array:
        """No torque on any coordinate, (ne, N)."""
        return np.zeros((self.state.coordinates, len(self.poses)))

    @property
    def touched(self) -> tuple[int, ...]:
        """The joints that parallel springs act on."""
        return springs.touched(self.faces)

    @cached_property
    def masses(self) -> tuple[Twists, ...]:
        """The masses' Jacobians, for the parameters that move the arm."""
        return mass_columns(self.state.placed, self.applied.moments)

    def sense(self, eps: Array | None, context: Context | None = None) -> Sensed | None:
        """What the instrument says of the pose deflected by eps (ne, N), in this or another state; None without
        sensors."""
        sensors = self.model.of_kind(Sensor, self.x)
        context = self.motion.context if context is None else context
        return sense(sensors, self.state, eps, self.model.marker_names, context) if sensors else None


@dataclass(frozen=True, eq=False, kw_only=True)
class Stages(PlacedArm):
    """The commanded arm, up to the torques on the springs.

    compliance (ne,), tau and preload (ne, N) N m; the preload is None where nobody asked for it:
    a displacement under linear laws does not depend on it
    """

    compliance: Array
    tau: Array
    preload: Array | None
    stiffness: springs.ParallelStiffness
    laws: springs.Laws

    @property
    def preloaded(self) -> bool:
        return self.preload is not None

    def respond(self, torque: Array) -> springs.Response:
        """How the springs answer to a torque (ne, N)."""
        return springs.respond(self.compliance, torque, self.stiffness, self.laws)


def evaluate_stages(model: Structure, poses: Poses, x: Array, preload: bool, loaded: bool = True) -> Stages:
    """Run the stages before the springs at the commanded poses, the arm as it is in one state."""
    geometry, motion = move_commanded(model, poses, x, loaded)
    state = place(motion, model.tip, model.markers)
    applied = loads.apply_loads(model.of_kind(Load, x), state.tip.rotation, motion.context)
    tau = loads.wrench_torque(state.tip, applied.wrench.T)
    faces = tuple(springs.faces(e, motion, xs) for e, xs in model.of_kind(ParallelSpring, x))
    drawn = tuple(pulls.pulls(model.of_kind(ParallelSpring, x), state.placed, motion.context))
    touched = springs.touched(faces)
    rates = springs.joint_rates(motion, touched, active_coordinates(motion, touched, drawn))
    joint_stiffness = gather(touched, [(f.joints, f.stiffness.value) for f in faces], len(poses))
    K = springs.ParallelStiffness(rates.active, springs.sandwich(rates.E, joint_stiffness, rates.E))
    pulled = pulls.stiffness(drawn, motion.coefficients)
    if pulled is not None:
        K = springs.ParallelStiffness(rates.active, K.K + pulled[np.ix_(rates.active, rates.active)])
    return Stages(
        model=model,
        x=x,
        poses=poses,
        geometry=geometry,
        motion=motion,
        state=state,
        applied=applied,
        compliance=model.compliance(x),
        tau=tau,
        preload=_preload(model, state, applied, faces, drawn, rates) if preload else None,
        faces=faces,
        pulls=drawn,
        rates=rates,
        held=CommandedStiffness(motion, rates, joint_stiffness),
        stiffness=K,
        laws=elastic_laws(model, x, motion.context),
    )


def move_commanded(
    model: Structure, poses: Poses, x: Array, loaded: bool = True
) -> tuple[tuple[GeometryTerm, ...], Motion]:
    """Stages 0 and 1 at the commanded poses, with the errors of geometry and bars."""
    return _commanded(model, poses, loaded, tuple(x[list(model.moving)].tolist()))


@lru_cache(maxsize=KNOWN)
def _commanded(
    model: Structure, poses: Poses, loaded: bool, moving: tuple[float, ...]
) -> tuple[tuple[GeometryTerm, ...], Motion]:
    """The same at values of the parameters that move the arm: the steps of a fit mostly change others."""
    x = model.nominal
    x[list(model.moving)] = moving
    context = Context(model.facts, poses, loaded)
    geometry = tuple(laws.geometry(e, xs, context) for e, xs in model.of_kind(Geometry, x))
    layout = mixed(model.layout, model.of_kind(Spring, x), context)
    phi = commanded_actuators(model.layout, poses).copy()
    placements = None
    for term in geometry:
        phi[: model.facts.n] += term.angles.T
        if term.twists is not None:
            twist = term.twists.transpose(1, 2, 0)
            placements = twist if placements is None else placements + twist
    bars = np.concatenate([xs for _, xs in model.of_kind(Loop, x)] or [np.zeros(0)])
    spread = np.broadcast_to(bars[:, None], (len(bars), len(poses)))
    return geometry, move(layout, context, phi, spread, placements)


def elastic_laws(model: Structure, x: Array, context: Context) -> springs.Laws:
    """The springs' laws with the coordinates that they act on and their parameters."""
    return [(e, rows, xs, context) for (e, xs), rows in zip(model.of_kind(SpringLaw, x), model.law_rows, strict=True)]


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
    model: Structure,
    state: State,
    applied: loads.Applied,
    faces: tuple[springs.Faces, ...],
    drawn: tuple[pulls.Pull | None, ...],
    rates: springs.JointRates,
) -> Array:
    """tau_0: gravity and the compensators' torques on the coordinates, (ne, N)."""
    torque = loads.gravity_torque(state, applied.moments, model.gravity)
    joints = joint_torque(faces, springs.touched(faces), torque.shape[1])
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


def spring_stiffness(model: Structure, poses: Poses, x: Array | None = None) -> Array:
    """K_theta(q) (N, ne, ne) of the elastic coordinates, equation (10): diag(1/c) + K_par at the commanded pose.

    A rigid spring (c = 0) has an infinite entry on the diagonal.
    """
    parts: list[Array] = []
    for _, chunk in chunks(poses):
        ev = evaluate_stages(model, chunk, model.nominal if x is None else model.checked(x), preload=False)
        count = len(ev.compliance)
        with np.errstate(divide="ignore"):
            total = np.zeros((len(chunk), count, count))
            total[:, range(count), range(count)] = 1.0 / ev.compliance
        rows = np.ix_(range(len(chunk)), ev.stiffness.active, ev.stiffness.active)
        total[rows] += ev.stiffness.K.transpose(2, 0, 1)
        parts.append(total)
    return np.concatenate(parts)
