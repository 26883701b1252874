"""The tracker's frame is turned against the robot's base."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from qsframework.plugin import Array, Context, Parameter, Reading, RobotFacts, Sensor, exponential


@dataclass(frozen=True)
class TrackerFrame(Sensor):
    """All readings are turned by a rotation vector (rx, ry, rz) about the base's origin."""

    order = 1
    equation = "reading = turn(rx, ry, rz) p"
    source = "frame fitting from reference points: 0.1 to 1 deg"
    check = "How the base frame was measured; measure it again."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"{self.name}.{axis}", "rad", typical=5e-3) for axis in ("rx", "ry", "rz"))

    def read(self, reading: Reading, x: Array, context: Context) -> Array:
        return reading.position @ exponential(x).T

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[TrackerFrame, ...]:
        return (cls(),)
