"""What an exported file says, read back: the proof that it says what the plan says."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from qsframework.applications.programme import Programme, load_name
from qsframework.errors import InputError, Problem
from qsframework.experiment import Plan
from qsframework.plugin import Array

ROUNDING = float(np.deg2rad(0.00005 * 1.001))
"""Files state angles to a ten-thousandth of a degree, 5 um at an arm of 3 m; URScript to 1e-7 rad."""


@dataclass(frozen=True, eq=False)
class Stop:
    """A stop of an exported file: pose "" in between; pause 0: none, None: until started by hand.

    load: what is hung there once the arm has stopped, or as much of its name as the format holds
    """

    pose: str
    repeat: int
    pendant: Array
    speed: int
    pause: float | None
    load: str = ""

    def waiting(self, pause: float | None) -> Stop:
        """The stop with its pause."""
        return replace(self, pause=pause)

    def hanging(self, load: str) -> Stop:
        """The stop with its load."""
        return replace(self, load=load)

    def holds(self, load: str) -> bool:
        """Whether this is its load."""
        return bool(self.load) == bool(load) and plain(load).startswith(plain(self.load))


@dataclass(frozen=True, eq=False)
class Parsed:
    """A file that was read back. tool, frame: as it states them, "" where it states none."""

    robot: str
    stops: tuple[Stop, ...]
    tool: str = ""
    frame: str = ""

    def differences(self, programme: Programme) -> list[str]:
        """Where the file says something else than the programme; empty for a good one."""
        out = [] if self.robot == programme.robot else [f"robot {self.robot}, not {programme.robot}"]
        if len(self.stops) != len(programme.moves):
            return [*out, f"{len(self.stops)} stops, not {len(programme.moves)}"]
        for what, said, meant in (("tool", self.tool, programme.tool), ("frame", self.frame, programme.frame)):
            if said and meant and said != meant:
                out.append(f"{what} {said}, not {meant}")
        for i, (stop, move) in enumerate(zip(self.stops, programme.moves, strict=True), start=1):
            pause = programme.pause if move.measured else 0.0
            said, meant = (stop.pose, stop.repeat), (move.pose, move.repeat)
            if said != meant or stop.speed != programme.speed or stop.pause != pause:
                out.append(f"stop {i}: {said}, {stop.speed} %, pause {stop.pause}")
            if not stop.holds(move.load):
                out.append(f"stop {i}: the load {stop.load!r} is hung there, not {move.load!r}")
            if stop.pendant.shape != move.pendant.shape or np.abs(stop.pendant - move.pendant).max() > ROUNDING:
                out.append(f"stop {i}: other angles")
        return out

    def plan_differences(self, plan: Plan) -> list[str]:
        """Where the measured stops differ from the plan: another pose, other angles, load or number of repeats."""
        out: list[str] = []
        for i, (name, pendant, repeats) in enumerate(zip(plan.pose, plan.pendant, plan.repeats, strict=True)):
            own = [s for s in self.stops if s.pose == name]
            if len(own) != repeats:
                out.append(f"{name}: {len(own)} visits, not {repeats}")
            if any(np.abs(s.pendant - pendant).max() > ROUNDING for s in own):
                out.append(f"{name}: other angles")
            if not all(s.holds(load_name(plan, i)) for s in own):
                out.append(f"{name}: another load")
        known = set(plan.pose) | {""}
        return out + [f"{s.pose}: not in the plan" for s in self.stops if s.pose not in known]


def plain(name: str) -> str:
    """A load's name as a remark of a controller's file holds it."""
    return re.sub(r"[^A-Za-z0-9_.+-]", "_", name)


def wrong(message: str) -> InputError:
    """An exported file that cannot be read."""
    return InputError(Problem(message))


def bad_name(found: str, allowed: str) -> InputError:
    """A name that the controller cannot hold."""
    return InputError(Problem("a name that the controller cannot hold", found=repr(found), allowed=allowed))
