"""What each kind of effect gives back for a batch of N poses: a value and, where it has them, its derivatives.

p is the number of parameters of the effect, n of joints, k of the joints or markers it touches. A derivative that is
left out is taken for it; a law may also give its value alone, the first field of its term, as an array.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from qsframework.errors import InputError, Problem
from qsframework.plugin.facts import Array

TAKEN: Any = None
"""Of a term's derivative: the framework takes it."""


@dataclass(frozen=True)
class GeometryTerm:
    """Errors of the unloaded geometry.

    angles     (N, n) rad, added to the actuator angles (on a serial arm: to the joint angles); None: no errors
    angles_dx  (N, n, p)
    twists     (N, n, 6) small displacement of each joint's placement in the frame of that joint's
               placement: translation x, y, z (m) then rotation about x, y, z (rad), applied in this
               order; None if placements are perfect
    twists_dx  (N, n, 6, p)
    """

    angles: Array = TAKEN
    angles_dx: Array = TAKEN
    twists: Array | None = None
    twists_dx: Array | None = None


@dataclass(frozen=True, eq=False)
class Range:
    """Of a law that holds only where it was seen: what it depends on at N states, and from where to where it was seen.

    label  what it is, such as `torque on joint_3`
    unit   SI unit as text, "N m"
    values (N,), low and high in this unit
    """

    label: str
    unit: str
    values: Array
    low: float
    high: float


Later = Callable[[], Array]


class LoopTerm:
    """A loop over k joints with m bars, at u = (actuator angles, bar errors) of k + m entries.

    q (N, k) joint angles; q_u (N, k, k + m); q_uu (N, k, k + m, k + m). The derivatives are arrays, or functions that
    give them, which are called where they are asked for: most who ask where the joints stand do not ask how they move
    """

    def __init__(self, q: Array, q_u: Array | Later = TAKEN, q_uu: Array | Later = TAKEN) -> None:
        self.q = q
        self.slope, self.bend = q_u, q_uu

    @cached_property
    def q_u(self) -> Array:
        """(N, k, k + m)."""
        return self.slope() if callable(self.slope) else self.slope

    @cached_property
    def q_uu(self) -> Array:
        """(N, k, k + m, k + m)."""
        return self.bend() if callable(self.bend) else self.bend


@dataclass(frozen=True)
class Actuator:
    """An elastic coordinate that turns the actuator of a joint (through the loop, if there is one)."""

    joint: str


@dataclass(frozen=True)
class Bar:
    """An elastic coordinate that lengthens one bar of a loop: `loop` is the loop's instance name."""

    loop: str
    index: int


@dataclass(frozen=True)
class VirtualJoint:
    """An elastic coordinate at the frame of a link, or of the flange, that moves the link and all that it carries.

    side "after": the axis turns with the link. side "before": the axis is fixed in the previous
    link, in the joint's frame at zero angle. For the base link both are the same.
    """

    link: str
    axis: Literal["x", "y", "z"] | tuple[float, float, float]
    kind: Literal["rotation", "translation"]
    side: Literal["before", "after"] = "after"


Coordinate = Actuator | Bar | VirtualJoint


@dataclass(frozen=True)
class Point:
    """A point fixed to a link, or to the flange: `xyz` in its frame, m."""

    link: str
    xyz: tuple[float, float, float]


@dataclass(frozen=True)
class TorqueTerm:
    """Torque on k joints as a function of their angles: value (N, k) N m, dq (N, k, k), dx (N, k, p).

    dqq (N, k, k, k) and dqx (N, k, k, p) are the derivatives of dq.
    """

    value: Array
    dq: Array = TAKEN
    dx: Array = TAKEN
    dqq: Array | None = None
    dqx: Array | None = None


@dataclass(frozen=True)
class StiffnessTerm:
    """Stiffness beside the springs of k joints at the commanded pose, with no torque there.

    value (N, k, k) N m/rad, dq (N, k, k, k) with the differentiating angle last, dx (N, k, k, p)
    """

    value: Array
    dq: Array = TAKEN
    dx: Array = TAKEN


@dataclass(frozen=True)
class TensionTerm:
    """Pull between two points at a distance s: value (N,) N, ds (N,) N/m, dx (N, p)."""

    value: Array
    ds: Array = TAKEN
    dx: Array = TAKEN


@dataclass(frozen=True)
class LawTerm:
    """What k gears give beyond their compliance at torque T: value (N, k), dT (N, k), dx (N, k, p)."""

    value: Array
    dT: Array = TAKEN
    dx: Array = TAKEN


@dataclass(frozen=True)
class Loads:
    """The wrench at the load point, base frame, and the masses that gravity pulls.

    wrench (N, 6); rotation (N, 3, 3) of the flange, in whose frame the file states the load point;
    moments (n + 1 + b, 4): for each of the robot's `bodies` its mass (kg) and mass times centre (kg m, link frame)
    """

    wrench: Array
    rotation: Array
    moments: Array


@dataclass(frozen=True)
class LoadTerm:
    """Loads out of loads in.

    wrench (N, 6) (None: as it came in), d_wrench (N, 6, 6), dx (N, 6, p), d_rotation (N, 6, 3) for a small rotation of
    the flange about the base axes (beside a given d_wrench, None: no dependence);
    moments (n + 1 + b, 4) *added* to those that came in (None: none), moments_dx (n + 1 + b, 4, p)
    """

    wrench: Array = TAKEN
    d_wrench: Array = TAKEN
    dx: Array = TAKEN
    d_rotation: Array | None = None
    moments: Array | None = None
    moments_dx: Array | None = None


@dataclass(frozen=True)
class Reading:
    """What the instrument sees of k markers in one state: position (N, k, 3) m and the rotation (N, k, 3, 3) of the
    frame in which the file states each, that of its link or of the flange, both in the base frame; the markers' names
    (k,)."""

    position: Array
    rotation: Array
    markers: tuple[str, ...] = ()

    def index(self, marker: str, name: str) -> int:
        """Place of a marker; the InputError says which effect `name` asks for it."""
        if marker not in self.markers:
            raise InputError(Problem(f"{name}: no such marker", allowed=", ".join(self.markers)))
        return self.markers.index(marker)


@dataclass(frozen=True)
class SensorTerm:
    """A reading out of a reading in.

    position (N, k, 3), d_position (N, k, 3, 3) by the marker's own position, dx (N, k, 3, p), d_rotation
    (N, k, 3, 3) for a small rotation of the marker's link about the base axes (beside a given d_position, None: no
    dependence)
    """

    position: Array
    d_position: Array = TAKEN
    dx: Array = TAKEN
    d_rotation: Array | None = None
