"""The tracker's metre is not a metre."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from qsframework.plugin import Array, Context, Parameter, Reading, RobotFacts, Sensor


@dataclass(frozen=True)
class TrackerScale(Sensor):
    """All readings are larger by a common factor 1 + k."""

    order = 2
    equation = "reading = (1 + k) p"
    source = "refraction and scale of laser trackers: parts per million; a wrong unit: much more"
    check = "Weather station of the tracker, a scale bar."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter(self.name, "", typical=1e-3, lower=-0.99),)

    def read(self, reading: Reading, x: Array, context: Context) -> Array:
        return reading.position * (1.0 + x[0])

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[TrackerScale, ...]:
        return (cls(),)
