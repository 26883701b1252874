"""A serial arm of turning and sliding joints in MuJoCo, read from its URDF. Shares no code with qsframework.

Bodies are placed at the commanded pose, so that every spring is at rest there.
"""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree import ElementTree

import mujoco
import numpy as np
from mujoco_m900ib import STEP, settle as relaxed


@dataclass(frozen=True)
class Stage:
    """A joint with the link that it moves, as the URDF has them."""

    slides: bool
    axis: np.ndarray
    xyz: np.ndarray
    rpy: np.ndarray
    mass: float
    centre: np.ndarray


def row(text: str | None) -> np.ndarray:
    return np.array([float(v) for v in (text or "0 0 0").split()])


def stages(urdf: str) -> list[Stage]:
    """The joints of a URDF whose links are a chain, in order."""
    robot = ElementTree.fromstring(urdf)
    links = {e.get("name"): e for e in robot.findall("link")}
    out: list[Stage] = []
    for joint in robot.findall("joint"):
        origin, axis, child = joint.find("origin"), joint.find("axis"), joint.find("child")
        assert origin is not None
        assert axis is not None
        assert child is not None
        inertial = links[child.get("link")].find("inertial")
        assert inertial is not None
        mass, centre = inertial.find("mass"), inertial.find("origin")
        assert mass is not None
        assert centre is not None
        direction = row(axis.get("xyz"))
        out.append(
            Stage(
                slides=joint.get("type") == "prismatic",
                axis=direction / np.linalg.norm(direction),
                xyz=row(origin.get("xyz")),
                rpy=row(origin.get("rpy")),
                mass=float(mass.get("value") or 0.0),
                centre=row(centre.get("xyz")),
            )
        )
    return out


def turned(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation matrix about a unit axis, by its quaternion."""
    quaternion, out = np.zeros(4), np.zeros(9)
    mujoco.mju_axisAngle2Quat(quaternion, axis, angle)
    mujoco.mju_quat2Mat(out, quaternion)
    return out.reshape(3, 3)


def words(values: np.ndarray) -> str:
    return " ".join(f"{v:.15g}" for v in values)


def mjcf(chain: list[Stage], q: np.ndarray, stiffness: np.ndarray, point: np.ndarray) -> str:
    """The arm at one commanded pose q (n,), springs (n,) N m/rad or N/m; point (3,) in the last link."""
    R, here, inner = np.eye(3), np.zeros(3), ""
    bodies: list[tuple[str, str]] = []
    for k, (stage, value) in enumerate(zip(chain, q, strict=True)):
        step = R @ stage.xyz
        for axis, angle in zip(np.eye(3)[::-1], stage.rpy[::-1], strict=True):
            R = R @ turned(axis, float(angle))
        axis = R @ stage.axis
        if stage.slides:
            step = step + axis * value
        else:
            R = R @ turned(stage.axis, float(value))
        kind = "slide" if stage.slides else "hinge"
        own = f'type="{kind}" axis="{words(axis)}" stiffness="{stiffness[k]}" damping="{0.02 * stiffness[k]}"'
        head = f'<body name="l{k}" pos="{words(step)}"><joint {own} armature="100"/>'
        head += f'<inertial pos="{words(R @ stage.centre)}" mass="{stage.mass}" diaginertia="5 5 5"/>'
        bodies.append((head, "</body>"))
        here = here + step
    inner = f'<site name="tip" pos="{words(R @ point)}"/>'
    for head, foot in reversed(bodies):
        inner = head + inner + foot
    options = f'<option timestep="{STEP}" integrator="implicit" gravity="0 0 -9.81"><flag contact="disable"/></option>'
    return f"<mujoco>{options}<worldbody>{inner}</worldbody></mujoco>"


def settle(
    chain: list[Stage], q: np.ndarray, stiffness: np.ndarray, point: np.ndarray, force: np.ndarray
) -> np.ndarray:
    """Position (3,) m of the point after relaxation under gravity and a force fixed in the world."""
    model = mujoco.MjModel.from_xml_string(mjcf(chain, q, stiffness, point))
    return relaxed(model, force, f"l{len(chain) - 1}")
