"""A tracker that wanders while the readings are taken, where nobody recorded the time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from qsframework.plugin import Array, Context, Parameter, Reading, RobotFacts, Sensor


@dataclass(frozen=True)
class ReadingDrift(Sensor):
    """All readings move evenly from the first to the last; in the pace of time_s where that is recorded.

    `tracker_drift` is the same by both times of a displacement. By steps: `tracker_move`.
    """

    order = 3
    equation = "reading gains d s, s the share of the readings taken"
    source = "drift of laser trackers and their stands: hundredths of a millimetre in a day"
    check = "Warm-up and stand of the tracker; read a fixed reflector at every pose."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"{self.name}.{axis}", "m", typical=1e-4) for axis in "xyz")

    def read(self, reading: Reading, x: Array, context: Context) -> Array:
        return reading.position + context.order[:, None, None] * x

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[ReadingDrift, ...]:
        return (cls(),)
