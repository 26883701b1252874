"""Springs between two points of any two links: their torque and stiffness on the chain.

A pull F(s) at the distance s between the points has the gradient g = ds/de over the elements e;
its torque is -F g and its stiffness F' g g' + F d2s/de2. Only elements between its two links change s: those
before both turn the spring as a whole.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from qsframework.elastostatics.motion import Coefficients, Motion, MotionRate, combine
from qsframework.errors import InputError
from qsframework.plugin import Array, Context, Indices, ParallelSpring, TensionTerm, laws
from qsframework.robot.kinematics import Chain, Frames, cross, frames, twists

_SHORTEST = 1e-9
_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class Pull:
    """One spring at a batch of poses: gradient g (m, N) and its tension; what takes long where it is asked for.

    between (b,): the elements that change its length
    """

    gradient: Array
    between: Indices
    term: TensionTerm
    bend: Callable[[], Array]
    rates: Callable[[], Array]

    @cached_property
    def second(self) -> Array:
        """Second derivative of s (b, b, N)."""
        return self.bend()

    @cached_property
    def slope_dx(self) -> Array:
        """Derivative (N, p) of F' by the effect's parameters."""
        return self.rates()

    @property
    def acts(self) -> bool:
        """Whether it pulls anywhere: one that is tried at the value where it vanishes does not."""
        return bool(np.any(self.term.value) or np.any(self.term.ds))

    def torque(self) -> Array:
        """-F g on the elements (m, N)."""
        return -self.term.value * self.gradient

    def stiffness(self) -> Array:
        """F' g g' + F d2s on the elements between its links (b, b, N)."""
        return self._matrix(self.term.ds, self.term.value)

    def stiffness_by(self, i: int) -> Array:
        """The stiffness by parameter i."""
        return self._matrix(self.slope_dx[:, i], self.term.dx[:, i])

    def torque_by(self, i: int) -> Array:
        """The torque by parameter i."""
        return -self.term.dx[:, i] * self.gradient

    def on(self, coefficients: Coefficients, matrix: Array) -> Array:
        """A stiffness (b, b, N) of this spring on the coordinates (ne, ne, N)."""
        place = {int(e): i for i, e in enumerate(self.between)}
        inner = [tuple((place[e], rate) for e, rate in terms if e in place) for terms in coefficients]
        moving = [c for c, terms in enumerate(inner) if terms]
        out = np.zeros((len(coefficients), len(coefficients), matrix.shape[-1]))
        out[np.ix_(moving, moving)] = on_coordinates(tuple(inner[c] for c in moving), matrix)
        return out

    def _matrix(self, slope: Array, force: Array) -> Array:
        g = self.gradient[self.between]
        return slope * g[:, None] * g[None] + force * self.second


Springs = Sequence[tuple[ParallelSpring, Array]]


def pulls(effects: Springs, placed: Frames, context: Context) -> list[Pull | None]:
    """The pull of each parallel spring, None for those that have no ends."""
    return [_pull(effect, x, placed, context) for effect, x in effects]


def _pull(effect: ParallelSpring, x: Array, placed: Frames, context: Context) -> Pull | None:
    ends = effect.ends(context.robot)
    if ends is None:
        return None
    links, stated = zip(*(context.robot.frame_of(end.link) for end in ends), strict=True)
    between = _between(placed.chain, links)
    points: list[Array] = []
    speed = np.zeros((len(between), 3, placed.axes.shape[-1]))
    for link, frame, end, sign in zip(links, stated, ends, (-1.0, 1.0), strict=True):
        points.append(placed.point(link, (frame @ np.append(end.xyz, 1.0))[:3]))
        found = twists(placed, link, points[-1]).linear
        upstream = between < len(found)
        speed[upstream] += sign * found[between[upstream]]
    apart = points[1] - points[0]
    length = np.sqrt(np.einsum("cn,cn->n", apart, apart))
    if np.any(length < _SHORTEST):
        raise InputError(f"{effect.name}: its two ends meet; a spring needs a length")
    along = apart / length
    gradient = np.zeros((len(placed.chain), placed.axes.shape[-1]))
    gradient[between] = np.einsum("cn,ecn->en", along, speed)
    term, size = laws.tension(effect, length, x, context), laws.sizes(effect, x, context)
    return Pull(
        gradient,
        between,
        term,
        bend=lambda: _second(placed, between, speed, along, gradient[between], length),
        rates=lambda: laws.difference(lambda v: laws.tension(effect, length, v, context).ds, x, size),
    )


def _between(chain: Chain, links: Sequence[int]) -> Indices:
    """The elements, in order, that move one of two links and not the other."""
    one, other = ({*range(end)} - {*idle} for end, idle in map(chain.reach, links))
    return np.array(sorted(one ^ other), dtype=np.intp)


def _second(placed: Frames, between: Indices, speed: Array, along: Array, gradient: Array, length: Array) -> Array:
    """d2s (b, b, N): u . (omega_a x v_b) for a <= b, and the turning of u itself."""
    turning = np.array([placed.chain.elements[int(e)].rotation for e in between], dtype=bool)
    lever = cross(along[None], np.where(turning[:, None, None], placed.axes[between], 0.0))
    swing = np.einsum("acn,bcn->abn", lever, speed)
    upper = np.triu(np.ones(swing.shape[:2]))[:, :, None]
    symmetric = swing * upper + (swing * np.triu(np.ones(swing.shape[:2]), 1)[:, :, None]).transpose(1, 0, 2)
    cosines = np.einsum("acn,bcn->abn", speed, speed) - gradient[:, None] * gradient[None]
    return symmetric + cosines / length


def on_coordinates(coefficients: Coefficients, elements: Array) -> Array:
    """E' M E for a matrix (m, m, N) over the elements: (ne, ne, N)."""
    half = combine(coefficients, elements)
    return combine(coefficients, np.ascontiguousarray(half.transpose(1, 0, 2))).transpose(1, 0, 2)


