"""Derivatives of unloaded positions by the geometry, all elements of the chain at once.

For an arm of linear springs without loops, compensators and loads the chain rule of `tangents` needs no
pass per parameter: a position reacts to element e and element f in the same way, whichever comes
first, so one contraction with the deflection gives the bending of all columns,
    d position / de = p_e + sum_f p_ef eps_f + sum_c D_c c_c d tau_c/de
    p_ef = z_min x p_max,   d tau_f/de = g . (z_min x W_max),   W_e = sum of mass times p_e over the links
with z the turning part of a column (0 for a shift) and min, max by the order in the chain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics.evaluation import Stages
from qsframework.elastostatics.sensors import Sensed
from qsframework.elastostatics.so3 import exponential, left_jacobian
from qsframework.elastostatics.springs import Response
from qsframework.elastostatics.state import Column, State
from qsframework.plugin import Array, Geometry
from qsframework.robot.kinematics import Twists, cross, twists_along


def is_direct(ev: Stages, loaded: bool) -> bool:
    """Whether the state of an arm is one that this module covers."""
    return not (loaded or ev.model.layout.loops or ev.touched or ev.laws or any(p is not None for p in ev.pulls))


@dataclass(frozen=True, eq=False)
class Bending:
    """Deflections of the elements (m, N), and how the torques' deflections react to each element (ne, m, N)."""

    eps: Array
    rate: Array


def element_readings(ev: Stages, sensed: Sensed | None, response: Response) -> Array:
    """d reading / d element of the chain, (m, K, 3, N)."""
    count, batch = len(ev.model.layout.chain), len(ev.poses)
    bending = _bending(ev, response)
    out = np.zeros((count, len(ev.state.markers), 3, batch))
    for k, marker in enumerate(ev.state.markers):
        shift, spin = _shift(marker, count, bending)
        if sensed is None:
            out[:, k] = shift
            continue
        out[:, k] = _times(sensed.by_position[:, k], shift)
        if np.any(sensed.by_rotation[:, k]):
            turned = sensed.turned[k].T
            turn = np.zeros_like(shift)
            turn[: marker.elements.upstream] = _times(exponential(turned), marker.elements.angular)
            if spin is not None:
                turn += _times(left_jacobian(turned), spin)
            out[:, k] += _times(sensed.by_rotation[:, k], turn)
    return out


def _shift(marker: Column, count: int, bending: Bending | None) -> tuple[Array, Array | None]:
    """Shift and spin (m, 3, N) of a marker per unit of each element; no spin of a rigid arm.

    Elements beyond the marker's link move it too: they shift the masses that bend the arm before it.
    """
    columns, u = marker.elements, marker.elements.upstream
    shift = np.zeros((count, *marker.position.shape))
    shift[:u] = columns.linear
    if bending is None:
        return shift, None
    spin = np.zeros_like(shift)
    shift[:u] += twists_along(columns, bending.eps[:u]).linear
    moving = columns.angular * bending.eps[:u, None, :]
    spin[:u] = cross(columns.angular, moving.sum(axis=0) - np.cumsum(moving, axis=0))
    for c in np.flatnonzero(bending.rate.any(axis=(1, 2))):
        shift += marker.linear[c] * bending.rate[c, :, None, :]
        spin += marker.angular[c] * bending.rate[c, :, None, :]
    return shift, spin


def _bending(ev: Stages, response: Response) -> Bending | None:
    """None where no spring bends."""
    soft = np.flatnonzero(np.any(response.eps, axis=1) | (ev.compliance != 0.0))
    if not len(soft):
        return None
    coefficients = ev.motion.coefficients
    weights = _weights(ev.state, ev.applied.moments)
    angular, gravity = weights.angular, ev.model.gravity[:, None]
    eps = np.zeros((len(angular), len(ev.poses)))
    rate = np.zeros((len(coefficients), len(angular), len(ev.poses)))
    for c in soft:
        for f, factor in coefficients[c]:
            eps[f] += factor * response.eps[c]
            before = cross(weights.linear[f], gravity)
            after = cross(np.broadcast_to(gravity, angular[f].shape), angular[f])
            size = ev.compliance[c] * factor
            rate[c, :f] += size * np.einsum("ecn,cn->en", angular[:f], before)
            rate[c, f:] += size * np.einsum("ecn,cn->en", weights.linear[f:], after)
    return Bending(eps, rate)


def _weights(state: State, moments: Array) -> Twists:
    """Velocity of all masses beyond each element, weighted by mass: (m, 3, N)."""
    placed, elements, stops = state.placed, state.placed.chain.elements, state.placed.chain.stops
    linear, angular = np.empty_like(placed.axes), placed.axes.copy()
    mass, moment, link = 0.0, np.zeros((3, 1)), len(stops)
    for e in range(len(elements) - 1, -1, -1):
        while link > 0 and stops[link - 1] > e:
            link -= 1
            r, m = placed.rotations[link], moments[link]
            moment = moment + m[0] * placed.positions[link] + m[1] * r[0] + m[2] * r[1] + m[3] * r[2]
            mass = mass + m[0]
        if elements[e].rotation:
            linear[e] = cross(placed.axes[e], moment - mass * placed.origins[e])
        else:
            linear[e], angular[e] = mass * placed.axes[e], 0.0
    return Twists(linear, angular)


def _times(matrix: Array, vectors: Array) -> Array:
    """Matrices (N, 3, 3) times vectors (u, 3, N)."""
    out = np.empty(vectors.shape)
    for i in range(3):
        a, b, c = np.ascontiguousarray(matrix[:, i].T)
        out[:, i] = a * vectors[:, 0] + b * vectors[:, 1] + c * vectors[:, 2]
    return out


def geometry_tangents(ev: Stages, wanted: Sequence[int], elements: Array, out: Array) -> list[int]:
    """Fill the rows of `out` (P, K, 3, N) of the wanted parameters of geometry; the rows that are left."""
    layout = ev.model.layout
    rows = {position: row for row, position in enumerate(wanted)}
    number = 0
    for effect, part in zip(ev.model.effects, ev.model.slices, strict=True):
        if not isinstance(effect, Geometry):
            continue
        term = ev.geometry[number]
        number += 1
        mine = [i for i in range(part.stop - part.start) if part.start + i in rows]
        if not mine:
            continue
        pairs = [(term.angles_dx, np.array(layout.joint_elements))]
        if term.twists_dx is not None and layout.placement_elements is not None:
            slopes = term.twists_dx
            if slopes.strides[0] == 0:  # the same at every pose
                slopes = slopes[:1]
            flat = slopes.reshape(len(slopes), -1, slopes.shape[-1])
            pairs.append((flat, layout.placement_elements.ravel()))
        targets = {i: rows.pop(part.start + i) for i in mine}
        for i in mine:
            out[targets[i]] = 0.0
        for slopes, places in pairs:
            for j, i in zip(*np.nonzero(np.any(slopes, axis=0)), strict=True):
                if int(i) in targets:
                    out[targets[int(i)]] += elements[places[j]] * slopes[:, j, i]
    return sorted(rows.values())
