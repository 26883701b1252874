"""Arms of a second generator and where they come to rest, by numpy alone: nothing of qsframework is imported.

An arm is a chain of joints with links of given mass. The equilibrium is the fixed point of angles and moments, the
moments by lever arms, for many states at once. What an arm has and its files do not say is `Hidden`: springs, laws of
gears, errors of angles and lengths, masses, loads, ropes and faults of the readings.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Vector = tuple[float, float, float]
GRAVITY = np.array([0.0, 0.0, -9.81])
AIR = 101325.0
WARM = 293.15
"""K at which links have the length of the drawing."""
_ROUNDS, _STILL = 300, 1e-13


class NoRest(RuntimeError):
    """The arm does not come to rest."""


# ---------------------------------------------------------------- arms


@dataclass(frozen=True)
class Link:
    """A joint and the link that it turns: origin m in the link before, axis, mass kg, centre m, limits deg as shown."""

    origin: Vector
    axis: Vector
    mass: float
    centre: Vector
    limits: tuple[float, float]


@dataclass(frozen=True)
class Coil:
    """A balancer's spring at joint 2: pivots lc and l2 (m) from its axis, the angle between them that of the joint."""

    lc: float
    l2: float
    stiffness: float
    free: float

    def pull(self, length: Array) -> Array:
        """N at lengths (N,) m."""
        return self.stiffness * (length - self.free)


@dataclass(frozen=True)
class Gas:
    """A gas balancer at joint 2, gas on the rod's side: gauge pressure Pa and volume m^3 at a length m, area m^2."""

    lc: float
    l2: float
    pressure: float
    volume: float
    length: float
    area: float

    def pull(self, length: Array) -> Array:
        """N at lengths (N,) m, at one temperature."""
        left = self.volume - self.area * (length - self.length)
        return self.area * ((self.pressure + AIR) * self.volume / left - AIR)


@dataclass(frozen=True)
class Arm:
    """Links from the base on.

    tool: where loads act, flange frame, m; compliance of the gears rad/(N m); payload kg; lever: of a parallelogram
    that drives joint 3 from the shoulder, m, 0 for none; absolute: joint 3 is shown as the forearm's elevation; foot:
    compliance of the pedestal about x and y that its files hold, rad/(N m), 0 for none
    """

    name: str
    links: tuple[Link, ...]
    tool: Vector
    markers: tuple[Vector, ...]
    compliance: tuple[float, ...]
    payload: float
    balancer: Coil | Gas | None = None
    lever: float = 0.0
    absolute: bool = False
    foot: float = 0.0

    @property
    def sense(self) -> float:
        """+1 where the axes of joints 2 and 3 point alike, -1 where they are opposed."""
        return float(np.sign(np.dot(self.links[1].axis, self.links[2].axis)))

    @property
    def torque(self) -> float:
        """N m, of the payload at the stretched arm."""
        reach = sum(float(np.linalg.norm(link.origin)) for link in self.links[1:])
        return 9.81 * self.payload * reach

    def joints(self, shown: Array) -> Array:
        """Angles (N, n) of the joints by those that the pendant shows."""
        q = np.array(shown)
        if self.absolute:
            q[:, 2] -= self.sense * shown[:, 1]
        return q


