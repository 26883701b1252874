"""What an effect may look at: the arm's constants and a batch of poses. No kinematics library here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from qsframework.errors import InputError, Problem, nearest
from qsframework.units import SLIDES, TURNS, JointUnit, JointUnits

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


def frozen(values: Any) -> Array:
    """A read-only float64 copy of the values."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


@dataclass(frozen=True)
class NaturalSizes:
    """What is small and what is large for an arm, so that a small one and a heavy one are judged by one rule.

    reach, m: the lengths of the chain beyond its first joint; payload, kg: stated, else a tenth of what moves;
    gravity, m/s^2
    """

    reach: float
    payload: float
    gravity: float

    @property
    def weight(self) -> float:
        """Of the payload, N."""
        return self.payload * self.gravity

    @property
    def torque(self) -> float:
        """Of the payload at full reach, N m."""
        return self.weight * self.reach

    def rotation(self, tip: float) -> float:
        """The turn, rad, that moves the tip by `tip` m at full reach."""
        return tip / self.reach

    def compliance(self, tip: float) -> float:
        """The compliance, rad/(N m), by which the payload at full reach moves the tip by `tip` m."""
        return self.rotation(tip) / self.torque

    def give(self, tip: float) -> float:
        """The compliance, m/N, by which the payload moves the tip by `tip` m."""
        return tip / self.weight

    def motion_of(self, unit: JointUnit, tip: float) -> float:
        """The turn, rad, or travel, m, of a joint that moves the tip by `tip` m at full reach."""
        return tip if unit == SLIDES else self.rotation(tip)

    def compliance_of(self, unit: JointUnit, tip: float) -> float:
        """A joint's compliance, rad/(N m) or m/N, by which the payload at full reach moves the tip by `tip` m."""
        return self.give(tip) if unit == SLIDES else self.compliance(tip)

    def load_of(self, unit: JointUnit) -> float:
        """What the payload at full reach puts on a joint: N m where it turns, N where it slides."""
        return self.weight if unit == SLIDES else self.torque


