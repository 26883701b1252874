"""A reflector that gives way when the load is on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Context, Parameter, Reading, RobotFacts, Sensor, place


@dataclass(frozen=True)
class MarkerOffsetLoaded(Sensor):
    """While a load is on a marker is off its place by a vector in the frame of its `xyz`."""

    marker: str = place()
    order = 0
    equation = "marker = origin + R (xyz + offset [loaded]), R of the frame of xyz"
    replaces = ("marker_slip", "the frame of the marker's xyz_mm")
    source = "nests on parts that the load bends or shakes: hundredths to tenths of a millimetre"
    check = "What this reflector's nest sits on: a cover, a cable, the part that carries the load."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"{self.name}.{axis}", "m", typical=1e-4) for axis in "xyz")

    def read(self, reading: Reading, x: Array, context: Context) -> Array:
        own = np.arange(len(reading.markers)) == reading.index(self.marker, self.name)
        return reading.position + context.loaded * own[:, None] * (reading.rotation @ x)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[MarkerOffsetLoaded, ...]:
        return tuple(cls(marker) for marker in markers)