HEAVY = Arm(
    "heavy",
    (
        Link((0, 0, 0.4), (0, 0, 1), 700.0, (0.1, 0.0, 0.2), (-150, 150)),
        Link((0.45, 0, 0.5), (0, 1, 0), 520.0, (0.02, 0.15, 0.6), (-40, 60)),
        Link((0, 0, 1.25), (0, 1, 0), 430.0, (0.25, -0.05, 0.12), (-60, 60)),
        Link((0.3, 0, 0.15), (1, 0, 0), 120.0, (0.5, 0.0, 0.0), (-170, 170)),
        Link((1.2, 0, 0), (0, 1, 0), 70.0, (0.05, 0.0, 0.0), (-100, 100)),
        Link((0.2, 0, 0), (1, 0, 0), 30.0, (0.05, 0.0, 0.0), (-170, 170)),
    ),
    (0.15, 0.0, 0.2),
    ((0.25, 0.2, -0.1), (0.05, -0.2, 0.3), (0.3, -0.1, 0.2)),
    (1.5e-7, 1.6e-7, 3.0e-7, 1.2e-6, 1.2e-6, 1.5e-6),
    450.0,
)
SMALL = Arm(
    "small",
    (
        Link((0, 0, 0.2), (0, 0, 1), 60.0, (0.02, 0.0, 0.1), (-150, 150)),
        Link((0.1, 0, 0.2), (0, 1, 0), 40.0, (0.0, 0.05, 0.3), (-60, 70)),
        Link((0, 0, 0.6), (0, 1, 0), 30.0, (0.1, -0.02, 0.05), (-60, 60)),
        Link((0.15, 0, 0.05), (1, 0, 0), 12.0, (0.2, 0.0, 0.0), (-170, 170)),
        Link((0.5, 0, 0), (0, 1, 0), 6.0, (0.02, 0.0, 0.0), (-100, 100)),
        Link((0.09, 0, 0), (1, 0, 0), 3.0, (0.02, 0.0, 0.0), (-170, 170)),
    ),
    (0.1, 0.0, 0.1),
    ((0.12, 0.1, -0.05), (0.02, -0.1, 0.12), (0.15, -0.05, 0.1)),
    (3e-6, 3e-6, 5e-6, 1.5e-5, 1.5e-5, 2e-5),
    40.0,
)
LOOP = Arm(  # a parallelogram drives its elbow, whose axis points the other way; the wrist turns about -x and -y
    "loop",
    (
        Link((0, 0, 0.55), (0, 0, 1), 900.0, (0.05, -0.02, 0.15), (-180, 180)),
        Link((0.5, 0, 0.45), (0, 1, 0), 480.0, (0.0, -0.2, 0.55), (-45, 75)),
        Link((0, 0, 1.2), (0, -1, 0), 520.0, (0.15, 0.1, 0.1), (-90, 25)),
        Link((1.1, 0, 0.28), (-1, 0, 0), 150.0, (0.3, 0.0, 0.02), (-180, 180)),
        Link((0.52, 0, 0), (0, -1, 0), 80.0, (0.03, 0.01, 0.0), (-115, 115)),
        Link((0.25, 0, 0), (-1, 0, 0), 35.0, (0.04, 0.0, 0.0), (-180, 180)),
    ),
    (0.2, 0.0, 0.25),
    ((0.2, 0.25, 0.15), (0.35, -0.15, 0.2), (0.1, -0.1, -0.25)),
    (1.7e-7, 1.5e-7, 1.9e-7, 8.5e-7, 1.0e-6, 1.3e-6),
    600.0,
    lever=0.6,
    absolute=True,
)
COILED = Arm(  # a coil spring beside its shoulder; the zero of joint 2 is the upright arm
    "coiled",
    (
        Link((0, 0, 0.35), (0, 0, -1), 420.0, (-0.08, 0.03, 0.18), (-170, 170)),
        Link((0.35, 0, 0.4), (0, 1, 0), 300.0, (0.03, -0.12, 0.5), (-60, 75)),
        Link((0, 0, 1.1), (0, 1, 0), 260.0, (0.1, 0.06, 0.14), (-70, 60)),
        Link((0.25, 0, 0.2), (1, 0, 0), 70.0, (0.45, 0.0, 0.01), (-180, 180)),
        Link((0.95, 0, 0), (0, 1, 0), 40.0, (0.02, 0.0, 0.0), (-120, 120)),
        Link((0.2, 0, 0), (1, 0, 0), 18.0, (0.03, 0.0, 0.0), (-180, 180)),
    ),
    (0.12, 0.05, 0.18),
    ((0.1, 0.2, 0.2), (0.3, -0.15, 0.1), (0.12, -0.12, -0.2)),
    (2.6e-7, 3.0e-7, 4.1e-7, 2.4e-6, 2.9e-6, 2.4e-6),
    220.0,
    Coil(0.22, 0.9, 7.0e4, 0.5),
)
GASSED = Arm(  # a gas cylinder at its shoulder, and a pedestal that its files know to give
    "gassed",
    (
        Link((0, 0, 0.6), (0, 0, 1), 1100.0, (0.1, 0.0, 0.2), (-160, 160)),
        Link((0.55, 0, 0.5), (0, 1, 0), 600.0, (0.0, 0.2, 0.6), (-50, 70)),
        Link((0, 0, 1.3), (0, 1, 0), 650.0, (0.05, -0.1, 0.15), (-75, 65)),
        Link((0.7, 0, 0.1), (1, 0, 0), 180.0, (0.4, 0.02, 0.0), (-180, 180)),
        Link((0.75, 0, 0), (0, 1, 0), 90.0, (0.05, 0.0, 0.0), (-110, 110)),
        Link((0.28, 0, 0), (1, 0, 0), 40.0, (0.05, 0.0, 0.0), (-180, 180)),
    ),
    (0.2, 0.0, 0.3),
    ((0.3, 0.25, 0.0), (0.05, -0.25, 0.3), (0.35, -0.1, 0.25)),
    (1.2e-7, 1.3e-7, 2.2e-7, 9.0e-7, 9.0e-7, 1.1e-6),
    700.0,
    Gas(0.25, 1.0, 9.0e6, 6.0e-3, 0.75, 5.0e-3),
    foot=1.5e-8,
)
SEVEN = Arm(  # a light arm of seven joints with soft gears
    "seven",
    (
        Link((0, 0, 0.15), (0, 0, 1), 4.0, (0.0, -0.03, 0.12), (-165, 165)),
        Link((0, 0, 0.2), (0, 1, 0), 4.0, (0.0, 0.06, 0.04), (-110, 110)),
        Link((0, 0, 0.22), (0, 0, 1), 3.0, (0.0, 0.03, 0.13), (-165, 165)),
        Link((0, 0, 0.2), (0, -1, 0), 2.7, (0.0, 0.07, 0.03), (-110, 110)),
        Link((0, 0, 0.2), (0, 0, 1), 1.7, (0.0, 0.02, 0.08), (-165, 165)),
        Link((0, 0, 0.2), (0, 1, 0), 1.8, (0.0, 0.0, 0.02), (-110, 110)),
        Link((0, 0, 0.08), (0, 0, 1), 0.6, (0.0, 0.0, 0.02), (-165, 165)),
    ),
    (0.06, 0.0, 0.12),
    ((0.1, 0.0, 0.1), (-0.06, 0.09, 0.06), (-0.03, -0.1, 0.14)),
    (6e-5, 6e-5, 8e-5, 8e-5, 1.2e-4, 1.6e-4, 1.6e-4),
    12.0,
)
ARMS = {arm.name: arm for arm in (HEAVY, SMALL, LOOP, COILED, GASSED, SEVEN)}


