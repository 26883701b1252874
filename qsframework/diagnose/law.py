"""A law that nobody has written: an extra motion at a place, that depends on a variable."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Part = Literal["drive", "link", "shift", "marker", "readings"]
"""What moves: a drive, a link's three rotations, a shift of the base or the flange, one marker, or all readings."""
Variable = Literal["torque", "angle", "others", "order", "step", "constant", "time", "temperature", "approach"]
"""On what it depends: the torque there, that torque and an angle, the torque about other axes, the order of the
readings, from where the joint came, nothing, or a column that was recorded."""


@dataclass(frozen=True)
class Law:
    """place: name of the joint, link or marker, empty for all readings; joints: whose angles, added up, count."""

    part: Part
    place: str
    variable: Variable
    joints: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Such as `joint_3/torque` or `link_2/joint_2+joint_3`."""
        return f"{self.place or self.part}/{'+'.join(self.joints) or self.variable}"
