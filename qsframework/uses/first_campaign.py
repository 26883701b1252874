"""A first campaign on a robot that nobody has measured yet: an experiment.yaml to start from."""

from __future__ import annotations

import numpy as np

from qsframework.robot import Robot
from qsframework.robot.kinematics import joint_frames

_WEIGHT = 10.0
"""kg, on an arm whose payload and masses are unknown."""
_TEXT = """# A first campaign on this robot. Assumed, to plan with: put your tool, load and noise in their place.
robot: {robot}
load: {{point_mm: [{a:g}, {b:g}, {c:g}]}}   # where the load pulls, flange frame: off the axis of the last joint
markers:   # reflectors around the tool, flange frame
  m1: {{xyz_mm: [{a:g}, {a:g}, {a:g}]}}
  m2: {{xyz_mm: [{d:g}, -{a:g}, 0]}}
  m3: {{xyz_mm: [0, -{a:g}, -{a:g}]}}
noise: {{sigma_mm: 0.03}}   # one coordinate of one displacement
loads:   # {why}
  - {{name: weight, fz_N: {weight:g}}}
  - {{name: side_pull, fz_N: {less:g}, fy_N: {side:g}{along}}}   # a weight alone does not turn a vertical axis
"""


def first_campaign(robot: Robot, name: str) -> str:
    """The text of an experiment.yaml: a weight, the same with a side pull, three markers around a tool that fits.

    Args:
        robot: the robot.
        name: what its file calls the robot: a name, or a folder relative to the file.

    Returns:
        YAML with all that is assumed; it fits the compliances of the joints.
    """
    if robot.payload:
        weight, why = 0.8 * robot.payload, "0.8 of the payload"
    else:
        weight, why = 0.1 * float(robot.facts.masses[1:].sum()), "a tenth of what moves: no payload is stated"
    force = _rounded(9.81 * (weight or _WEIGHT))
    size = _rounded(1e3 * _size(robot))
    return _TEXT.format(
        robot=name,
        a=size,
        b=_rounded(0.3 * size),
        c=_rounded(0.5 * size),
        d=2.0 * size,
        why=why,
        weight=-force,
        less=-_rounded(0.8 * force),
        side=_rounded(0.5 * force),
        along=f", fx_N: {_rounded(0.3 * force):g}" if _slides_along_x(robot) else "",
    )


def _rounded(value: float) -> float:
    """Two digits: what is assumed needs no more."""
    return float(f"{value:.2g}")


def _slides_along_x(robot: Robot) -> bool:
    """Whether a joint slides along the base's x, at zero joint angles, so that only a pull that way loads it: a
    gantry's beam, a track."""
    axes = joint_frames(robot.facts, np.zeros((1, robot.facts.n))).axes[:, 0, 0]
    return bool((np.abs(axes[list(robot.facts.sliding)]) > 0.5).any())


def _size(robot: Robot) -> float:
    """Length (m) of a tool that fits the arm: a tenth of all link lengths."""
    return 0.1 * float(np.linalg.norm(robot.facts.placements[:, :3, 3], axis=1).sum())
