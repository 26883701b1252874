"""Derivatives of readings by the geometry, all elements of the chain at once.

An error of geometry moves elements of the chain, and to those that no loop and no compensator turns the arm reacts
alike: a position to element e and element f in the same way, whichever comes first. So one contraction with the
deflection gives the bending of all columns, and no pass per parameter is needed as in `tangents`,
    d position / de = p_e + sum_f p_ef eps_f + sum_c D_c deps_c/de
    p_ef = z_min x p_max,   d tau_f/de = F . (z_min x P_max) + M . (z_e x z_f for e before f)
with z the turning part of a column (0 for a shift), min and max by the order in the chain; F and M stand for the load
on the tip, P = p, and F for gravity, P = W_e the sum of mass times p_e over the links.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from qsframework.elastostatics.evaluation import PlacedArm
from qsframework.elastostatics.loads import wrench_along
from qsframework.elastostatics.sensors import Sensed
from qsframework.elastostatics.so3 import exponential, left_jacobian
from qsframework.elastostatics.springs import Response
from qsframework.elastostatics.state import PlacedSite
from qsframework.plugin import Array, Geometry, Indices
from qsframework.robot.kinematics import Twists, cross, twists_along

_FEW = 3
"""Parameters below which a pass for each costs less than all elements."""


Bending = tuple[Array, Array]
"""Deflections of the elements (m, N), and how the coordinates' deflections react to each element (ne, m, N)."""


def element_readings(ev: PlacedArm, sensed: Sensed | None, response: Response | None, loaded: bool) -> Array:
    """d reading / d element of the chain, (m, K, 3, N), of one state; without a response, of the pose that nothing
    deflects. Not of the elements that loops and compensators turn."""
    count, batch = len(ev.model.layout.chain), len(ev.poses)
    bending = None if response is None else _bending(ev, response, loaded)
    bent = bending is not None and bool(np.any(bending[0]))
    straight = sensed is None or bool(np.all(sensed.by_position == np.eye(3)))
    out = np.empty((count, len(ev.state.markers), 3, batch))
    first: dict[int, tuple[PlacedSite, Array, Array]] = {}
    for k, marker in enumerate(ev.state.markers):
        if bent or marker.site.link not in first:
            shift, turn = _motion(marker, count, bending, response.eps if bent and response is not None else None)
            first[marker.site.link] = marker, shift, turn
        else:  # where nothing is bent, those on one link move as one body does
            other, shift, turn = first[marker.site.link]
            shift = shift + cross(turn, marker.position - other.position)
        out[:, k] = shift if sensed is None or straight else _times(sensed.by_position[:, k], shift)
        if sensed is not None and np.any(sensed.by_rotation[:, k]):
            out[:, k] += _times(sensed.by_rotation[:, k], turn)
    return out


def _motion(marker: PlacedSite, count: int, bending: Bending | None, eps: Array | None) -> tuple[Array, Array]:
    """Shift and turn (m, 3, N) of a marker per unit of each element.

    Elements beyond the marker's link move it too: they shift the masses and the load that bend the arm before it.
    eps (ne, N): deflection of the coordinates, None where nothing is deflected
    """
    columns, u = marker.elements, marker.elements.upstream
    shift, turn = np.zeros((2, count, *marker.position.shape))
    shift[:u], turn[:u] = columns.linear, columns.angular
    if bending is None:
        return shift, turn
    deflections, rate = bending
    soft = np.flatnonzero(rate.any(axis=(1, 2)))
    spin = np.einsum("ckn,cmn->mkn", marker.angular[soft], rate[soft])
    if eps is not None:
        shift[:u] += twists_along(columns, deflections[:u]).linear
        moving = columns.angular * deflections[:u, None, :]
        spin[:u] += cross(columns.angular, moving.sum(axis=0) - np.cumsum(moving, axis=0))
        turned = np.einsum("ecn,en->nc", marker.angular, eps)
        turn, spin = _times(exponential(turned), turn), _times(left_jacobian(turned), spin)
    shift += np.einsum("ckn,cmn->mkn", marker.linear[soft], rate[soft])
    return shift, turn + spin


