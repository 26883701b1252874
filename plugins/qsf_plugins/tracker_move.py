"""A tracker that was knocked while the readings were taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from qsframework.plugin import (
    Array,
    Context,
    InputError,
    Parameter,
    Problem,
    Reading,
    RobotFacts,
    Sensor,
    exponential,
    place,
)

STEPS = "25", "50", "75"
"""Where a diagnosis tries a sudden change, per cent of the readings."""


def share(name: str, percent: str) -> float:
    """The share of the readings, 0 to 1, of a whole number of per cent; InputError for anything else."""
    if not (percent.isascii() and percent.isdigit() and 0 < int(percent) < 100):
        allowed = "whole numbers between 0 and 100, such as '50'"
        raise InputError(Problem(f"{name}: unknown percent", found=repr(percent), allowed=allowed))
    return int(percent) / 100.0


@dataclass(frozen=True)
class TrackerMove(Sensor):
    """The tracker stands elsewhere from some reading on: all readings after it are shifted and turned."""

    percent: str = place("50")
    """After how many per cent of the readings it moved."""
    order = 4
    equation = "reading = p, then turn(rx, ry, rz) p + (x, y, z) where the share of readings taken >= p"
    source = "a stand that is touched, a floor that settles: tenths of a millimetre"
    check = "What happened at that reading; read fixed reflectors on the floor before and after."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        shifts = tuple(Parameter(f"{self.name}.{axis}", "m", typical=2e-4) for axis in "xyz")
        return shifts + tuple(Parameter(f"{self.name}.r{axis}", "rad", typical=1e-4) for axis in "xyz")

    def validate(self, robot: RobotFacts) -> None:
        share(self.name, self.percent)

    def read(self, reading: Reading, x: Array, context: Context) -> Array:
        after = (context.order >= share(self.name, self.percent))[:, None, None]
        turned = reading.position @ exponential(x[3:]).T
        return reading.position + after * (turned - reading.position + x[:3])

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[TrackerMove, ...]:
        return tuple(cls(percent) for percent in STEPS)