# ---------------------------------------------------------------- what is hidden


@dataclass(frozen=True)
class Visits:
    """States of rest, one row each.

    shown: pendant angles (N, n) rad; force at the tool (N, 3) N, base frame; loaded (N,) 0 or 1; order: share of the
    readings taken (N,); time s, warmth K above that of the drawing, side of approach +-1, each (N,); number: of the
    pose, in the order in which they were visited (N,)
    """

    shown: Array
    force: Array
    loaded: Array
    order: Array
    time: Array
    warmth: Array
    side: Array
    number: Array

    def take(self, rows: Array | slice) -> Visits:
        """Some of the states."""
        return Visits(*(getattr(self, f.name)[rows] for f in fields(self)))


@dataclass(frozen=True)
class Rest:
    """An arm at rest: angles of its joints (N, n) rad, torques of its actuators (N, n) N m, moments or forces of its
    hidden springs (N, m), rotations of its links (N, n, 3, 3); rotations and origins m of its base and links."""

    visits: Visits
    angles: Array
    torque: Array
    springs: Array
    turned: Array
    frames: tuple[tuple[Array, Array], ...] = ()


@dataclass(frozen=True)
class Spring:
    """A hidden turn about an axis, or a slide along it.

    where: at the `foot` of the base; `before` joint k, in the link before it; `after` joint k, in its own link at a
    point m; compliance rad/(N m) or m/N; law: what it gives beside, (N,) by its own moment (N,) and the arm at rest
    """

    k: int
    where: str
    axis: Vector
    compliance: float = 0.0
    slide: bool = False
    at: Vector = (0.0, 0.0, 0.0)
    law: Callable[[Array, Rest], Array] | None = None