def _bending(ev: PlacedArm, response: Response, loaded: bool) -> Bending | None:
    """None where no spring bends."""
    soft = np.flatnonzero(np.any(response.eps, axis=1) | np.any(response.slope, axis=1))
    if not len(soft):
        return None
    coefficients, batch = ev.motion.coefficients, len(ev.poses)
    eps = np.zeros((len(ev.model.layout.chain), batch))
    torque = np.zeros((len(coefficients), *eps.shape))
    acting = list(_acting(ev, loaded))
    for c in soft:
        for f, factor in coefficients[c]:
            eps[f] += factor * response.eps[c]
            for columns, force, moment in acting:
                u = columns.upstream
                if f >= u:
                    continue
                before = cross(columns.linear[f], force)
                if moment is not None:
                    before += cross(columns.angular[f], moment)
                torque[c, :f] += factor * np.einsum("ecn,cn->en", columns.angular[:f], before)
                after = cross(force, columns.angular[f])
                torque[c, f:u] += factor * np.einsum("ecn,cn->en", columns.linear[f:], after)
    tip = ev.state.tip
    if loaded and any(term.d_rotation is not None for term in ev.applied.terms):  # the load turns with the flange
        turned = wrench_along(ev.applied.terms, tip.elements.angular, None)
        for c in soft:
            torque[c, : len(turned)] += np.einsum("cn,enc->en", tip.linear[c], turned[..., :3])
            torque[c, : len(turned)] += np.einsum("cn,enc->en", tip.angular[c], turned[..., 3:])
    return eps, response.react(response.slope[:, None] * torque)


def _acting(ev: PlacedArm, loaded: bool) -> Iterator[tuple[Twists, Array, Array | None]]:
    """What pulls at the arm: the columns of where it acts, the force (3, N), and a moment."""
    if ev.preloaded:
        pull = np.broadcast_to(ev.model.gravity[:, None], (3, len(ev.poses)))
        yield from ((columns, pull, None) for columns in ev.masses)
    if loaded:
        wrench = ev.applied.wrench.T
        yield ev.state.tip.elements, wrench[:3], wrench[3:] if np.any(wrench[3:]) else None


def _times(matrix: Array, vectors: Array) -> Array:
    """Matrices (N, 3, 3) times vectors (u, 3, N)."""
    out = np.empty(vectors.shape)
    for i in range(3):
        a, b, c = np.ascontiguousarray(matrix[:, i].T)
        out[:, i] = a * vectors[:, 0] + b * vectors[:, 1] + c * vectors[:, 2]
    return out


def geometry_tangents(ev: PlacedArm, wanted: Sequence[int], readings: Callable[[], Array], out: Array) -> list[int]:
    """Fill the rows of `out` (P, K, 3, N) of the wanted parameters of geometry, if they are several; the rows that are
    left.

    readings: the derivatives by the elements, `element_readings`, for those who need them
    """
    found = dict(_by_elements(ev, wanted))
    if len(found) >= _FEW:
        elements = readings()
        for row, terms in found.items():
            out[row] = 0.0
            for element, slope in terms:
                out[row] += elements[element] * slope
        return [row for row in range(len(wanted)) if row not in found]
    return list(range(len(wanted)))


def _by_elements(ev: PlacedArm, wanted: Sequence[int]) -> Iterator[tuple[int, list[tuple[int, Array]]]]:
    """The rows of geometry, with the elements that each moves and the slopes (N,) or (1,); not of those that move
    what a loop or a compensator turns, nor of any where a spring between two points pulls."""
    layout = ev.model.layout
    if any(pull is not None and pull.acts for pull in ev.pulls):
        return
    rows = {position: row for row, position in enumerate(wanted)}
    tied = {layout.joint_elements[j] for place in layout.loops for j in place.joints}
    tied |= {layout.joint_elements[j] for j in ev.touched}
    geometry = (p for e, p in zip(ev.model.effects, ev.model.slices, strict=True) if isinstance(e, Geometry))
    for part, term in zip(geometry, ev.geometry, strict=True):
        mine = [i for i in range(part.stop - part.start) if part.start + i in rows]
        if not mine:
            continue
        pairs: list[tuple[Array, Indices]] = [(term.angles_dx, np.array(layout.joint_elements))]
        if term.twists_dx is not None and layout.placement_elements is not None:
            slopes = term.twists_dx
            if slopes.strides[0] == 0:  # the same at every pose
                slopes = slopes[:1]
            pairs.append((slopes.reshape(len(slopes), -1, slopes.shape[-1]), layout.placement_elements.ravel()))
        moved: dict[int, list[tuple[int, Array]]] = {i: [] for i in mine}
        for slopes, places in pairs:
            for j, i in zip(*np.nonzero(np.any(slopes, axis=0)), strict=True):
                if int(i) in moved:
                    moved[int(i)].append((int(places[j]), slopes[:, j, i]))
        for i, terms in moved.items():
            if not tied & {element for element, _ in terms}:
                yield rows[part.start + i], terms