def stiffness(found: Sequence[Pull | None], coefficients: Coefficients) -> Array | None:
    """Stiffness (ne, ne, N) of all pulls on the coordinates, None if there is no pull."""
    matrices = [p.on(coefficients, p.stiffness()) for p in found if p is not None]
    return sum(matrices[1:], matrices[0]) if matrices else None


def torque(found: Sequence[Pull | None], coefficients: Coefficients) -> Array | None:
    """Torque (ne, N) of all pulls on the coordinates, None if there is no pull."""
    vectors = [p.torque() for p in found if p is not None]
    return combine(coefficients, sum(vectors[1:], vectors[0])) if vectors else None


def torque_along(found: Sequence[Pull | None], coefficients: Coefficients, rate: MotionRate) -> Array | None:
    """Derivative of `torque` along a change of the geometry, None if nothing pulls.

    What moves both ends turns the pull with them: only the elements between its links change the torque on these.
    """
    acting = [pull for pull in found if pull is not None and pull.acts]
    if not acting:
        return None
    bent = np.zeros_like(acting[0].gradient)
    for pull in acting:
        bent[pull.between] -= np.einsum("abn,bn->an", pull.stiffness(), rate.elements[pull.between])
    drawn = sum((pull.torque() for pull in acting[1:]), acting[0].torque())
    return combine(coefficients, bent) + combine(rate.coefficients, drawn)


def stiffness_along(effects: Springs, motion: Motion, drawn: Sequence[Pull | None], rate: MotionRate) -> Array | None:
    """Derivative of `stiffness` along a change of the geometry; None where no spring feels it.

    The third derivative of s has no short form: fourth-order differences of the analytic stiffness, with a relative
    error of about 1e-10.
    """
    acting = [pull for pull in drawn if pull is not None and pull.acts]
    moved = {*np.flatnonzero(np.any(rate.elements, axis=1)), *(e for terms in rate.coefficients for e, _ in terms)}
    if not any(moved & {*pull.between} for pull in acting):
        return None

    def at(step: float) -> Array:
        values = motion.element_values()
        there = [step * r if v is None else v + step * r for v, r in zip(values, rate.elements, strict=True)]
        placed = frames(motion.layout.chain, there, motion.q.shape[-1])
        found = pulls(effects, placed, motion.context)
        bent = _bent(motion.coefficients, rate.coefficients, step)
        K = stiffness(found, bent)
        assert K is not None
        return K

    near, back, far, farther = at(_STEP), at(-_STEP), at(2 * _STEP), at(-2 * _STEP)
    return (8.0 * (near - back) - (far - farther)) / (12.0 * _STEP)


def _bent(coefficients: Coefficients, slopes: Coefficients, step: float) -> Coefficients:
    out: list[tuple[tuple[int, Array | float], ...]] = []
    for terms, slope in zip(coefficients, slopes, strict=True):
        total = dict(terms)
        for e, s in slope:
            total[e] = total.get(e, 0.0) + step * s
        out.append(tuple(sorted(total.items())))
    return tuple(out)
