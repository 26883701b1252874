"""A reflector that was knocked out of its place while the readings were taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsf_plugins.tracker_move import STEPS, share
from qsframework.plugin import Array, Context, Parameter, Reading, RobotFacts, Sensor, place


@dataclass(frozen=True)
class MarkerOffsetAfter(Sensor):
    """From some reading on a marker is off its place by a vector in the frame of its `xyz`."""

    marker: str = place()
    percent: str = place("50")
    """After how many per cent of the readings it moved."""
    order = 0
    equation = "marker = origin + R (xyz + offset [share of readings taken >= p]), R of the frame of xyz"
    replaces = ("marker_move", "the frame of the marker's xyz_mm")
    source = "magnetic nests that are touched or cleaned: tenths of a millimetre"
    check = "What happened to this reflector at that reading; seat it again and repeat some poses."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"{self.name}.{axis}", "m", typical=2e-4) for axis in "xyz")

    def validate(self, robot: RobotFacts) -> None:
        share(self.name, self.percent)

    def read(self, reading: Reading, x: Array, context: Context) -> Array:
        own = np.arange(len(reading.markers)) == reading.index(self.marker, self.name)
        after = (context.order >= share(self.name, self.percent))[:, None, None]
        return reading.position + after * own[:, None] * (reading.rotation @ x)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[MarkerOffsetAfter, ...]:
        return tuple(cls(marker, percent) for marker in markers for percent in STEPS)
