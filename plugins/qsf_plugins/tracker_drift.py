"""The tracker wanders with time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from qsframework.plugin import Array, Context, Parameter, Reading, RobotFacts, Sensor


@dataclass(frozen=True)
class TrackerDrift(Sensor):
    """All readings move with a constant velocity; a displacement sees it between its two states."""

    order = 3
    needs = ("time",)
    equation = "reading gains v t; a displacement v (t_loaded - t_unloaded)"
    source = "drift of laser trackers and their stands: micrometres per hour"
    check = "Warm-up and stand of the tracker; read a fixed reflector at every pose."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"{self.name}.{axis}", "m/s", typical=1e-8) for axis in ("vx", "vy", "vz"))

    def read(self, reading: Reading, x: Array, context: Context) -> Array:
        return reading.position + context.recorded("time", self.name)[:, None, None] * x

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[TrackerDrift, ...]:
        return (cls(),)
