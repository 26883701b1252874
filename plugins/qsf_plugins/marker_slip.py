"""A reflector that gives way when the load is on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Context, Parameter, Reading, RobotFacts, Sensor, place


@dataclass(frozen=True)
class MarkerSlip(Sensor):
    """A marker sits elsewhere in its link while a load is on, by a vector that the link carries along."""

    marker: str = place()
    order = 0
    equation = "marker = link's place + R_link (nominal + offset [loaded])"
    source = "nests on parts that the load bends or shakes: hundredths to tenths of a millimetre"
    check = "What this reflector's nest sits on: a cover, a cable, the part that carries the load."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"{self.name}.{axis}", "m", typical=1e-4) for axis in "xyz")

    def read(self, reading: Reading, x: Array, context: Context) -> Array:
        own = np.arange(len(reading.markers)) == reading.index(self.marker, self.name)
        return reading.position + context.loaded * own[:, None] * (reading.rotation @ x)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[MarkerSlip, ...]:
        return tuple(cls(marker) for marker in markers)
