"""Everything that geometry says about a batch of poses, before any spring is looked at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from qsframework.elastostatics.motion import Motion, MotionRate, combine
from qsframework.plugin import Array
from qsframework.plugin.facts import frozen
from qsframework.robot.kinematics import Frames, Twists, cross, frames, twists, twists_along
from qsframework.robot.robot import LinkFrame


@dataclass(frozen=True, eq=False)
class Site:
    """A point fixed to a moving link: `xyz` (3,) m in the link's frame.

    attitude (3, 3): in the link's frame, of the frame in which the point is stated, and all that corrects it; None:
    that is the link's own
    """

    link: int
    xyz: Array
    attitude: Array | None = None

    def rotation(self, placed: Frames) -> Array:
        """(N, 3, 3) of the frame in which the point is stated, in the base's."""
        R = placed.matrix(self.link)
        return R if self.attitude is None else R @ self.attitude


def site_in(frame: LinkFrame, xyz: Array) -> Site:
    """A point (3,) m that is stated in a frame on a moving link."""
    R = frame.placement[:3, :3]
    at = (frame.placement @ np.append(xyz, 1.0))[:3]
    return Site(frame.link, frozen(at), None if np.array_equal(R, np.eye(3)) else R)


@dataclass(frozen=True, eq=False)
class PlacedSite:
    """A site's position (3, N), and its twist where it is asked for: an equilibrium asks for that of the tip only."""

    site: Site
    position: Array
    motion: Motion
    placed: Frames

    @property
    def rotation(self) -> Array:
        """(N, 3, 3) of the frame in which the site is stated, in the base's."""
        return self.site.rotation(self.placed)

    @cached_property
    def elements(self) -> Twists:
        """The twist per element of the chain."""
        return twists(self.placed, self.site.link, self.position)

    @cached_property
    def linear(self) -> Array:
        """Velocity (ne, 3, N) per unit of each elastic coordinate."""
        return combine(self.motion.coefficients, self.elements.linear)

    @cached_property
    def angular(self) -> Array:
        """Turning (ne, 3, N) per unit of each elastic coordinate."""
        return combine(self.motion.coefficients, self.elements.angular)


@dataclass(frozen=True, eq=False)
class State:
    """A batch of N placed poses: the loading point, the markers, and the mass centres of the links.

    `D` is the matrix of the pipeline: the tip twist (force point) per unit of each coordinate.
    """

    motion: Motion
    placed: Frames
    tip: PlacedSite
    markers: tuple[PlacedSite, ...]

    @property
    def D(self) -> Array:
        """Tip twist per elastic coordinate, (N, 6, ne), base-aligned, translation first."""
        return np.concatenate([self.tip.linear, self.tip.angular], axis=1).transpose(2, 1, 0)

    @property
    def coordinates(self) -> int:
        return len(self.motion.coefficients)


def place(motion: Motion, tip: Site, markers: Sequence[Site], virtual: dict[int, Array] | None = None) -> State:
    """Forward kinematics and Jacobians of the tip and the markers."""
    placed = frames(motion.layout.chain, motion.element_values(virtual), motion.q.shape[-1])
    return State(motion, placed, column(motion, placed, tip), tuple(column(motion, placed, m) for m in markers))


def column(motion: Motion, placed: Frames, site: Site) -> PlacedSite:
    """Position and Jacobian of one site."""
    return PlacedSite(site, placed.point(site.link, site.xyz), motion, placed)


@dataclass(frozen=True, eq=False)
class PlacedSiteRate:
    """Derivative of a Column along one geometric parameter.

    position (3, N), turn (3, N) rad: how the site's link moves; linear, angular (ne, 3, N)
    """

    position: Array
    turn: Array
    linear: Array
    angular: Array


def column_along(motion: Motion, site: PlacedSite, rate: MotionRate) -> PlacedSiteRate:
    """Derivative of a site's position and Jacobian along element rates."""
    rates = rate.elements[: site.elements.upstream]
    slope = twists_along(site.elements, rates, motion.used)
    linear = combine(motion.coefficients, slope.linear) + combine(rate.coefficients, site.elements.linear)
    angular = combine(motion.coefficients, slope.angular) + combine(rate.coefficients, site.elements.angular)
    moved = np.flatnonzero(np.any(rates, axis=1))
    return PlacedSiteRate(
        np.einsum("ecn,en->cn", site.elements.linear[moved], rates[moved]),
        np.einsum("ecn,en->cn", site.elements.angular[moved], rates[moved]),
        linear,
        angular,
    )


def columns_along(motion: Motion, sites: Sequence[PlacedSite], rate: MotionRate) -> list[PlacedSiteRate]:
    """`column_along` of sites, of which those on one link move as one body does, after the first."""
    first: dict[int, tuple[PlacedSite, PlacedSiteRate]] = {}
    out: list[PlacedSiteRate] = []
    for one in sites:
        link = one.site.link
        if link not in first:
            first[link] = one, column_along(motion, one, rate)
            out.append(first[link][1])
            continue
        other, known = first[link]
        arm = one.position - other.position
        swing = cross(known.turn, arm)
        linear = known.linear + cross(known.angular, arm) + cross(other.angular, swing)
        out.append(PlacedSiteRate(known.position + swing, known.turn, linear, known.angular))
    return out
