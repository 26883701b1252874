"""A joint sags under links whose masses nobody knows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import (
    Array,
    Context,
    Geometry,
    GeometryTerm,
    InputError,
    Parameter,
    Problem,
    RobotFacts,
    place,
    turns,
)

_VERTICAL = 1e-6
"""rad from the vertical below which an axis counts as vertical."""


@dataclass(frozen=True)
class GravitySag(Geometry):
    """A joint sags by compliance times the gravity torque of all that it carries, masses unknown.

    With g = |g| d the torque about axis z_j is the sum over the carried links k of
    |g| (d x z_j) . R_k L_k, where L_k = m_k c_k + M_{k+1} o_{k+1} is the link's first mass moment with
    all masses farther out lumped into the origin of the next joint. Readings tell the products
    P_k = c_j |g| L_k (rad) and nothing finer. L_k along the link's own joint axis acts like a moment
    of the link before it (of joint j's own link: not at all), so two entries of P_k, across that axis, are
    the whole of what is identifiable: 2 (n - j + 1) parameters of joint j. P_k is how far the joint sags
    where that moment lies level, at right angles to the joint's axis.

    Of a joint that slides it says nothing, nor where one slides beyond it: that changes the moments.

    Use it for absolute positions. It adds to what the URDF's masses and `joint_compliance` already
    give. Behind a parallelogram it is the actuator that sags, and the same parameters describe it exactly.
    """

    joint: str = place()
    role = "sag"
    last: str = ""
    """The last link that turns apart; those farther out are taken as lumped into it. The flange by default."""
    equation = "dq_j = sum over carried links k of (d x z_j) . R_k P_k, d the direction of gravity"
    source = "statics of a tree of rigid bodies; base parameters: Khalil, Dombre, Modeling of Robots, ch. 9"
    check = "Stiffness of this gear; weights of the links, cables and tool that it carries."

    def _links(self, robot: RobotFacts) -> range:
        """Places in the chain of the joints whose links turn apart."""
        end = robot.n if not self.last else robot.link_index(self.last)
        return range(robot.joint_index(self.joint), end)

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        labels = [(robot.links[k + 1], label) for k in self._links(robot) for label in _across(robot.axes[k])[0]]
        size = robot.sizes.rotation(0.3e-3)
        return tuple(
            Parameter(f"{self.name}.{link}_{label}", "rad", typical=size, nominal_sd=size) for link, label in labels
        )

    def validate(self, robot: RobotFacts) -> None:
        if not _is_loaded(robot, robot.joint_index(self.joint)):
            allowed = ", ".join(e.joint for e in self.places(robot)) or "none on this arm"
            raise InputError(Problem(f"{self.name}: gravity never turns this joint", allowed=allowed))
        if not self._links(robot):
            allowed = ", ".join(robot.links[robot.joint_index(self.joint) + 1 :])
            raise InputError(
                Problem(f"{self.name}: last must be carried by the joint", found=self.last, allowed=allowed)
            )

    def errors(self, x: Array, context: Context) -> GeometryTerm:
        robot, poses = context.robot, context.poses
        j, links = robot.joint_index(self.joint), self._links(robot)
        down = robot.gravity / np.linalg.norm(robot.gravity)
        slope = np.zeros((*poses.q.shape, len(x)))
        along = np.broadcast_to(down, (len(poses), 3))  # in the frames of the links, one after the other
        for k in range(links.stop):
            along = along @ robot.placements[k, :3, :3]
            if k == j:  # from here on what gravity would turn the joint about were it free
                along = np.cross(along, robot.axes[k])
            if not robot.sliding[k]:
                along = np.einsum("nij,ni->nj", turns(robot.axes[k], poses.q[:, k]), along)
            if k >= j:
                slope[:, j, 2 * (k - j) : 2 * (k - j) + 2] = along @ _across(robot.axes[k])[1].T
        return GeometryTerm(slope @ x, slope)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[GravitySag, ...]:
        return tuple(cls(joint) for k, joint in enumerate(robot.joints) if _is_loaded(robot, k))


def _is_loaded(robot: RobotFacts, joint: int) -> bool:
    """Whether gravity can turn a joint: its axis, or one before it that turns, is not vertical, and nothing slides
    from it on."""
    size = np.linalg.norm(robot.gravity)
    if size == 0.0 or any(robot.sliding[joint:]):
        return False
    rotation = np.eye(3)
    for k in range(joint + 1):
        rotation = rotation @ robot.placements[k, :3, :3]
        if (
            not robot.sliding[k]
            and np.linalg.norm(np.cross(robot.gravity / size, rotation @ robot.axes[k])) > _VERTICAL
        ):
            return True
    return False


def _across(axis: Array) -> tuple[tuple[str, str], Array]:
    """Names and directions (2, 3) across a joint's axis: the link's own axes where the joint's is one of them."""
    main = int(np.argmax(np.abs(axis)))
    if abs(axis[main]) > 1.0 - 1e-12:
        others = [i for i in range(3) if i != main]
        return ("xyz"[others[0]], "xyz"[others[1]]), np.eye(3)[others]
    first = np.cross(np.eye(3)[int(np.argmin(np.abs(axis)))], axis)
    first /= np.linalg.norm(first)
    return ("u", "v"), np.stack([first, np.cross(axis, first)])
