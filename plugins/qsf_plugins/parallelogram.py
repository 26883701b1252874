"""The parallelogram that drives the elbow of a heavy arm from its shoulder."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, InputError, Loop, LoopTerm, RobotFacts, place, setting


@dataclass(frozen=True)
class Parallelogram(Loop):
    """Lever, bar and link 2 move as a parallelogram, so that the forearm keeps its attitude when link 2 turns.

    The driven joint's actuator turns the lever: q_driven = phi_driven - s q_driver, with s = +1
    where the two axes point alike and -1 where they are opposed. This is the correction of the
    paper's equations (12)-(16).
    """

    driven: str = place()
    driver: str = setting()
    lever: float = setting("m")
    """Length of the lever and of its copy on the driven link."""
    margin: float = setting("rad", float(np.deg2rad(15.0)))
    """Smallest transmission angle of a planned pose."""
    zero: float = setting("rad", float(np.pi / 2))
    """Angle from link 2 to the lever, about the driver's axis, at zero joint angles."""
    source = "Klimchik et al., section 3.1, corrected"
    check = "Play in the bearings of the coupling bar, length of the bar."

    def joints(self, robot: RobotFacts) -> tuple[str, ...]:
        return (self.driver, self.driven)

    def validate(self, robot: RobotFacts) -> None:
        for joint in self.joints(robot):
            robot.joint_index(joint)
        self._sign(robot)

    def _sign(self, robot: RobotFacts) -> float:
        return parallel_sign(robot, self.driver, self.driven)

    def actuators(self, q: Array, robot: RobotFacts) -> Array:
        return np.stack([q[:, 0], q[:, 1] + self._sign(robot) * q[:, 0]], axis=1)

    def closure(self, actuators: Array, bars: Array, robot: RobotFacts) -> LoopTerm:
        sign = self._sign(robot)
        batch = len(actuators)
        q = np.stack([actuators[:, 0], actuators[:, 1] - sign * actuators[:, 0]], axis=1)
        q_u = np.broadcast_to(np.array([[1.0, 0.0], [-sign, 1.0]]), (batch, 2, 2))
        return LoopTerm(q, q_u, np.zeros((batch, 2, 2, 2)))

    def transmission_angle(self, q: Array, robot: RobotFacts) -> Array:
        """Angle between link 2 and the lever, folded into [0, 90] deg."""
        return np.abs(np.arcsin(np.sin(self.zero + self._sign(robot) * q[:, 1])))

    @property
    def smallest_transmission_angle(self) -> float:
        return self.margin


def parallel_sign(robot: RobotFacts, driver: str, driven: str) -> float:
    """+1 where the axes of two joints point alike, -1 where opposed. InputError if they are not parallel."""
    first, second = robot.joint_index(driver), robot.joint_index(driven)
    rotation = np.eye(3)
    for k in range(first + 1, second + 1):
        rotation = rotation @ robot.placements[k, :3, :3]
    cosine = float(robot.axes[first] @ rotation @ robot.axes[second])
    if second <= first or abs(abs(cosine) - 1.0) > 1e-6:
        raise InputError(f"a loop needs parallel axes: {driver} and {driven} are not (cosine {cosine:.6f})")
    return float(np.sign(cosine))