@dataclass(frozen=True)
class Rope:
    """From a point of the base m to the flange's origin: pulls with (N,) N by its length (N,) m."""

    anchor: Vector
    pull: Callable[[Array], Array]


Gear = Callable[[Rest], Array]
"""Extra angles (N, n) of the actuators."""


@dataclass(frozen=True)
class Hidden:
    """What an arm has and its files do not say.

    angles: errors (N, n) rad by commanded angles of the joints and visits; shifts: of the joints' origins (N, n, 3) m
    in the link before; tilts: turns of these frames (n, 3) rad; masses: link, kg, and kg m (3,) in its frame
    loads: force and moment at the tool (N, 3) each by those that are meant and the flange's rotation (N, 3, 3)
    readings: markers (N, K, 3) m by markers and the arm at rest; bar: error of the parallelogram's bar, m
    charge: share by which the balancer's stiffness or pressure is off
    """

    springs: tuple[Spring, ...] = ()
    gears: tuple[Gear, ...] = ()
    angles: tuple[Callable[[Array, Visits], Array], ...] = ()
    shifts: tuple[Callable[[Visits], Array], ...] = ()
    tilts: tuple[tuple[int, Vector], ...] = ()
    masses: tuple[tuple[int, float, Vector], ...] = ()
    loads: tuple[Callable[[Array, Array, Array], tuple[Array, Array]], ...] = ()
    ropes: tuple[Rope, ...] = ()
    readings: tuple[Callable[[Array, Rest], Array], ...] = ()
    bar: float = 0.0
    charge: float = 0.0

    def __add__(self, other: Hidden) -> Hidden:
        """Both at once."""
        return Hidden(**{f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self)})


# ---------------------------------------------------------------- equilibrium


