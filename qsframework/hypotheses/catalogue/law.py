"""A law that nobody has written: an extra motion at a place, that depends on a product of factors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from qsframework.plugin import RobotFacts

Part = Literal["drive", "bearing", "link", "shift", "marker", "readings", "load", "point"]
"""What moves: a drive, the tilt of a joint's bearing, a link's three rotations, its shift, one marker, or all readings;
or the force of the load, or the point where it acts, which move all."""
FACTORS = (
    "torque",
    "others",
    "moment",
    "attitude",
    "order",
    "came",
    "loaded",
    "always",
    "time",
    "temperature",
    "approach",
    "force",
    "direction",
    "before",
)
"""On what it may depend beside angles: the torque there, torques about other axes, the moments
where an end shifts, where gravity points, the order of
the readings, from where the joint came, that a load hangs, nothing, a column that was recorded, the load's force, the
load that hung before."""
_NEAR = 2.0
"""Joints away from a place within which what a joint does can act there: through a shaft, a cable, a casting."""
OF_A_JOINT = ("torque ", "came ", "travel ")
"""Begin factors that are of another joint, by its name."""


@dataclass(frozen=True)
class Law:
    """place: name of the joint, link or marker, empty for all readings; by: the factors, angles by their joints with a
    plus between; without a torque, `loaded` or `always` it grows with the torque there, without any factor it differs
    at each visit; axis: of several about or along which a place may move, the one that it does, empty: all."""

    part: Part
    place: str
    by: tuple[str, ...]
    axis: str = ""

    @property
    def angles(self) -> tuple[str, ...]:
        """The factors that are angles."""
        return tuple(f for f in self.by if f not in FACTORS and not f.startswith(OF_A_JOINT))

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints whose angles count."""
        return tuple(joint for factor in self.angles for joint in factor.split("+"))

    @property
    def where(self) -> tuple[str, str]:
        """Part and place: a link that shifts is where it turns."""
        return "link" if self.part == "shift" else self.part, self.place

    @property
    def name(self) -> str:
        """Such as `joint_3/torque`, `joint_2/torque*joint_2+joint_3` or `bearing joint_4 rx/attitude`."""
        place = f"{self.part} {self.place}" if self.part in ("bearing", "shift", "point") else self.place or self.part
        return f"{f'{place} {self.axis}'.strip()}/{'*'.join(self.by)}"

    def follows_another(self, facts: RobotFacts) -> bool:
        """Whether a part of one joint moves by an angle, torque or way of other joints alone."""
        if self.place not in (*facts.joints, *facts.links):
            return False
        named = [f.split("+") for f in self.angles]
        named += [[f.partition(" ")[2]] for f in self.by if f.startswith(OF_A_JOINT)]
        return any(facts.joint_of(self.place) not in joints for joints in named)

    def reaches(self, facts: RobotFacts) -> bool:
        """Whether what it depends on can act at its place: angles, torques and ways of joints near it; all else can,
        and whatever the instrument sees of the end of the arm."""
        if self.place not in (*facts.joints, *facts.links, facts.flange):
            return True
        own = facts.joint_index(self.place) + 0.5 if self.place in facts.joints else float(facts.link_index(self.place))
        named = [f.split("+") for f in self.angles]
        named += [[f.partition(" ")[2]] for f in self.by if f.startswith(OF_A_JOINT)]
        return all(any(abs(facts.joint_index(j) + 0.5 - own) <= _NEAR for j in joints) for joints in named)


@dataclass(frozen=True)
class LikelyPlace:
    """A place of what is left: its likeliest law, without factors where it differs at each visit; its share of the
    evidence; how far it moves (sd over the visits, rad or m); and the places that move the markers alike."""

    law: Law
    share: float
    sd: float = float("nan")
    equivalent: tuple[Law, ...] = ()

    @property
    def wheres(self) -> set[tuple[str, str]]:
        """Of itself and its equivalents."""
        return {self.law.where, *(law.where for law in self.equivalent)}
