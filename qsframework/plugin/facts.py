"""What an effect may look at: the arm's constants and a batch of poses. No kinematics library here."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from qsframework.errors import InputError, Problem, nearest

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


def frozen(values: Any) -> Array:
    """A read-only float64 copy of the values."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class RobotFacts:
    """The constants of an arm of n joints, base to flange, in SI.

    joints      (n,) names in chain order
    links       (n + 1,) names: the base link, then the link that each joint moves
    axes        (n, 3) joint axes in their joint frames
    placements  (n, 4, 4) joint frame in the previous link's frame at zero angle
    masses      (n + 1,) kg; `centres` (n + 1, 3) m in the link frames
    gravity     (3,) m/s^2 in the base frame
    """

    name: str
    joints: tuple[str, ...]
    links: tuple[str, ...]
    axes: Array
    placements: Array
    masses: Array
    centres: Array
    gravity: Array = field(default_factory=lambda: frozen([0.0, 0.0, -9.81]))

    @property
    def n(self) -> int:
        return len(self.joints)

    @property
    def base(self) -> str:
        return self.links[0]

    @property
    def flange(self) -> str:
        return self.links[-1]

    def joint_index(self, joint: str) -> int:
        """Position of a joint in the chain; an InputError names the nearest joint."""
        return _index("joint", joint, self.joints, self.name)

    def link_index(self, link: str) -> int:
        """Position of a moving link in the chain, 0 for the base."""
        return _index("link", link, self.links, self.name)

    def link_of(self, joint: str) -> str:
        """The link that a joint moves."""
        return self.links[self.joint_index(joint) + 1]


def _index(kind: str, name: str, names: tuple[str, ...], robot: str) -> int:
    if name in names:
        return names.index(name)
    raise InputError(
        Problem(
            f"robot {robot} has no {kind} {name!r}",
            allowed=", ".join(names),
            hint=nearest(name, names),
        )
    )


@dataclass(frozen=True, eq=False)
class Conditions:
    """What was recorded beside a state of N poses; None where it was not.

    time (N,) s, temperature (N,) K, approach (N,) -1 or +1: the side from which the pose was reached.
    """

    time: Array | None = None
    temperature: Array | None = None
    approach: Array | None = None

    def take(self, index: Any) -> Conditions:
        return Conditions(*(None if a is None else a[index] for a in (self.time, self.temperature, self.approach)))


@dataclass(frozen=True, eq=False)
class Poses:
    """A batch of N commanded poses and the wrench on each, SI.

    pendant  (N, n) angles as the pendant shows them, rad
    q        (N, n) URDF joint angles by the robot's controller map, rad
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
