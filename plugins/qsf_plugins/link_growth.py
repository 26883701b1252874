"""A link that grows between the readings, whatever warms it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Context, Geometry, GeometryTerm, InputError, Parameter, RobotFacts, place

_SHORTEST = 0.01
"""m: length of a link below which nothing shows."""


@dataclass(frozen=True)
class LinkGrowth(Geometry):
    """A link is longer in the loaded series than in the unloaded one, and grows while the readings are taken.

    It grows along the line from its own joint to the next. `.loaded` is by how much it is longer in loaded states,
    `.drift` by how much it grows from the first reading to the last. No temperature is needed.
    """

    link: str = place()
    moves_placements = True
    by_state = True
    equation = (
        "origin of the next joint = nominal origin + (g [loaded] + d s) its direction, s the share of readings taken"
    )
    source = "a drive's heat in a casting: 12 um/(m K), some kelvin in an hour"
    check = "Warm-up before measuring; take unloaded and loaded readings in turns."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        size = 3e-5 * robot.sizes.reach
        return tuple(Parameter(f"{self.name}.{name}", "m", typical=size) for name in ("loaded", "drift"))

    def validate(self, robot: RobotFacts) -> None:
        if self.link not in [e.link for e in self.places(robot)]:
            robot.link_index(self.link)
            raise InputError(f"{self.name}: this link has no length to the next joint")

    def errors(self, x: Array, context: Context) -> GeometryTerm:
        robot, q = context.robot, context.poses.q
        k = robot.link_index(self.link)
        frame = robot.placements[k]
        along = frame[:3, :3].T @ frame[:3, 3] / np.linalg.norm(frame[:3, 3])
        slope = np.zeros((*q.shape, 6, 2))
        slope[:, k, :3, 0] = along * context.loaded
        slope[:, k, :3, 1] = along * context.order[:, None]
        return GeometryTerm(twists=slope @ x, twists_dx=slope)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[LinkGrowth, ...]:
        long = np.linalg.norm(robot.placements[1:, :3, 3], axis=1) > _SHORTEST
        return tuple(cls(link) for link, grows in zip(robot.links[1:-1], long, strict=True) if grows)
