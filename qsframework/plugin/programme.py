"""A plan as a sequence of moves of the real robot: what the languages of controllers write."""

from __future__ import annotations

from dataclasses import dataclass, field

from qsframework.plugin.facts import Array
from qsframework.units import JointUnits


@dataclass(frozen=True, eq=False)
class Move:
    """A joint move to what the pendant is to show (n,), rad or m.

    pose: the plan's name, "" for a pose in between or home.

    repeat: 1, 2, ... counts the visits of the pose; load: the name of what is hung once the arm has stopped there;
    station: where the tracker is to stand from here on, "" where it stays
    """

    pendant: Array
    pose: str = ""
    repeat: int = 0
    load: str = ""
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    station: str = ""

    @property
    def measured(self) -> bool:
        return self.pose != ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Programme:
    """What the robot is to do. speed: percent of every joint's largest; pause: s at each pose, None: until started.

    length, length_as_planned: rad of the slowest joint, in this order and in the plan's, both from home and back
    where `home` says so; external: which angles are external axes of the controller; tool, frame: the controller's
    numbers or names of the tool and of the user frame, "" for those that the format begins with
    """

    robot: str
    title: str
    payload: float | None
    moves: tuple[Move, ...]
    units: JointUnits
    speed: int
    pause: float | None
    length: float = 0.0
    length_as_planned: float = 0.0
    notes: tuple[str, ...] = field(default=())
    home: bool = False
    external: tuple[int, ...] = ()
    tool: str = ""
    frame: str = ""

    @property
    def loaded(self) -> bool:
        """Whether anything is hung anywhere."""
        return any(m.load for m in self.moves)

    @property
    def vias(self) -> int:
        """How many poses in between were needed; home is none."""
        return sum(1 for m in self.moves if not m.measured) - 2 * self.home