def about(axis: Sequence[float] | Array, angle: Array) -> Array:
    """Rotations (N, 3, 3) about one unit axis by angles (N,)."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=np.float64)
    return np.eye(3) + np.sin(angle)[:, None, None] * K + (1.0 - np.cos(angle))[:, None, None] * (K @ K)


def turn(vector: Sequence[float] | Array) -> Array:
    """Rotation (3, 3) by a rotation vector."""
    v = np.asarray(vector, dtype=np.float64)
    angle = float(np.linalg.norm(v))
    return about(v / angle, np.array([angle]))[0] if angle > 0.0 else np.eye(3)


def moved(R: Array, vector: Sequence[float] | Array) -> Array:
    """R v (N, 3) of rotations (N, 3, 3) and one vector (3,) or one each (N, 3)."""
    v = np.asarray(vector, dtype=np.float64)
    return R @ v if v.ndim == 1 else np.einsum("nij,nj->ni", R, v)


@dataclass(frozen=True)
class _Stand:
    """Where everything is: axes and points of joints and springs, (N, 3) each, in the order of the chain; centres of
    the links; the flange; rotations and origins of base and links."""

    chain: tuple[tuple[str, int, Array, Array], ...]
    turned: Array
    flange: Array
    frames: tuple[tuple[Array, Array], ...]


def _stand(arm: Arm, hidden: Hidden, q: Array, gives: Array, shifts: Array) -> _Stand:
    """q: angles of the joints (N, n), deflected; gives: of the hidden springs (N, m); shifts (N, n, 3) m."""
    N = len(q)
    R, p = np.broadcast_to(np.eye(3), (N, 3, 3)), np.zeros((N, 3))
    chain: list[tuple[str, int, Array, Array]] = []
    turned: list[Array] = []
    tilts = np.zeros((len(arm.links), 3))
    for k, tilt in hidden.tilts:
        tilts[k] += tilt

    def give(where: str, k: int, R: Array, p: Array) -> tuple[Array, Array]:
        for i, s in enumerate(hidden.springs):
            if s.where != where or (where != "foot" and s.k != k):
                continue
            at = p + moved(R, s.at)
            axis = moved(R, s.axis)
            chain.append(("slide" if s.slide else "spring", i, axis, at))
            if s.slide:
                p = p + gives[:, i, None] * axis
            else:
                R = R @ about(s.axis, gives[:, i])
                p = at - moved(R, s.at)
        return R, p

    R, p = give("foot", 0, R, p)
    frames = [(R, p)]
    for k, link in enumerate(arm.links):
        p = p + moved(R, np.asarray(link.origin) + shifts[:, k])
        if tilts[k].any():
            R = R @ turn(tilts[k])
        R, p = give("before", k, R, p)
        chain.append(("joint", k, moved(R, link.axis), p))
        R = R @ about(link.axis, q[:, k])
        R, p = give("after", k, R, p)
        chain.append(("mass", k, moved(R, link.centre), p))
        turned.append(R)
        frames.append((R, p))
    return _Stand(tuple(chain), np.stack(turned, axis=1), p, tuple(frames))


def _moments(arm: Arm, hidden: Hidden, visits: Visits, stand: _Stand) -> tuple[Array, Array]:
    """Torques about the joints (N, n) and moments about, or forces along, the hidden springs (N, m)."""
    R, p = stand.turned[:, -1], stand.flange
    tool = p + moved(R, arm.tool)
    force, moment = visits.force, np.zeros_like(visits.force)
    for load in hidden.loads:
        force, moment = load(force, moment, R)
    F, M = force, moment + np.cross(tool, force)
    for rope in hidden.ropes:
        along = np.asarray(rope.anchor) - p
        length = np.linalg.norm(along, axis=1)
        pull = (rope.pull(length) / length)[:, None] * along
        F, M = F + pull, M + np.cross(p, pull)
    torque, other = np.zeros((len(p), len(arm.links))), np.zeros((len(p), len(hidden.springs)))
    for what, k, axis, at in reversed(stand.chain):
        if what == "mass":
            mass = arm.links[k].mass
            weight = np.broadcast_to(mass * GRAVITY, F.shape)
            F, M = F + weight, M + np.cross(at + axis, weight)
            for link, more, first in hidden.masses:
                if link == k:
                    lever = more * at + moved(stand.turned[:, k], first)
                    F, M = F + more * GRAVITY, M + np.cross(lever, GRAVITY)
        elif what == "slide":
            other[:, k] = np.einsum("ni,ni->n", axis, F)
        else:
            own = np.einsum("ni,ni->n", axis, M - np.cross(at, F))
            (torque if what == "joint" else other)[:, k] = own
    return torque, other


def _four_bar(arm: Arm, psi: Array, bar: float) -> tuple[Array, Array]:
    """By how much the rocker stands beyond the lever at psi (N,), and its slope, for a bar that is too long."""
    a, L = arm.lever, float(np.linalg.norm(arm.links[2].origin))
    rho = psi.copy()
    for _ in range(30):
        gap = L + a * np.exp(1j * rho) - a * np.exp(1j * psi)
        step = (np.abs(gap) - L - bar) / (np.conj(gap) * 1j * a * np.exp(1j * rho) / np.abs(gap)).real
        rho = rho - step
    gap = L + a * np.exp(1j * rho) - a * np.exp(1j * psi)
    by_rho = (np.conj(gap) * 1j * np.exp(1j * rho)).real
    by_psi = -(np.conj(gap) * 1j * np.exp(1j * psi)).real
    return rho - psi, -by_psi / by_rho


def _drive(arm: Arm, hidden: Hidden, phi: Array) -> tuple[Array, Array]:
    """Angles of the joints by those of the actuators (N, n), and the rate at which actuator 3 turns joint 3."""
    q, rate = np.array(phi), np.ones(len(phi))
    if arm.lever:
        q[:, 2] -= arm.sense * phi[:, 1]
        if hidden.bar:
            beyond, rate = _four_bar(arm, 0.5 * np.pi + arm.sense * q[:, 2], hidden.bar)
            q[:, 2] += arm.sense * beyond
    return q, rate


def rest(arm: Arm, hidden: Hidden, compliance: Array, visits: Visits) -> tuple[Rest, Array]:
    """The arm at rest under its weight and the forces, and its flange (N, 3) m."""
    q = arm.joints(visits.shown)
    q = q + sum((error(q, visits) for error in hidden.angles), np.zeros_like(q))
    phi = np.array(q)
    if arm.lever:
        phi[:, 2] += arm.sense * q[:, 1]
    shifts = sum((s(visits) for s in hidden.shifts), np.zeros((*q.shape, 3)))
    own = np.array([s.compliance for s in hidden.springs])
    gears, gives = np.zeros_like(q), np.zeros((len(q), len(hidden.springs)))
    for _ in range(_ROUNDS):
        angles, rate = _drive(arm, hidden, phi + gears)
        stand = _stand(arm, hidden, angles, gives, shifts)
        torque, other = _moments(arm, hidden, visits, stand)
        if arm.balancer is not None:
            torque[:, 1] += balance(_charged(arm.balancer, hidden.charge), angles[:, 1])
        if arm.lever:
            torque[:, 1] -= arm.sense * rate * torque[:, 2]
            torque[:, 2] *= rate
        still = Rest(visits, angles, torque, other, stand.turned)
        new = compliance * torque + sum((law(still) for law in hidden.gears), np.zeros_like(q))
        extra = [s.law(other[:, i], still) if s.law else np.zeros(len(q)) for i, s in enumerate(hidden.springs)]
        now = own * other + (np.stack(extra, axis=1) if extra else 0.0)
        change = np.abs(new - gears).max() + np.abs(now - gives).max(initial=0.0)
        gears, gives = new, now
        if not change < 1.0:
            break
        if change < _STILL * len(arm.links):
            angles, _ = _drive(arm, hidden, phi + gears)
            stand = _stand(arm, hidden, angles, gives, shifts)
            return replace(still, angles=angles, turned=stand.turned, frames=stand.frames), stand.flange
    raise NoRest(arm.name)


def _charged(balancer: Coil | Gas, share: float) -> Coil | Gas:
    """A balancer with more stiffness or pressure by a share."""
    if isinstance(balancer, Coil):
        return replace(balancer, stiffness=balancer.stiffness * (1.0 + share))
    return replace(balancer, pressure=balancer.pressure * (1.0 + share))


def balance(balancer: Coil | Gas, angle: Array) -> Array:
    """Torque (N,) N m of a balancer on its joint."""
    lc, l2 = balancer.lc, balancer.l2
    length = np.sqrt(lc**2 + l2**2 - 2.0 * lc * l2 * np.cos(angle))
    return -balancer.pull(length) * lc * l2 * np.sin(angle) / length


Mounted = tuple[int, Vector]
"""Where something is mounted: base 0, link k, or the floor -1; and where in the frame of that, m."""


def positions(
    arm: Arm, hidden: Hidden, compliance: Array, visits: Visits, markers: Array, mounted: Sequence[Mounted] = ()
) -> Array:
    """Where the markers (K, 3) m of the flange and what is mounted elsewhere are read, base frame, (N, K, 3) m."""
    still, flange = rest(arm, hidden, compliance, visits)
    read = flange[:, None] + np.einsum("nij,kj->nki", still.turned[:, -1], markers)
    for k, xyz in mounted:
        R, p = still.frames[k] if k >= 0 else (np.broadcast_to(np.eye(3), still.turned[:, 0].shape), np.zeros(3))
        read = np.concatenate([read, (p + moved(R, xyz))[:, None]], axis=1)
    for fault in hidden.readings:
        read = fault(read, still)
    return read


def still_visits(shown: Array, force: Array) -> Visits:
    """States (N, n) rad under forces (N, 3) N of which nothing else is known."""
    N = len(shown)
    zero = np.zeros(N)
    loaded = (np.abs(force).max(axis=1) > 0.0).astype(np.float64)
    return Visits(shown, force, loaded, np.arange(N) / N, zero, zero, zero + 1.0, np.arange(N, dtype=np.float64))
