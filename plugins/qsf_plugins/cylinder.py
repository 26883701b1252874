"""A balancer's cylinder or rod: a link beside the arm that always points at a pivot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qsf_plugins.planar_loop import with_branches
from qsframework.plugin import Array, Context, InputError, Loop, LoopTerm, Problem, RobotFacts, place, setting

_PARALLEL = 1e-6
_CLOSE = 1e-3
"""m: two pivots as far from the driver's axis as each other would meet at some angle."""


@dataclass(frozen=True)
class Cylinder(Loop):
    """A branch swings about its pivot on the one side of the driver and points at a pivot on the other side.

    joint: of the cylinder, on the link before the driver, or of the rod, on the link that the driver moves; the URDF
    draws it as it stands at zero joint angles. Its mass loads the arm; what it pulls is a balancer of its own effect.
    """

    joint: str = place()
    driver: str = setting()
    """The joint between the two pivots."""
    x: float = setting("m")
    """The pivot at which it points, in the frame of the other link."""
    y: float = setting("m")
    z: float = setting("m")
    equation = "q = arg(p e^(i q_driver) - o), from its value at zero; o, p the pivots across the driver's axis"
    source = "inverted slider crank"
    check = "Mass of the cylinder, place of its pivots."

    def joints(self, robot: RobotFacts) -> tuple[str, ...]:
        return (self.driver, self.joint)

    def leaders(self, robot: RobotFacts) -> tuple[str, ...]:
        return (self.driver,)

    def validate(self, robot: RobotFacts) -> None:
        _, _, own, pivot = self._pivots(robot)
        if abs(abs(own) - abs(pivot)) < _CLOSE:
            found = f"{abs(own):.4g} m and {abs(pivot):.4g} m from the axis of {self.driver}"
            raise InputError(
                Problem(f"{self.name}: its two pivots can meet, so nothing determines its angle", found=found)
            )

    def _pivots(self, robot: RobotFacts) -> tuple[float, float, complex, complex]:
        """Senses of the branch's axis and of the driver's turn, and both pivots across the driver's axis at zero."""
        k, branch = robot.joint_index(self.driver), robot.branch(self.joint)
        sides = {robot.links[k]: 1.0, robot.links[k + 1]: -1.0}
        if branch.parent not in sides:
            allowed = f"{robot.links[k]} or {robot.links[k + 1]}, the links on both sides of {self.driver}"
            raise InputError(Problem(f"{self.name} hangs on the wrong link", found=branch.parent, allowed=allowed))
        before = np.asarray(np.linalg.inv(robot.placements[k]), dtype=np.float64)
        side = sides[branch.parent]
        frame = (before if side > 0.0 else np.eye(4)) @ branch.placement
        target = (np.eye(4) if side > 0.0 else before) @ [self.x, self.y, self.z, 1.0]
        axis = robot.axes[k]
        sense = float(axis @ frame[:3, :3] @ branch.axis)
        if abs(abs(sense) - 1.0) > _PARALLEL:
            raise InputError(f"{self.name}: its axis is not parallel to that of {self.driver} (cosine {sense:.6f})")
        x = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        x /= np.linalg.norm(x)
        plane = x + 1j * np.cross(axis, x)
        return float(np.sign(sense)), side, complex(plane @ frame[:3, 3]), complex(plane @ target[:3])

    def _angle(self, q: Array, robot: RobotFacts) -> LoopTerm:
        """The branch's angle (N, 1) by the driver's (N,), continuous over whole turns."""
        sense, side, own, pivot = self._pivots(robot)
        turn = np.exp(1j * side * q)
        D = pivot * turn - own
        far = abs(pivot) > abs(own)  # whichever arm is longer, the other never turns D around once
        ratio = 1.0 - own / (pivot * turn) if far else 1.0 - pivot * turn / own
        start = 1.0 - own / pivot if far else 1.0 - pivot / own
        w = pivot * turn / D
        value = np.angle(ratio) - np.angle(start) + (side * q if far else 0.0)
        first, second = side * w.real, (w * w - w).imag
        return LoopTerm(sense * value[:, None], sense * first[:, None, None], sense * second[:, None, None, None])

    def actuators(self, q: Array, robot: RobotFacts) -> Array:
        return np.stack([q[:, 0], q[:, 1] - self._angle(q[:, 0], robot).q[:, 0]], axis=1)

    def closure(self, actuators: Array, bars: Array, context: Context) -> LoopTerm:
        batch = len(actuators)
        lead = LoopTerm(actuators[:, :1], np.ones((batch, 1, 1)), np.zeros((batch, 1, 1, 1)))
        return with_branches(lead, self._angle(actuators[:, 0], context.robot), actuators[:, 1:])
