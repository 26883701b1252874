"""A reflector sits beside the place that was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Context, Parameter, Reading, RobotFacts, Sensor, SensorTerm, cross_matrix, place


@dataclass(frozen=True)
class MarkerOffset(Sensor):
    """A marker is off its place by a vector in the frame of its `xyz`, which that frame's rotation carries along."""

    marker: str = place()
    role = "marker offset"
    replaces = ("tool_offset", "the frame of the marker's xyz_mm")
    order = 0
    equation = "marker = origin + R (xyz + offset), R the rotation of the frame in which xyz is stated"
    source = "rigid-body kinematics"
    check = "Where the reflector's nest is glued or bolted."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"{self.name}.{axis}", "m", typical=2e-3) for axis in "xyz")

    def read(self, reading: Reading, x: Array, context: Context) -> SensorTerm:
        k = reading.index(self.marker, self.name)
        position = reading.position.copy()
        carried = reading.rotation[:, k]
        offset = carried @ x
        position[:, k] += offset
        d_position = np.broadcast_to(np.eye(3), (*position.shape, 3))
        dx, d_rotation = np.zeros((*position.shape, 3)), np.zeros((*position.shape, 3))
        dx[:, k], d_rotation[:, k] = carried, -cross_matrix(offset)
        return SensorTerm(position, d_position, dx, d_rotation)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[MarkerOffset, ...]:
        return tuple(cls(marker) for marker in markers)