@dataclass(frozen=True, eq=False, kw_only=True)
class Branch:
    """A moving link beside the arm: a loop's bar, the lever of a counterweight, a balancer's cylinder.

    joint, link: its names; parent: the link on which it hangs, of the arm or of a branch before it.
    placement (4, 4) of its joint in the parent's frame at zero angle, axis (3,); mass kg and centre (3,) m in its own
    """

    joint: str
    link: str
    parent: str
    placement: Array
    axis: Array
    mass: float
    centre: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class RobotFacts:
    """The constants of an arm of n joints, base to flange, in SI.

    joints      (n,) names in chain order
    sliding     (n,) which of them slide (prismatic joints), the others turn; none where it is left out
    links       (n + 1,) names: the base link, then the link that each joint moves
    axes        (n, 3) joint axes in their joint frames
    placements  (n, 4, 4) joint frame in the previous link's frame at zero angle
    masses      (n + 1,) kg; `centres` (n + 1, 3) m in the link frames
    gravity     (3,) m/s^2 in the base frame
    payload     kg, None where nobody states it
    limits      (n, 2) rad, m where a joint slides: all that the controller can command; None where nobody states them
    passive     names of joints that no actuator drives: they follow others by a loop
    branches    (b,) moving links beside the arm, parents first; loops determine their angles
    bearings    (n,) m along each joint's axis from its frame to the point about which its bearing tilts, None where
                nobody states it; nobody does where it is left out
    flange      name of the frame in which the load's point and, unless said, the markers are stated
    flange_placement (4, 4) that frame in the last link's; it is the last link's own where both are left out
    """

    name: str
    joints: tuple[str, ...]
    links: tuple[str, ...]
    axes: Array
    placements: Array
    masses: Array
    centres: Array
    gravity: Array = field(default_factory=lambda: frozen([0.0, 0.0, -9.81]))
    payload: float | None = None
    limits: Array | None = None
    passive: tuple[str, ...] = ()
    branches: tuple[Branch, ...] = ()
    sliding: tuple[bool, ...] = ()
    bearings: tuple[float | None, ...] = ()
    flange: str = ""
    flange_placement: Array = field(default_factory=lambda: frozen(np.eye(4)))

    def __post_init__(self) -> None:
        if not self.sliding:
            object.__setattr__(self, "sliding", (False,) * len(self.joints))
        if not self.bearings:
            object.__setattr__(self, "bearings", (None,) * len(self.joints))
        if not self.flange:
            object.__setattr__(self, "flange", self.links[-1])

    @cached_property
    def units(self) -> JointUnits:
        """Of the joints' values (n,)."""
        return JointUnits(self.sliding)

    def slides(self, joint: str) -> bool:
        """Whether a joint of the arm slides; a branch's joint turns. An InputError names the nearest joint."""
        return joint not in self.turning[self.n :] and self.sliding[self.joint_index(joint)]

    def unit_of(self, joint: str) -> JointUnit:
        """The units of a joint's value, load and compliance."""
        return SLIDES if self.slides(joint) else TURNS

    @cached_property
    def sizes(self) -> NaturalSizes:
        """By which effects say how large they naturally are."""
        lengths: Array = np.linalg.norm(self.placements[1:, :3, 3], axis=1)
        travels = [] if self.limits is None else [np.ptp(self.limits[k]) for k in range(1, self.n) if self.sliding[k]]
        reach = max(float(lengths.sum() + np.sum(travels)), 0.1)
        moving = 0.1 * float(self.masses[1:].sum())
        payload = self.payload or moving or 100.0 * (reach / 2.5) ** 3
        return NaturalSizes(reach, payload, float(np.linalg.norm(self.gravity)) or 9.81)

    def load_at(self, joint: str) -> float:
        """Of the payload on a joint of the stretched arm: N m, a tenth of that at full reach at least; N on a slide."""
        if self.slides(joint):
            return self.sizes.weight
        beyond = np.linalg.norm(self.placements[self.joint_index(joint) + 1 :, :3, 3], axis=1)
        return self.sizes.weight * max(float(beyond.sum()), 0.1 * self.sizes.reach)

    @property
    def n(self) -> int:
        return len(self.joints)

    @property
    def driven(self) -> tuple[str, ...]:
        """(m,) names of the joints that have an actuator, in chain order."""
        return tuple(joint for joint in self.joints if joint not in self.passive)

    @property
    def base(self) -> str:
        return self.links[0]

    def joint_index(self, joint: str) -> int:
        """Position of a joint in the chain; an InputError names the nearest joint."""
        return _index("joint", joint, self.joints, self.name)

    def link_index(self, link: str) -> int:
        """Position of a moving link in the chain, 0 for the base; the flange is on the last one."""
        names = tuple(dict.fromkeys((*self.links, self.flange)))
        return min(_index("link", link, names, self.name), self.n)

    def frame_of(self, link: str) -> tuple[int, Array]:
        """Where a point or an axis is that is stated in the frame of a link or of the flange: the moving link's
        position in the chain, and that frame (4, 4) in the link's."""
        return self.link_index(link), self.flange_placement if link == self.flange else np.eye(4)

    @property
    def turning(self) -> tuple[str, ...]:
        """(n + b,) names of all joints: the arm's, then those of the branches."""
        return (*self.joints, *(branch.joint for branch in self.branches))

    @property
    def bodies(self) -> tuple[str, ...]:
        """(n + 1 + b,) names of all links: the arm's, then those of the branches."""
        return (*self.links, *(branch.link for branch in self.branches))

    @property
    def moments(self) -> Array:
        """Mass, kg, and mass times centre, kg m in its own frame, of each body, (n + 1 + b, 4)."""
        masses = np.array([*self.masses, *(branch.mass for branch in self.branches)])
        centres = np.array([*self.centres, *(branch.centre for branch in self.branches)])
        return np.concatenate([masses[:, None], masses[:, None] * centres], axis=1)

    def turning_index(self, joint: str) -> int:
        """Position of a joint of the arm or of a branch among `turning`."""
        return _index("joint", joint, self.turning, self.name)

    def body_index(self, link: str) -> int:
        """Position of a link of the arm or of a branch among `bodies`."""
        return _index("link", link, self.bodies, self.name)

    def branch(self, joint: str) -> Branch:
        """The branch that a joint moves; an InputError names the nearest."""
        names = tuple(branch.joint for branch in self.branches)
        return self.branches[_index("joint beside the arm", joint, names, self.name)]

    def link_of(self, joint: str) -> str:
        """The link that a joint moves."""
        return self.links[self.joint_index(joint) + 1]

    def joint_of(self, place: str) -> str:
        """The joint that brings a place where it is: itself, or that before a link; the first one swings the base."""
        return place if place in self.joints else self.joints[max(self.link_index(place) - 1, 0)]


