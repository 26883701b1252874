"""Readings by the full equilibrium, with sensors: where the markers of each state settle, and what the instrument says.

Each state stands under its own conditions: what warms up between two states moves the arm between them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsframework.elastostatics import springs
from qsframework.elastostatics.direct import element_readings, geometry_tangents
from qsframework.elastostatics.equilibrium import Settled, settle
from qsframework.elastostatics.evaluation import Held, Placed, gather
from qsframework.elastostatics.model import Model
from qsframework.elastostatics.sensors import said
from qsframework.elastostatics.structure import chunks
from qsframework.elastostatics.tangents import changes, reading_along
from qsframework.plugin import Array, ParallelSpring, Poses, Sensor, StiffnessTerm, laws


def exact_positions(model: Model, poses: Poses, x: Array | None = None, loaded: bool = True) -> Array:
    """Position readings (N, K, 3) m of one state, base frame: `Model.positions` without its linearisation.

    Raises NotConverged where a pose does not settle.
    """
    x = model.nominal if x is None else model.checked(x)
    out = np.empty((len(poses), len(model.markers), 3))
    for part, chunk in chunks(poses):
        out[part] = _read(model, settle(model, chunk, x, loaded), x)
    return out


def exact_readings(model: Model, poses: Poses, x: Array | None = None) -> Array:
    """Displacement readings (N, K, 3) m: the loaded less the unloaded equilibrium, each under its own conditions."""
    x = model.nominal if x is None else model.checked(x)
    out = np.empty((len(poses), len(model.markers), 3))
    for part, chunk in chunks(poses):
        unloaded = settle(model, chunk, x, False)
        loaded = settle(model, chunk, x, True, start=None if model.differs(x) else unloaded)
        out[part] = _read(model, loaded, x) - _read(model, unloaded, x)
    return out


def _read(model: Model, settled: Settled, x: Array) -> Array:
    """What the instrument says (N, K, 3) of a settled batch."""
    state = settled.at.state
    if not state.markers:
        return np.zeros((settled.eps.shape[1], 0, 3))
    return said(model.of_kind(Sensor, x), state, model.marker_names)


def position_rates(
    model: Model, poses: Poses, x: Array, names: Sequence[str], loaded: bool = True
) -> tuple[Array, Array]:
    """`exact_positions` (N, K, 3) and their derivatives by the named parameters (N, K, 3, p), at the settled state."""
    x, wanted = model.checked(x), model.index(names)
    value = np.empty((len(poses), len(model.markers), 3))
    slope = np.empty((*value.shape, len(wanted)))
    for part, chunk in chunks(poses):
        settled = settle(model, chunk, x, loaded)
        value[part] = _read(model, settled, x)
        slope[part] = _slopes(model, chunk, x, settled, wanted, loaded).transpose(3, 1, 2, 0)
    return value, slope


def reading_rates(model: Model, poses: Poses, x: Array, names: Sequence[str]) -> tuple[Array, Array]:
    """`exact_readings` (N, K, 3) and their derivatives by the named parameters (N, K, 3, p), each state where it
    settles."""
    x, wanted = model.checked(x), model.index(names)
    value = np.empty((len(poses), len(model.markers), 3))
    slope = np.empty((*value.shape, len(wanted)))
    for part, chunk in chunks(poses):
        before = settle(model, chunk, x, False)
        after = settle(model, chunk, x, True, start=None if model.differs(x) else before)
        value[part] = _read(model, after, x) - _read(model, before, x)
        moved = _slopes(model, chunk, x, after, wanted, True) - _slopes(model, chunk, x, before, wanted, False)
        slope[part] = moved.transpose(3, 1, 2, 0)
    return value, slope


def _slopes(model: Model, poses: Poses, x: Array, settled: Settled, wanted: Sequence[int], loaded: bool) -> Array:
    """d reading / d parameter (P, K, 3, N) of one state, by the implicit function theorem.

    With eps = c T + f(T) at every x, d eps = (I + diag(c + f') (K - H))^-1 (dc T + df + (c + f') dT), dT at fixed eps.
    """
    ev = _placed(model, poses, x, settled)
    response, sensed = _response(settled), ev.sense(None)
    out = np.empty((len(wanted), len(ev.state.markers), 3, len(poses)))
    left = geometry_tangents(ev, wanted, lambda: element_readings(ev, sensed, response, loaded), out)
    for row, change in changes(ev, [wanted[i] for i in left]):
        out[left[row]] = reading_along(ev, sensed, response, change, loaded)
    return out


def _response(settled: Settled) -> springs.Response:
    """How a settled batch reacts: nothing is left to give, and what gives further also moves the loads."""
    at, count = settled.at, len(settled.eps)
    stiffness = -at.hessian()
    rows = list(settled.K.active)
    stiffness[np.ix_(rows, rows)] += settled.K.K
    A = at.slope[:, None] * stiffness
    A[range(count), range(count)] += 1.0
    inverse = np.asarray(np.linalg.inv(A.transpose(2, 0, 1)).transpose(1, 2, 0), dtype=np.float64)
    reaction = springs.Stiffness(tuple(range(count)), stiffness)
    return springs.Response(np.zeros_like(at.T), at.T, at.slope, reaction, at.laws, inverse, settled.eps)


def _placed(model: Model, poses: Poses, x: Array, settled: Settled) -> Placed:
    """A settled batch as the chain rule looks at it."""
    motion, commanded, batch = settled.at.state.motion, settled.commanded, len(poses)
    faces, stiff = list[springs.Faces](), False
    for effect, xs in model.of_kind(ParallelSpring, x):
        joints = tuple(model.facts.joint_index(j) for j in effect.joints(model.facts))
        torque = laws.torque(effect, motion.q[list(joints)].T, xs, motion.context)
        term = laws.stiffness(effect, commanded.q[list(joints)].T, xs, commanded.context)
        stiff = stiff or term is not None
        faces.append(springs.Faces(joints, torque, term or _nothing(batch, len(joints), len(xs))))
    touched = tuple(sorted({j for f in faces for j in f.joints}))
    rates = springs.joint_rates(motion, touched)
    held = None
    if stiff:
        own = springs.joint_rates(commanded, touched, rates.active)
        held = Held(commanded, own, gather(touched, [(f.joints, f.stiffness.value) for f in faces], batch))
    return Placed(
        model=model,
        x=x,
        poses=poses,
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


def _nothing(batch: int, joints: int, parameters: int) -> StiffnessTerm:
    """The stiffness of a spring that has a torque only."""
    shape = (batch, joints, joints)
    return StiffnessTerm(np.zeros(shape), np.zeros((*shape, joints)), np.zeros((*shape, parameters)))
