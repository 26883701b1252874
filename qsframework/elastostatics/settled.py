"""Readings where the arm settles, with sensors, and their derivatives there.

Each state stands under its own conditions: what warms up between two states moves the arm between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics import springs
from qsframework.elastostatics.equilibrium import Settled, settle, stiffness_left
from qsframework.elastostatics.evaluation import CommandedStiffness, PlacedArm, gather
from qsframework.elastostatics.sensors import Sensed, sense
from qsframework.elastostatics.structure import Structure
from qsframework.elastostatics.tangents import ReadState, tangents
from qsframework.plugin import Array, ParallelSpring, Poses, Sensor, laws


@dataclass(frozen=True, eq=False)
class SettledState:
    """One state of a batch, where it settles."""

    model: Structure
    poses: Poses
    x: Array
    loaded: bool
    settled: Settled

    @property
    def reading(self) -> Array:
        """What the instrument says (N, K, 3) m of the markers."""
        state = self.settled.at.state
        if not state.markers:
            return np.zeros((len(self.poses), 0, 3))
        return self._sensed.position.transpose(2, 0, 1)

    @property
    def _sensed(self) -> Sensed:
        """The reading of the state as it is placed."""
        state, sensors = self.settled.at.state, self.model.of_kind(Sensor, self.x)
        return sense(sensors, state, None, self.model.marker_names, state.motion.context)

    def followed(self) -> Array:
        """d reading (K, ne, 3, N) per unit by which something beside its springs moves each elastic coordinate."""
        state, inverse = self.settled.at.state, _response(self.settled).inverse
        sensed = self._sensed if self.model.of_kind(Sensor, self.x) else None

        def reached(own: Array) -> Array:
            return own if inverse is None else np.einsum("kaxn,abn->kbxn", own, inverse)

        shift = reached(np.stack([m.linear for m in state.markers]))
        if sensed is None:
            return shift
        out = np.einsum("nkij,kajn->kain", sensed.by_position, shift)
        if sensed.turns:
            out += np.einsum(
                "nkij,kajn->kain", sensed.by_rotation, reached(np.stack([m.angular for m in state.markers]))
            )
        return out

    def tangents(self, wanted: Sequence[int]) -> Array:
        """d reading / d parameter (N, K, 3, P) for the wanted positions in x, by the implicit function theorem.

        With eps = c T + f(T) at every x, d eps = (I + diag(c + f') (K - H))^-1 (dc T + df + (c + f') dT), dT at fixed
        eps.
        """
        ev = _placed(self)
        return tangents(ev, wanted, [ReadState(self.loaded, _response(self.settled), ev.sense(None))])


def one_state(
    model: Structure, poses: Poses, x: Array, loaded: bool, start: SettledState | None = None
) -> SettledState:
    """A state of up to CHUNK poses, from where the other has settled if the arm is the same in both.

    Raises NotConverged where a pose does not settle.
    """
    from_there = None if start is None or model.differs(x) else start.settled
    return SettledState(model, poses, x, loaded, settle(model, poses, x, loaded, from_there))


def _response(settled: Settled) -> springs.Response:
    """How a settled batch reacts: nothing is left to give, and what gives further also moves the loads."""
    at = settled.at
    stiffness = stiffness_left(settled.K, at.hessian())
    return springs.Response(
        eps=np.zeros_like(at.T),
        T=at.T,
        slope=at.slope,
        stiffness=stiffness,
        laws=at.laws,
        inverse=springs.inverse(stiffness, at.slope),
        held=settled.eps,
    )


def _placed(at: SettledState) -> PlacedArm:
    """A settled batch as the chain rule looks at it."""
    model, x, settled, batch = at.model, at.x, at.settled, len(at.poses)
    motion, commanded = settled.at.state.motion, settled.commanded
    faces, stiff = list[springs.Faces](), False
    for effect, xs in model.of_kind(ParallelSpring, x):
        joints = springs.joints_of(effect, motion)
        torque = laws.torque(effect, motion.q[list(joints)].T, xs, motion.context)
        term = laws.stiffness(effect, commanded.q[list(joints)].T, xs, commanded.context)
        stiff = stiff or term is not None
        faces.append(springs.Faces(joints, torque, term or springs.no_stiffness(batch, len(joints), len(xs))))
    touched = springs.touched(faces)
    rates = springs.joint_rates(motion, touched)
    held = None
    if stiff:
        own = springs.joint_rates(commanded, touched, rates.active)
        held = CommandedStiffness(
            commanded, own, gather(touched, [(f.joints, f.stiffness.value) for f in faces], batch)
        )
    return PlacedArm(
        model=model,
        x=x,
        poses=at.poses,
        geometry=settled.geometry,
        motion=motion,
        state=settled.at.state,
        applied=settled.at.applied,
        faces=tuple(faces),
        pulls=tuple(settled.at.drawn),
        rates=rates,
        held=held,
        settled=settled.eps,
    )