def _index(kind: str, name: str, names: tuple[str, ...], robot: str) -> int:
    if name in names:
        return names.index(name)
    raise InputError(
        Problem(
            f"robot {robot} has no {kind} {name!r}",
            allowed=", ".join(names) or "none",
            hint=nearest(name, names),
        )
    )


@dataclass(frozen=True, eq=False)
class Conditions:
    """What was recorded beside a state of N poses; None where it was not.

    time (N,) s, temperature (N,) K, approach (N,) -1 or +1: the side from which the pose was reached;
    order (N,) 0 to 1: which share of the readings had been taken, by where they stand or in the pace of time_s;
    came (N, n) rad, m: by how much each joint moved from the pose that was visited before
    """

    time: Array | None = None
    temperature: Array | None = None
    approach: Array | None = None
    order: Array | None = None
    came: Array | None = None

    def take(self, index: Any) -> Conditions:
        return self.each(lambda name: None if (a := getattr(self, name)) is None else a[index])

    @classmethod
    def each(cls, value: Callable[[str], Array | None]) -> Conditions:
        """Conditions whose every field is the value of its name."""
        return cls(**{f.name: value(f.name) for f in fields(cls)})


@dataclass(frozen=True, eq=False)
class Poses:
    """A batch of N commanded poses and the wrench on each, SI.

    pendant  (N, m) what the pendant shows, rad, m where a joint slides; m < n where joints follow others
    q        (N, n) URDF joint values by the robot's controller map, rad or m
    wrench   (N, 6) force (N) and moment (N m) at the load point, base frame
    """

    pendant: Array
    q: Array
    wrench: Array
    unloaded: Conditions = field(default_factory=Conditions)
    loaded: Conditions = field(default_factory=Conditions)

    def __len__(self) -> int:
        return len(self.q)

    def take(self, index: Any) -> Poses:
        """The poses at an index, slice or mask."""
        return Poses(
            self.pendant[index],
            self.q[index],
            self.wrench[index],
            self.unloaded.take(index),
            self.loaded.take(index),
        )


def came_from(q: Array, order: Array) -> Array:
    """By how much (N, n) each joint moved to poses q (N, n) that were visited in this order (N,), 0 to the first.

    An arm that stays, as between the two states of a pose, stands as it came.
    """
    rows = np.argsort(order, kind="stable")
    moves = np.diff(q[rows], axis=0, prepend=q[rows[:1]])
    new = np.any(moves != 0.0, axis=1)
    last = np.maximum.accumulate(np.where(new, np.arange(len(rows)), 0))
    came = np.empty_like(moves)
    came[rows] = moves[last]
    return came


_COLUMNS = {"time": "time_s", "temperature": "temperature_degC", "approach": "approach (-1 or 1)", "order": "order"}


@dataclass(frozen=True, eq=False)
class Context:
    """Where a law is asked for: an arm at N poses in one of their two states.

    A law of the arm that looks at `conditions` or `loaded` sets `by_state`, unless its `needs` say so already.
    """

    robot: RobotFacts
    poses: Poses
    loaded: bool = True

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def conditions(self) -> Conditions:
        """What was recorded of this state."""
        return self.poses.loaded if self.loaded else self.poses.unloaded

    def recorded(self, what: str, name: str) -> Array:
        """What was recorded (N,) of this state; the InputError says which column the effect `name` needs."""
        found: Array | None = getattr(self.conditions, what)
        if found is not None:
            return found
        both = " and time_unloaded_s" if what == "time" else ""
        raise InputError(f"{name} needs the column{'s' if both else ''} {_COLUMNS[what]}{both} in the readings")

    @property
    def side(self) -> Array:
        """From which side (N,) the poses were reached, -1 or +1; +1, all from one, where nobody recorded it."""
        found = self.conditions.approach
        return np.ones(len(self)) if found is None else found

    @property
    def order(self) -> Array:
        """Which share (N,) of the readings had been taken, 0 to 1; 0 in a plan whose order nobody has chosen yet."""
        found = self.conditions.order
        return np.zeros(len(self)) if found is None else found

    @property
    def came(self) -> Array:
        """By how much (N, n) each joint moved to a pose, rad, m; 0 in a plan whose order nobody has chosen yet."""
        found = self.conditions.came
        return np.zeros((len(self), self.robot.n)) if found is None else found
